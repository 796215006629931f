"""Averages over time origins: in a stationary run every sample is as good a start as t = 0."""

from collections.abc import Iterator

from brownpipe.scene import Scene
from brownpipe.scene.scene import SAME

MOST_ORIGINS = 20_000  # which have 2e8 pairs


def is_stationary(scene: Scene) -> bool:
    """Return whether the runs of a scene are in equilibrium from t = 0, so that their statistics do not depend on t."""
    return why_not_stationary(scene) is None


def why_not_stationary(scene: Scene) -> str | None:
    """Return why runs of the scene may not be stationary, None if they are.

    They are if all disks are drawn at one temperature and equilibrate, the tracer included, before t = 0.
    """
    if scene.velocities is None:
        return "its disks are listed one by one"
    if scene.velocities.temperature is None:
        return "velocities.temperature is not given"
    if scene.equilibrate.time == 0:
        return "equilibrate.time is 0"
    if scene.equilibrate.tracer == "pinned":
        return "its tracer is pinned while it equilibrates"
    return None


def unfit(scene: Scene) -> str | None:
    """Return why a stationary scene has no average over time origins, None if it has one."""
    if scene.samples is not None:
        return "origins needs sample_interval, not samples: lags are differences of sample times"
    if len(scene.times) > MOST_ORIGINS:
        return f"origins needs at most {MOST_ORIGINS} samples; there are {len(scene.times)}"
    return None


def lags(scene: Scene) -> Iterator[tuple[slice, slice]]:
    """For each sample time t yield the slices (earlier, later) of all pairs of samples that are t apart.

    Sample times are multiples of the sample interval, except the duration if it is none: its only time origin is t = 0.
    """
    times = scene.times
    count = len(times)
    equal = count if abs(times[-1] - (count - 1) * scene.sample_interval) <= SAME * scene.sample_interval else count - 1
    for lag in range(equal):
        yield slice(0, equal - lag), slice(lag, equal)
    if equal < count:
        yield slice(0, 1), slice(equal, count)
