"""Sample times of a run: at equal steps of time or of its logarithm, and always at 0 and at the duration exactly."""

import math
from dataclasses import dataclass

import numpy as np

from brownpipe.scene import reading
from brownpipe.scene.reading import Entry, must_be, refuse

MOST_SAMPLES = 10_000_000
MOST_PER_DECADE = 10_000
SMALLEST_TIME = 1e-290  # of logarithmic samples after 0; above it no time loses digits to gradual underflow
SAME = 1e-6  # in steps: a sample time this close to the duration is the duration


@dataclass(frozen=True)
class Samples:
    """Logarithmic sample times: equal steps of log t."""

    per_decade: int
    first: float  # the first time after 0 [time]

    def intervals(self, duration: float) -> int:
        """Return the number of samples after t = 0."""
        decades = math.log10(duration) - math.log10(self.first)
        return 1 + max(0, math.ceil(self.per_decade * decades - SAME))


def linear_times(interval: float, duration: float) -> np.ndarray:
    """Return the multiples of the interval and the duration, (T,) [time]."""
    times = np.arange(math.floor(duration / interval) + 1) * interval
    if duration - times[-1] > SAME * interval:
        return np.append(times, duration)
    times[-1] = duration  # a multiple of the interval, to round-off
    return times


def logarithmic_times(samples: Samples, duration: float) -> np.ndarray:
    """Return 0, first * 10**(k / per_decade) for k = 0, 1, ... below the duration, and the duration, (T,) [time].

    Powers are computed by Python: NumPy's may differ in the last bit between processors.
    """
    steps = range(samples.intervals(duration) - 1)
    return np.array([0.0, *(samples.first * 10 ** (k / samples.per_decade) for k in steps), duration])


def default_fit_windows(shortest: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the windows of straight-line fits in runs of which the shortest lasts so long [time]."""
    return (0.1 * shortest, shortest), (0.5 * shortest, shortest)


def read_interval(entry: Entry, duration: float) -> float:
    """Return `sample_interval` of a scene, by default the duration; raise RequestError if it makes no sense."""
    if entry.value is None:
        return duration
    interval = reading.number(entry, above=0)
    if interval > duration:
        must_be(entry, f"at most the duration, {duration!r}")
    if duration / interval > MOST_SAMPLES:
        must_be(entry, f"at least {duration / MOST_SAMPLES:g}, for at most {MOST_SAMPLES} samples")
    return interval


def read_samples(entry: Entry, interval: Entry, duration: float) -> Samples | None:
    """Return `samples` of a scene, given instead of `sample_interval`; raise RequestError if they make no sense."""
    if entry.value is None:
        return None
    if interval.value is not None:
        refuse(entry, "must not be given with sample_interval; give one of the two")
    if isinstance(entry.value, int | float):
        must_be(entry, "a mapping with the keys per_decade, first", "; equal steps of time are sample_interval")
    fields = reading.fields(entry, ("per_decade",), {"first": duration * 1e-4})
    first = reading.number(fields["first"], above=SMALLEST_TIME)
    if first >= duration:
        must_be(fields["first"], f"below the duration, {duration!r}")
    samples = Samples(reading.integer(fields["per_decade"], 1, MOST_PER_DECADE), first)
    if samples.intervals(duration) > MOST_SAMPLES:
        must_be(fields["per_decade"], f"smaller, for at most {MOST_SAMPLES} samples")
    return samples
