"""The units in which the engines compute: sizes, speeds and masses near 1, and the disks in the order of the engine."""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.engines.state import State
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

LARGEST_RATIO = 1e12  # of masses, up to which the light disks are given time for speeds they may reach
SHORTEST_UNIT = 1e-305  # of time: it, its inverse and products with speeds are floating-point numbers


class Frame(NamedTuple):
    """The engine's coordinates: internal = (scene's - origin) / unit. Units are powers of two, so exact."""

    origin: np.ndarray  # (2,) zero if the box holds the zero of the scene's coordinates, else its centre
    length: float
    time: float
    mass: float
    order: np.ndarray  # (N,) the scene's number of each of the engine's disks; much bigger ones come first
    back: np.ndarray  # (N,) the inverse


def power_of_two(value: float) -> float:
    """Return the power of two at or below a positive number; 1 for 0."""
    return math.ldexp(1.0, math.frexp(value)[1] - 1) if value > 0 else 1.0


def frame_of(scene: Scene) -> Frame:
    """Choose units in which sizes, speeds and masses are near 1."""
    box, radius, mass = scene.box, scene.radius, scene.mass
    origin = np.array([0.0 if low <= 0.0 <= high else low + (high - low) / 2 for low, high in (box.x, box.y)])
    common = common_radius(radius) if len(radius) else box.width
    length, speed = power_of_two(2 * common), thermal_speed(scene)
    at_rest = max(length, power_of_two(scene.duration * 2.0**-960))  # a unit in which the duration is a number
    time = length / power_of_two(speed) if speed > 0 else at_rest
    if not SHORTEST_UNIT <= time <= 1 / SHORTEST_UNIT:
        raise RequestError(
            f"{scene.name}: velocities: the thermal speed {speed:.3g} must be from {length * SHORTEST_UNIT:.3g} to "
            f"{length / SHORTEST_UNIT:.3g} for disks of radius {common:.3g}; choose other units"
        )
    order = np.argsort(radius <= common, kind="stable")
    heaviest = mass.max(initial=0.0)
    equal = np.all(mass == heaviest) and heaviest > 0
    unit = float(heaviest) if equal else power_of_two(heaviest)  # equal masses are 1 to the kernels
    return Frame(origin, length, time, unit, order, np.argsort(order))


def thermal_speed(scene: Scene) -> float:
    """Return sqrt(2 kT/m) of the lightest disks if all shared the energy that the scene gives them; 0 at rest."""
    if scene.particles == 0:
        return 0.0
    if scene.velocities is None:
        velocity = np.array([disk.velocity for disk in scene.disks])
        largest = power_of_two(np.abs(velocity).max())
        squares = np.sum((velocity / largest) ** 2, axis=1)
    else:
        given = scene.velocities
        largest = given.standard_deviation if given.temperature is None else math.sqrt(given.temperature)
        squares = 2.0 if given.temperature is None else 2.0 / scene.mass
    ratio = np.minimum(scene.mass / scene.mass.min(), LARGEST_RATIO)
    return largest * math.sqrt(np.mean(ratio * squares))


def motion_of(state: State, frame: Frame) -> np.ndarray:
    """Return positions and velocities (N, 4) in the engine's units and order."""
    position = (state.position[frame.order] - frame.origin) / frame.length
    return np.hstack([position, state.velocity[frame.order] / (frame.length / frame.time)])


def common_radius(radius: np.ndarray) -> float:
    """Return the radius that cells are sized by: the largest, leaving out the few that are much larger than the rest.

    Few is at most sqrt(N), much larger is more than half as large again as the largest that stays.
    """
    ordered = np.sort(radius)
    for few in range(math.isqrt(len(ordered)), 0, -1):
        if len(ordered) > few and ordered[-few] > 1.5 * ordered[-few - 1]:
            return float(ordered[-few - 1])
    return float(ordered[-1])
