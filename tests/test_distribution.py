"""The distribution of the displacement at several times: counts, models, power, kurtosis."""

import numpy as np
import pytest

import test_estimators
import test_goodness
from brownpipe import theory
from brownpipe.analysis import aggregate, displacement, distribution, estimator, goodness
from brownpipe.engines import Engine
from brownpipe.errors import AnalysisError
from ensembles import make_runs, make_scene, write
from scenes import CHANNEL_X, CHANNEL_Y

TIMES = (0.2, 0.55, 1.0)
WINDOWS = ((0.1, 1.0), (0.5, 1.0))


def test_counts_and_tests_at_every_time_are_those_of_single_runs():
    """Of diffusers between walls, which they reach. In the square changes by ln MSD stand for those
    by ln D.
    """
    edges = 0.2 * np.arange(18)
    runs = make_runs(make_scene(), range(600), diffusion=0.8)
    track = runs.ensemble.tracer.position
    track[...] = 2.7 - np.abs((track + 2.7) % 10.8 - 5.4)
    dataset = aggregate([runs], WINDOWS, dr=0.2, rings=17, displacement_times=TIMES).squeeze()
    squared = (track**2).sum(axis=-1).T
    times = runs.ensemble.times
    slopes = [squared @ displacement.line_weights(times, window)[0] for window in WINDOWS]
    assert np.allclose(dataset.r, edges[1:] - 0.1)
    for k, t in enumerate(TIMES):
        results = dataset.isel(displacement_time=k)
        r2 = squared[:, round(t / 0.05)]
        msd = r2.mean()
        ring = distribution.ring_of(np.sqrt(r2), edges)
        plane = [test_goodness.model(ring, each, edges, time=t) for each in (r2 / t, *slopes)]
        observed, of_msd, _, *source = plane[0]

        d, d_more, d_less = (
            theory.reflecting_square_diffusion(msd * change, t, 2.7)
            for change in (1, 1.0001, 0.9999)
        )
        expected = distribution.expected_ring_counts(600, edges, t, d, 2.7)
        more = distribution.expected_ring_counts(600, edges, t, d_more, 2.7)
        less = distribution.expected_ring_counts(600, edges, t, d_less, 2.7)
        square = (observed, expected, (more - less) / 2e-4, *source)
        tests = [goodness.chi_square(*model) for model in (*plane, square)]
        p = np.array([test.p for test in tests])
        counts = [*results.displacement_counts, results.displacement_overflow]
        assert results.displacement_time == t
        assert np.array_equal(counts, observed)
        coefficients = [msd / (4 * t), *(slope.mean() / 4 for slope in slopes), d]
        assert results.model_diffusion_coefficient.values == pytest.approx(coefficients)
        of_square = np.append(results.expected_counts[3], results.expected_overflow[3])
        assert of_square == pytest.approx(expected)
        statistics = [test.statistic for test in tests]
        assert results.chi_square.values == pytest.approx(statistics)
        assert results.p_value.values == pytest.approx(p, rel=1e-3)
        assert results.kurtosis == pytest.approx((r2**2).mean() / (2 * msd**2))
        of_shape = goodness.kurtosis_p_value(float(results.kurtosis), 600)
        joint = np.minimum(2 * np.minimum(p[:3], of_shape), 1)
        assert results.p_value_joint.values == pytest.approx([*joint, p[3]], rel=1e-3)
        powers = []
        for scale in (0.95, 1.05):
            wrong = distribution.expected_ring_counts(600, edges, t, msd / (4 * t) * scale)
            powers.append(goodness.power(of_msd, wrong, goodness.LEVEL / 2))
        assert results.power_5_percent[0] == pytest.approx(min(powers))
        # E. B. Wilson, J. Am. Stat. Assoc. 22, 209 (1927)
        within = observed[:-1]
        z = 1.959964
        middle = within + z**2 / 2
        reach = z * np.sqrt(within * (1 - within / 600) + z**2 / 4)
        low = results.displacement_counts_low.values * (1 + z**2 / 600)
        assert low == pytest.approx(middle - reach, abs=1e-4)
        high = results.displacement_counts_high.values * (1 + z**2 / 600)
        assert high == pytest.approx(middle + reach, abs=1e-4)


# --- rings from the data


@pytest.mark.slow
def test_rings_suit_the_data_where_none_are_given(tmp_path):
    """Whatever the unit of length: 16 to 32 rings up to three rms displacements, of a width that is
    a power of two.
    """
    scene = make_scene(boundary="periodic")
    for size in (1e-6, 1.0, 40.0):
        trajectories = make_runs(scene, range(500))
        trajectories.ensemble.tracer.position[...] *= size
        for path in tmp_path.iterdir():
            path.unlink()
        found = aggregate([write(tmp_path, trajectories)], displacement_times=(0.2, 1.0)).squeeze()
        for time in (0, 1):
            at_time = found.isel(displacement_time=time)
            rings = at_time.dropna("r", subset=["displacement_counts"])
            msd = found.msd.sel(time=rings.displacement_time, method="nearest").item()
            inner, outer = rings.r_inner.values, rings.r_outer.values
            width = outer - inner
            assert np.all(width == width[0])
            assert np.log2(width[0]) % 1 == 0
            assert outer.tolist()[:-1] == inner.tolist()[1:]
            assert 16 <= rings.sizes["r"] <= 32
            assert 3 * np.sqrt(msd) <= outer[-1] < 3 * np.sqrt(msd) + width[0]
            assert rings.displacement_counts.sum() + rings.displacement_overflow == 500
            of_msd = rings.sel(model="msd")
            assert of_msd.p_value > 1e-4
            assert of_msd.degrees_of_freedom > 5


def test_rings_are_chosen_from_more_than_a_first_block_of_one_run(tmp_path):
    """Runs are read in blocks of 1,024 seeds; the first of these blocks ends after seed 24,575 and
    has a single run.

    This run ends at a twelfth of the rms displacement; of rings up to three times as far, 190 of
    200 runs were beyond.
    """
    runs = make_runs(make_scene(), range(24575, 24775))
    found = aggregate([write(tmp_path, runs)]).squeeze()
    assert 3 * np.sqrt(found.msd[-1]) <= found.r_outer[-1]
    assert found.displacement_overflow <= 2


def test_a_few_percent_of_runs_are_beyond_the_last_ring_however_they_are_distributed(tmp_path):
    """One run in twelve goes 9.9 times as far as the others, 3.3 rms displacements: beyond three of
    them.
    """
    trajectories = make_runs(make_scene(boundary="periodic"), range(240))
    track = trajectories.ensemble.tracer.position
    track /= np.hypot(*track[-1].T)[:, None]
    track[:, ::12] *= 9.9
    found = aggregate([write(tmp_path, trajectories)]).squeeze()
    rms = np.sqrt(found.msd[-1].item())
    assert 3 * rms < 9.9 < found.r_outer[-1]
    assert found.displacement_overflow <= 0.03 * 240


def test_a_time_without_a_sample_is_refused_and_one_that_is_given_twice_counts_once(tmp_path):
    runs = write(tmp_path, make_runs(make_scene(), range(12)))
    with pytest.raises(AnalysisError, match=r"displacement time 0\.33: must be a sample time"):
        aggregate([runs], displacement_times=(0.33,))
    found = aggregate([runs], displacement_times=(0.2, 0.2000000001))
    assert found.displacement_counts.sum() + found.displacement_overflow.sum() == 12


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_no_distribution_with_one_diffusion_coefficient_is_tested_in_a_channel(boundary, tmp_path):
    """Rings of an anisotropic motion look like those of an isotropic one in few runs."""
    runs = make_runs(make_scene(boundary=boundary), range(60))
    tracer = runs.ensemble.tracer._replace(image=np.zeros((21, 60, 2), np.int32))
    channel = runs._replace(ensemble=runs.ensemble._replace(tracer=tracer))
    found = aggregate([write(tmp_path, channel)]).squeeze()
    assert found.displacement_counts.sum() + found.displacement_overflow == 60
    assert np.isnan(found.p_value_joint).all()
    assert np.isnan(found.model_diffusion_coefficient).all()


# --- kurtosis


@pytest.mark.parametrize(("n", "least"), [(20, 0.89), (400, 0.91)])
def test_interval_of_the_kurtosis_covers(n, least):
    """Of a normal law, in 400 ensembles. 95 % of 20 runs and 94 % of 400 are expected, less
    between.
    """
    times = 0.5 + np.arange(400)
    squared = np.random.default_rng(n).exponential(1.0, (n, 400))
    rings = (0.1 * np.arange(11),) * 400
    sampling = {"windows": WINDOWS, "displacement_times": times, "rings": rings}
    case = estimator.Case(make_scene(), Engine("exact"), times, **sampling)
    seen = {"square_displacement": squared}
    averages = test_estimators.averages_of(case, seen, distribution.ESTIMATOR)
    estimate = distribution.kurtosis(averages)
    covered = (estimate.low < 1) & (estimate.high > 1)
    assert least <= covered.mean() <= 0.99


# --- where the square is


def test_accessible_half_width():
    half = displacement.accessible_half_width
    assert half(make_scene()) == pytest.approx(2.7)
    assert half(make_scene(equilibrate={"time": 1.0, "tracer": "pinned"})) == pytest.approx(2.7)
    oblong = {"x": [-3.0, 3.0], "y": [-4.0, 4.0], "boundary": "reflecting"}
    for scene in (
        make_scene(boundary="periodic"),
        make_scene(boundary={"x": "reflecting", "y": "periodic"}),
        make_scene(box=oblong),
        make_scene(box=oblong | {"y": [-2.9, 3.1]}),
        make_scene(equilibrate={"time": 1.0, "tracer": "free"}),
    ):
        assert np.isnan(half(scene))
