"""Errors of averages over independent runs. Runs are resampled, never the time points of a run.

Everything brownpipe reports at this level is a mean over runs or a function of such means: the MSD at one time is the
mean of the squared displacements, and a least-squares slope of the MSD is the mean of the slopes of the single runs,
because least squares is linear. So the standard error is exact (the jackknife's, s / sqrt(n)) and only the interval
needs resampling.

Resampling is a Poisson bootstrap: in each of REPLICATES replicates every run counts w times, w from the Poisson law of
mean 1. Given the sum of the weights that is the ordinary bootstrap, drawing that many runs with replacement; but the
weights of a run depend on its seed alone. So runs may come in blocks of BLOCK seeds, in bounded memory; more runs leave
the weights of the others alone; and what shares seeds (scenes, engines) shares weights.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

BLOCK = 1024  # seeds with one stream of weights, and of runs added up at a time
REPLICATES = 1999  # 2.5 % and 97.5 % are then the 50th value from either end
FEWEST_RUNS = 10  # below this an interval of a skewed quantity means nothing
_KEY = 0x62726F776E70697065  # of the Philox stream: the same replicates in every process
_LONGEST = 64.0  # sqrt(sum of w^2) over the runs of a block is 45 +- 1.2
_AT_ONCE = 512  # columns
_OTHER = 2**62  # a seed that no run has: there a second set of weights begins
_NORMAL_975 = 1.959963984540054

# A weight is how many of these bounds 16 random bits reach: P(w <= k) of the Poisson law of mean 1, to 2^-17.
_BOUNDS = [round(2**16 * math.exp(-1) * sum(1 / math.factorial(j) for j in range(k + 1))) for k in range(8)]


class Estimate(NamedTuple):
    """A mean over runs, shape (...) like one run's entry, and its uncertainty."""

    mean: np.ndarray
    standard_error: np.ndarray  # NaN for a single run
    low: np.ndarray  # 95 % interval; NaN for fewer than FEWEST_RUNS runs
    high: np.ndarray


class Sums(NamedTuple):
    """Sums over runs of d = x - pivot for C quantities x, and of d^2 for the first Q of them; B replicates."""

    runs: int
    pivot: np.ndarray  # (C,) near the mean, so that no digits are lost
    first: np.ndarray  # (C,) sum of d
    second: np.ndarray  # (Q,) sum of d^2
    weight: np.ndarray  # (B,) sum of the weights w
    drawn_first: np.ndarray  # (B, C) sum of w d
    drawn_second: np.ndarray  # (B, Q) sum of w d^2


ALL = slice(None)


def mean_of(sums, columns=ALL):
    """(C,) means over runs."""
    return sums.pivot[columns] + sums.first[columns] / sums.runs


def drawn_mean(sums, columns=ALL):
    """(B, C) means over the runs of each replicate; NaN for a replicate without runs."""
    return sums.pivot[columns] + _per_run(sums.drawn_first[:, columns], sums.weight)


def drawn_variance(sums, columns=ALL):
    """(B, Q) variances over the runs of each replicate, divided by its number of runs."""
    first, second = (_per_run(drawn[:, columns], sums.weight) for drawn in (sums.drawn_first, sums.drawn_second))
    return second - np.square(first)


def variance_of(sums, columns=ALL):
    """(Q,) variances over runs, divided by their number."""
    return np.maximum(sums.second[columns] / sums.runs - np.square(sums.first[columns] / sums.runs), 0.0)


def add_block(sums, seeds, columns, squares):
    """`sums` (or None) and the runs `seeds` (n,) of one block, ascending, whose entries are `columns` (n, C), n > 0.

    Sums of squares are kept for the first `squares` columns. The arrays of `sums` are added to in place; blocks are to
    be added in ascending order. The bits do not depend on the number of threads.
    """
    block, columns = int(seeds[0]) // BLOCK, np.asarray(columns, float)
    if sums is None:
        in_turn = np.cumsum(columns - columns[0], axis=0)[-1]  # added up as each column would be alone
        sums = Sums(0, columns[0] + in_turn / len(seeds), *map(np.zeros, _sizes(columns.shape[1], squares)))
    deviation, rows = columns - sums.pivot, np.asarray(seeds) - block * BLOCK
    once = np.ones((len(seeds), 1))
    for terms, first, drawn in (
        (deviation, sums.first, sums.drawn_first),
        (deviation[:, :squares] ** 2, sums.second, sums.drawn_second),
        (once, np.zeros(1), sums.weight[:, None]),
    ):
        first += np.cumsum(terms, axis=0)[-1] if terms.shape[1] == 1 else terms.sum(axis=0)
        for some in _chunks(terms.shape[1]):
            drawn[:, some] += _drawn(block, rows, terms[:, some])
    return sums._replace(runs=sums.runs + len(seeds))


def _chunks(columns):
    """Columns a few at a time: what is computed on the way then takes little memory."""
    return [slice(start, min(start + _AT_ONCE, columns)) for start in range(0, columns, _AT_ONCE)]


def _drawn(block, rows, terms):
    """Weighted sums (B, K) of `terms` (n, K), which belong to the given rows of a block; gaps count as 0."""
    steps, unit = _on_a_grid(terms)
    full = np.zeros((rows[-1] + 1 - rows[0], terms.shape[1]), np.float32)
    full[rows - rows[0]] = steps
    return (_weights(block)[:, rows[0] : rows[-1] + 1] @ full) * unit


def _sizes(columns, squares):
    return columns, squares, REPLICATES, (REPLICATES, columns), (REPLICATES, squares)


@lru_cache(maxsize=4)
def _weights(block):
    """How often each seed of a block counts, (REPLICATES, BLOCK): whole numbers from 0 to 8."""
    stream = np.random.Philox(key=_KEY, counter=[0, 0, 0, block])
    bits = stream.random_raw(REPLICATES * BLOCK // 4).astype("<u8").view("<u2").reshape(REPLICATES, BLOCK)
    weights = np.zeros(bits.shape, np.uint8)
    for bound in _BOUNDS:
        weights += bits >= bound
    return weights.astype(np.float32)


def _on_a_grid(columns):
    """Round each column x to whole numbers of a unit so coarse that weighted sums over a block have no round-off.

    Sums of w x over any of the runs are below |w| |x| (Cauchy and Schwarz), and _LONGEST bounds |w| in any replicate.
    The unit makes that 2^24, up to which single precision is exact: the matrix product gives the same bits in whatever
    order, on however many threads, it is done. A unit is 2e-4 standard deviations or so: nothing to a resampled mean.
    """
    largest = np.abs(columns).max(axis=0)
    length = np.sqrt(np.square(columns / _or_nan(largest)).sum(axis=0)) * largest
    unit = np.ldexp(1.0, np.frexp(np.nan_to_num(length) * _LONGEST)[1] - 24)
    return np.rint(columns / unit).astype(np.float32), unit


def estimate(sums):
    """The Estimate, arrays (Q,), of the columns whose squares were summed, with its interval by the bootstrap-t.

    Bootstrap-t, because r^2 is as skewed as an exponential: each replicate is studentized by its own standard error,
    which makes the interval lean to the right side and cover the truth in 95 % of the ensembles even for 50 runs.
    """
    parts = [_estimate(sums, some) for some in _chunks(len(sums.second))]
    return Estimate(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _estimate(sums, some):
    runs, variance = sums.runs, variance_of(sums, some)
    error = np.sqrt(variance / (runs - 1)) if runs > 1 else np.full_like(variance, np.nan)
    shift = _per_run(sums.drawn_first[:, some], sums.weight) - sums.first[some] / runs
    return studentized(runs, mean_of(sums, some), error, shift, drawn_variance(sums, some) / degrees(sums))


def degrees(sums):
    """(B, 1) runs of each replicate less one, NaN if there are none left: a variance over it is that of a mean."""
    return _or_nan(sums.weight - 1)[:, None]


def studentized(runs, value, error, shift, variance):
    """Estimate of `value` (...) with standard error `error`, from its replicates.

    `shift` (B, ...) is a replicate's value less `value`, `variance` (B, ...) the square of the replicate's own standard
    error. A replicate without scatter counts as being in the middle.
    """
    if runs < FEWEST_RUNS:
        return Estimate(value, error, *np.full((2, *np.shape(value)), np.nan))
    scatter = variance > 0.0
    t = np.where(scatter, shift / np.sqrt(np.where(scatter, variance, 1.0)), 0.0)
    t.sort(axis=0)
    tail = (REPLICATES + 1) // 40
    return Estimate(value, error, value - t[-tail] * error, value - t[tail - 1] * error)


def _per_run(drawn, weight):
    return drawn / _or_nan(weight)[:, None]


def _or_nan(count):
    """`count`, NaN where it is not positive."""
    return np.where(count > 0, count, np.nan)


def resample(samples, seeds=None):
    """Mean over runs with standard error and 95 % interval of `samples` (runs, ...), one entry per run: an Estimate.

    `seeds` (runs,), 0, 1, ... by default, are ascending; the result depends on seeds and samples alone, to the bit.
    """
    samples = np.asarray(samples, float)
    runs, shape = len(samples), samples.shape[1:]
    if not runs:
        return Estimate(*np.full((4, *shape), np.nan))
    columns = samples.reshape(runs, -1)
    sums = _added_up(np.arange(runs) if seeds is None else np.asarray(seeds), columns, columns.shape[1])
    return Estimate(*(values.reshape(shape) for values in estimate(sums)))


def replicates(samples, other=False):
    """What resampling the runs of `samples` (runs, Q) does to their mean: (REPLICATES, Q) deviations from it.

    `other` takes a second set of replicates, independent of the first. To the bit as in `resample`.
    """
    samples = np.asarray(samples, float)
    sums = _added_up(np.arange(len(samples)) + _OTHER * other, samples, 0)
    return drawn_mean(sums) - mean_of(sums)


def _added_up(seeds, columns, squares):
    """Sums over all runs, seeds ascending."""
    sums = None
    for rows in np.split(np.arange(len(seeds)), np.flatnonzero(np.diff(seeds // BLOCK)) + 1):
        sums = add_block(sums, seeds[rows], columns[rows], squares)
    return sums


def wilson_interval(count, total):
    """95 % interval of the expected count behind `count` of `total` independent runs (Wilson 1927), not empty at 0."""
    share, z2 = np.asarray(count, float) / total, _NORMAL_975**2
    centre = (share + z2 / (2 * total)) / (1 + z2 / total)
    half = np.sqrt(share * (1 - share) * z2 / total + (z2 / (2 * total)) ** 2) / (1 + z2 / total)
    return total * (centre - half), total * (centre + half)
