"""Errors of averages over independent runs. Runs are resampled, never the time points of a run.

All results are means over runs or functions of such means: the MSD at one time is the mean of the
squared displacements, and a least-squares slope of the MSD is the mean of the slopes of the single
runs, because least squares is linear. So the standard error is s/sqrt(n), which is also the
jackknife's, and only the interval needs resampling: a bootstrap-t (B. Efron, Can. J. Stat. 9, 139
(1981)).

Runs are resampled by a Poisson bootstrap (J. A. Hanley, B. MacGibbon, Comput. Methods Programs
Biomed. 83, 57 (2006)): in each of REPLICATES replicates every run counts w times, w from the
Poisson distribution of mean 1. Given the sum of the weights this is the ordinary bootstrap, which
draws that many runs with replacement. But the weights of a run depend on its seed alone: runs may
come in blocks of SEEDS_PER_BLOCK seeds, in bounded memory, further runs do not change the weights
of the others, and scenes and engines that share seeds share weights. See docs/theory.md, section 5.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np

# seeds that share a stream of weights, and whose runs are added up at a time
SEEDS_PER_BLOCK = 1024
REPLICATES = 1999  # the 2.5 % and 97.5 % quantiles are then the 50th value from either end
FEWEST_FOR_INTERVAL = 10  # runs; with fewer its coverage is unknown for a skewed quantity
# in standard errors: a replicate with less error has equal runs only (round-off on the grid gives
# 0.01)
ALIKE = 0.03
_KEY = 0x62726F776E70697065  # of the Philox stream: the same replicates in every process
_LONGEST = 64.0  # sqrt(sum of w^2) over the runs of a block is 45 +- 1.2
_AT_ONCE = 512  # columns at a time, to bound the memory of intermediate arrays
_OTHER = 2**62  # first seed of a second, independent set of weights, far beyond the first set
_NORMAL_975 = 1.959963984540054

# Inverse transform: a weight is the number of these bounds, P(w <= k) to 2^-17, that 16 random bits
# reach or exceed.
_PARTIAL_SUMS = accumulate(1 / math.factorial(k) for k in range(8))  # of the series of e
_BOUNDS = [round(2**16 * math.exp(-1) * partial_sum) for partial_sum in _PARTIAL_SUMS]


# From the means and then the variances of several sums to the value and n - 1 times its squared
# error, all (1 + B, C).
FunctionOfMeans = Callable[..., tuple[np.ndarray, np.ndarray]]


class Estimate(NamedTuple):
    """A mean over runs, shape (...) like one run's entry, and its uncertainty."""

    mean: np.ndarray
    standard_error: np.ndarray  # NaN for a single run
    # 95 % interval; NaN for fewer than FEWEST_FOR_INTERVAL runs, or events in up to three of them
    low: np.ndarray
    high: np.ndarray

    def at(self, index: int | tuple[int, ...]) -> "Estimate":
        """Return the Estimate of some of the entries."""
        return Estimate(*(values[index] for values in self))

    def scaled(self, factor: np.ndarray | float) -> "Estimate":
        """Return the Estimate of `factor` (>= 0, or NaN) times the mean."""
        return Estimate(*(values * factor for values in self))

    def unless_alike(self) -> "Estimate":
        """Return the Estimate with error and interval NaN where all runs are equal: mostly nothing
        was counted.
        """
        differ = self.standard_error > 0
        uncertainties = (np.where(differ, values, np.nan) for values in self[1:])
        return Estimate(self.mean, *uncertainties)


class Sums(NamedTuple):
    """Sums over runs of d = x - pivot for C quantities x, and of d^2: of all runs first, then of
    the B replicates.
    """

    pivot: np.ndarray  # (C,) near the mean, so that no digits are lost
    weight: np.ndarray  # (1 + B,) number of runs; sum of the weights w
    first: np.ndarray  # (1 + B, C) sum of d; of w d
    second: np.ndarray  # (1 + B, C) sum of d^2; of w d^2

    def at(self, columns: slice) -> "Sums":
        """Return the sums of some of the quantities."""
        return Sums(
            self.pivot[columns], self.weight, self.first[:, columns], self.second[:, columns]
        )


# sums of no runs, from which `add_block` begins
NO_SUMS = Sums(
    pivot=np.zeros(0),
    weight=np.zeros(1 + REPLICATES),
    first=np.zeros((1 + REPLICATES, 0)),
    second=np.zeros((1 + REPLICATES, 0)),
)


def moments(sums: Sums, replicates: int = REPLICATES) -> tuple[np.ndarray, np.ndarray]:
    """Return means and variances (1 + `replicates`, C), divided by n, not n - 1; NaN for a
    replicate without runs.
    """
    rows = slice(1 + replicates)
    runs = _or_nan(sums.weight[rows])[:, None]
    first = sums.first[rows] / runs
    second = sums.second[rows] / runs
    return sums.pivot + first, np.maximum(second - np.square(first), 0.0)


def add_block(sums: Sums, seeds: np.ndarray, columns: np.ndarray) -> Sums:
    """Return `sums` with the runs `seeds` (n,) of one block added, n > 0, whose entries are
    `columns` (n, C).

    The arrays of `sums` are changed in place, unless it has no runs yet. Seeds must ascend, and
    blocks be added in ascending order; the result is then the same to the bit on any number of
    threads.
    """
    columns = np.asarray(columns, float)
    if sums.weight[0] == 0:  # no runs yet
        rows = 1 + REPLICATES
        shape = (rows, columns.shape[1])
        pivot = columns[0] + (columns - columns[0]).mean(axis=0)
        sums = Sums(pivot, np.zeros(rows), np.zeros(shape), np.zeros(shape))
    blocks, places = np.divmod(seeds, SEEDS_PER_BLOCK)
    # an index in place of `take` copies this axis twelve times as slowly
    weights = _weights(int(blocks[0])).take(places, axis=1)
    deviation = columns - sums.pivot
    sums.weight[0] += len(seeds)
    sums.weight[1:] += weights.sum(axis=1)
    for terms, total in ((deviation, sums.first), (deviation**2, sums.second)):
        total[0] += terms.sum(axis=0)
        for start in range(0, terms.shape[1], _AT_ONCE):
            chunk = slice(start, start + _AT_ONCE)
            steps, unit = _on_a_grid(terms[:, chunk])
            total[1:, chunk] += (weights @ steps) * unit
    return sums


@lru_cache(maxsize=4)
def _weights(block: int) -> np.ndarray:
    """Return Poisson weights (REPLICATES, SEEDS_PER_BLOCK) of the seeds of a block: 0 to 8."""
    stream = np.random.Philox(key=_KEY, counter=[0, 0, 0, block])
    numbers = stream.random_raw(REPLICATES * SEEDS_PER_BLOCK // 4).astype("<u8")
    bits = numbers.view("<u2").reshape(REPLICATES, -1)
    weights = np.zeros(bits.shape, np.uint8)
    for bound in _BOUNDS:
        weights += bits >= bound
    return weights.astype(np.float32)


def _on_a_grid(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Round columns x to integers times a unit, such that weighted sums over a block have no
    round-off.

    By the Cauchy-Schwarz inequality sums of w x over any of the runs are below |w| |x|, and
    _LONGEST bounds |w| in any replicate. The unit makes this bound 2^24, up to which integers are
    exact in single precision: the matrix product gives the same bits in any order of summation, on
    any number of threads. The unit is about 2e-4 standard deviations, negligible for a resampled
    mean.
    """
    largest = np.abs(columns).max(axis=0)
    length = np.sqrt(np.square(columns / _or_nan(largest)).sum(axis=0)) * largest
    _, exponent = np.frexp(np.nan_to_num(length) * _LONGEST)
    unit = np.ldexp(1.0, exponent - 24)
    return np.rint(columns / unit).astype(np.float32), unit


def estimate(
    *sums: Sums, function: FunctionOfMeans = lambda mean, variance: (mean, variance)
) -> Estimate:
    """Return the Estimate of a function of means over runs, arrays (C,), by default of one mean;
    bootstrap-t interval.

    r^2 is as skewed as an exponential variable. Each replicate is studentized by its own standard
    error, which makes the interval asymmetric in the right sense: it covers the truth in 95 % of
    the ensembles even for 10 runs (B. Efron, Can. J. Stat. 9, 139 (1981)). NaN ends below
    FEWEST_FOR_INTERVAL runs, and where the runs are alike in 2.5 % of the replicates, as if only
    three runs have an event: for such a replicate t is infinite.
    """
    columns = len(sums[0].pivot)
    if columns > _AT_ONCE:
        chunks = [slice(start, start + _AT_ONCE) for start in range(0, columns, _AT_ONCE)]
        estimates = []
        for chunk in chunks:
            sums_of_chunk = [sums_of_mean.at(chunk) for sums_of_mean in sums]
            estimates.append(estimate(*sums_of_chunk, function=function))
        return Estimate(*map(np.concatenate, zip(*estimates, strict=True)))
    means, variances = zip(*map(moments, sums), strict=True)
    value, variance = function(*means, *variances)
    runs = sums[0].weight
    error = np.sqrt(variance / _or_nan(runs - 1)[:, None])
    # Of all runs; views would keep the replicates in memory.
    mean = value[0].copy()
    standard_error = error[0].copy()
    deviation = value[1:] - mean
    tail = (REPLICATES + 1) // 40
    # For replicates of equal runs.
    t = np.where(standard_error > 0.0, np.copysign(np.inf, deviation), 0.0)
    np.divide(deviation, error[1:], out=t, where=error[1:] > ALIKE * standard_error)
    t.sort(axis=0)
    ends = mean - t[[-tail, tail - 1]] * standard_error
    is_known = np.isfinite(ends).all(axis=0) & (runs[0] >= FEWEST_FOR_INTERVAL)
    low, high = np.where(is_known, ends, np.nan)
    return Estimate(mean, standard_error, low, high)


def _or_nan(count: np.ndarray) -> np.ndarray:
    """`count`, NaN where it is not positive."""
    return np.where(count > 0, count, np.nan)


def resample(samples: np.ndarray, seeds: np.ndarray | None = None) -> Estimate:
    """Return mean over runs, standard error and 95 % interval of `samples` (runs, ...), one entry
    per run.

    `seeds` (runs,), by default 0, 1, ..., must ascend; the result depends on seeds and samples
    alone, to the bit.
    """
    samples = np.asarray(samples, float)
    if not len(samples):
        return Estimate(*np.full((4, *samples.shape[1:]), np.nan))
    seeds = np.arange(len(samples)) if seeds is None else np.asarray(seeds)
    flat = estimate(_added_up(seeds, samples.reshape(len(samples), -1)))
    return Estimate(*(values.reshape(samples.shape[1:]) for values in flat))


def replicates(samples: np.ndarray, other: bool = False) -> np.ndarray:
    """Return the means of the replicates of `samples` (runs, Q) minus the mean of the runs,
    (REPLICATES, Q).

    The replicates are those of `resample`; with `other` a second set, independent of the first.
    """
    samples = np.asarray(samples, float)
    first_seed = _OTHER if other else 0
    mean, _ = moments(_added_up(first_seed + np.arange(len(samples)), samples))
    return mean[1:] - mean[0]


def _added_up(seeds: np.ndarray, columns: np.ndarray) -> Sums:
    """Return the sums over all runs, seeds ascending."""
    sums = NO_SUMS
    starts = np.flatnonzero(np.diff(seeds // SEEDS_PER_BLOCK)) + 1  # of the blocks but the first
    for rows in np.split(np.arange(len(seeds)), starts):
        sums = add_block(sums, seeds[rows], columns[rows])
    return sums


def wilson_interval(count: np.ndarray, total: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Return the 95 % interval of the expected number behind `count` (...) of `total` independent
    runs.

    E. B. Wilson, J. Am. Stat. Assoc. 22, 209 (1927). Its upper end is positive at a count of 0. Of
    infinitely many runs, `count` is a number of rare events (Poisson).

    >>> low, high = wilson_interval(np.array([0, 50]), 100)
    >>> low.round(1), high.round(1)
    (array([ 0. , 40.4]), array([ 3.7, 59.6]))
    """
    count = np.asarray(count, float)
    z2 = _NORMAL_975**2
    half = np.sqrt(z2 * (count * (1 - count / total) + z2 / 4))
    middle = count + z2 / 2
    width = 1 + z2 / total
    return (middle - half) / width, (middle + half) / width
