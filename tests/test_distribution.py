"""The distribution of the displacement at several times: counts, models, power, kurtosis."""

import numpy as np
import pytest

import test_estimators
from brownpipe import theory
from brownpipe.analysis import aggregate, displacement, distribution, estimator, goodness
from brownpipe.engines import Engine
from brownpipe.errors import AnalysisError
from ensembles import DIFFUSION, make_runs, make_scene, write

SIGMAS = 4.5
TIMES = (0.2, 0.55, 1.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    path = write(tmp_path_factory.mktemp("walk"), make_runs(make_scene(), range(600)))
    return aggregate([path], dr=0.06, rings=24, displacement_times=TIMES).squeeze()


def case_of(times, **more):
    """A case with rings of width 0.1."""
    edges = 0.1 * np.arange(11)
    return estimator.Case(make_scene(), Engine("exact"), times, windows=((0.0, 1.0),), edges=edges, **more)


def found_of(squared, at=(0,)):
    """What runs with the squared displacements (n, T) add up to, as the estimator sees them."""
    case = case_of(0.5 + np.arange(squared.shape[1]), displacement_times=tuple(0.5 + np.array(at)))
    case = case._replace(rings=(case.edges,) * len(at))
    return test_estimators.found_of(case, {"square_displacement": squared}, distribution)


def test_every_time_has_its_counts(dataset):
    assert dataset.displacement_time.values.tolist() == pytest.approx(TIMES)
    assert (dataset.displacement_counts.sum("r") + dataset.displacement_overflow == 600).all()
    times = np.array(TIMES)[:, None]
    expected = 600 * theory.ring_probability(dataset.r_inner.values, dataset.r_outer.values, times, DIFFUSION)
    assert (abs(dataset.displacement_counts - expected) < SIGMAS * np.sqrt(expected) + 1).all()


def test_models_take_d_from_their_own_time(dataset):
    msd = dataset.msd.sel(time=list(TIMES), method="nearest").values
    assert dataset.model_diffusion_coefficient.sel(model="msd").values == pytest.approx(msd / (4 * np.array(TIMES)))
    square = dataset.model_diffusion_coefficient.sel(model="square").values
    assert theory.reflecting_square_msd(np.array(TIMES), square, 2.7) == pytest.approx(msd, rel=1e-12)
    assert np.allclose(dataset.expected_counts.sum("r") + dataset.expected_overflow, 600)
    assert (dataset.p_value > 1e-4).all()  # 12 tests of a true model


@pytest.mark.slow
def test_a_distribution_that_is_not_normal_is_rejected(tmp_path):
    """D differs from run to run, so that more runs are near the start and far away than eq. (18) has it."""
    scene, rng = make_scene(boundary="periodic"), np.random.default_rng(1)
    trajectories = make_runs(scene, range(2000))
    track = trajectories.ensemble.tracer.position
    track *= np.sqrt(rng.gamma(4.0, 1 / 4.0, 2000))[:, None]  # kurtosis 1.25
    one = aggregate([write(tmp_path, trajectories)], dr=0.2, rings=3).squeeze().sel(model="msd")
    assert one.kurtosis.item() > 1.1 and one.kurtosis_p_value.item() < 1e-4 * one.p_value.item()
    assert one.p_value_joint.item() < goodness.LEVEL


# --- rings from the data


@pytest.mark.slow
def test_rings_suit_the_data_where_none_are_given(tmp_path):
    """Whatever the unit of length: 16 to 32 rings up to three rms displacements, of a width that is a power of two."""
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
            assert one.r_outer.values.tolist()[:-1] == one.r_inner.values.tolist()[1:] and 16 <= one.sizes["r"] <= 32
            assert 3 * rms <= one.r_outer.values[-1] < 3 * rms + width[0]
            assert one.displacement_counts.sum() + one.displacement_overflow == 500
            assert (one.p_value.sel(model="msd") > 1e-4) and one.degrees_of_freedom.sel(model="msd") > 5


def test_rings_are_chosen_from_more_than_a_first_block_of_one_run(tmp_path):
    """Runs are read in blocks of 1,024 seeds; the first of these blocks ends after seed 24,575 and has a single run.

    This run ends at a twelfth of the rms displacement; of rings up to three times as far, 190 of 200 runs were beyond.
    """
    found = aggregate([write(tmp_path, make_runs(make_scene(), range(24575, 24775)))]).squeeze()
    assert 3 * np.sqrt(found.msd[-1]) <= found.r_outer[-1]
    assert found.displacement_overflow <= 2


def test_a_few_percent_of_runs_are_beyond_the_last_ring_however_they_are_distributed(tmp_path):
    """One run in twelve goes 9.9 times as far as the others, 3.3 rms displacements: beyond three of them."""
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


@pytest.mark.slow
def test_kurtosis_and_its_error():
    """Of exponential r^2: 1, and log(m4/m2^2) has variance 1/n by the delta method."""
    n, sets = 4000, 300
    estimate = distribution.kurtosis(found_of(np.random.default_rng(2).exponential(1.0, (n, sets)), range(sets)))
    assert abs(estimate.mean.mean() - 1) < SIGMAS / np.sqrt(n * sets) + 2 / n  # the bias is -1/n
    scatter = estimate.mean.std(ddof=1)
    assert scatter == pytest.approx(estimate.standard_error.mean(), rel=SIGMAS / np.sqrt(2 * sets) + 0.05)


@pytest.mark.parametrize(("n", "least"), [(20, 0.89), (400, 0.91)])
def test_interval_of_the_kurtosis_covers(n, least):
    """Of a normal law, in 400 ensembles. 95 % of 20 runs and 94 % of 400 are expected, less between."""
    estimate = distribution.kurtosis(found_of(np.random.default_rng(n).exponential(1.0, (n, 400)), range(400)))
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
