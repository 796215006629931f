"""The state of all disks, and the units and the order of the disks in which engines that move all
disks compute.

Sizes, speeds and masses are near 1 in these units, so that their squares do not over- or underflow.
The units of length and time are powers of two, so that conversion by them is exact.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import Scene, motion

# of a mass to the smallest one; `rms_speed` treats heavier disks as if they had this ratio
LARGEST_RATIO = 1e12
# ratio of masses above which a heavy disk does not soon share its energy with light ones
SLOW_TO_COOL = 100.0
# the smallest floating-point number with all its digits
SMALLEST_NORMAL = float(np.finfo(float).smallest_normal)
# of time: the unit, its inverse and its products with speeds are normal floating-point numbers
SHORTEST_UNIT = 1e-305
# The longest path in a block of time of the exact engine, in contact distances, of a disk at rms
# speed. Times are counted from the start of the block: at its end, round-off of the time moves such
# a disk by 1e-13 contact distances. Where cells are wider, it is the width of a cell: round-off of
# positions is larger than that.
PATH_PER_BLOCK = 1024.0


class State(NamedTuple):
    """All disks at one time, in the scene's units and order; the tracer is disk 0."""

    position: np.ndarray  # (N, 2) centres [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    radius: np.ndarray  # (N,) [length]
    mass: np.ndarray  # (N,) [mass]


class Frame(NamedTuple):
    """The engine's units and order of disks: engine's coordinate = (scene's coordinate - origin) /
    length.
    """

    # (2,) [length]; per axis 0 if the box contains coordinate 0, else the centre of the box
    origin: np.ndarray
    length: float  # engine's unit of length [length], a power of two
    time: float  # engine's unit of time [time], a power of two
    speed: float  # length / time, a power of two
    mass: float  # engine's unit of mass; if all masses are equal it is this mass
    # (N,) int64, number in the scene of each of the engine's disks; much bigger disks come first
    order: np.ndarray
    back: np.ndarray  # (N,) int64, the inverse: number in the engine of each of the scene's disks


def power_of_two(value: float) -> float:
    """Return the power of two at or below a positive number; 1 for 0."""
    return math.ldexp(1.0, math.frexp(value)[1] - 1) if value > 0 else 1.0


def engine_frame(scene: Scene) -> Frame:
    """Choose the engine's units for a scene: sizes, speeds and masses are near 1 in them.

    Raises RequestError if the disks are so fast or slow that no unit of time is a normal
    floating-point number.
    """
    box = scene.box
    radius = scene.radius
    origin = np.array([_origin_of_axis(*box.x), _origin_of_axis(*box.y)])
    common = common_radius(radius) if len(radius) else box.width
    length = power_of_two(2 * common)
    speed = rms_speed(scene)
    # in this unit the duration does not overflow
    time_at_rest = max(length, power_of_two(scene.duration * 2.0**-960))
    time = length / power_of_two(speed) if speed > 0 else time_at_rest
    if not SHORTEST_UNIT <= time <= 1 / SHORTEST_UNIT:
        raise RequestError(
            f"{scene.name}: velocities: the rms speed {speed:.3g} must be from "
            f"{length * SHORTEST_UNIT:.3g} to {length / SHORTEST_UNIT:.3g} for disks of "
            f"radius {common:.3g}; choose other units"
        )
    order = np.argsort(radius <= common, kind="stable")
    heaviest = scene.mass.max(initial=0.0)
    are_equal = np.all(scene.mass == heaviest) and heaviest > 0
    # equal masses are 1 to the kernels
    mass = float(heaviest) if are_equal else power_of_two(heaviest)
    return Frame(origin, length, time, length / time, mass, order, np.argsort(order))


def _origin_of_axis(low: float, high: float) -> float:
    """Return the origin of coordinates for a side of the box: 0 if that is in it, else its middle.

    >>> _origin_of_axis(-1.0, 3.0), _origin_of_axis(10.0, 12.0)
    (0.0, 11.0)
    """
    return 0.0 if low <= 0.0 <= high else low + (high - low) / 2


def rms_speed(scene: Scene) -> float:
    """Return the rms speed sqrt(2 kT/m) of the lightest disks [length/time]; 0 if all disks are at
    rest.

    kT is the mean kinetic energy per disk, by the velocities that the scene gives; equipartition is
    assumed. Where disks of very different mass begin at one speed, the heaviest sqrt(N) keep their
    energy for long and do not count.
    """
    if scene.particles == 0:
        return 0.0
    ratio = np.minimum(scene.mass / scene.mass.min(), LARGEST_RATIO)
    velocity = motion.given_velocities(scene)
    if velocity is not None:
        unit = power_of_two(np.abs(velocity).max())
        squares = np.sum((velocity / unit) ** 2, axis=1)
        return unit * math.sqrt(np.mean(ratio * squares))
    velocities = scene.velocities
    if velocities is not None and velocities.temperature is not None:
        unit = math.sqrt(velocities.temperature)
        squares = 2.0 / scene.mass
    else:
        unit = motion.common_deviation(scene)
        squares = 2.0
        if ratio.max() > SLOW_TO_COOL:
            ratio = np.sort(ratio)[: -math.isqrt(len(ratio))]
    drawn = unit * math.sqrt(np.mean(ratio * squares))
    if scene.tracer_velocity is None:
        return drawn
    heat = math.sqrt(min(scene.mass[0] / scene.mass.min(), LARGEST_RATIO) / scene.particles)
    return math.hypot(drawn, heat * math.hypot(*scene.tracer_velocity))


def motion_of(state: State, frame: Frame) -> np.ndarray:
    """Return positions and velocities (N, 4) float64 in the engine's units and order."""
    motion = np.empty((len(frame.order), 4))
    motion[:, :2] = (state.position.take(frame.order, axis=0) - frame.origin) / frame.length
    motion[:, 2:] = state.velocity.take(frame.order, axis=0) / frame.speed
    return motion


def common_radius(radius: np.ndarray) -> float:
    """Return the radius that sets the size of the cells: the largest of (N,) radii, N > 0, without
    a few big disks.

    Big disks are at most sqrt(N) in number, and their radii exceed 1.5 times the largest of the
    rest.
    """
    ordered = np.sort(radius)
    for big in range(math.isqrt(len(ordered)), 0, -1):
        if len(ordered) > big and ordered[-big] > 1.5 * ordered[-big - 1]:
            return float(ordered[-big - 1])
    return float(ordered[-1])


def cell_width(common: float, packing_fraction: float) -> float:
    """Return the width of cells: 1.1 (dense) to 2 (dilute) contact distances of disks of the common
    radius.
    """
    return 2 * common * (2.0 - 1.8 * min(packing_fraction, 0.5))
