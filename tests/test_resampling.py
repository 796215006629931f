"""Errors over runs: intervals that cover, weights that belong to seeds, the same bits on any number
of threads.
"""

import math
import tracemalloc

import numpy as np
import pytest

from brownpipe.analysis import displacement, resampling
from brownpipe.observables.displacement import squared
from ensembles import DIFFUSION, walk

SIGMAS = 4.5


def ensembles_of_diffusers(runs, count, seed):
    """r^2(1) and the slope over [0.1, 1] of every run: (runs, count, 2), in `count` ensembles."""
    rng = np.random.default_rng(seed)
    times = np.arange(11) * 0.1
    samples = []
    for _ in range(0, count, 50):
        r2 = squared(walk(rng, times, runs * 50)).T
        lines = displacement.per_run_lines(r2, times, ((0.1, 1.0),))
        last_and_slope = np.stack([r2[:, -1], lines[:, 0, 0]], axis=-1)
        samples.append(last_and_slope.reshape(runs, 50, 2))
    return np.concatenate(samples, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(("runs", "count"), [(20, 1000), (50, 1000), (400, 600), (2400, 600)])
def test_interval_covers_the_truth(runs, count):
    """95 +- 4 % of the ensembles, for MSD(1) and for the slope: 4.5 standard errors of 600
    ensembles, 5.8 of 1,000.
    """
    estimate = resampling.resample(ensembles_of_diffusers(runs, count, seed=runs))
    covered = (estimate.low < 4 * DIFFUSION) & (estimate.high > 4 * DIFFUSION)
    assert covered.mean(axis=0) == pytest.approx([0.95, 0.95], abs=0.04)


def test_sums_over_resampled_runs_have_no_round_off():
    """So no order of summation, number of threads or processor changes a bit of an interval."""
    samples = np.random.default_rng(6).exponential(1.0, (777, 5))
    columns = samples * [1.0, 1e-30, 1e20, np.pi, 0.0]
    columns[3, 0] = 1e6
    values, unit = resampling._on_a_grid(columns)
    weights = resampling._weights(0)[:20, :777]
    exact = np.zeros((20, 5))
    for replicate, column in np.ndindex(exact.shape):
        products = weights[replicate].astype(float) * values[:, column].astype(float)
        exact[replicate, column] = math.fsum(products)
    assert np.array_equal(weights @ values, exact)
    assert np.array_equal(weights[:, ::-1] @ values[::-1], exact)
    assert (np.abs(values * unit - columns) <= unit / 2).all()
    rms = np.sqrt((columns**2).mean(axis=0))
    assert (unit < 1e-3 * rms + 1e-7).all()


def test_weights_are_poisson_and_of_each_seed_alone():
    """Mean, variance and correlation of 2e6 weights within 4.5 standard errors; no replicate is
    near the bound.
    """
    weights = resampling._weights(7)
    others = resampling._weights(8)
    n = weights.size
    assert abs(weights.mean() - 1) < SIGMAS / np.sqrt(n)
    variance = np.square(weights - 1).mean()
    assert abs(variance - 1) < SIGMAS * np.sqrt(3 / n)  # the fourth central moment is 4
    covariance = ((weights - 1) * (others - 1)).mean()
    assert abs(covariance) < SIGMAS / np.sqrt(n)
    longest = np.square(weights).sum(axis=1).max()
    assert longest < 0.75 * resampling._LONGEST**2


def test_blocks_add_up():
    """Mean and error of many blocks are those of all runs at once, to round-off."""
    samples = np.random.default_rng(10).exponential(1.0, 5000) + 1e6
    seeds = np.arange(5000) * 3 + 17
    estimate = resampling.resample(samples, seeds)
    standard_error = samples.std(ddof=1) / np.sqrt(5000)
    assert estimate.mean == pytest.approx(samples.mean(), rel=1e-14)
    assert estimate.standard_error == pytest.approx(standard_error, rel=1e-9)
    assert estimate.low < estimate.mean < estimate.high


def test_too_few_runs():
    for values in resampling.resample(np.empty((0, 3))):
        assert np.isnan(values).all()
    single = resampling.resample(np.ones((1, 3)))
    assert single.mean.tolist() == [1, 1, 1]
    assert np.isnan(single.standard_error).all()
    nine = resampling.resample(np.arange(9.0))
    assert nine.standard_error == pytest.approx(np.arange(9).std(ddof=1) / 3)
    assert np.isnan(nine.low)
    alike = 0.1 + 0.2
    assert resampling.resample(np.full(12, alike)) == (alike, 0.0, alike, alike)


def test_events_of_up_to_three_runs_have_no_interval_and_those_of_more_one_that_covers():
    """Whatever their unit. The bootstrap-t of runs with three of 20 events on average covers in 82
    % of ensembles.
    """
    share = np.repeat([0.1, 0.15, 0.2, 0.8], 1000)
    unit = np.tile([1.0, 0.7, 2.17, 1e-9], 1000)
    seen = np.random.default_rng(3).random((20, 4000)) < share
    events = np.minimum(seen.sum(axis=0), 20 - seen.sum(axis=0))
    estimate = resampling.resample(unit * seen)
    interval = np.array([estimate.low, estimate.high])
    assert np.isnan(interval[:, (events > 0) & (events < 4)]).all()
    assert np.isfinite(interval[:, events > 4]).all()
    missed = (estimate.low > unit * share) | (estimate.high < unit * share)
    assert missed[events > 0].mean() < 0.05


def test_wilson_interval_covers():
    """Exact coverage, summed over the binomial law, for counts like those of a ring."""
    from scipy.stats import binom

    runs = 2400
    k = np.arange(301)
    low, high = resampling.wilson_interval(k, runs)
    for p in np.array([4.0, 10.0, 30.0, 85.0]) / runs:
        covers = (low <= runs * p) & (runs * p <= high)
        coverage = binom.pmf(k, runs, p)[covers].sum()
        assert coverage == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize(("expected", "runs"), [(0.1, 10), (0.3, 10), (1.9, 10), (0.05, 100)])
def test_rare_pairs_have_an_interval_that_covers(expected, runs):
    """Poisson numbers of pairs in 600 ensembles; 95 % less four standard errors is 91.4 %."""
    counts = np.random.default_rng(7).poisson(expected, (runs, 600)).astype(float)
    wilson_low, wilson_high = resampling.wilson_interval(counts.sum(axis=0))
    estimate = resampling.resample(counts)
    low = np.fmin(wilson_low / runs, estimate.low)
    high = np.fmax(wilson_high / runs, estimate.high)
    covered = (low <= expected) & (expected <= high)
    assert covered.mean() > 0.914


def test_intervals_of_many_quantities_take_little_memory_beside_their_sums():
    """MSD and autocorrelation at 10,000 times would otherwise take gigabytes."""
    samples = np.random.default_rng(1).random((20, 8 * resampling._AT_ONCE))
    sums = resampling._added_up(np.arange(20), samples)
    tracemalloc.start()
    resampling.estimate(sums)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < sums.first.nbytes  # 64 MB; all columns at once take five times as much
