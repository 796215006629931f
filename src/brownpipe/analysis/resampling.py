"""Errors of averages over independent runs. Runs are resampled, never the time points of a run.

Everything brownpipe reports at this level is a mean over runs: the MSD at one time is the mean of the squared
displacements, and a least-squares slope of the MSD is the mean of the slopes of the single runs, because least squares
is linear. So the standard error is exact (the jackknife's, s / sqrt(n)) and only the interval needs resampling.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

REPLICATES = 1999  # 2.5 % and 97.5 % are then the 50th value from either end
FEWEST_RUNS = 10  # below this an interval of a skewed quantity means nothing
_KEY = 0x62726F776E70697065  # of the Philox stream: the same replicates in every process
_CHUNK = 1 << 22  # weights computed at a time, 32 MiB
_NORMAL_975 = 1.959963984540054


class Estimate(NamedTuple):
    """A mean over runs, shape (...) like one run's entry, and its uncertainty."""

    mean: np.ndarray
    standard_error: np.ndarray  # NaN for a single run
    low: np.ndarray  # 95 % interval; NaN for fewer than FEWEST_RUNS runs
    high: np.ndarray


def resample(samples):
    """Mean over runs with standard error and 95 % interval, by the bootstrap-t over runs.

    `samples` has shape (runs, ...): one entry per run. Bootstrap-t, because r^2 is as skewed as an exponential: each
    replicate is studentized by its own standard error, which makes the interval lean to the right side and cover the
    truth in 95 % of the ensembles even for 50 runs. The result depends on the samples and their order alone, to the
    bit: the weights come from a fixed stream and no sum over runs has round-off.
    """
    samples = np.asarray(samples, float)
    runs, shape = len(samples), samples.shape[1:]
    columns = samples.reshape(runs, int(np.prod(shape)))
    mean = np.array([math.fsum(column.tolist()) for column in columns.T]) / (runs or np.nan)
    deviation = columns - mean
    error = np.full_like(mean, np.nan)
    if runs > 1:
        error = np.sqrt(_on_a_grid(deviation**2).sum(axis=0) / runs / (runs - 1))
    interval = _interval(deviation) if runs >= FEWEST_RUNS else np.full((2, 1), np.nan)
    return Estimate(*(values.reshape(shape) for values in (mean, error, *(mean + interval * error))))


def resample_each(samples):
    """`resample` of several quantities of the same runs, name -> (runs, ...), in one pass: name -> Estimate."""
    columns = [np.reshape(values, (len(values), -1)) for values in samples.values()]
    together = resample(np.concatenate(columns, axis=1))
    ends = np.cumsum([block.shape[1] for block in columns])[:-1]
    parts = zip(*(np.split(values, ends) for values in together), strict=True)
    shapes = [np.shape(values)[1:] for values in samples.values()]
    estimates = [
        Estimate(*(values.reshape(shape) for values in part)) for shape, part in zip(shapes, parts, strict=True)
    ]
    return dict(zip(samples, estimates, strict=True))


def replicates(samples, other=False):
    """What resampling the runs of `samples` (runs, Q) does to their mean: (REPLICATES, Q) deviations from it.

    `other` takes a second, independent set of replicates. To the bit as in `resample`.
    """
    samples = np.asarray(samples, float)
    deviation, chunk = _on_a_grid(samples - samples.mean(axis=0)), max(1, _CHUNK // len(samples))
    starts, later = range(0, REPLICATES, chunk), REPLICATES * other
    sums = [_weights(len(samples), k + later, min(chunk, REPLICATES - k)) @ deviation for k in starts]
    return np.concatenate(sums) / len(samples)


def _interval(deviation):
    """Both ends of the 95 % interval in standard errors from the mean, (2, columns); 0 for columns without scatter."""
    runs = len(deviation)
    moments = np.concatenate([_on_a_grid(deviation), _on_a_grid(deviation**2)], axis=1)
    chunk = max(1, _CHUNK // runs)
    sums = [_weights(runs, first, min(chunk, REPLICATES - first)) @ moments for first in range(0, REPLICATES, chunk)]
    first, second = np.split(np.concatenate(sums) / runs, 2, axis=1)
    variance = (second - first**2) / (runs - 1)
    scatter = variance > 0.0
    t = np.where(scatter, first / np.sqrt(np.where(scatter, variance, 1.0)), 0.0)
    t.sort(axis=0)
    tail = (REPLICATES + 1) // 40
    return np.stack([-t[-tail], -t[tail - 1]])


@lru_cache(maxsize=2)
def _weights(runs, first, replicates):
    """How often each run is drawn, (replicates, runs), in the replicates numbered from `first`."""
    draw = np.random.Generator(np.random.Philox(key=_KEY, counter=[0, 0, 0, first]))
    drawn = draw.integers(0, runs, (replicates, runs)) + runs * np.arange(replicates)[:, None]
    return np.bincount(drawn.ravel(), minlength=replicates * runs).reshape(replicates, runs).astype(float)


def _on_a_grid(columns):
    """Round each column to multiples of a power of two so coarse that sums over resampled runs have no round-off.

    The weights are whole numbers that add up to the number of runs, so every product and partial sum fits into the 53
    bits of a double: the matrix product gives the same bits in whatever order, on however many threads, it is done.
    Costs 1e-12 of the largest value for 2,400 runs.
    """
    largest = np.abs(columns).max(axis=0)
    step = np.ldexp(1.0, np.frexp(largest)[1] - 52 + int(np.ceil(np.log2(len(columns)))))
    return np.rint(columns / step) * step


def wilson_interval(count, total):
    """95 % interval of the expected count behind `count` of `total` independent runs (Wilson 1927), not empty at 0."""
    share, z2 = np.asarray(count, float) / total, _NORMAL_975**2
    centre = (share + z2 / (2 * total)) / (1 + z2 / total)
    half = np.sqrt(share * (1 - share) * z2 / total + (z2 / (2 * total)) ** 2) / (1 + z2 / total)
    return total * (centre - half), total * (centre + half)
