"""Tests of eq. (18): true ensembles are rejected as often as stated, wrong ones with the stated
power.
"""

import math

import numpy as np
import pytest

from brownpipe.analysis import distribution, goodness
from brownpipe.analysis.displacement import line_weights

TIMES = np.arange(0, 1.01, 0.05)
SETS = 600
KNOWN = (np.zeros(6), np.zeros(6), 0.0)  # a D that does not depend on the counts


def ensembles(runs, edges, sets=SETS, seed=1, sample=-1):
    """Free diffusers, D = 1/4, that obey eq. (18): of each set r^2 and ring at a sample, three 4 D
    by run.
    """
    rng = np.random.default_rng(seed)
    weights = [line_weights(TIMES, window)[0] for window in ((0.1, 1.0), (0.5, 1.0))]
    for _ in range(sets):
        steps = rng.normal(0, math.sqrt(0.025), (runs, len(TIMES) - 1, 2))
        track = np.cumsum(steps, axis=1)
        later = (track**2).sum(axis=-1)
        squared = np.concatenate([np.zeros((runs, 1)), later], axis=1)
        at_sample = squared[:, sample]
        ring = distribution.ring_of(np.sqrt(at_sample), edges)
        estimates = at_sample / TIMES[sample], *(squared @ weight for weight in weights)
        yield at_sample, ring, estimates


def model(ring, estimate, edges, scale=1.0, time=1.0):
    """Counts, what eq. (18) expects with D from these estimates (times a scale), and the source of
    this D.
    """
    runs = len(ring)
    mean = estimate.mean()
    expected, more, less = (
        distribution.expected_ring_counts(runs, edges, time, mean / 4 * scale * factor)
        for factor in (1, 1.0001, 0.9999)
    )
    observed = np.bincount(ring, minlength=len(edges))
    shared = np.bincount(ring, estimate / mean - 1, len(edges))
    return observed, expected, (more - less) / 2e-4, shared, estimate.var() / mean**2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("runs", "width", "sample"), [(200, 0.1, -1), (2400, 0.04, -1), (400, 0.05, 4)]
)
def test_true_ensembles_are_rejected_as_often_as_stated(runs, width, sample):
    """At 5 % and at 1 %, within 4 standard errors (0.9 and 0.4 % of 600 sets) and 0.4 % for the
    approximations.

    With chi-square of K - 2 degrees the slope over [0.5, 1] is refused in 7 to 10 % at the 5 %
    level: more than that.
    """
    edges = width * np.arange(25)
    p = []
    joint = []
    for squared, ring, estimates in ensembles(runs, edges, sample=sample):
        kurtosis = (squared**2).mean() / (2 * squared.mean() ** 2)
        of_shape = goodness.kurtosis_p_value(kurtosis, runs)
        models = [model(ring, estimate, edges, time=TIMES[sample]) for estimate in estimates]
        of_counts = [goodness.chi_square(*columns).p for columns in models]
        p.append(of_counts)
        joint.append([goodness.both(of_model, of_shape) for of_model in of_counts])
    for level in (0.05, 0.01):
        bound = 4 * math.sqrt(level * (1 - level) / SETS) + 0.004
        rejected = np.mean(np.array(p) < level, axis=0)
        assert np.all(np.abs(rejected - level) < bound)
    rejected = np.mean(np.array(joint) < 0.01, axis=0)
    assert np.all(np.abs(rejected - 0.01) < 4 * math.sqrt(0.01 / SETS) + 0.004)


@pytest.mark.slow
def test_power_is_the_share_of_tests_that_reject_a_wrong_d():
    """D 5 % too large, from all three sources; within 4 standard errors of 300 sets and 3 % for the
    cumulants.
    """
    edges = 0.04 * np.arange(25)
    rejections = []
    powers = []
    for number, (_, ring, estimates) in enumerate(ensembles(2400, edges, 300, seed=2)):
        models = [model(ring, estimate, edges, 1.05) for estimate in estimates]
        rejections.append([goodness.chi_square(*columns).p < goodness.LEVEL for columns in models])
        if number >= 20:  # the power hardly differs from set to set
            continue
        powers_of_set = []
        for estimate in estimates:
            true = model(ring, estimate, edges)[1]
            d = estimate.mean() / 4 * 1.05
            wrong = distribution.expected_ring_counts(2400, edges, 1.0, d)
            powers_of_set.append(goodness.power(true, wrong))
        powers.append(powers_of_set)
    share = np.mean(rejections, axis=0)
    stated = np.mean(powers, axis=0)
    standard_error = np.sqrt(stated * (1 - stated) / 300)
    assert np.all(np.abs(share - stated) < 4 * standard_error + 0.03)
    assert np.all(stated > 0.02)


def test_a_known_d_gives_pearsons_chi_square():
    from scipy.stats import chisquare

    observed = [18, 25, 30, 27]
    expected = [20.0, 20.0, 35.0, 25.0]
    test = goodness.chi_square(observed, expected, *KNOWN)
    pearson = chisquare(observed, expected)
    assert (test.statistic, test.p) == pytest.approx(tuple(pearson))


def test_sparse_bins_are_pooled():
    sparse = goodness.chi_square([1, 2, 9, 10, 3, 1], [2.0, 4.0, 7.0, 9.0, 3.0, 1.0], *KNOWN)
    assert sparse == goodness.chi_square([3, 9, 14], [6.0, 7.0, 13.0], *KNOWN)
    assert sparse.degrees_of_freedom == 1
    assert np.isnan(goodness.chi_square([3, 4], [3.0, 4.0], *KNOWN).p)
    assert np.isnan(goodness.chi_square([30, 40, 50], [np.nan] * 3, *KNOWN).p)


def test_a_d_fitted_to_the_counts_costs_one_degree_of_freedom():
    """A maximum-likelihood fit has C = B/(B.B) and v = 1/(B.B): the weights are 0 and 1."""
    from scipy.stats import chi2

    edges = 0.1 * np.arange(21)
    expected, more, less = (
        distribution.expected_ring_counts(5000, edges, 1.0, d) for d in (0.25, 0.250025, 0.249975)
    )
    change = (more - less) / 2e-4
    information = (change**2 / expected).sum()
    counts = np.random.default_rng(1).multinomial(5000, expected / 5000)
    shared = 5000 * change / information
    test = goodness.chi_square(counts, expected, change, shared, 5000 / information)
    p = chi2.sf(test.statistic, test.degrees_of_freedom)
    assert test.p == pytest.approx(p, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("runs", "extra"), [(50, 0.008), (400, 0.002), (2400, 0.001)])
def test_the_kurtosis_is_tested_at_the_stated_level(runs, extra):
    """4,000 ensembles of exponential r^2, within 4 standard errors and what the docstring
    concedes.
    """
    squared = np.random.default_rng(runs).exponential(1.0, (4000, runs))
    kurtosis = (squared**2).mean(axis=1) / (2 * squared.mean(axis=1) ** 2)
    p = np.array([goodness.kurtosis_p_value(each, runs) for each in kurtosis])
    for level in (0.05, 0.01):
        tolerance = 4 * math.sqrt(level * (1 - level) / 4000) + extra
        assert abs(np.mean(p < level) - level) < tolerance


def test_holm_keeps_the_family_wise_level():
    """16 tests of which all hold, independent or all the same: one or more rejected in 5 % of
    tables or fewer.
    """
    rng = np.random.default_rng(1)
    tables = 4000
    independent = rng.random((tables, 16))
    alike = np.repeat(rng.random((tables, 1)), 16, axis=1)
    for p in (independent, alike):
        wrong = np.mean([goodness.holm(row).min() < 0.05 for row in p])
        assert 0.0 < wrong < 0.05 + 4 * math.sqrt(0.05 * 0.95 / tables)
    adjusted = goodness.holm([0.01, 0.04, np.nan, 0.03])
    assert adjusted == pytest.approx([0.03, 0.06, np.nan, 0.06], nan_ok=True)
