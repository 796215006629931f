"""Sample times of a run: at equal steps of time or of its logarithm, and always at 0 and at the duration exactly."""

import math

import numpy as np

SAME = 1e-6  # in steps: a sample time this close to the duration is the duration


def intervals(per_decade: int, first: float, duration: float) -> int:
    """Return the number of logarithmic sample times after t = 0."""
    decades = math.log10(duration) - math.log10(first)
    return 1 + max(0, math.ceil(per_decade * decades - SAME))


def linear_times(interval: float, duration: float) -> np.ndarray:
    """Return the multiples of the interval and the duration, (T,) [time]."""
    times = np.arange(math.floor(duration / interval) + 1) * interval
    if duration - times[-1] > SAME * interval:
        return np.append(times, duration)
    times[-1] = duration  # a multiple of the interval, to round-off
    return times


def logarithmic_times(per_decade: int, first: float, duration: float) -> np.ndarray:
    """Return 0, first * 10**(k / per_decade) for k = 0, 1, ... below the duration, and the duration, (T,) [time].

    Powers are computed by Python: NumPy's may differ in the last bit between processors.
    """
    steps = range(intervals(per_decade, first, duration) - 1)
    return np.array([0.0, *(first * 10 ** (k / per_decade) for k in steps), duration])


def default_fit_windows(shortest: float, diffusive_from: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the windows of straight-line fits in runs of which the shortest lasts so long [time].

    Both end with it. The first begins at `diffusive_from` [time], from a tenth to a half of it, the second at twice
    that, from a half to three quarters.
    """
    first = min(max(diffusive_from, 0.1 * shortest), 0.5 * shortest)
    second = min(max(2 * diffusive_from, 0.5 * shortest), 0.75 * shortest)
    return (first, shortest), (second, shortest)
