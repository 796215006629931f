"""The time-stepping engine, for comparison: all disks fly for a fixed time, then the pairs that met
collide.

This file has its `Definition`, and the time steps that a scene can be run with; `simulation` says
how it works.
"""

import math
from collections.abc import Collection
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition
from brownpipe.engines.units import rms_speed
from brownpipe.errors import RequestError
from brownpipe.scene.reading import Positive, key
from brownpipe.scene.scene import Scene

When = Literal["at_contact", "late"]
COLLISIONS = get_args(When)
MOST_STEPS = 1e10  # in a run
# shortest path of a disk in a step, in units of the round-off of the largest coordinate
FINEST = 64
SECONDS_PER_DISK_STEP = 1.5e-9  # CPU seconds per disk and time step
# CPU seconds for lists of pairs while a disk moves by the distance of neighbours
SECONDS_PER_CROSSING = 5e-7


class Settings(NamedTuple):
    """The settings of the engine."""

    time_step: Annotated[Positive, key("must be given")]
    collisions: Annotated[When, key("at_contact (default) or late")] = "at_contact"


def refuse_unfit(scene: Scene, settings: Settings, record: Collection[str]) -> None:
    """Raise RequestError for a time step that does not fit the scene, or a record of events."""
    time_step = settings.time_step
    most = largest_step(scene)
    least = smallest_step(scene)
    if not time_step <= most:  # NaN, too
        raise RequestError(
            f"{scene.name}: time_step: must be at most {most:.4g}, in which a disk at rms speed "
            f"covers its radius, found {time_step!r}"
        )
    if math.isinf(time_step):
        raise RequestError(
            f"{scene.title}: --engine timestep needs disks that move, or a finite time_step"
        )
    if not time_step >= least:
        raise RequestError(
            f"{scene.name}: time_step: must be at least {least:.4g}, for at most "
            f"{MOST_STEPS:g} steps in which disks move by more than round-off, found {time_step!r}"
        )
    if "events" in record:
        raise RequestError(
            "--record events: the timestep engine knows no instants of collisions; must be tracer "
            "or all"
        )


def largest_step(scene: Scene) -> float:
    """Return the shortest time [time] in which a disk at its rms speed, sqrt(2 kT/m), covers its
    own radius.

    In a longer step two disks could pass through each other. inf if nothing moves.
    """
    speed = rms_speed(scene)
    if speed == 0.0 or scene.particles == 0:
        return math.inf
    slowness = np.sqrt(scene.mass / scene.mass.min())  # `speed` is that of the lightest disks
    return float(np.min(scene.radius * slowness)) / speed


def smallest_step(scene: Scene) -> float:
    """Return the time step [time] below which a run has too many steps, or a step is lost in
    round-off.

    The latter: a disk at the rms speed moves in a step by less than FINEST times the round-off of a
    coordinate.
    """
    shortest = scene.duration / MOST_STEPS
    speed = rms_speed(scene)
    if not speed > 0:
        return shortest
    size = max(scene.box.width, scene.box.height)
    return max(shortest, FINEST * float(np.finfo(float).eps) * size / speed)


def _forecast(
    scene: Scene,
    settings: Settings,
    record: Collection[str],
    observables: Collection[str],
    average: str,
) -> forecast.Cost:
    """Return the cost of a run: that of an exact run, plus time steps and lists of pairs."""
    exact = forecast.run_cost(scene, record, observables, average)
    steps = scene.duration / settings.time_step
    seconds = SECONDS_PER_DISK_STEP * scene.particles * steps
    seconds += SECONDS_PER_CROSSING * scene.duration * forecast.crossing_rate(scene)
    return exact._replace(seconds=exact.seconds + seconds)


TIMESTEP = Definition(
    name="timestep",
    summary="in steps",
    simulation="brownpipe.engines.timestep.simulation",
    settings=Settings,
    model=lambda scenes, settings: "all disks, in time steps",
    refuse_unfit=refuse_unfit,
    caution=forecast.caution,
    forecast=_forecast,
)
