"""The initial state of a run, drawn from its seed before any equilibration."""

import math

import numpy as np

from brownpipe.engines import placement
from brownpipe.engines.units import State
from brownpipe.scene import Scene

ROOT_SEED = 2020  # of all streams of random numbers; the year of Harrison's note


def draw(scene: Scene, seed: int) -> State:
    """Return the initial state of one run. It depends on the scene and the seed alone.

    An explicit list of disks is returned unchanged. For species, velocities are drawn first, each component normal
    with the scene's standard deviation or with variance kT/m, and then positions (`placement`), the tracer first.
    `zero_momentum` is applied here only if the scene has no time to equilibrate, else at the end of that time.
    The random numbers are a Philox stream, seeded by (ROOT_SEED, N, seed). Raises RequestError if the disks cannot be
    placed.
    """
    radius, mass = scene.radius, scene.mass
    if scene.velocities is None:
        position = np.array([disk.position for disk in scene.listed]).reshape(-1, 2)
        velocity = np.array([disk.velocity for disk in scene.listed]).reshape(-1, 2)
        return State(position, velocity, radius, mass)
    stream = _stream(ROOT_SEED, scene, seed)
    velocity = _velocities(scene, mass, stream)
    return State(placement.place(scene, stream), velocity, radius, mass)


def draw_tracer(
    scene: Scene, mass: np.ndarray, seed: int, stream: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return initial position (2,) and velocity (2,) of disk 0 alone; `mass` (N,) is the scene's.

    The velocity is that of `draw` for the same seed, where the tracer's is drawn first. With `zero_momentum` those of
    the other disks are drawn, too, to subtract the velocity of the centre of mass. If the scene gives no position of
    the tracer, it is drawn from `stream`, uniform over the accessible box.
    """
    zero_momentum = scene.velocities.zero_momentum
    velocity = _velocities(scene, mass if zero_momentum else mass[:1], _stream(ROOT_SEED, scene, seed))
    if zero_momentum and scene.equilibrate.time > 0:
        velocity = without_total_momentum(velocity, mass)
    tracer = next(species for species in scene.species if species.count)
    if tracer.position is not None:
        return np.array(tracer.position), velocity[0]
    low, size = scene.box.accessible(tracer.radius)
    return low + np.maximum(size, 0.0) * stream.random(2), velocity[0]


def noise(scene: Scene, seed: int) -> np.random.Generator:
    """Return the stream of random numbers for the noise of one run, independent of that of `draw`."""
    return _stream((ROOT_SEED, 1), scene, seed)


def _stream(root: int | tuple[int, ...], scene: Scene, seed: int) -> np.random.Generator:
    """Return the Philox stream of (root, N, seed)."""
    sequence = np.random.SeedSequence(root, spawn_key=(scene.particles, seed))
    return np.random.Generator(np.random.Philox(sequence))


def _velocities(scene: Scene, mass: np.ndarray, stream: np.random.Generator) -> np.ndarray:
    """Return velocities (n, 2), with normal components as the scene says, of disks of the given masses (n,)."""
    distribution = scene.velocities
    normal = stream.standard_normal((len(mass), 2))
    if distribution.temperature is None:
        velocity = distribution.standard_deviation * normal
    else:
        velocity = np.sqrt(distribution.temperature / mass)[:, None] * normal
    if distribution.zero_momentum and len(mass) and scene.equilibrate.time == 0:
        return without_total_momentum(velocity, mass)
    return velocity


def without_total_momentum(velocity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return velocities (N, 2) relative to the centre of mass: their total momentum is zero."""
    share = np.ldexp(mass, -math.frexp(mass.max(initial=0.0))[1])  # exact, and the sum of the masses cannot overflow
    return velocity - [math.fsum(share * component) / math.fsum(share) for component in velocity.T]
