"""The initial state of a run, drawn from its seed."""

import math

import numpy as np

from brownpipe.engines import placement
from brownpipe.engines.state import State
from brownpipe.scene import Scene

ROOT_SEED = 2020  # of every stream of random numbers; the year of the note


def draw(scene: Scene, seed: int) -> State:
    """Return the initial state of one run, the same for the same (scene, seed) whatever else is asked for.

    An explicit list of disks is returned as it is. Species get their velocities first, every component normal with
    the scene's standard deviation or with variance kT/m, and then their places (`placement`), the tracer first.
    The total momentum, where it is to be zero, is taken out at t = 0: if there is time to equilibrate, after it.
    The stream is Philox, seeded by (2020, N, seed). Raises RequestError if the disks cannot be placed.
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
        velocity = without_total_momentum(velocity, mass)
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
        return without_total_momentum(velocity, mass)
    return velocity


def without_total_momentum(velocity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return velocities (N, 2) with zero total momentum, relative to the centre of mass."""
    share = np.ldexp(mass, -math.frexp(mass.max(initial=0.0))[1])  # exact; of 1e300 each the sum of masses is infinite
    return velocity - [math.fsum(share * component) / math.fsum(share) for component in velocity.T]
