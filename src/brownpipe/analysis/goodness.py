"""Goodness of fit of eq. (18): Pearson's chi-square with a D from the same runs, kurtosis, multiple
tests.

O_k of n runs end in bin k of K; the model expects E_k(D). With D known, X^2 = sum (O_k - E_k)^2/E_k
is chi-square distributed with K - 1 degrees of freedom, and with D fitted to the counts by maximum
likelihood with K - 2. Here D is estimated otherwise from the same runs, by <r^2>/4t or the slope of
the MSD: a mean over runs of some s_i, with relative error delta. To first order the standardised
counts are then Z_k - delta B_k with B_k = (dE_k/d ln D)/sqrt(E_k), where Z and delta are jointly
normal. The covariance of Z_k and Z_l is 1 for k = l, less sqrt(E_k E_l)/n; that of Z_k and delta is
C_k, the sum over the runs of bin k of (s_i/<s> - 1), over n sqrt(E_k); and delta has the variance
v = var(s)/(n <s>^2). So if the model holds,

    X^2 ~ chi2(K - 3) + l_1 chi2(1) + l_2 chi2(1),

where l_1 - 1 and l_2 - 1 are the eigenvalues of v B B' - B C' - C B', a matrix of rank two. This
sum is approximated by a chi-square, shifted and scaled to the same mean, variance and skewness (J.
P. Imhof, Biometrika 48, 419 (1961), eq. 4.1, after E. S. Pearson); this is exact for a D that is
known or fitted to the counts. H. Chernoff and E. L. Lehmann, Ann. Math. Stat. 25, 579 (1954), treat
a D fitted to single runs by maximum likelihood. See docs/theory.md, section 5.
"""

from typing import NamedTuple

import numpy as np

FEWEST_EXPECTED = 5.0  # bins with fewer expected counts are pooled before a chi-square
LEVEL = 0.01  # significance level of the verdict on one model at one time
FAMILY_LEVEL = 0.05  # family-wise error rate of all tests of a table
LEAST = 1e-6  # p-values below are not reliable


class ChiSquare(NamedTuple):
    """The result of Pearson's test."""

    statistic: float
    degrees_of_freedom: int
    p: float  # probability of a larger statistic if the model holds; NaN without degrees of freedom


def chi_square(
    observed: np.ndarray,
    expected: np.ndarray,
    change: np.ndarray,
    shared: np.ndarray,
    variance: float,
) -> ChiSquare:
    """Return Pearson's test of counts (K,) against expected counts (K,) of the same total, for a D
    from the same runs.

    change: (K,) dE_k/d ln D. shared: (K,) sum over the runs of bin k of s_i/<s> - 1. variance: of
    s_i/<s> over runs. Neighbouring bins are pooled until each expects FEWEST_EXPECTED. The nominal
    number of degrees of freedom is that of the pooled bins minus one for the total and one for D; p
    follows from the distribution at the head of this module.
    """
    from scipy.special import gammaincc

    observed, expected, change, shared = _pooled(expected, observed, expected, change, shared)
    freedom = len(expected) - 2
    if freedom < 1 or not np.all(np.isfinite(expected)):
        return ChiSquare(np.nan, max(freedom, 0), np.nan)
    runs = expected.sum()
    root = np.sqrt(expected)
    b = change / root
    c = shared / root / runs
    bb = (b * b).sum()
    bc = (b * c).sum()
    cc = (c * c).sum()
    middle = variance / runs * bb / 2 - bc
    apart = np.sqrt(max(middle**2 + bb * cc - bc**2, 0.0))
    weights = np.maximum([1 + middle + apart, 1 + middle - apart], 0.0)  # l_1, l_2
    statistic = ((observed - expected) ** 2 / expected).sum()
    first = len(expected) - 3 + weights.sum()
    second = len(expected) - 3 + (weights**2).sum()
    third = len(expected) - 3 + (weights**3).sum()
    degrees = (second / third) ** 2 * second
    scaled = degrees + (statistic - first) * np.sqrt(degrees / second)
    p = gammaincc(degrees / 2, max(scaled, 0.0) / 2)
    return ChiSquare(statistic, freedom, float(p))


def power(expected: np.ndarray, others: np.ndarray, level: float = LEVEL) -> float:
    """Return the power: the probability that `chi_square` rejects `expected` (K,) if `others` (K,)
    holds.

    X^2 is then treated as a noncentral chi-square with the nominal number of degrees of freedom.
    For a D from the same runs this is an approximation: for a D that is 5 % wrong it gives 4 %
    where 5 or 6 % of 300 sets of 2,400 runs are rejected, and 61 % where 66 to 69 % of 150 sets of
    16,000 are. NaN without degrees of freedom.
    """
    from scipy.special import chdtri, chndtr

    expected, others = _pooled(expected, expected, others)
    freedom = len(expected) - 2
    if freedom < 1 or not np.all(np.isfinite(expected + others)):
        return np.nan
    critical = chdtri(freedom, level)
    noncentrality = ((others - expected) ** 2 / expected).sum()
    return float(1.0 - chndtr(critical, freedom, noncentrality))


def _pooled(expected: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Return sums over pools of neighbouring bins that expect FEWEST_EXPECTED or more; the rest
    joins the last pool.

    >>> _pooled(np.array([6.0, 2.0, 3.0, 1.0]), np.array([7, 1, 3, 1]))
    [array([7., 5.])]
    """
    starts = [0]
    for k in range(1, len(expected)):
        if np.sum(expected[starts[-1] : k]) >= FEWEST_EXPECTED <= np.sum(expected[k:]):
            starts.append(k)
    return [np.add.reduceat(np.asarray(counts, float), starts) for counts in values]


# --- kurtosis


def kurtosis_p_value(kurtosis: float, runs: int) -> float:
    """Return the two-sided p-value of <r^4>/(2 <r^2>^2) of a number of runs if eq. (18) holds; NaN
    below three runs.

    r^2 is then exponential, and the kurtosis is runs/2 times Greenwood's statistic, the sum of
    squares of the parts of the unit interval cut at random points (M. Greenwood, J. R. Stat. Soc.
    109, 85 (1946); P. A. P. Moran, Suppl. J. R. Stat. Soc. 9, 92 (1947)). A shifted lognormal
    distribution has the same mean, variance and skewness: a test at 1 % rejects 1.5 % of ensembles
    of 50 runs, 1.1 % of 400 and 1.0 % of 2,400; at 0.16 %, the first step of Holm's procedure for
    16 tests, 0.4, 0.2 and 0.2 %.
    """
    from scipy.special import ndtr

    if not (np.isfinite(kurtosis) and runs > 2):
        return np.nan
    n = int(runs)
    variance = n**2 * (n - 1) / ((n + 1) ** 2 * (n + 2) * (n + 3))
    ratio = (n + 2) * (n + 3) / (n - 1)
    skewness = 2 * (5 * n - 7) / ((n + 4) * (n + 5)) * np.sqrt(ratio)
    root = np.sqrt(1 + skewness**2 / 4)
    third = np.log(1 + skewness**2 / 2 + skewness * root) / 3
    w = np.exp(third) + np.exp(-third) - 1  # exp(width^2): skewness = (w + 2) sqrt(w - 1)
    median = np.sqrt(variance / (w * (w - 1)))  # less the shift
    mean = n / (n + 1)  # of the kurtosis
    shifted = kurtosis - mean + median * np.sqrt(w)
    if not shifted > 0.0:
        return 0.0
    deviation = np.log(shifted / median) / np.sqrt(np.log(w))
    return float(2 * ndtr(-abs(deviation)))


# --- multiple tests


def p_value_in_words(p: float) -> str:
    """Return a p-value with two digits, and `p < 1e-06` where the number is not reliable.

    >>> p_value_in_words(0.312), p_value_in_words(0.002), p_value_in_words(1e-9)
    ('p = 0.31', 'p = 0.0020', 'p < 1e-06')
    """
    if p < LEAST:
        return f"p < {LEAST:g}"
    return f"p = {p:.2f}" if p >= 0.095 else f"p = {p:#.2g}"


def change_found_with_power(error: np.ndarray, runs: int, level: float, power: float) -> np.ndarray:
    """Return the changes (Q,) that a two-sided t-test over runs finds with a probability.

    `error`: their standard errors (Q,) over that number of `runs`, in whose units the result is.
    `power`: the probability, each test alone.
    """
    from scipy.special import stdtrit

    critical = stdtrit(runs - 1, 1 - level / 2)
    return error * (critical + stdtrit(runs - 1, power))


def both(p: float, q: float) -> float:
    """Return the p-value of two tests of one hypothesis together (Bonferroni); p if q is NaN."""
    return float(p if np.isnan(q) else np.minimum(2 * np.minimum(p, q), 1.0))


def holm(p: np.ndarray) -> np.ndarray:
    """Return adjusted p-values (n,): rejecting those below a level has at most that family-wise
    error rate.

    S. Holm, Scand. J. Stat. 6, 65 (1979). NaN are left out.

    >>> holm(np.array([0.01, np.nan, 0.03]))
    array([0.02,  nan, 0.03])
    """
    p = np.asarray(p, float)
    order = np.argsort(p, kind="stable")  # NaN last
    tests = np.count_nonzero(np.isfinite(p))
    adjusted = np.full(len(p), np.nan)
    remaining = np.maximum(tests - np.arange(len(p)), 1)  # tests at each step
    steps = np.maximum.accumulate(p[order] * remaining)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted
