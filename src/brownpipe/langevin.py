"""The Langevin engine: the tracer alone, its bath replaced by friction and noise.

    dx = v dt,    dv = -gamma v dt + sqrt(2 gamma kT/m) dW        (Langevin 1908; Uhlenbeck & Ornstein 1930)

The step is exact for any length (D. T. Gillespie, Phys. Rev. E 54, 2084 (1996)), so one step leads from sample to
sample: there is no time step and no error of one. Hard walls need none either: the equation and its noise are the same
in a mirror, so a path that a wall reflects is the mirror image of one that goes through it. The free path is followed
and, where a sample is taken, folded into the region that the tracer's centre can reach.

What gamma is and where this means anything: `brownpipe.friction`. Not modelled are the 1/t tail of the velocity
autocorrelation, cages of neighbours, and that walls change the friction near them.

The noise is a stream of its own for each (N, seed). Another sample interval therefore gives other paths of the same
law; nothing else does.
"""

import numpy as np

from brownpipe.batch import Run, enter, request, room_for
from brownpipe.friction import bath_of, followed, friction_rate, refuse_unfit
from brownpipe.kernels import entry_point, one_compiler
from brownpipe.observables import of_tracer
from brownpipe.scene import Scene, SceneError
from brownpipe.state import Ensemble, Track, draw_tracer, noise

MOST_BOXES = 2.0**30  # away from the first one
FLAT = 0.1  # gamma dt below which x - 2 tanh(x/2) is summed as a series: the closed form cancels


def simulate(
    scene: Scene, seeds, record=frozenset({"tracer"}), *, observables=(), average="runs", friction: str = "enskog"
) -> Ensemble:
    """Follow the tracer of the scene once for every seed; `friction` as in `friction.friction_rate`.

    It begins with the velocity that it has in the exact engine, and where the scene puts it, or anywhere in the
    accessible box. If it is free while the scene equilibrates, it moves for that time before t = 0.
    Of `observables` it has those of the tracer alone; the others are left out.
    Raises SceneError where the Langevin equation is not to be used.
    """
    refuse_unfit(scene, friction, record)
    gamma = friction_rate(scene, friction)
    before = scene.equilibrate if scene.tracer_while_equilibrating == "free" else 0.0
    steps = np.diff(scene.times, prepend=-before)
    if not gamma * float(steps.max()) < np.inf:
        raise SceneError(f"{scene.name}: the friction rate {gamma:g} times the duration must be below 1.8e308")
    weights = step_weights(steps, gamma, bath_of(scene).temperature / followed(scene).mass)
    asked = request(scene, record, *of_tracer(observables, average))
    mass, batch = scene.mass, room_for(asked, seeds)
    with one_compiler():
        follow(np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, 4)))
    for column, seed in enumerate(batch.seeds.tolist()):
        path = _path(scene, mass, seed, weights)
        found = {"friction_rate": gamma, "failed": np.uint8(not is_known(scene, path))}
        enter(batch, column, Run(folded(scene, path), None, None, found), asked)
    return batch


def step_weights(dt, gamma: float, square_speed: float) -> np.ndarray:
    """Return (steps, 4) weights of the exact step of length `dt` (steps,); `square_speed` is kT/m, of one component.

    v' = e v + w1 xi and x' = x + w2 (v + v') + w3 eta with independent standard normal xi, eta, where X = gamma dt,
    e = exp(-X), w1^2 = kT/m (1 - e^2), w2 = tanh(X/2)/gamma, w3^2 = 2 kT/(m gamma^2) (X - 2 tanh(X/2)). This is
    Gillespie's pair of correlated numbers, written so that x' is that of the middle of v and v' plus what v and v'
    leave open. Without friction it is x' = x + v dt.
    """
    dt = np.asarray(dt, float)
    x = gamma * dt
    speed = np.sqrt(square_speed)
    spread = speed * np.sqrt(-np.expm1(-2 * x))
    middle = dt / 2 * _tanh_ratio(x / 2)
    return np.stack([np.exp(-x), spread, middle, dt * np.sqrt(2 * _left_open(x)) * speed], axis=-1)


def _tanh_ratio(y):
    """tanh(y) / y, 1 at 0."""
    safe = np.where(y == 0.0, 1.0, y)
    return np.where(y == 0.0, 1.0, np.tanh(safe) / safe)


def _left_open(x):
    """(x - 2 tanh(x/2)) / x^2; below FLAT by the power series of tanh, of which 5 terms are enough."""
    y2 = (np.minimum(x, FLAT) / 2) ** 2
    series = x / 12 * (1 + y2 * (-2 / 5 + y2 * (17 / 105 + y2 * (-62 / 945 + y2 * 1382 / 51975))))
    safe = np.where(x < FLAT, 1.0, x)
    return np.where(x < FLAT, series, (1 - 2 * np.tanh(safe / 2) / safe) / safe)


@entry_point
def follow(path, normal, weights):
    """Continue a path from its first entry: path (T, 2, 2) holds position and velocity, normal (T - 1, 2, 2)."""
    for k in range(len(normal)):
        decay, spread, middle, loose = weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3]
        for c in range(2):
            v = path[k, 1, c]
            after = decay * v + spread * normal[k, 0, c]
            path[k + 1, 1, c] = after
            path[k + 1, 0, c] = path[k, 0, c] + middle * (v + after) + loose * normal[k, 1, c]


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
