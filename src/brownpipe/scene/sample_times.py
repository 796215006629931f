"""When a run is sampled: at equal steps of time or of its logarithm; in any case at 0 and at the duration exactly."""

import math
from dataclasses import dataclass

import numpy as np

from brownpipe.scene import reading
from brownpipe.scene.reading import Entry, must_be, refuse

MOST_SAMPLES = 10_000_000
SMALLEST_TIME = 1e-290  # of the first of logarithmic samples: above it floating-point numbers have all their digits
SAME = 1e-6  # of a step: a sample so near the duration is the duration


@dataclass(frozen=True)
class Samples:
    """Logarithmic sample times: equal steps of log t."""

    per_decade: int
    first: float  # after 0 [time]

    def intervals(self, duration: float) -> int:
        """The number of samples after t = 0."""
        decades = math.log10(duration) - math.log10(self.first)
        return 1 + max(0, math.ceil(self.per_decade * decades - SAME))


def linear_times(interval: float, duration: float) -> np.ndarray:
    """(T,) the multiples of the interval, and the duration."""
    times = np.arange(math.floor(duration / interval) + 1) * interval
    if duration - times[-1] > SAME * interval:
        return np.append(times, duration)
    times[-1] = duration  # a multiple, to round-off
    return times


def logarithmic_times(samples: Samples, duration: float) -> np.ndarray:
    """(T,) 0, first * 10**(k / per_decade) for k = 0, 1, ... below the duration, and the duration.

    The powers are Python's: those of NumPy may differ in the last bit from one processor to the next.
    """
    steps = range(samples.intervals(duration) - 1)
    return np.array([0.0, *(samples.first * 10 ** (k / samples.per_decade) for k in steps), duration])


def read_interval(entry: Entry, duration: float) -> float:
    """Return `sample_interval`; the duration if there is none."""
    if entry.value is None:
        return duration
    interval = reading.number(entry, above=0)
    if interval > duration:
        must_be(entry, f"at most the duration, {duration!r}")
    if duration / interval > MOST_SAMPLES:
        must_be(entry, f"at least {duration / MOST_SAMPLES:g}, for at most {MOST_SAMPLES} samples")
    return interval


def read_samples(entry: Entry, interval: Entry, duration: float) -> Samples | None:
    """Return `samples`, which takes the place of `sample_interval`."""
    if entry.value is None:
        return None
    if interval.value is not None:
        refuse(entry, "must not be given with sample_interval; give one of the two")
    given = reading.fields(entry, ("per_decade",), {"first": duration * 1e-4})
    first = reading.number(given["first"], above=SMALLEST_TIME)
    if first >= duration:
        must_be(given["first"], f"below the duration, {duration!r}")
    samples = Samples(reading.integer(given["per_decade"], 1, 10_000), first)
    if samples.intervals(duration) > MOST_SAMPLES:
        must_be(given["per_decade"], f"smaller, for at most {MOST_SAMPLES} samples")
    return samples
