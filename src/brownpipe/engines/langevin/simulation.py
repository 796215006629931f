"""The Langevin engine: the tracer alone, its bath replaced by friction and noise.

    dx = v dt,    dv = -gamma v dt + sqrt(2 gamma kT/m) dW        (Langevin 1908; Uhlenbeck & Ornstein 1930)

The step is exact for any length (D. T. Gillespie, Phys. Rev. E 54, 2084 (1996)), so one step leads from sample to
sample: there is no time step and no error of one. Hard walls need none either: the equation and its noise are the same
in a mirror, so a path that a wall reflects is the mirror image of one that goes through it. The free path is followed
and, where a sample is taken, folded into the region that the tracer's centre can reach.

What gamma is and where this means anything: `engines.friction`. Not modelled are the 1/t tail of the velocity
autocorrelation, cages of neighbours, and that walls change the friction near them.

The noise is a stream of its own for each (N, seed). Another sample interval therefore gives other paths of the same
law; nothing else does.
"""

import numpy as np

from brownpipe.engines.batch import RunResult, add_run, new_batch
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.friction import bath_of, followed, friction_rate
from brownpipe.engines.initial_state import draw_tracer, noise
from brownpipe.engines.kernels import one_compiler
from brownpipe.engines.langevin import RUNS, measuring_runs, refuse_unfit
from brownpipe.engines.langevin.step import follow, step_weights
from brownpipe.engines.state import Ensemble, Track
from brownpipe.errors import RequestError, RunError
from brownpipe.observables import of_tracer
from brownpipe.scene import Scene

MOST_BOXES = 2.0**30  # away from the first one


def simulate(
    scene: Scene, seeds, record=frozenset({"tracer"}), *, observables=(), average="runs", friction: str = "enskog"
) -> Ensemble:
    """Follow the tracer of the scene once for every seed; `friction` as in `friction.friction_rate`.

    It begins with the velocity that it has in the exact engine, and where the scene puts it, or anywhere in the
    accessible box. If it is free while the scene equilibrates, it moves for that time before t = 0.
    Of `observables` it has those of the tracer alone; the others are left out.
    Raises RequestError where the Langevin equation is not to be used.
    """
    refuse_unfit(scene, {"friction": friction}, record)
    gamma = rate_of(scene, friction)
    before = scene.equilibrate if scene.tracer_while_equilibrating == "free" else 0.0
    steps = np.diff(scene.times, prepend=-before)
    if not gamma * float(steps.max()) < np.inf:
        raise RequestError(f"{scene.name}: the friction rate {gamma:g} times the duration must be below 1.8e308")
    weights = step_weights(steps, gamma, bath_of(scene).temperature / followed(scene).mass)
    batch = new_batch(scene, seeds, record, *of_tracer(observables, average))
    mass = scene.mass
    with one_compiler():
        follow(np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, 4)))
    for column, seed in enumerate(batch.ensemble.seeds.tolist()):
        path = _path(scene, mass, seed, weights)
        found = {"friction_rate": gamma, "failed": np.uint8(not is_known(scene, path))}
        add_run(batch, column, RunResult(folded(scene, path), None, None, found))
    return batch.ensemble


def rate_of(scene: Scene, friction: str) -> float:
    """Return gamma [1/time] as `friction.friction_rate`, measured by runs of the exact engine if that is asked for."""
    measuring = measuring_runs(scene) if friction == "measured" else None
    return friction_rate(scene, friction, None if measuring is None else _collision_rate(measuring))


def _collision_rate(scene: Scene) -> float:
    """Return the collisions of the tracer per time [1/time] in the runs that are made to measure it."""
    found = exact.simulate(scene, range(RUNS), frozenset({"none"})).observables
    if found["failed"].any():
        raise RunError(f"{scene.name}: the runs that measure the friction failed their health check")
    heat = found["kinetic_energy"] / (scene.particles * scene.velocities.temperature)  # of a run; rates go as its root
    return float(np.sum(found["tracer_collisions"] / np.sqrt(heat)) / (RUNS * scene.duration))


def _path(scene: Scene, mass: np.ndarray, seed: int, weights: np.ndarray) -> np.ndarray:
    """Return position and velocity (T, 2, 2) at the sample times, as if there were no walls."""
    stream = noise(scene, seed)
    path = np.empty((len(weights) + 1, 2, 2))
    path[0] = draw_tracer(scene, mass, seed, stream)
    follow(path, stream.standard_normal((len(weights), 2, 2)), weights)
    return path[1:]  # the first step is the time to equilibrate


def is_known(scene: Scene, path: np.ndarray) -> bool:
    """Whether it is known where in the box a path (T, 2, 2) leads: it stays within MOST_BOXES of the first one.

    Further away round-off is more than 2e-7 of the box, and soon an int32 cannot count the images.
    """
    box, margin = scene.box, 0.0 if scene.box.periodic else followed(scene).radius
    low, size = np.array(box.origin) + margin, np.array((box.width, box.height)) - 2 * margin
    with np.errstate(over="ignore", invalid="ignore"):
        away = np.abs(path[:, 0] - low)
        return bool(np.isfinite(path).all() and np.all((size <= 0) | (away < MOST_BOXES * size)))


def folded(scene: Scene, path: np.ndarray) -> Track:
    """Return the track, M = 1, in the box: wrapped with images, or mirrored at the accessible walls."""
    box, position, velocity = scene.box, path[:, None, 0], path[:, None, 1]
    margin = 0.0 if box.periodic else followed(scene).radius
    low, size = np.array(box.origin) + margin, np.array((box.width, box.height)) - 2 * margin
    image = np.floor(np.divide(position - low, size, out=np.zeros_like(position), where=size > 0))
    image = np.clip(np.nan_to_num(image), -MOST_BOXES, MOST_BOXES)  # beyond, the run has failed
    if box.periodic:
        inside = np.clip(position - image * size, low, np.nextafter(low + size, low))
        return Track(inside, velocity, (image - image[0]).astype(np.int32))
    turned, inside = image % 2 == 1, position - low - image * size
    inside = np.clip(np.where(turned, size - inside, inside), 0.0, np.maximum(size, 0.0))
    return Track(low + inside, np.where(turned, -velocity, velocity))
