"""Runs of the Langevin engine: the tracer alone, friction and noise in place of its bath.

    dx = v dt,    dv = -gamma v dt + sqrt(2 gamma kT/m) dW        (G. E. Uhlenbeck & L. S. Ornstein,
    1930)

Where the total momentum stays zero, the bath recoils: friction acts on the velocity relative to the
bath, v/f, with f of `motion.bath_share`. The rate is then gamma/f and <v^2> of equilibrium 2 f
kT/m; the noise is the same.

The step is exact for any length (D. T. Gillespie, Phys. Rev. E 54, 2084 (1996)), so one step leads
from sample to sample: there is no time-step error. Walls need no extra step: equation and noise are
invariant under reflection, and a reflected path is the mirror image of a path through the wall. The
free path is computed and, at each sample, folded into the region that the tracer's centre can
reach. docs/theory.md, section 4.

gamma is explained in `engines.friction`, the limits of the model in `engines.langevin`. Walls are
assumed not to change the friction near them. The noise is one random stream for each (N, seed).
With other sample times the same seed gives another path, of the same distribution.
"""

import math
from collections.abc import Collection, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import progress
from brownpipe.engines.compiled.kernels import compile_all, entry_point
from brownpipe.engines.ensemble import Ensemble, failures, make_runs, new_batch
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.friction import (
    bath_of,
    friction_rate,
    rate_at_temperature,
)
from brownpipe.engines.langevin import RATE_RUNS, Friction, Settings, refuse_unfit, scene_of_rate
from brownpipe.engines.start.initial_state import draw_tracer, noise_stream
from brownpipe.errors import RequestError, RunError
from brownpipe.observables import tracer_observables
from brownpipe.observables.trajectory import Run, Track
from brownpipe.scene import Scene, motion

FLAT = 0.1  # gamma dt below which x - 2 tanh(x/2) cancels and is summed as a power series
MOST_BOXES = 2.0**30  # greatest distance of the free path from the box, in sides of the box


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    *,
    observables: Collection[str] = (),
    average: str = "runs",
    friction: Friction = "enskog",
) -> Ensemble:
    """Follow the tracer of the scene once for every seed; `friction` as in
    `friction.friction_rate`.

    A run starts with the tracer's velocity of the same seed in the exact engine, at the position
    that the scene gives or at a uniform position in the accessible box. If the tracer is free while
    the scene equilibrates, it first moves for that time. Of `observables`, those that need other
    disks are left out.
    Raises RequestError for a scene or record that the engine refuses, RunError if measuring the
    friction fails.
    """
    refuse_unfit(scene, Settings(friction), record)
    gamma = rate_of(scene, friction)
    before = scene.equilibrate.time if scene.equilibrate.tracer == "free" else 0.0
    steps = np.diff(scene.times, prepend=-before)
    if not gamma * float(steps.max()) < np.inf:
        raise RequestError(
            f"{scene.name}: the friction rate {gamma:g} times the duration must be below 1.8e308"
        )
    mass = float(scene.mass[0])
    square_speed = motion.bath_share(scene) * bath_of(scene).temperature / mass
    weights = step_weights(steps, gamma, square_speed)
    measured = tracer_observables(observables)
    batch = new_batch(scene, seeds, record, measured, average if measured else "runs")
    no_path = np.empty((0, 2, 2))
    compile_all(partial(follow, no_path, no_path, weights[:0]), partial(folded, scene, no_path))

    def run(column: int) -> Run:
        seed = int(batch.ensemble.seeds[column])
        stream = noise_stream(scene, seed)
        path = np.empty((len(weights) + 1, 2, 2))  # as if there were no walls
        path[0] = draw_tracer(scene, seed, stream)
        follow(path, stream.standard_normal((len(weights), 2, 2)), weights)
        track, known = folded(scene, path[1:])  # the first step is the time to equilibrate
        report: dict[str, ArrayLike] = {"friction_rate": gamma, "failed": np.uint8(not known)}
        return Run(track, None, observables=report)

    return make_runs(batch, run)


def rate_of(scene: Scene, friction: str) -> float:
    """Return the rate gamma/f [1/time] at which the velocity decays; for `measured`, after runs of
    the exact engine.
    """
    rate_scene = scene_of_rate(scene, friction)
    measured = None if rate_scene is None else _collision_rate(rate_scene)
    gamma = friction_rate(scene, friction, measured)
    return gamma / motion.bath_share(scene)


def _collision_rate(scene: Scene) -> float:
    """Return the tracer's collisions per time [1/time] in RATE_RUNS runs of the exact engine.

    The rate of each run is scaled from the run's own temperature to the scene's.
    """
    with progress.unreported():
        runs = exact.simulate(scene, range(RATE_RUNS), frozenset({"none"}))
    if failed := failures(runs):
        raise RunError(
            f"{scene.name}: of the runs that measure the friction {failed}; must be friction: "
            "enskog"
        )
    reports = runs.observables
    kt = reports["kinetic_energy"] / motion.moving_disks(scene)  # of each run
    rate = reports["tracer_collisions"] / scene.duration
    return float(rate_at_temperature(scene, rate, kt).mean())


def folded(scene: Scene, path: np.ndarray) -> tuple[Track, bool]:
    """Return the track (M = 1) of a free path (T, 2, 2) in the box, and whether it could be
    computed (`fold`).
    """
    region = scene.box.accessible(float(scene.radius[0]))
    position, velocity = np.empty((2, len(path), 1, 2))
    image = np.empty((len(path), 1, 2), np.int32) if scene.box.has_images else None
    known = fold(path, *region, position, velocity, image)
    return Track(position, velocity, image), known


# -- the exact step, of any length: D. T. Gillespie, Phys. Rev. E 54, 2084 (1996) ------------------


def step_weights(dt: np.ndarray, gamma: float, square_speed: float) -> np.ndarray:
    """Return the weights (steps, 4) e, w1, w2, w3 of exact steps of lengths `dt` (steps,) [time].

    `gamma` is the friction rate [1/time], `square_speed` the variance kT/m of a velocity component
    [length^2/time^2].

    v' = e v + w1 xi and x' = x + w2 (v + v') + w3 eta with independent standard normal xi, eta,
    where X = gamma dt, e = exp(-X), w1^2 = kT/m (1 - e^2), w2 = tanh(X/2)/gamma, w3^2 = 2 kT/(m
    gamma^2) (X - 2 tanh(X/2)). This is equivalent to Gillespie's pair of correlated random numbers:
    given v and v', the displacement x' - x is normal with mean w2 (v + v') and standard deviation
    w3. Without friction x' = x + v dt. docs/theory.md, section 4.
    """
    dt = np.asarray(dt, float)
    x = gamma * dt
    speed = np.sqrt(square_speed)
    w1 = speed * np.sqrt(-np.expm1(-2 * x))
    w2 = dt / 2 * _tanh_ratio(x / 2)
    w3 = dt * np.sqrt(2 * _undetermined(x)) * speed
    return np.stack([np.exp(-x), w1, w2, w3], axis=-1)


def _tanh_ratio(y: np.ndarray) -> np.ndarray:
    """Return tanh(y)/y, 1 at y = 0."""
    safe = np.where(y == 0.0, 1.0, y)
    return np.where(y == 0.0, 1.0, np.tanh(safe) / safe)


def _undetermined(x: np.ndarray) -> np.ndarray:
    """Return (x - 2 tanh(x/2))/x^2; below FLAT by five terms of the power series of tanh, exact to
    round-off.
    """
    y2 = (np.minimum(x, FLAT) / 2) ** 2
    factor = y2 * (17 / 105 + y2 * (-62 / 945 + y2 * 1382 / 51975))
    series = x / 12 * (1 + y2 * (-2 / 5 + factor))
    safe = np.where(x < FLAT, 1.0, x)
    return np.where(x < FLAT, series, (1 - 2 * np.tanh(safe / 2) / safe) / safe)


@entry_point
def follow(path: np.ndarray, normal: np.ndarray, weights: np.ndarray) -> None:
    """Continue a path from its first entry, in place.

    path (T, 2, 2) holds positions and velocities; normal (T - 1, 2, 2) standard normal numbers xi
    and eta for each step and coordinate; weights (T - 1, 4) is from `step_weights`.
    """
    for k in range(len(normal)):
        decay, w1, w2, w3 = weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3]
        for c in range(2):
            v = path[k, 1, c]
            next_v = decay * v + w1 * normal[k, 0, c]
            path[k + 1, 1, c] = next_v
            path[k + 1, 0, c] = path[k, 0, c] + w2 * (v + next_v) + w3 * normal[k, 1, c]


@entry_point
def fold(
    path: np.ndarray,
    low: np.ndarray,
    size: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    image: np.ndarray | None,
) -> bool:
    """Fold a free path (T, 2, 2) into a region from `low` (2,) of a `size` (2,): the one that the
    centre can reach.

    It is written to `position` and `velocity` (T, 1, 2): wrapped, with an `image` (T, 1, 2) int32
    counted from the first sample on, or without one mirrored at the walls. Return whether the path
    is finite and close enough to the
    box: further away than MOST_BOXES sides the round-off of a position exceeds 2e-7 of the box, and
    soon an int32 cannot count the images.
    """
    known = True
    for c in range(2):
        furthest, high = MOST_BOXES * size[c], np.nextafter(low[c] + size[c], low[c])
        first = 0.0
        for t in range(len(path)):
            x, v, boxes = path[t, 0, c], path[t, 1, c], 0.0
            known &= math.isfinite(x) and math.isfinite(v)
            if size[c] > 0.0:
                known &= abs(x - low[c]) < furthest
                boxes = np.floor((x - low[c]) / size[c])
                boxes = min(max(boxes, -MOST_BOXES), MOST_BOXES) if math.isfinite(boxes) else 0.0
            if image is not None:
                first = boxes if t == 0 else first
                image[t, 0, c] = int(boxes - first)
                x = min(max(x - boxes * size[c], low[c]), high)
            else:
                x = x - low[c] - boxes * size[c]
                if boxes % 2.0 == 1.0:
                    x, v = size[c] - x, -v
                x = low[c] + min(max(x, 0.0), max(size[c], 0.0))
            position[t, 0, c], velocity[t, 0, c] = x, v
    return known
