"""What the engines of all disks hand back of a run, in the scene's units and order."""

import math

import numpy as np

from brownpipe.engines.state import Track
from brownpipe.engines.units import Frame
from brownpipe.scene import Scene

MOST_IMAGES = 2.0**31  # periodic images that an int32 can count
SMALLEST = np.finfo(float).smallest_normal


def tracer_track(scene: Scene, frame: Frame, r) -> Track:
    """Return where the tracer was, M = 1."""
    return _track(scene, frame, r.position, r.velocity, r.image)


def whole_track(scene: Scene, frame: Frame, r) -> Track | None:
    """Return where all disks were, M = N, if that was recorded."""
    if len(frame.back) == 0 or r.whole_position.shape[1] == 0:
        return None
    order = frame.back
    return _track(scene, frame, r.whole_position[:, order], r.whole_velocity[:, order], r.whole_image[:, order])


def _track(scene: Scene, frame: Frame, position, velocity, image) -> Track:
    position = position * frame.length + frame.origin
    return Track(position, velocity * (frame.length / frame.time), image if scene.box.periodic else None)


def represented(value, *units):
    """Return value * product(units), NaN where that is beyond the floating-point numbers (0 stays 0).

    Factors and products on the way may be beyond them. Rounded as the product itself.
    """
    mantissa, exponent = np.frexp(value)
    for unit in units:
        part, power = math.frexp(unit)
        mantissa, exponent = mantissa * part, exponent + power
    with np.errstate(over="ignore", under="ignore"):
        found = np.ldexp(mantissa, exponent)
    lost = ~np.isfinite(found) | ((np.abs(found) < SMALLEST) & (np.asarray(value) != 0.0))
    return np.where(lost, np.nan, found)[()]


def energies(frame: Frame, before: float, virial: float) -> dict[str, float]:
    """Return kinetic energy and virial in the scene's units; `before` is sum m v^2, both in the engine's."""
    speed = frame.length / frame.time
    return {
        "kinetic_energy": float(represented(0.5 * before, frame.mass, speed, speed)),
        "virial": float(represented(virial, frame.mass, speed, frame.length)),
    }


def images_fit(scene: Scene, frame: Frame, crossings: int, path: float) -> bool:
    """Whether int32 can count the images that a disk may have crossed, in so many crossings and on so long a path."""
    side = min(scene.box.width, scene.box.height) / frame.length
    return not scene.box.periodic or bool(crossings < MOST_IMAGES or path < MOST_IMAGES * side)


def all_finite(*arrays) -> bool:
    """Whether no number is inf or NaN."""
    return all(bool(np.all(np.isfinite(each))) for each in arrays)
