"""Runs of the Langevin engine: the tracer alone, friction and noise in place of its bath.

    dx = v dt,    dv = -gamma v dt + sqrt(2 gamma kT/m) dW        (G. E. Uhlenbeck & L. S. Ornstein, 1930)

The step is exact for any length (D. T. Gillespie, Phys. Rev. E 54, 2084 (1996)), so one step leads from sample to
sample: there is no time-step error. Walls need no extra step: equation and noise are invariant under reflection, and a
reflected path is the mirror image of a path through the wall. The free path is computed and, at each sample, folded
into the region that the tracer's centre can reach. docs/theory.md, section 4.

gamma is explained in `engines.friction`, the limits of the model in `engines.langevin`. Walls are assumed not to change
the friction near them. The noise is one random stream for each (N, seed). With other sample times the same seed
gives another path, of the same distribution.
"""

from collections.abc import Collection, Sequence
from functools import partial

import numpy as np

from brownpipe import progress
from brownpipe.engines.compiling import compile_all
from brownpipe.engines.ensemble import Ensemble, RunResult, failures, make_runs, new_batch
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.friction import bath_of, followed, friction_rate
from brownpipe.engines.initial_state import draw_tracer, noise
from brownpipe.engines.langevin import RATE_RUNS, refuse_unfit, scene_with_disks
from brownpipe.engines.langevin.step import fold, follow, step_weights
from brownpipe.errors import RequestError, RunError
from brownpipe.observables import of_tracer
from brownpipe.observables.tracks import Track
from brownpipe.scene import Scene


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    *,
    observables: Collection[str] = (),
    average: str = "runs",
    friction: str = "enskog",
) -> Ensemble:
    """Follow the tracer of the scene once for every seed; `friction` as in `friction.friction_rate`.

    A run starts with the tracer's velocity of the same seed in the exact engine, at the position that the scene gives
    or at a uniform position in the accessible box. If the tracer is free while the scene equilibrates, it first moves
    for that time. Of `observables`, those that need other disks are left out.
    Raises RequestError for a scene or record that the engine refuses, RunError if measuring the friction fails.
    """
    refuse_unfit(scene, {"friction": friction}, record)
    gamma = rate_of(scene, friction)
    before = scene.equilibrate.time if scene.equilibrate.tracer == "free" else 0.0
    steps = np.diff(scene.times, prepend=-before)
    if not gamma * float(steps.max()) < np.inf:
        raise RequestError(f"{scene.name}: the friction rate {gamma:g} times the duration must be below 1.8e308")
    weights = step_weights(steps, gamma, bath_of(scene).temperature / followed(scene).mass)
    batch = new_batch(scene, seeds, record, *of_tracer(observables, average))
    mass = scene.mass
    no_path = np.empty((0, 2, 2))
    compile_all(partial(follow, no_path, no_path, weights[:0]), partial(folded, scene, no_path))

    def run(column: int) -> RunResult:
        path = _path(scene, mass, int(batch.ensemble.seeds[column]), weights)
        track, known = folded(scene, path)
        return RunResult(track, None, None, {"friction_rate": gamma, "failed": np.uint8(not known)})

    return make_runs(batch, run)


def rate_of(scene: Scene, friction: str) -> float:
    """Return gamma [1/time] as `friction.friction_rate` does; for `measured`, after runs of the exact engine."""
    rate_scene = scene_with_disks(scene, {"friction": friction})
    return friction_rate(scene, friction, None if rate_scene is None else _collision_rate(rate_scene))


def _collision_rate(scene: Scene) -> float:
    """Return the tracer's collisions per time [1/time] in RATE_RUNS runs of the exact engine.

    The rate of each run is scaled from the run's own temperature to the scene's: rates are proportional to sqrt(kT).
    """
    with progress.unreported():
        runs = exact.simulate(scene, range(RATE_RUNS), frozenset({"none"}))
    if failed := failures(runs):
        raise RunError(f"{scene.name}: of the runs that measure the friction {failed}; must be friction: enskog")
    reports = runs.observables
    heat = reports["kinetic_energy"] / (scene.particles * scene.velocities.temperature)  # kT of a run / kT of the scene
    return float(np.sum(reports["tracer_collisions"] / np.sqrt(heat)) / (RATE_RUNS * scene.duration))


def _path(scene: Scene, mass: np.ndarray, seed: int, weights: np.ndarray) -> np.ndarray:
    """Return positions and velocities (T, 2, 2) at the sample times as if there were no walls."""
    stream = noise(scene, seed)
    path = np.empty((len(weights) + 1, 2, 2))
    path[0] = draw_tracer(scene, mass, seed, stream)
    follow(path, stream.standard_normal((len(weights), 2, 2)), weights)
    return path[1:]  # the first step is the time to equilibrate


def folded(scene: Scene, path: np.ndarray) -> tuple[Track, bool]:
    """Return the track (M = 1) of a free path (T, 2, 2) in the box, and whether the path is known, by `step.fold`."""
    region = scene.box.accessible(followed(scene).radius)
    position, velocity = np.empty((2, len(path), 1, 2))
    image = np.empty((len(path), 1, 2), np.int32) if scene.box.periodic else None
    known = fold(path, *region, position, velocity, image)
    return Track(position, velocity, image), known
