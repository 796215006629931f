"""The time steps, precisions and treatments of collisions that a scene can be run with."""

import math
from collections.abc import Collection

import numpy as np

from brownpipe.engines.units import thermal_speed
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

PRECISIONS: dict[str, type[np.floating]] = {"double": np.float64, "single": np.float32}
COLLISIONS = ("at_contact", "late")
MOST_STEPS = 1e10  # in a run
FINEST = 64  # shortest path of a disk in a step, in units of the round-off of the largest coordinate


def refuse_unfit(scene: Scene, settings: dict, record: Collection[str]) -> None:
    """Raise RequestError for unknown words, a time step that does not fit the scene, or a record of events."""
    for name, words in (("collisions", COLLISIONS), ("precision", PRECISIONS)):
        if settings[name] not in words:
            raise RequestError(f"{name}: must be one of {', '.join(words)}, found {settings[name]!r}")
    time_step, precision = settings["time_step"], settings["precision"]
    most, least = largest_step(scene), smallest_step(scene, precision)
    if not time_step <= most:  # NaN, too
        raise RequestError(
            f"{scene.name}: time_step: must be at most {most:.4g}, in which a disk at thermal speed covers its radius, "
            f"found {time_step!r}"
        )
    if math.isinf(time_step):
        raise RequestError(
            f"{scene.name}, N = {scene.particles}: --engine timestep needs disks that move, or a finite time_step"
        )
    if not time_step >= least:
        raise RequestError(
            f"{scene.name}: time_step: must be at least {least:.4g} in {precision} precision, for at most "
            f"{MOST_STEPS:g} steps in which disks move by more than round-off, found {time_step!r}"
        )
    if "events" in record:
        raise RequestError(
            "--record events: the timestep engine knows no instants of collisions; must be tracer or all"
        )


def largest_step(scene: Scene) -> float:
    """Return the shortest time [time] in which a disk at its thermal speed, sqrt(2 kT/m), covers its own radius.

    In a longer step two disks could pass through each other. inf if nothing moves.
    """
    speed = thermal_speed(scene)
    if speed == 0.0 or scene.particles == 0:
        return math.inf
    return float(np.min(scene.radius * np.sqrt(scene.mass / scene.mass.min()))) / speed


def smallest_step(scene: Scene, precision: str) -> float:
    """Return the time step [time] below which a run has too many steps, or a step is lost in round-off.

    The latter: a disk at the thermal speed moves in a step by less than FINEST times the round-off of a coordinate.
    """
    speed, size = thermal_speed(scene), max(scene.box.width, scene.box.height)
    moving = FINEST * float(np.finfo(PRECISIONS[precision]).eps) * size / speed if speed > 0 else 0.0
    return max(scene.duration / MOST_STEPS, moving)
