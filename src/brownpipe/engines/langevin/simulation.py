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

from brownpipe import stages
from brownpipe.engines.batch import RunResult, making_run, most_together, new_batch, report_ended
from brownpipe.engines.compiling import compile_all
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.failures import failures
from brownpipe.engines.friction import bath_of, followed, friction_rate
from brownpipe.engines.initial_state import draw_tracer, noise
from brownpipe.engines.langevin import RATE_RUNS, refuse_unfit, scene_with_disks
from brownpipe.engines.langevin.step import follow, step_weights
from brownpipe.engines.state import Ensemble, Track, together
from brownpipe.errors import RequestError, RunError
from brownpipe.observables import of_tracer
from brownpipe.scene import Scene

MOST_BOXES = 2.0**30  # greatest distance of the free path from the box, in sides of the box


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
    compile_all(partial(follow, np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, 4))))
    ended: dict[int, np.ndarray] = {}  # paths by column
    results, at_once = partial(_results_of, scene, gamma), most_together(batch, len(scene.times))
    for column, seed in enumerate(batch.ensemble.seeds.tolist()):
        with making_run(batch, column):
            ended[column] = _path(scene, mass, seed, weights)
        report_ended(batch, ended, results, at_once)
    report_ended(batch, ended, results)
    return batch.ensemble


def rate_of(scene: Scene, friction: str) -> float:
    """Return gamma [1/time] as `friction.friction_rate` does; for `measured`, after runs of the exact engine."""
    rate_scene = scene_with_disks(scene, {"friction": friction})
    return friction_rate(scene, friction, None if rate_scene is None else _collision_rate(rate_scene))


def _collision_rate(scene: Scene) -> float:
    """Return the tracer's collisions per time [1/time] in RATE_RUNS runs of the exact engine.

    The rate of each run is scaled from the run's own temperature to the scene's: rates are proportional to sqrt(kT).
    """
    with stages.unreported():
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


def _results_of(scene: Scene, gamma: float, paths: Sequence[np.ndarray]) -> list[RunResult]:
    """Return the results of runs from their free paths (T, 2, 2)."""
    free = together(paths)
    failed = (~are_known(scene, free)).astype(np.uint8)
    tracks = folded(scene, free)
    return [
        RunResult(track, None, None, {"friction_rate": gamma, "failed": each})
        for track, each in zip(tracks, failed, strict=True)
    ]


def are_known(scene: Scene, paths: np.ndarray) -> np.ndarray:
    """Return (K,) whether free paths (K, T, 2, 2) are finite and close enough to the box to be folded into it.

    Further away than MOST_BOXES sides the round-off of a position exceeds 2e-7 of the box, and soon an int32 cannot
    count the images.
    """
    low, size = scene.box.accessible(followed(scene).radius)
    with np.errstate(over="ignore", invalid="ignore"):
        near = (size <= 0) | (np.abs(paths[:, :, 0] - low) < MOST_BOXES * size)
    return np.isfinite(paths).all(axis=(1, 2, 3)) & near.all(axis=(1, 2))


def folded(scene: Scene, paths: np.ndarray) -> list[Track]:
    """Return the tracks (M = 1) of free paths (K, T, 2, 2) in the box: wrapped with images, or mirrored at the walls.

    The walls are those of the region that the tracer's centre can reach.
    """
    position, velocity = paths[:, :, None, 0], paths[:, :, None, 1]
    low, size = scene.box.accessible(followed(scene).radius)
    image = np.floor(np.divide(position - low, size, out=np.zeros_like(position), where=size > 0))
    image = np.clip(np.nan_to_num(image), -MOST_BOXES, MOST_BOXES)  # beyond these bounds the run has failed
    if scene.box.periodic:
        inside = np.clip(position - image * size, low, np.nextafter(low + size, low))
        counted = (image - image[:, :1]).astype(np.int32)
        return [Track(*each) for each in zip(inside, velocity, counted, strict=True)]
    mirrored = image % 2 == 1
    inside = position - low - image * size
    inside = np.clip(np.where(mirrored, size - inside, inside), 0.0, np.maximum(size, 0.0))
    return [Track(*each) for each in zip(low + inside, np.where(mirrored, -velocity, velocity), strict=True)]
