"""Estimators of a user's own: the example of the guide, and the mistakes that users make."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

import brownpipe as bp
from brownpipe.analysis.dataset import ESTIMATORS
from brownpipe.analysis.resampling import resample
from ensembles import make_scene

GUIDE = (Path(__file__).parents[1] / "docs" / "guide.md").read_text()
SECTION = GUIDE.partition("## An estimator of your own")[2]
EXAMPLE = re.search(r"```python\n(.*?)```", SECTION, re.DOTALL)[1]
CASE = ("scene", "particles", "engine")


@pytest.fixture(scope="module")
def far():
    """The estimator of the guide."""
    names = {}
    exec(EXAMPLE, names)
    return names["far"]


@pytest.fixture(scope="module")
def runs():
    return bp.simulate(make_scene(), seeds=30, quiet=True)


def mean_of_seeds(name="own", dims=CASE, coordinates=None, columns=None, results=None):
    """An estimator whose variable `name` is the mean of the seeds, or of other columns."""

    def seeds(case, runs):
        return bp.Columns({name: runs.seeds})

    variables = {name: bp.Variable(dims, "1", "mean of the seeds", ("standard_error",))}
    estimator = bp.Estimator("seeds", variables, columns or seeds)
    if results is not None:
        estimator = estimator._replace(results=lambda case, averages: results)
    return estimator._replace(coordinates=coordinates or {})


def test_the_example_of_the_guide_adds_its_variables(far, runs):
    result = bp.analyse(runs, estimators=[far], quiet=True)
    way = (runs.position - runs.position.isel(time=0)).values  # (time, seed, component)
    is_far = np.hypot(way[..., 0], way[..., 1]) > 1.0
    expected = resample(is_far.T).unless_alike()  # no error where no tracer is far
    shares = result.isel(scene=0, particles=0, engine=0)
    assert shares.far_share.dims == ("time",)
    assert shares.far_share.values == pytest.approx(expected.mean)
    assert shares.far_share_low.values == pytest.approx(expected.low, nan_ok=True)
    reached = shares.time.values[expected.mean >= 0.5]
    assert shares.far_time == min(reached, default=np.inf)
    assert result.far_share.attrs["long_name"] == "share of tracers beyond 1"
    assert result.attrs["estimators"] == "far"


def test_variables_of_brownpipe_are_the_same_with_an_estimator_of_ones_own(far, runs):
    alone = bp.analyse(runs, quiet=True)
    together = bp.analyse(runs, estimators=[far], quiet=True)
    for name in alone.variables:
        assert together[name].identical(alone[name]), name


def test_a_dataset_is_saved_opened_and_shown_without_the_estimator(far, runs, tmp_path):
    result = bp.analyse(runs, estimators=[far], quiet=True)
    bp.save(result, tmp_path / "far.nc")
    opened = bp.open(tmp_path / "far.nc")
    assert opened.identical(result)
    assert len(bp.table(opened)) == 1


def test_a_scan_has_the_variables_for_each_value_of_its_keys(far):
    masses = bp.scan(
        make_scene(), {"disks.tracer.mass": [4, 40]}, seeds=8, estimators=[far], quiet=True
    )
    assert masses.far_share.dims == ("scene", "tracer_mass", "particles", "engine", "time")
    heavy = make_scene().replace(**{"disks.tracer.mass": 40})
    runs = bp.simulate(heavy, seeds=8, quiet=True)
    alone = bp.analyse(runs, estimators=[far], quiet=True)
    expected = alone.far_share.values.ravel()
    assert masses.far_share.sel(tracer_mass=40).values.ravel() == pytest.approx(expected, abs=0)


def test_a_scan_refuses_an_estimator_before_it_makes_runs(monkeypatch):
    monkeypatch.setattr("brownpipe.interface.simulate", None)
    masses = {"disks.tracer.mass": [4, 40]}
    for name in ("msd", "tracer_mass"):
        with pytest.raises(bp.AnalysisError, match=f"seeds: {name}: is a name in datasets"):
            bp.scan(make_scene(), masses, estimators=[mean_of_seeds(name)])


def test_a_dataset_names_the_file_that_an_estimator_is_from(runs, tmp_path, monkeypatch):
    (tmp_path / "far_tracers.py").write_text(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    from far_tracers import far

    result = bp.analyse(runs, estimators=[far], quiet=True)
    digest = hashlib.sha256(EXAMPLE.encode()).hexdigest()
    assert result.attrs["estimators"] == f"far [far_tracers {digest[:12]}]"


def test_a_case_without_what_the_estimator_needs_has_nan(far, runs):
    untracked = bp.simulate(
        make_scene().replace(name="untracked"), seeds=12, record="none", quiet=True
    )
    result = bp.analyse([runs, untracked], estimators=[far], quiet=True)
    shares = result.far_share.isel(particles=0, engine=0, time=0)
    assert np.isnan(shares.sel(scene="untracked"))
    assert shares.isel(scene=0) == 0.0


def test_values_of_runs_and_an_axis_of_ones_own(runs):
    def columns(case, runs):
        return bp.Columns(run_values={"parity": runs.seeds % 2})

    def results(case, averages):
        return {"remainder": [0, 1], "count": np.bincount(averages.run_values["parity"])}

    variables = {
        "parity": bp.Variable((*CASE, "seed"), "1", "whether the seed is odd"),
        "count": bp.Variable((*CASE, "remainder"), "1", "runs with this remainder"),
    }
    remainder = bp.Variable(("remainder",), "1", "remainder of the seed by 2")
    estimator = bp.Estimator("parity", variables, columns, results, {"remainder": remainder})
    result = bp.analyse(runs, estimators=[estimator], quiet=True)
    assert result.parity.values.ravel().tolist() == [0, 1] * 15
    assert result["count"].values.ravel().tolist() == [15, 15]
    assert result.remainder.values.tolist() == [0, 1]


SEEDS = "estimator seeds"


@pytest.mark.parametrize(
    ("estimator", "problem"),
    [
        (mean_of_seeds("msd"), f"{SEEDS}: msd: is a name in datasets; choose another"),
        (
            mean_of_seeds("msd_over_4t_low"),
            f"{SEEDS}: msd_over_4t_low: is a name in datasets; choose another",
        ),
        (
            mean_of_seeds(dims=("scene", "time")),
            f"{SEEDS}: own: dimensions must begin with {CASE}, not ('scene', 'time')",
        ),
        (
            mean_of_seeds(dims=(*CASE, "height")),
            f"{SEEDS}: own: dimension height must be among its coordinates",
        ),
        (
            mean_of_seeds(
                dims=(*CASE, "height"),
                coordinates={"height": bp.Variable(("height",), "length", "height")},
            ),
            f"{SEEDS}: own: height, its dimension, has no values",
        ),
        (
            mean_of_seeds(coordinates={"own": bp.Variable(("own",), "1", "own")}),
            f"{SEEDS}: own: must be a variable or a coordinate, not both",
        ),
        (
            mean_of_seeds(coordinates={"side": bp.Variable(("time", "seed"), "1", "side")}),
            f"{SEEDS}: side: must have one dimension, not ('time', 'seed')",
        ),
        (
            mean_of_seeds(dims=(*CASE, "time")),
            f"{SEEDS}: own: must have (21,) values along ('time',), not ()",
        ),
        (
            mean_of_seeds(columns=lambda case, runs: bp.Columns({"own": np.zeros((4, 30))})),
            f"{SEEDS}: column own: must have a row for each of 30 runs, not the shape (4, 30)",
        ),
        (
            mean_of_seeds(columns=lambda case, runs: bp.Columns({"slope": runs.seeds})),
            f"{SEEDS}: slope is a column of another estimator; choose another name",
        ),
        (
            mean_of_seeds(results={"diffusion_coefficient": 1.0}),
            f"{SEEDS}: diffusion_coefficient is a result, but none of its variables",
        ),
    ],
)
def test_a_mistake_is_one_line_that_names_estimator_and_variable(runs, estimator, problem):
    with pytest.raises(bp.AnalysisError) as refusal:
        bp.analyse(runs, estimators=[estimator], quiet=True)
    assert str(refusal.value) == problem


def test_two_estimators_with_one_variable_and_what_is_none_are_refused(runs):
    with pytest.raises(bp.AnalysisError, match="seeds: own: is a name in datasets"):
        bp.analyse(runs, estimators=[mean_of_seeds(), mean_of_seeds()], quiet=True)
    with pytest.raises(bp.RequestError, match="must be of brownpipe"):
        bp.analyse(runs, estimators=[len], quiet=True)
    for not_a_list in (None, mean_of_seeds()):
        with pytest.raises(bp.RequestError, match=r"must be a list of brownpipe.Estimator, not "):
            bp.analyse(runs, estimators=not_a_list, quiet=True)


def test_what_brownpipe_declares_fits_itself():
    """The estimators of brownpipe pass what is asked of a user's own."""
    names = [name for estimator in ESTIMATORS for name in estimator.variables]
    assert len(names) == len({*names})
    for estimator in ESTIMATORS:
        assert all(variable.dims[:3] == CASE for variable in estimator.variables.values())
