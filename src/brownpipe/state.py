"""Where the disks are: the initial state of a run, and the records that engines hand back."""

import math
from typing import NamedTuple

import numpy as np

from brownpipe import placement
from brownpipe.scene import Scene

HEALTH_BOUND = 1e-9  # energy drift, overlap and momentum residual beyond which a run has failed; round-off is far below
ROOT_SEED = 2020  # of every stream of random numbers; the year of the note


class State(NamedTuple):
    """All disks at one time."""

    position: np.ndarray  # (N, 2) centres [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    radius: np.ndarray  # (N,) [length]
    mass: np.ndarray  # (N,)


class Track(NamedTuple):
    """Where M disks were at T sample times."""

    position: np.ndarray  # (T, M, 2) centres, inside the box [length]
    velocity: np.ndarray | None = None  # (T, M, 2)
    image: np.ndarray | None = None  # (T, M, 2) int32, periodic boxes: unwrapped = position + image * (width, height)


class Events(NamedTuple):
    """Every collision of one run, in order."""

    time: np.ndarray  # (E,)
    a: np.ndarray  # (E,) int32, the disk
    b: np.ndarray  # (E,) int32, the other disk, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2), given to a [mass length/time]


class Ensemble(NamedTuple):
    """What an engine returns for a batch of S seeds."""

    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) sample times
    tracer: Track | None  # disk 0 of every run, M = S
    observables: dict[str, np.ndarray]  # name -> (S, ...): one number or array per run
    whole: dict[int, Track]  # seed -> all disks of that run, M = N, where asked for
    events: dict[int, Events]  # seed -> its collisions, where asked for
    average: str = "runs"  # what displacements and autocorrelations among the observables are averages over


def draw(scene: Scene, seed: int) -> State:
    """Return the initial state of one run, the same for the same (scene, seed) whatever else is asked for.

    An explicit list of disks is returned as it is. Species get their velocities first, every component normal with
    the scene's standard deviation or with variance kT/m, and then their places (`placement`), the tracer first.
    The total momentum, where it is to be zero, is taken out at t = 0: if there is time to equilibrate, after it.
    The stream is Philox, seeded by (2020, N, seed). Raises SceneError if the disks cannot be placed.
    """
    radius, mass = scene.radius, scene.mass
    if scene.velocities is None:
        position = np.array([disk.position for disk in scene.disks]).reshape(-1, 2)
        velocity = np.array([disk.velocity for disk in scene.disks]).reshape(-1, 2)
        return State(position, velocity, radius, mass)
    stream = _stream(ROOT_SEED, scene, seed)
    velocity = _velocities(scene, mass, stream)
    return State(placement.place(scene, radius, stream), velocity, radius, mass)


def draw_tracer(scene: Scene, mass: np.ndarray, seed: int, stream: np.random.Generator) -> tuple:
    """Return position and velocity of disk 0 alone at the beginning of a run; `mass` is the scene's, (N,).

    The velocity is that of `draw`, whose numbers begin with it (without total momentum, if that is to be zero; then all
    velocities are drawn). A tracer without a place gets one from `stream`, anywhere in the accessible box.
    """
    still = scene.velocities.zero_momentum
    velocity = _velocities(scene, mass if still else mass[:1], _stream(ROOT_SEED, scene, seed))
    if still and scene.equilibrate > 0:
        velocity = at_rest_on_the_whole(velocity, mass)
    first = next(one for one in scene.species if one.count)
    if first.position is not None:
        return first.position, velocity[0]
    box, margin = scene.box, 0.0 if scene.box.periodic else first.radius
    size = np.maximum(np.array((box.width, box.height)) - 2 * margin, 0.0)
    return np.array(box.origin) + margin + size * stream.random(2), velocity[0]


def noise(scene: Scene, seed: int) -> np.random.Generator:
    """Return the random numbers that belong to a run from its beginning on, for engines with noise."""
    return _stream((ROOT_SEED, 1), scene, seed)


def _stream(root, scene: Scene, seed: int) -> np.random.Generator:
    numbers = np.random.SeedSequence(root, spawn_key=(scene.particles, seed))
    return np.random.Generator(np.random.Philox(numbers))


def _velocities(scene: Scene, mass: np.ndarray, stream: np.random.Generator) -> np.ndarray:
    given = scene.velocities
    normal = stream.standard_normal((len(mass), 2))
    if given.temperature is None:
        velocity = given.standard_deviation * normal
    else:
        velocity = np.sqrt(given.temperature / mass)[:, None] * normal
    if given.zero_momentum and len(mass) and scene.equilibrate == 0:
        return at_rest_on_the_whole(velocity, mass)
    return velocity


def at_rest_on_the_whole(velocity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return velocities (N, 2) with zero total momentum, relative to the centre of mass."""
    share = np.ldexp(mass, -math.frexp(mass.max(initial=0.0))[1])  # exact; of 1e300 each the sum of masses is infinite
    return velocity - [math.fsum(share * component) / math.fsum(share) for component in velocity.T]
