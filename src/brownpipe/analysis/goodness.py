"""Goodness of fit of eq. (18): Pearson's chi-square with a D from the same runs, the kurtosis, several tests at once.

Of O_k of n runs in bin k the model expects E_k(D). With D known, X^2 = sum (O_k - E_k)^2/E_k is chi-square distributed
with K - 1 degrees of freedom, and with D fitted to the counts by maximum likelihood with K - 2. Here D is taken from
something else of the same runs, <r^2>/4t or the slope of the MSD: a mean over runs of some s_i, with relative error
delta. To first order the standardised counts are then Z_k - delta B_k with B_k = (dE_k/d ln D)/sqrt(E_k), where Z and
delta are jointly normal. The covariance of Z_k and Z_l is 1 for k = l, less sqrt(E_k E_l)/n; that of Z_k and delta is
C_k, the sum over the runs of bin k of (s_i/<s> - 1), over n sqrt(E_k); and delta has the variance v = var(s)/(n <s>^2).
So if the model holds,

    X^2 ~ chi2(K - 3) + l_1 chi2(1) + l_2 chi2(1),

where l_1, l_2 - 1 are the eigenvalues of v B B' - B C' - C B', of rank two. (H. Chernoff and E. L. Lehmann,
Ann. Math. Statist. 25, 579 (1954) treat D fitted to single runs by maximum likelihood.)
"""

from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np

FEWEST_EXPECTED = 5.0  # bins with fewer expected counts are pooled before a chi-square
LEVEL = 0.01  # of the verdict on one model at one time: the chance to reject it if it holds
FAMILY_LEVEL = 0.05  # of all tests of a table: the chance to reject one or more of them if all hold
LONGEST = 60.0  # of the mean of two squared normal numbers: beyond, their density is below 1e-26


class ChiSquare(NamedTuple):
    statistic: float
    degrees_of_freedom: int
    p: float  # chance of a larger statistic if the expectation is right; NaN without degrees of freedom


class Estimated(NamedTuple):
    """How a D that was estimated from the same runs goes with the counts."""

    change: np.ndarray  # (K,) dE_k/d ln D
    shared: np.ndarray  # (K,) sum over the runs of bin k of s_i/<s> - 1
    variance: float  # of s_i/<s> over runs
    elasticity: float = 1.0  # d ln D/d ln <s>


KNOWN = None  # a D that does not come from the runs


def chi_square(observed, expected, source=KNOWN):
    """Pearson's test of counts (K,) against expected counts of the same total; `source` says where D comes from.

    Neighbouring bins are pooled until each expects FEWEST_EXPECTED. One degree of freedom is lost to the total and, by
    name, one to a D that was `Estimated`; p follows from the distribution above.
    """
    pools = _pools(np.asarray(expected, float))
    observed, expected = _pooled(observed, pools), _pooled(expected, pools)
    freedom = len(expected) - 1 - (source is not KNOWN)
    if freedom < 1 or not np.all(np.isfinite(expected)):
        return ChiSquare(np.nan, max(freedom, 0), np.nan)
    statistic = ((observed - expected) ** 2 / expected).sum()
    return ChiSquare(statistic, freedom, upper_tail(statistic, *_law(expected, source, pools, observed.sum())))


def power(expected, others, source=KNOWN, level=LEVEL):
    """Chance that `chi_square` rejects `expected` (K,) at a level if the counts come from `others` (K,).

    X^2 is then |Z - delta B + h|^2 with h_k the difference over sqrt(E_k); its first three cumulants are matched by a
    gamma distribution (E. S. Pearson, Biometrika 46, 364 (1959)).
    """
    pools = _pools(np.asarray(expected, float))
    others, expected = _pooled(others, pools), _pooled(expected, pools)
    if len(expected) < 2 + (source is not KNOWN) or not np.all(np.isfinite(expected + others)):
        return np.nan
    runs, shift = expected.sum(), (others - expected) / np.sqrt(expected)
    ones, first, second = law = _law(expected, source, pools, runs)
    b, c, v = _vectors(expected, source, pools, runs)

    def covariance(h):
        root = np.sqrt(expected / runs)
        return h - root * (root * h).sum() - b * (c * h).sum() - c * (b * h).sum() + v * b * (b * h).sum()

    once, spread = covariance(shift), (shift**2).sum()
    mean = ones + first + second + spread
    along = max((shift * once).sum(), 0.0)  # negative only where the runs are far from the model
    variance = 2 * (ones + first**2 + second**2) + 4 * along
    third = 8 * (ones + first**3 + second**3) + 24 * (once**2).sum()
    from scipy.special import gammaincc

    shape = 4 * variance**3 / third**2
    return float(gammaincc(shape, max(shape + (_quantile(level, law) - mean) * np.sqrt(shape / variance), 0.0)))


def _pools(expected):
    """Where pools of neighbouring bins start that each expect enough; the rest joins the last pool."""
    starts, waiting = [0], 0.0
    for k, count in enumerate(expected):
        waiting += count
        if waiting >= FEWEST_EXPECTED and expected[k + 1 :].sum() >= FEWEST_EXPECTED:
            starts.append(k + 1)
            waiting = 0.0
    return starts


def _pooled(values, pools):
    return np.add.reduceat(np.asarray(values, float), pools)


def _vectors(expected, source, pools, runs):
    """B (K,), C (K,) and v of a D from the runs; zeros for a known one."""
    if source is KNOWN:
        return np.zeros(len(expected)), np.zeros(len(expected)), 0.0
    change, root = _pooled(source.change, pools), np.sqrt(expected)
    shared = source.elasticity * _pooled(source.shared, pools)
    return change / root, shared / root / runs, source.elasticity**2 * source.variance / runs


def _law(expected, source, pools, runs):
    """Number of unit terms and the two other weights (l_1, l_2) of the chi-squares that make up X^2."""
    b, c, v = _vectors(expected, source, pools, runs)
    bb, bc, cc = (b * b).sum(), (b * c).sum(), (c * c).sum()
    middle = (v * bb - 2 * bc) / 2
    apart = np.sqrt(max(middle**2 + bb * cc - bc**2, 0.0))
    return len(expected) - 3, max(1 + middle + apart, 0.0), max(1 + middle - apart, 0.0)


def upper_tail(x, ones, first, second):
    """P(chi2(ones) + first chi2(1) + second chi2(1) > x), for ones >= -1, -1 standing for first alone.

    The two squares in polar coordinates: half the squared radius is exponential, the angle uniform. By Simpson's rule
    over the one and equal steps of the other; to 1e-4 of the result.
    """
    from scipy.special import gammaincc

    if first == second == 1.0:
        return float(gammaincc(ones / 2 + 1, x / 2))
    if ones < 0:
        return float(gammaincc(0.5, x / (2 * first))) if first > 0.0 else float(x <= 0.0)
    angle = np.pi / 2 * (np.arange(48) + 0.5) / 48
    weight = 2 * (first * np.cos(angle) ** 2 + second * np.sin(angle) ** 2)
    end = np.minimum(np.divide(x, weight, out=np.full(48, LONGEST), where=weight > 0.0), LONGEST)
    at = end[:, None] * np.linspace(0, 1, 401)
    left = np.maximum(x - weight[:, None] * at, 0.0) / 2
    inner = np.exp(-at) * (gammaincc(ones / 2, left) if ones else left <= 0.0)
    simpson = np.where(np.arange(401) % 2, 4.0, 2.0)
    simpson[[0, -1]] = 1.0
    return float((np.exp(-end) + end / 1200 * (inner * simpson).sum(axis=1)).mean())


def _quantile(level, law):
    """The value that X^2 exceeds with probability `level`."""
    from scipy.optimize import brentq

    return brentq(lambda x: upper_tail(x, *law) - level, 0.0, 100.0 * sum(law) + 1000.0, rtol=1e-5)


# --- kurtosis


def kurtosis_p_value(kurtosis, runs):
    """Chance that <r^4>/(2 <r^2>^2) of so many runs is as far from 1, to either side, if eq. (18) holds.

    r^2 is exponential then, and the kurtosis is runs/2 times Greenwood's statistic, the sum of squares of random parts
    of 1 (M. Greenwood, J. R. Stat. Soc. 109, 85 (1946); P. A. P. Moran, Suppl. J. R. Stat. Soc. 9, 92 (1947)). Its
    mean, variance and skewness are matched by a shifted lognormal distribution: a 1 % test rejects 1.5 % of ensembles
    of 50 runs, 1.1 % of 400 and 1.0 % of 2,400; at 0.16 %, the first step of Holm for 16 tests, 0.4, 0.2 and 0.2 %.
    """
    from scipy.special import ndtr

    if not (np.isfinite(kurtosis) and runs > 2):
        return np.nan
    shift, scale, width = _lognormal(int(runs))
    if kurtosis <= shift:
        return 0.0
    return float(2 * ndtr(-abs(np.log((kurtosis - shift) / scale)) / width))


@lru_cache(maxsize=64)
def _lognormal(runs):
    """Shift, median less the shift, and width of the lognormal law with the kurtosis' first three moments."""
    mean, variance, skewness = _greenwood(runs)
    low, high = 1.0, 1e3
    for _ in range(200):  # of w = exp(width^2): skewness = (w + 2) sqrt(w - 1)
        w = (low + high) / 2
        low, high = (w, high) if (w + 2) * np.sqrt(w - 1) < skewness else (low, w)
    scale = np.sqrt(variance / (w * (w - 1)))
    return mean - scale * np.sqrt(w), scale, np.sqrt(np.log(w))


def _greenwood(n):
    """Mean, variance and skewness of n/2 times the sum of squares of n random parts of 1, exact until the end."""

    def rising(k):
        return Fraction(int(np.prod([n + j for j in range(k)], dtype=object)))

    first = Fraction(2 * n) / rising(2)
    second = Fraction(24 * n + 4 * n * (n - 1)) / rising(4)
    third = Fraction(720 * n + 144 * n * (n - 1) + 8 * n * (n - 1) * (n - 2)) / rising(6)
    variance = second - first**2
    skewness = float(third - 3 * first * second + 2 * first**3) / float(variance) ** 1.5
    return float(first * n / 2), float(variance * n * n / 4), skewness


# --- several tests at once


def in_words(p):
    """`p = 0.31`, `p = 0.0020`; what is smaller than it can be known is `p < 1e-12`."""
    return "p < 1e-12" if p < 1e-12 else f"p = {p:.2f}" if p >= 0.095 else f"p = {p:#.2g}"


def both(p, q):
    """p-value of two tests of one hypothesis together (Bonferroni); of one alone where the other is NaN."""
    one = np.fmin(p, q)
    return float(one if np.isnan(p) or np.isnan(q) else min(1.0, 2 * one))


def holm(p):
    """Adjusted p-values (n,): rejecting those below a level errs at all with at most that chance.

    S. Holm, Scand. J. Statist. 6, 65 (1979). NaN are left out.
    """
    p = np.asarray(p, float)
    order = np.argsort(p, kind="stable")  # NaN last
    tests = np.count_nonzero(np.isfinite(p))
    adjusted = np.full(len(p), np.nan)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.maximum(tests - np.arange(len(p)), 1)), 1.0)
    return adjusted
