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

TIMES, WINDOWS = (0.2, 0.55, 1.0), ((0.1, 1.0), (0.5, 1.0))


def test_counts_and_tests_at_every_time_are_those_of_single_runs():
    """Of diffusers between walls, which they reach. In the square changes by ln MSD stand for those
    by ln D.
    """
    edges, runs = 0.2 * np.arange(18), make_runs(make_scene(), range(600), diffusion=0.8)
    track = runs.ensemble.tracer.position
    track[...] = 2.7 - np.abs((track + 2.7) % 10.8 - 5.4)
    dataset = aggregate([runs], WINDOWS, dr=0.2, rings=17, displacement_times=TIMES).squeeze()
    squared, times = (track**2).sum(axis=-1).T, runs.ensemble.times
    assert np.allclose(dataset.r, edges[1:] - 0.1)
    for k, t in enumerate(TIMES):
        one, r2 = dataset.isel(displacement_time=k), squared[:, round(t / 0.05)]
        slopes = [squared @ displacement.line_weights(times, window)[0] for window in WINDOWS]
        ring, msd = distribution.ring_of(np.sqrt(r2), edges), r2.mean()
        plane = [test_goodness.model(ring, each, edges, time=t) for each in (r2 / t, *slopes)]
        d = [
            theory.reflecting_square_diffusion(msd * change, t, 2.7)
            for change in (1, 1.0001, 0.9999)
        ]
        expected, more, less = (
            distribution.expected_ring_counts(600, edges, t, each, 2.7) for each in d
        )
        square = plane[0][0], expected, (more - less) / 2e-4, *plane[0][3:]
        found = [goodness.chi_square(*of_model) for of_model in (*plane, square)]
        of_runs, p = (
            [*one.displacement_counts, one.displacement_overflow],
            np.array([test.p for test in found]),
        )
        assert one.displacement_time == t and np.array_equal(of_runs, plane[0][0])
        of_models = [msd / (4 * t), *(slope.mean() / 4 for slope in slopes), d[0]]
        assert one.model_diffusion_coefficient.values == pytest.approx(of_models)
        assert np.append(one.expected_counts[3], one.expected_overflow[3]) == pytest.approx(
            expected
        )
        assert one.chi_square.values == pytest.approx([test.statistic for test in found])
        assert one.p_value.values == pytest.approx(p, rel=1e-3)
        assert one.kurtosis == pytest.approx((r2**2).mean() / (2 * msd**2))
        of_shape = goodness.kurtosis_p_value(float(one.kurtosis), 600)
        joint = np.minimum(2 * np.minimum(p[:3], of_shape), 1)
        assert one.p_value_joint.values == pytest.approx([*joint, p[3]], rel=1e-3)
        wrong = [
            distribution.expected_ring_counts(600, edges, t, msd / (4 * t) * scale)
            for scale in (0.95, 1.05)
        ]
        power = min(goodness.power(plane[0][1], other, goodness.LEVEL / 2) for other in wrong)
        assert one.power_5_percent[0] == pytest.approx(power)
        counts, z = plane[0][0][:-1], 1.959964  # E. B. Wilson, J. Am. Stat. Assoc. 22, 209 (1927)
        middle, reach = counts + z**2 / 2, z * np.sqrt(counts * (1 - counts / 600) + z**2 / 4)
        ends = one.displacement_counts_low.values, one.displacement_counts_high.values
        assert np.stack(ends) * (1 + z**2 / 600) == pytest.approx(
            np.stack([middle - reach, middle + reach]), abs=1e-4
        )


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
            one = found.isel(displacement_time=time).dropna("r", subset=["displacement_counts"])
            rms = np.sqrt(found.msd.sel(time=one.displacement_time, method="nearest").item())
            width = (one.r_outer - one.r_inner).values
            assert np.all(width == width[0]) and np.log2(width[0]) % 1 == 0
            assert (
                one.r_outer.values.tolist()[:-1] == one.r_inner.values.tolist()[1:]
                and 16 <= one.sizes["r"] <= 32
            )
            assert 3 * rms <= one.r_outer.values[-1] < 3 * rms + width[0]
            assert one.displacement_counts.sum() + one.displacement_overflow == 500
            assert (one.p_value.sel(model="msd") > 1e-4) and one.degrees_of_freedom.sel(
                model="msd"
            ) > 5


def test_rings_are_chosen_from_more_than_a_first_block_of_one_run(tmp_path):
    """Runs are read in blocks of 1,024 seeds; the first of these blocks ends after seed 24,575 and
    has a single run.

    This run ends at a twelfth of the rms displacement; of rings up to three times as far, 190 of
    200 runs were beyond.
    """
    found = aggregate([write(tmp_path, make_runs(make_scene(), range(24575, 24775)))]).squeeze()
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
    assert 3 * np.sqrt(found.msd[-1].item()) < 9.9 < found.r_outer[-1]
    assert found.displacement_overflow <= 0.03 * 240


def test_a_time_without_a_sample_is_refused_and_one_that_is_given_twice_counts_once(tmp_path):
    runs = write(tmp_path, make_runs(make_scene(), range(12)))
    with pytest.raises(AnalysisError, match=r"displacement time 0\.33: must be a sample time"):
        aggregate([runs], displacement_times=(0.33,))
    found = aggregate([runs], displacement_times=(0.2, 0.2000000001))
    assert found.displacement_counts.sum() + found.displacement_overflow.sum() == 12


# --- kurtosis


@pytest.mark.parametrize(("n", "least"), [(20, 0.89), (400, 0.91)])
def test_interval_of_the_kurtosis_covers(n, least):
    """Of a normal law, in 400 ensembles. 95 % of 20 runs and 94 % of 400 are expected, less
    between.
    """
    times, squared = 0.5 + np.arange(400), np.random.default_rng(n).exponential(1.0, (n, 400))
    rings = (0.1 * np.arange(11),) * 400
    case = estimator.Case(
        make_scene(), Engine("exact"), times, windows=WINDOWS, displacement_times=times, rings=rings
    )
    estimate = distribution.kurtosis(
        test_estimators.averages_of(case, {"square_displacement": squared}, distribution.ESTIMATOR)
    )
    assert least <= ((estimate.low < 1) & (estimate.high > 1)).mean() <= 0.99


# --- where the square is


def test_accessible_half_width():
    half = displacement.accessible_half_width
    assert half(make_scene()) == pytest.approx(2.7)
    assert half(make_scene(equilibrate={"time": 1.0, "tracer": "pinned"})) == pytest.approx(2.7)
    oblong = {"x": [-3.0, 3.0], "y": [-4.0, 4.0], "boundary": "reflecting"}
    for scene in (
        make_scene(boundary="periodic"),
        make_scene(box=oblong),
        make_scene(box=oblong | {"y": [-2.9, 3.1]}),
        make_scene(equilibrate={"time": 1.0, "tracer": "free"}),
    ):
        assert np.isnan(half(scene))
