"""How far an approximate result lies from the exact one, and how well that is known.

Every quantity is a mean over runs. Two engines that begin a seed from the same state give correlated runs until these
have forgotten it, and the exact engine often has more runs than the other. Both are put to use by double sampling with
regression (Cochran, Sampling Techniques, 3rd ed. 1977, chapter 12): the approximate mean is corrected by
slope * (mean of all exact runs - mean of the exact runs with the same seeds). Without common seeds the slope is 0 and
this is the difference of two independent means; with all seeds in common it is the mean of the paired differences.
"""

from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.resampling import replicates, resample

SHELLS, NEAR = 5, 1.25  # of equal width, from contact to so many contact distances, in which g(r) is compared
RINGS = 10  # of equal probability, in which displacement distributions are compared
CERTAIN = 0.95


class Bias(NamedTuple):
    """A relative difference from the exact mean, shape (...) like one run's entry, and its uncertainty."""

    value: np.ndarray  # NaN where the exact mean is not positive
    standard_error: np.ndarray
    low: np.ndarray  # 95 % interval; NaN for fewer runs than an interval needs
    high: np.ndarray

    @property
    def resolved(self):
        """Whether the 95 % interval leaves out 0."""
        return (self.low > 0.0) | (self.high < 0.0)

    @property
    def bound(self):
        """What the size of the bias stays below with 95 % confidence or more."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @property
    def square(self):
        """b^2 without the part that the scatter of b alone would give: max(b^2 - se^2, 0)."""
        return np.maximum(self.value**2 - self.standard_error**2, 0.0)

    @property
    def careful(self):
        """As `square` for a bias that is resolved; the square of its bound for one that is not."""
        return np.where(self.resolved, self.square, self.bound**2)


class Distance(NamedTuple):
    """The total variation distance of two distributions over rings."""

    value: float  # noise taken off; 0 where there is no more than noise
    low: float  # 95 % interval
    high: float
    noise: float  # what equal distributions would show on average with these runs


NO_DISTANCE = Distance(0.0, 0.0, 0.0, 0.0)


def none_of(exact):
    """The bias of the exact runs (S, ...) themselves: none."""
    return Bias(*(np.zeros(np.shape(exact)[1:]) for _ in Bias._fields))


def same_seeds(approximate, exact):
    """Indices (n,), (n,) of the seeds that both engines ran, in ascending order of the seeds."""
    _, mine, theirs = np.intersect1d(approximate, exact, assume_unique=True, return_indices=True)
    return mine, theirs


def relative_bias(approximate, exact, same=None):
    """Bias of the mean of `approximate` (S_a, ...) relative to that of `exact` (S_e, ...).

    `same` holds the indices of runs of equal seeds, `same_seeds`; runs without a partner are then left out of
    `approximate` and kept in `exact`. The interval joins those of the two independent terms (Zou and Donner, Statist.
    Med. 27, 1693 (2008), eq. 7), each by the bootstrap over runs.
    """
    shape = np.shape(exact)[1:]
    approximate, exact = (np.reshape(np.asarray(runs, float), (len(runs), -1)) for runs in (approximate, exact))
    mean = exact.mean(axis=0)
    defined = mean > 0.0
    scale = np.where(defined, mean, 1.0)
    residual, slope = _corrected(approximate / scale, exact / scale, same)
    value = residual.mean(axis=0) + (slope - 1.0) * mean / scale
    own, other = resample(residual), resample((1.0 + value - slope) * exact / scale)
    low = value - np.hypot(own.mean - own.low, other.high - other.mean)
    high = value + np.hypot(own.high - own.mean, other.mean - other.low)
    error = np.hypot(own.standard_error, other.standard_error)
    return Bias(*(np.where(defined, values, np.nan).reshape(shape) for values in (value, error, low, high)))


def _corrected(approximate, exact, same):
    """What is left of the approximate runs (n, Q) after regression on exact runs of the same seeds, and the slopes."""
    if same is None:
        return approximate, np.zeros(approximate.shape[1])
    mine, partner = approximate[same[0]], exact[same[1]]
    centred = partner - partner.mean(axis=0)
    square = (centred**2).sum(axis=0)
    slope = np.divide((centred * mine).sum(axis=0), square, out=np.zeros(len(square)), where=square > 0.0)
    return mine - slope * partner, slope


def total_variation(approximate, exact, same=None, rings=RINGS):
    """Distance between the distributions of displacements (S_a,) and (S_e,): half the sum of abs(p_a - p_e).

    Rings hold equal shares of the exact runs, so that no scene needs a choice of its own; differences inside a ring are
    not seen. Noise alone gives a positive distance, whose size the bootstrap shows: the distances of resampled
    shares from the shares found. Its mean is taken off in squares, its 95 % quantile q gives the interval: the true
    distance is within q of the one found (triangle inequality). That covers in more than 95 % of the cases.
    """
    edges = np.quantile(exact, np.linspace(0.0, 1.0, rings + 1))
    edges[0], edges[-1] = 0.0, np.inf
    mine, theirs = _indicators(approximate, edges), _indicators(exact, edges)
    slope = 0.0
    if same is not None:
        mine, partner = mine[same[0]], theirs[same[1]]
        slope = _common_slope(mine, partner)
        mine = mine - slope * partner
    found = _half_sum(mine.mean(axis=0) - (1.0 - slope) * theirs.mean(axis=0))
    noise = np.sort(_half_sum(replicates(mine) - (1.0 - slope) * replicates(theirs, other=True)))
    quantile = noise[int(np.ceil(CERTAIN * len(noise))) - 1]
    value = np.sqrt(max(found**2 - noise.mean() ** 2, 0.0))
    return Distance(float(value), float(max(found - quantile, 0.0)), float(found + quantile), float(noise.mean()))


def contact_deviation(approximate, exact, same=None):
    """Largest relative deviation of g(r) near contact, from pair counts (S_a, P, R) and (S_e, P, R) of the same scene.

    Shells of distance between contact and NEAR times that, for each of P pairs of species; of all shells the one whose
    deviation stands out most from its scatter. Its interval is widened as a choice among so many asks for (Bonferroni).
    None if the exact runs have no pair near contact.
    """
    shells = _shells(np.asarray(exact).sum(axis=0))
    if not shells:
        return None
    pooled = [np.stack([runs[:, p, k:m].sum(axis=1) for p, k, m in shells], axis=1) for runs in (approximate, exact)]
    found = relative_bias(*pooled, same)
    size = np.abs(found.value)
    sure = np.divide(size, found.standard_error, out=np.zeros_like(size), where=found.standard_error > 0.0)
    value, error, low, high = (part[int(np.nanargmax(sure))] for part in found)
    tail = (1.0 - CERTAIN) / 2
    wider = NormalDist().inv_cdf(1.0 - tail / len(shells)) / NormalDist().inv_cdf(1.0 - tail)
    return Bias(value, error, value - wider * (value - low), value + wider * (high - value))


def _shells(counts):
    """Pair, first bin and end of every shell; contact is the first bin (of R) in which exact runs have a pair."""
    shells = []
    for pair, row in enumerate(counts):
        contact = int(np.argmax(row > 0))
        edges = np.unique(np.rint(np.linspace(contact, min(NEAR * (contact + 0.5), len(row)), SHELLS + 1)).astype(int))
        shells += [(pair, k, m) for k, m in pairwise(edges) if row[k:m].sum() > 0]
    return shells


def spread_of_shares(rings=RINGS):
    """Mean distance of the shares of one run from the law, such that n runs are spread/sqrt(n) from it on average.

    For rings of equal probability p each share scatters by sqrt(p (1 - p)/n), on average sqrt(2/pi) times that.
    """
    share = 1.0 / rings
    return float(rings / 2 * np.sqrt(2 / np.pi * share * (1 - share)))


def _indicators(distance, edges):
    """(S, K): 1.0 for the ring in which each run ended."""
    ring = np.searchsorted(edges, distance, side="right") - 1
    return np.eye(len(edges) - 1)[np.minimum(ring, len(edges) - 2)]


def _common_slope(mine, partner):
    """One regression slope for all rings, which keeps the sum over rings at 0."""
    centred = partner - partner.mean(axis=0)
    square = (centred**2).sum()
    return float((centred * mine).sum() / square) if square > 0.0 else 0.0


def _half_sum(differences):
    return np.abs(differences).sum(axis=-1) / 2
