"""The distribution of the displacement at several times: counts, models, power, kurtosis."""

import numpy as np
import pytest

from brownpipe import theory
from brownpipe.analysis import AnalysisError, aggregate, conditions, distribution, measure, runs
from ensembles import DIFFUSION, make_runs, make_scene, write

SIGMAS = 4.5
TIMES = (0.2, 0.55, 1.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    path = write(tmp_path_factory.mktemp("walk"), make_runs(make_scene(), range(600)))
    return aggregate([path], dr=0.06, displacement_times=TIMES).squeeze()


def found_of(squared, at=(0,)):
    """What runs with the squared displacements (n, T) add up to, as the measure sees them."""
    asked = measure.Asked(((0.0, 1.0),), distribution.ring_edges(0.1, 10), tuple(0.5 + np.array(at)))
    case = measure.Case(make_scene(), "exact", 0.5 + np.arange(squared.shape[1]), asked)
    found = measure.NOTHING
    for seeds in np.split(np.arange(len(squared)), range(1024, len(squared), 1024)):
        one = runs.Runs(seeds, None, {"square_displacement": squared[seeds]})
        found = measure.add_runs(found, seeds, distribution.MEASURE.sample(case, one))
    return found


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


def test_verdict_says_p_and_power(dataset):
    one = dataset.isel(displacement_time=0).sel(model="msd")
    assert one.verdict.item() == distribution.verdict(one.p_value.item(), one.power_5_percent.item())
    assert distribution.verdict(0.3, 0.123).startswith("not ruled out, p = 0.3; ")
    assert distribution.verdict(1e-5, 0.9).startswith("ruled out, p = 1e-05; ")
    assert distribution.verdict(np.nan, np.nan).startswith("not tested")


def test_power_is_the_share_of_tests_that_see_it():
    """2,000 sets of 2,400 diffusers, tested against a D 5 % too small that is not fitted to them."""
    rng, edges, n = np.random.default_rng(1), distribution.ring_edges(0.04, 24), 2400
    said, true = (distribution.expected_ring_counts(n, edges, 1.0, d) for d in (0.25, 0.2625))
    sets = rng.multinomial(n, true / n, 2000)
    refused = np.mean([distribution.chi_square(counts, said, fitted=0).p < 0.05 for counts in sets])
    assert abs(refused - distribution.power(said, true, fitted=0)) < SIGMAS * np.sqrt(0.25 / 2000)


def test_distribution_of_an_average_is_none():
    """Averages over time origins are no displacements: they have an MSD, and no distribution."""
    asked = measure.Asked(((0.0, 1.0),), distribution.ring_edges(0.1, 10), ())
    case = measure.Case(make_scene(), "exact", np.arange(3.0), asked, "origins")
    squared = runs.Runs(np.arange(20), None, {"square_displacement": np.ones((20, 3))})
    assert distribution.MEASURE.sample(case, squared).means == {}


@pytest.mark.parametrize(("times", "message"), [
    ((0.2, 0.2000000001), "displacement time 0.2: must be given once"),
    ((0.33,), "displacement time 0.33: must be a sample time"),
])  # fmt: skip
def test_times_that_are_wrong_are_refused(tmp_path, times, message):
    with pytest.raises(AnalysisError, match=message):
        aggregate([write(tmp_path, make_runs(make_scene(), range(12)))], displacement_times=times)


# --- kurtosis


def test_kurtosis_and_its_error():
    """Of exponential r^2: 1, and log(m4/m2^2) has variance 1/n by the delta method."""
    n, sets = 4000, 300
    squared = np.random.default_rng(2).exponential(1.0, (n, sets))
    estimate = distribution.kurtosis(found_of(squared, range(sets)))
    assert abs(estimate.mean.mean() - 1) < SIGMAS / np.sqrt(n * sets) + 2 / n  # the bias is -1/n
    scatter = estimate.mean.std(ddof=1)
    assert scatter == pytest.approx(estimate.standard_error.mean(), rel=SIGMAS / np.sqrt(2 * sets) + 0.05)


def test_kurtosis_of_a_square_is_below_one():
    x = np.random.default_rng(3).uniform(-1, 1, (20000, 2))
    estimate = distribution.kurtosis(found_of((x**2).sum(axis=1)[:, None]))
    assert abs(estimate.mean[0] - (2 / 5 + 2 / 9) / (2 * (2 / 3) ** 2)) < SIGMAS * estimate.standard_error[0]


@pytest.mark.parametrize(("n", "least"), [(20, 0.89), (400, 0.91)])
def test_interval_of_the_kurtosis_covers(n, least):
    """Of a normal law, in 400 ensembles. 95 % of 20 runs and 94 % of 400 are expected, less between."""
    estimate = distribution.kurtosis(found_of(np.random.default_rng(n).exponential(1.0, (n, 400)), range(400)))
    assert least <= ((estimate.low < 1) & (estimate.high > 1)).mean() <= 0.99


def test_no_kurtosis_at_the_start():
    assert np.isnan(distribution.kurtosis(found_of(np.zeros((20, 1)))).mean).all()


# --- where the square is


def test_accessible_half_width():
    half = conditions.accessible_half_width
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
