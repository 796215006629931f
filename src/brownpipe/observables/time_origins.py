"""Averages over time origins: every sample of a stationary run is as good a beginning as t = 0."""

from collections.abc import Callable, Iterator

import numpy as np

from brownpipe.scene import Scene
from brownpipe.scene.sample_times import SAME

MOST_SAMPLES = 20_000  # there are half as many pairs of samples as the square of this


def is_stationary(scene: Scene) -> bool:
    """Are the runs in equilibrium from t = 0, so that all times are alike?"""
    return why_not_stationary(scene) is None


def why_not_stationary(scene: Scene) -> str | None:
    """Return what stands against it; None if all disks have one temperature and had time to mix."""
    if scene.velocities is None:
        return "its disks are listed one by one"
    if scene.velocities.temperature is None:
        return "velocities.temperature is not given"
    if scene.equilibrate == 0:
        return "equilibrate.time is 0"
    if scene.tracer_while_equilibrating == "pinned":
        return "its tracer is pinned while it equilibrates"
    return None


def unfit(scene: Scene) -> str | None:
    """Return why a stationary scene has no average over origins; None if it has."""
    if scene.samples is not None:
        return "origins needs sample_interval, not samples: lags are differences of sample times"
    if len(scene.times) > MOST_SAMPLES:
        return f"origins needs at most {MOST_SAMPLES} samples; there are {len(scene.times)}"
    return None


def averaged(scene: Scene, average: str, products: Callable) -> np.ndarray:
    """Means (K, T) over disks, and origins if these are asked for, of K products of two samples.

    `products` (earlier, later) yields arrays (T', M), one for each product, of the samples in two slices.
    """
    if average != "origins":
        return np.stack([product.mean(axis=1) for product in products(slice(0, 1), slice(None))])
    return np.array([[product.mean() for product in products(*pair)] for pair in lags(scene)]).T


def lags(scene: Scene) -> Iterator[tuple[slice, slice]]:
    """For each sample time the samples (earlier, later) that lie so far apart.

    The times are multiples of the sample interval. An end that is none has t = 0 alone before it at its distance.
    """
    times = scene.times
    count = len(times)
    equal = count if abs(times[-1] - (count - 1) * scene.sample_interval) <= SAME * scene.sample_interval else count - 1
    for lag in range(equal):
        yield slice(0, equal - lag), slice(lag, equal)
    if equal < count:
        yield slice(0, 1), slice(equal, count)
