"""Made-up ensembles with known statistics, as trajectory records: free diffusion instead of
colliding disks.
"""

import numpy as np

from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble, Track
from brownpipe.scene import parse_scene
from brownpipe.storage.trajectories import Trajectories, write_trajectories

DIFFUSION = 0.25


def make_scene(
    name="plain", particles=20, duration=1.0, boundary="reflecting", velocities=None, **more
):
    """A scene of some disks in the note's box; 21 sample times a unit of time."""
    mapping = {
        "box": {"x": [-3.0, 3.0], "y": [-3.0, 3.0], "boundary": boundary},
        "particles": particles,
        "disks": {
            "tracer": {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]},
            "species": [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}],
        },
        "velocities": velocities or {"standard_deviation": 2.0},
        "duration": duration,
        "sample_interval": 0.05,
    }
    return parse_scene(mapping | more, f"{name}.yaml")


def walk(rng, times, runs, diffusion=DIFFUSION):
    """Positions (T, runs, 2) of free diffusers that start at the origin, with one D or that along x
    and along y.
    """
    length = np.sqrt(2 * np.diff(times, prepend=0.0))[:, None, None] * np.sqrt(diffusion)
    return (rng.standard_normal((len(times), runs, 2)) * length).cumsum(axis=0)


def make_runs(scene, seeds, failed=(), diffusion=DIFFUSION):
    """The batch `seeds` of a scene. A run depends on its seed alone; failed runs end very far
    away.
    """
    seeds = np.asarray(seeds)
    numbers = [np.random.default_rng([scene.particles, seed]) for seed in seeds]
    position = np.concatenate([walk(rng, scene.times, 1, diffusion) for rng in numbers], axis=1)
    bad = np.isin(seeds, failed)
    position[-1, bad] += 1e6
    observables = {
        "pair_collisions": np.array([rng.poisson(80) for rng in numbers]),
        "wall_collisions": np.array([rng.poisson(30) for rng in numbers]),
        "tracer_collisions": np.array([rng.poisson(9) for rng in numbers]),
        "energy_drift": np.array([rng.normal(0, 3e-15) for rng in numbers]),
        "worst_overlap": np.array([abs(rng.normal(0, 3e-15)) for rng in numbers]),
        "momentum_residual": np.array([abs(rng.normal(0, 3e-15)) for rng in numbers]),
        "failed": bad.astype(np.uint8),
    }
    ensemble = Ensemble(
        seeds.astype(np.int64),
        scene.times,
        Track(position, None, None),
        observables,
        {},
        {},
        {},
        {},
    )
    return Trajectories(scene, Engine("exact"), ensemble)


def write(folder, trajectories):
    """The trajectory file of a batch; its path."""
    scene = trajectories.scene
    seeds = trajectories.ensemble.seeds
    path = (
        folder
        / f"{scene.name}-{scene.particles}-{trajectories.engine.name}-{seeds[0]}-{seeds[-1]}.h5"
    )
    write_trajectories(path, *trajectories[:3])
    return path


def study(folder, names=("hot", "thermal"), counts=(10, 20), runs=60, batch=20, failed=()):
    """Trajectory files of a small study, in batches; their paths."""
    batches = [range(first, min(first + batch, runs)) for first in range(0, runs, batch)]
    scenes = [make_scene(name, particles) for name in names for particles in counts]
    return [write(folder, make_runs(scene, seeds, failed)) for scene in scenes for seeds in batches]
