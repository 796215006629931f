"""The time at which the tracer first leaves a circle around its start, by its exact path."""

import math

import numpy as np

from brownpipe.observables.observable import Observable, RunArray
from brownpipe.observables.trajectory import DiskPath
from brownpipe.scene import Scene


def exit_radius(scene: Scene) -> float:
    """Return the radius [length] of the circle: that of the tracer."""
    return float(scene.radius[0])


def first_passage(scene: Scene, path: DiskPath) -> dict[str, np.ndarray]:
    """Return the time () at which the tracer's centre leaves the circle of `exit_radius` around its
    place at t = 0; NaN if it is inside until the end of the run.
    """
    return {"first_passage_time": np.array(exit_time(path, exit_radius(scene)))}


def exit_time(path: DiskPath, radius: float) -> float:
    """Return the time [time] at which a path leaves the circle of a radius [length] around its
    start; NaN if it does not.

    A circle is convex: a straight piece leaves it that begins inside and ends outside. On this
    piece the distance from the start is that of `_time_to_leave`.
    """
    way = path.position - path.position[0]
    is_outside = np.hypot(way[:, 0], way[:, 1]) > radius
    if not is_outside.any():
        return math.nan
    last_inside = int(is_outside.argmax()) - 1
    after = _time_to_leave(way[last_inside], path.velocity[last_inside], radius)
    return float(path.time[last_inside]) + after


def _time_to_leave(place: np.ndarray, velocity: np.ndarray, radius: float) -> float:
    """Return the time until a point at a place (2,) inside a circle around 0, with a velocity (2,),
    leaves it: the positive root t of |a + v t|^2 = R^2, without cancellation.

        t = (sqrt((a.v)^2 + v^2 c) - a.v)/v^2 = c/(sqrt((a.v)^2 + v^2 c) + a.v),  c = R^2 - a^2
    """
    to_rim = (radius - math.hypot(*place)) * (radius + math.hypot(*place))
    outward = float(place @ velocity)
    square_speed = float(velocity @ velocity)
    root = math.sqrt(outward * outward + square_speed * to_rim)
    if outward > 0:
        return to_rim / (root + outward)
    return (root - outward) / square_speed


FIRST_PASSAGE = Observable(
    lambda *_: {},
    {
        "first_passage_time": RunArray(
            (),
            "time",
            "time at which the tracer first leaves the circle of its radius around its start; NaN "
            "if not before the end of the run",
        )
    },
    tracks_needed="path",
    seconds_per_disk_sample=3.6e-8,
    measure_path=first_passage,
)
