"""Bias of an approximate engine: difference from the exact result, with its uncertainty.

Every quantity is a mean over runs. Runs of two engines that start from the same state are
correlated until the initial state is forgotten, and the exact engine often has more runs than the
other. Double sampling with regression uses both (W. G. Cochran, Sampling Techniques, 3rd ed., Wiley
1977, chapter 12): the approximate mean is corrected by slope * (mean of all exact runs - mean of
the exact runs with the same seeds). Without common seeds the slope is 0, and the bias is the
difference of two independent means; with all seeds in common and slope 1 it is the mean of the
paired differences.
"""

from itertools import pairwise
from statistics import NormalDist

import numpy as np

from brownpipe.analysis.resampling import FEWEST_FOR_INTERVAL, Estimate, replicates, resample

# for g(r): shells of equal width, from contact to NEAR_CONTACT contact distances
SHELLS = 5
NEAR_CONTACT = 1.25
RINGS = 10  # rings of equal probability, for displacement distributions
CERTAIN = 0.95
# standard errors from one event to the upper end of Poisson's 95 % interval; from two 3.7, from
# three 3.3
RARE = 4.6
Pairs = tuple[np.ndarray, np.ndarray]  # (n,), (n,) rows of the runs of equal seeds in two samples


def square(bias: Estimate) -> np.ndarray:
    """Return an unbiased estimate of the squared bias, but not below 0: max(b^2 - se^2, 0)."""
    return np.maximum(bias.mean**2 - bias.standard_error**2, 0.0)


def is_resolved(bias: Estimate) -> np.ndarray:
    """Return whether the 95 % interval excludes 0."""
    return (bias.low > 0.0) | (bias.high < 0.0)


def careful_square(bias: Estimate) -> np.ndarray:
    """Return the `square` of a resolved bias; of an unresolved one that of its upper bound, with 95
    % confidence.
    """
    bound = np.maximum(np.abs(bias.low), np.abs(bias.high))
    return np.where(is_resolved(bias), square(bias), bound**2)


def same_seeds(approximate: np.ndarray, exact: np.ndarray) -> Pairs:
    """Return the rows of the seeds that both engines ran, in ascending order of the seeds."""
    _, rows, exact_rows = np.intersect1d(
        approximate, exact, assume_unique=True, return_indices=True
    )
    return rows, exact_rows


def relative_bias(
    approximate: np.ndarray, exact: np.ndarray, pairs: Pairs | None = None
) -> Estimate:
    """Return the bias of the mean of `approximate` (S_a, ...) relative to that of `exact` (S_e,
    ...).

    NaN where the exact mean is not positive. `pairs` are the runs of equal seeds, `same_seeds`.
    Approximate runs without an exact partner are left out, unless the unpaired bias of all runs has
    a smaller standard error.
    """
    paired = _relative_bias(approximate, exact, pairs)
    if pairs is None or len(pairs[0]) == len(approximate):
        return paired
    unpaired = _relative_bias(approximate, exact, None)
    is_better = unpaired.standard_error < paired.standard_error
    fields = zip(unpaired, paired, strict=True)
    return Estimate(*(np.where(is_better, *choices) for choices in fields))


def _relative_bias(approximate: np.ndarray, exact: np.ndarray, pairs: Pairs | None) -> Estimate:
    """Return the relative bias from pairs alone, or without pairs from the difference of two
    independent means.

    The interval combines those of the two independent terms (G. Y. Zou, A. Donner, Statist. Med.
    27, 1693 (2008), eq. 7), each a bootstrap-t over runs.
    """
    shape = np.shape(exact)[1:]
    approximate = np.reshape(np.asarray(approximate, float), (len(approximate), -1))
    exact = np.reshape(np.asarray(exact, float), (len(exact), -1))
    mean = exact.mean(axis=0)
    defined = mean > 0.0
    scale = np.where(defined, mean, 1.0)
    residual, slope = _corrected(approximate / scale, exact / scale, pairs)
    value = residual.mean(axis=0) + (slope - 1.0) * mean / scale
    residuals = _resampled(residual)
    reference = _resampled((1.0 + value - slope) * exact / scale)
    low = value - np.hypot(residuals.mean - residuals.low, reference.high - reference.mean)
    high = value + np.hypot(residuals.high - residuals.mean, reference.mean - reference.low)
    error = np.hypot(residuals.standard_error, reference.standard_error)
    fields = (value, error, low, high)
    return Estimate(*(np.where(defined, field, np.nan).reshape(shape) for field in fields))


def _resampled(runs: np.ndarray) -> Estimate:
    """Return `resample`; where it gives no interval, as at most three runs differ from the others,
    +-RARE errors.
    """
    estimate = resample(runs)
    reach = RARE * estimate.standard_error if len(runs) >= FEWEST_FOR_INTERVAL else np.nan
    low = np.where(np.isnan(estimate.low), estimate.mean - reach, estimate.low)
    high = np.where(np.isnan(estimate.high), estimate.mean + reach, estimate.high)
    return estimate._replace(low=low, high=high)


def _corrected(
    approximate: np.ndarray, exact: np.ndarray, pairs: Pairs | None, axis: int | None = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (n, Q) of the regression of approximate runs on exact runs of the same seeds, and
    its slope.

    The slope is that of each quantity, (Q,), or with `axis` None one for all. It is exactly 1 for
    runs that are their own partners, and 0 without pairs.
    """
    if pairs is None:
        return approximate, np.zeros(())
    rows, exact_rows = pairs
    paired = approximate[rows]
    partner = exact[exact_rows]
    centred = paired - paired.mean(axis=0)
    reference = partner - partner.mean(axis=0)
    covariance = (reference * centred).sum(axis=axis)
    variance = (reference**2).sum(axis=axis)
    slope = np.divide(covariance, variance, out=np.zeros_like(variance), where=variance > 0.0)
    return paired - slope * partner, slope


def total_variation(
    approximate: np.ndarray, exact: np.ndarray, pairs: Pairs | None = None
) -> Estimate:
    """Return the total variation distance of displacements (S_a,) and (S_e,): half the sum of
    abs(p_a - p_e).

    p are the shares of the runs in rings, which hold equal shares of the exact runs; differences
    inside a ring are not detected. Noise alone gives a positive distance. Its size is estimated
    from the distances between resampled and measured shares: the square of their mean is subtracted
    from the square of the distance, and their 95 % quantile q is the half-width of the interval, as
    the true distance is within q of the measured one (triangle inequality). The coverage is above
    95 %. The mean of these distances, the noise, stands in place of the standard error.
    """
    edges = np.quantile(exact, np.linspace(0.0, 1.0, RINGS + 1))
    edges[0] = 0.0
    edges[-1] = np.inf
    reference = _indicators(exact, edges)
    # One slope for all rings, so that the differences of shares still sum to 0.
    residual, slope = _corrected(_indicators(approximate, edges), reference, pairs, axis=None)
    distance = _half_sum(residual.mean(axis=0) - (1.0 - slope) * reference.mean(axis=0))
    differences = replicates(residual) - (1.0 - slope) * replicates(reference, other=True)
    noise = np.sort(_half_sum(differences))
    quantile = noise[int(np.ceil(CERTAIN * len(noise))) - 1]
    value = np.sqrt(np.maximum(distance**2 - noise.mean() ** 2, 0.0))
    low = np.maximum(distance - quantile, 0.0)
    return Estimate(value, noise.mean(), low, distance + quantile)


def contact_deviation(
    approximate: np.ndarray, exact: np.ndarray, pairs: Pairs | None = None
) -> Estimate | None:
    """Return the most significant deviation of g(r) near contact, from pair counts (S_a, P, R),
    (S_e, P, R) of a scene.

    Counts are pooled in shells between the contact distance and NEAR_CONTACT times that, for each
    of P pairs of species; the shell with the largest deviation in units of its standard error is
    chosen, and its interval widened for this choice (Bonferroni). None if the exact runs have no
    pair near contact.
    """
    shells = _shells(np.asarray(exact).sum(axis=0))
    if not shells:
        return None
    biases = relative_bias(
        _counts_in_shells(approximate, shells), _counts_in_shells(exact, shells), pairs
    )
    size = np.abs(biases.mean)
    error = biases.standard_error
    significance = np.divide(size, error, out=np.zeros_like(size), where=error > 0.0)
    worst = biases.at(int(np.nanargmax(significance)))
    tail = (1.0 - CERTAIN) / 2
    wider = NormalDist().inv_cdf(1.0 - tail / len(shells)) / NormalDist().inv_cdf(1.0 - tail)
    low = worst.mean - wider * (worst.mean - worst.low)
    high = worst.mean + wider * (worst.high - worst.mean)
    return worst._replace(low=low, high=high)


def _counts_in_shells(counts: np.ndarray, shells: list[tuple[int, int, int]]) -> np.ndarray:
    """Return the counts (S, shells) of pairs in the shells of `_shells`, from those in bins (S, P,
    R).
    """
    sums = [counts[:, pair, first:end].sum(axis=1) for pair, first, end in shells]
    return np.stack(sums, axis=1)


def _shells(counts: np.ndarray) -> list[tuple[int, int, int]]:
    """(pair, first bin, end) of every shell of counts (P, R); contact is the first bin with a
    count.
    """
    shells = []
    for pair, row in enumerate(counts):
        contact = int(np.argmax(row > 0))
        farthest = min(NEAR_CONTACT * (contact + 0.5), len(row))
        edges = np.unique(np.rint(np.linspace(contact, farthest, SHELLS + 1)).astype(int))
        for first, end in pairwise(edges):
            if row[first:end].sum() > 0:
                shells.append((pair, first, end))
    return shells


def spread_of_shares() -> float:
    """Return s such that the shares of n runs are on average at a distance s/sqrt(n) from the
    distribution.

    For rings of equal probability p each share has the standard deviation sqrt(p (1 - p)/n), and
    its mean absolute deviation is sqrt(2/pi) times that (normal approximation).
    """
    share = 1.0 / RINGS
    return float(RINGS / 2 * np.sqrt(2 / np.pi * share * (1 - share)))


def _indicators(distance: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(S, K): 1.0 for the ring in which each run ended."""
    ring = np.searchsorted(edges, distance, side="right") - 1
    return np.eye(len(edges) - 1)[np.minimum(ring, len(edges) - 2)]


def _half_sum(differences: np.ndarray) -> np.ndarray:
    return np.abs(differences).sum(axis=-1) / 2
