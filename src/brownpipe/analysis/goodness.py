"""Goodness of fit of eq. (18): Pearson's chi-square with a D from the same runs, kurtosis, multiple tests.

O_k of n runs end in bin k of K; the model expects E_k(D). With D known, X^2 = sum (O_k - E_k)^2/E_k is chi-square
distributed with K - 1 degrees of freedom, and with D fitted to the counts by maximum likelihood with K - 2. Here D is
estimated otherwise from the same runs, by <r^2>/4t or the slope of the MSD: a mean over runs of some s_i, with relative
error delta. To first order the standardised counts are then Z_k - delta B_k with B_k = (dE_k/d ln D)/sqrt(E_k), where
Z and delta are jointly normal. The covariance of Z_k and Z_l is 1 for k = l, less sqrt(E_k E_l)/n; that of Z_k and
delta is C_k, the sum over the runs of bin k of (s_i/<s> - 1), over n sqrt(E_k); and delta has the variance
v = var(s)/(n <s>^2). So if the model holds,

    X^2 ~ chi2(K - 3) + l_1 chi2(1) + l_2 chi2(1),

where l_1 - 1 and l_2 - 1 are the eigenvalues of v B B' - B C' - C B', a matrix of rank two. H. Chernoff and
E. L. Lehmann, Ann. Math. Stat. 25, 579 (1954), treat a D fitted to single runs by maximum likelihood. See
docs/theory.md, section 5.
"""

import math
from fractions import Fraction
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from brownpipe.elementary import cos, exp, gauss_legendre, log, sin

FEWEST_EXPECTED = 5.0  # bins with fewer expected counts are pooled before a chi-square
LEVEL = 0.01  # significance level of the verdict on one model at one time
FAMILY_LEVEL = 0.05  # family-wise error rate of all tests of a table
INTEGRAL_END = 60.0  # upper limit of the integral over half the squared radius of two normal numbers: e^-60 < 1e-26
ANGLES, RADII = 48, 32  # nodes of the integral


class ChiSquare(NamedTuple):
    """The result of Pearson's test."""

    statistic: float
    degrees_of_freedom: int
    p: float  # probability of a larger statistic if the model holds; NaN without degrees of freedom


class Estimated(NamedTuple):
    """Correlation of the counts with a D that is estimated from the same runs."""

    change: np.ndarray  # (K,) dE_k/d ln D
    shared: np.ndarray  # (K,) sum over the runs of bin k of s_i/<s> - 1
    variance: float  # of s_i/<s> over runs


KNOWN = None  # source of a D that does not come from the runs


def chi_square(observed: np.ndarray, expected: np.ndarray, source: Estimated | None = KNOWN) -> ChiSquare:
    """Return Pearson's test of counts (K,) against expected counts (K,) of the same total.

    Neighbouring bins are pooled until each expects FEWEST_EXPECTED. The nominal number of degrees of freedom is that of
    the pooled bins minus one for the total and one for a D that is `Estimated`; p follows from the distribution at the
    head of this module.
    """
    pools, expected, weights = _linearised(expected, source)
    freedom = len(expected) - 1 - (source is not KNOWN)
    if freedom < 1 or not np.all(np.isfinite(expected)):
        return ChiSquare(np.nan, max(freedom, 0), np.nan)
    statistic = ((_pooled(observed, pools) - expected) ** 2 / expected).sum()
    return ChiSquare(statistic, freedom, upper_tail(statistic, *weights))


def power(expected: np.ndarray, others: np.ndarray, source: Estimated | None = KNOWN, level: float = LEVEL) -> float:
    """Return the power: the probability that `chi_square` rejects `expected` (K,) if `others` (K,) holds.

    X^2 is then taken for a noncentral chi-square with the nominal number of degrees of freedom. For a D from the same
    runs this is an approximation: for one that is 5 % wrong it gives 4 % where 5 or 6 % of 300 sets of 2,400 runs are
    rejected, and 61 % where 66 to 69 % of 150 sets of 16,000 are. NaN without degrees of freedom.
    """
    from scipy.special import chdtri, chndtr

    pools, expected, _ = _linearised(expected, source)
    others, freedom = _pooled(others, pools), len(expected) - 1 - (source is not KNOWN)
    if freedom < 1 or not np.all(np.isfinite(expected + others)):
        return np.nan
    return float(1.0 - chndtr(chdtri(freedom, level), freedom, ((others - expected) ** 2 / expected).sum()))


def _pools(expected: np.ndarray) -> list[int]:
    """First bins of pools of neighbouring bins that expect FEWEST_EXPECTED or more; the rest joins the last pool."""
    starts, pool = [0], 0.0
    for k, count in enumerate(expected):
        pool += count
        if pool >= FEWEST_EXPECTED and expected[k + 1 :].sum() >= FEWEST_EXPECTED:
            starts.append(k + 1)
            pool = 0.0
    return starts


def _pooled(values: np.ndarray, pools: list[int]) -> np.ndarray:
    """Sums over the bins of each pool."""
    return np.add.reduceat(np.asarray(values, float), pools)


def _linearised(expected: np.ndarray, source: Estimated | None) -> tuple[list[int], np.ndarray, tuple]:
    """Pools, counts E (K,) expected in them, and K - 3, l_1, l_2 of the module's head; B, C, v are 0 for a known D."""
    pools = _pools(np.asarray(expected, float))
    expected = _pooled(expected, pools)
    bb = bc = cc = v = 0.0
    if source is not KNOWN:
        runs, root = expected.sum(), np.sqrt(expected)
        b, c = _pooled(source.change, pools) / root, _pooled(source.shared, pools) / root / runs
        bb, bc, cc, v = (b * b).sum(), (b * c).sum(), (c * c).sum(), source.variance / runs
    middle = (v * bb - 2 * bc) / 2
    apart = np.sqrt(max(middle**2 + bb * cc - bc**2, 0.0))
    return pools, expected, (len(expected) - 3, max(1 + middle + apart, 0.0), max(1 + middle - apart, 0.0))


def upper_tail(x: float, ones: int, first: float, second: float) -> float:
    """Return P(chi2(ones) + first chi2(1) + second chi2(1) > x), for ones >= -1; -1 means first chi2(1) alone.

    The two squares in polar coordinates: half the squared radius is exponential, the angle uniform. By Gauss-Legendre
    quadrature over the former, in the root of its distance from the end, as the integrand may end like a root; and by
    equal steps of the latter. The relative error is below 1e-9 for weights up to 6 and p down to 1e-13, and below 1e-4
    for weights up to 200.
    """
    from scipy.special import gammaincc

    if ones < 0:
        return float(gammaincc(0.5, x / (2 * first))) if first > 0.0 else float(x <= 0.0)
    cos2, sin2 = _squares()
    weight = 2 * (first * cos2 + second * sin2)
    end = np.minimum(np.divide(x, weight, out=np.full(ANGLES, INTEGRAL_END), where=weight > 0.0), INTEGRAL_END)
    beyond = exp(-end)  # the two squares alone exceed x
    if ones == 0:
        return float(beyond.mean())
    nodes, weights = gauss_legendre(RADII)
    root = (nodes + 1) / 2  # of the distance from the end
    at = end[:, None] * (1 - root * root)
    inner = exp(-at) * gammaincc(ones / 2, np.maximum(x - weight[:, None] * at, 0.0) / 2)
    return float((beyond + end * (inner * weights * root).sum(axis=1)).mean())


@cache
def _squares() -> tuple[np.ndarray, np.ndarray]:
    """Return cos^2 and sin^2, (ANGLES,) each, at the middle of equal parts of a right angle."""
    angle = np.pi / 2 * (np.arange(ANGLES) + 0.5) / ANGLES
    return cos(angle) ** 2, sin(angle) ** 2


# --- kurtosis


def kurtosis_p_value(kurtosis: float, runs: int) -> float:
    """Return the two-sided p-value of <r^4>/(2 <r^2>^2) of a number of runs if eq. (18) holds; NaN below three runs.

    r^2 is then exponential, and the kurtosis is runs/2 times Greenwood's statistic, the sum of squares of the parts of
    the unit interval cut at random points (M. Greenwood, J. R. Stat. Soc. 109, 85 (1946); P. A. P. Moran, Suppl. J. R.
    Stat. Soc. 9, 92 (1947)). A shifted lognormal distribution has the same mean, variance and skewness: a test at 1 %
    rejects 1.5 % of ensembles of 50 runs, 1.1 % of 400 and 1.0 % of 2,400; at 0.16 %, the first step of Holm's
    procedure for 16 tests, 0.4, 0.2 and 0.2 %.
    """
    from scipy.special import ndtr

    if not (np.isfinite(kurtosis) and runs > 2):
        return np.nan
    shift, scale, width = _lognormal(int(runs))
    if kurtosis <= shift:
        return 0.0
    return float(2 * ndtr(-abs(log((kurtosis - shift) / scale)) / width))


@lru_cache(maxsize=64)
def _lognormal(runs: int) -> tuple[float, float, float]:
    """Shift, median minus shift, and width of the lognormal distribution with the kurtosis' first three moments."""
    mean, variance, skewness = _greenwood(runs)
    third = log(1 + skewness**2 / 2 + skewness * np.sqrt(1 + skewness**2 / 4)) / 3
    w = exp(third) + exp(-third) - 1  # exp(width^2): skewness = (w + 2) sqrt(w - 1)
    scale = np.sqrt(variance / (w * (w - 1)))
    return mean - scale * np.sqrt(w), scale, np.sqrt(log(w))


def _greenwood(n: int) -> tuple[float, float, float]:
    """Mean, variance and skewness of n/2 times the sum of squares of n random parts of 1, in exact fractions."""
    rising = {k: math.prod(range(n, n + k)) for k in (2, 4, 6)}  # n (n + 1) ... (n + k - 1)
    first = Fraction(2 * n, rising[2])
    second = Fraction(24 * n + 4 * n * (n - 1), rising[4])
    third = Fraction(720 * n + 144 * n * (n - 1) + 8 * n * (n - 1) * (n - 2), rising[6])
    variance = second - first**2
    skewness = float(third - 3 * first * second + 2 * first**3) / (float(variance) * math.sqrt(variance))
    return float(first * n / 2), float(variance * n * n / 4), skewness


# --- multiple tests


def in_words(p: float) -> str:
    """Return `p = 0.31`, `p = 0.0020`, or `p < 1e-12` where the number is not reliable."""
    return "p < 1e-12" if p < 1e-12 else f"p = {p:.2f}" if p >= 0.095 else f"p = {p:#.2g}"


def both(p: float, q: float) -> float:
    """Return the p-value of two tests of one hypothesis together (Bonferroni); p if q is NaN."""
    return float(p if np.isnan(q) else np.minimum(2 * np.minimum(p, q), 1.0))


def holm(p: np.ndarray) -> np.ndarray:
    """Return adjusted p-values (n,): rejecting those below a level has at most that family-wise error rate.

    S. Holm, Scand. J. Stat. 6, 65 (1979). NaN are left out.
    """
    p = np.asarray(p, float)
    order = np.argsort(p, kind="stable")  # NaN last
    tests = np.count_nonzero(np.isfinite(p))
    adjusted = np.full(len(p), np.nan)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.maximum(tests - np.arange(len(p)), 1)), 1.0)
    return adjusted
