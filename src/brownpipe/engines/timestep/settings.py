"""The time steps and treatments of collisions that a scene can be run with."""

import math
from collections.abc import Collection

import numpy as np

from brownpipe.engines.units import rms_speed
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

COLLISIONS = ("at_contact", "late")
MOST_STEPS = 1e10  # in a run
FINEST = 64  # shortest path of a disk in a step, in units of the round-off of the largest coordinate


def refuse_unfit(scene: Scene, settings: dict, record: Collection[str]) -> None:
    """Raise RequestError for unknown words, a time step that does not fit the scene, or a record of events."""
    if settings["collisions"] not in COLLISIONS:
        raise RequestError(f"collisions: must be one of {', '.join(COLLISIONS)}, found {settings['collisions']!r}")
    time_step, most, least = settings["time_step"], largest_step(scene), smallest_step(scene)
    if not time_step <= most:  # NaN, too
        raise RequestError(
            f"{scene.name}: time_step: must be at most {most:.4g}, in which a disk at rms speed covers its radius, "
            f"found {time_step!r}"
        )
    if math.isinf(time_step):
        raise RequestError(
            f"{scene.name}, N = {scene.particles}: --engine timestep needs disks that move, or a finite time_step"
        )
    if not time_step >= least:
        raise RequestError(
            f"{scene.name}: time_step: must be at least {least:.4g}, for at most "
            f"{MOST_STEPS:g} steps in which disks move by more than round-off, found {time_step!r}"
        )
    if "events" in record:
        raise RequestError(
            "--record events: the timestep engine knows no instants of collisions; must be tracer or all"
        )


def largest_step(scene: Scene) -> float:
    """Return the shortest time [time] in which a disk at its rms speed, sqrt(2 kT/m), covers its own radius.

    In a longer step two disks could pass through each other. inf if nothing moves.
    """
    speed = rms_speed(scene)
    if speed == 0.0 or scene.particles == 0:
        return math.inf
    return float(np.min(scene.radius * np.sqrt(scene.mass / scene.mass.min()))) / speed


def smallest_step(scene: Scene) -> float:
    """Return the time step [time] below which a run has too many steps, or a step is lost in round-off.

    The latter: a disk at the rms speed moves in a step by less than FINEST times the round-off of a coordinate.
    """
    speed, size = rms_speed(scene), max(scene.box.width, scene.box.height)
    moving = FINEST * float(np.finfo(float).eps) * size / speed if speed > 0 else 0.0
    return max(scene.duration / MOST_STEPS, moving)
