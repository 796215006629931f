"""When the tracer leaves the circle of its radius: by hand, by its samples, over runs."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import brownpipe as bp
from brownpipe.engines import Engine
from brownpipe.errors import RequestError
from brownpipe.figures.summary import summary
from brownpipe.observables.first_passage import exit_time
from brownpipe.observables.trajectory import DiskPath
from brownpipe.storage.configurations import read_scene
from brownpipe.study import read_study
from ensembles import make_scene

NOTE = "config/scenes/harrison2020.yaml"
ALONE = [{"position": [-1.0, 0.5], "velocity": [3.0, 4.0], "radius": 0.5, "mass": 2.0}]
AT_REST = [ALONE[0] | {"velocity": [0.0, 0.0]}]
PASSAGE = ["first_passage"]


@pytest.fixture(scope="module")
def runs():
    """Runs of the note's scene, some of which end before the tracer leaves the circle."""
    scene = read_scene(NOTE).replace(duration=0.4)
    return bp.simulate(scene, 40, record="velocity,events", observables=PASSAGE, quiet=True)


@pytest.fixture(scope="module")
def result(runs):
    return bp.analyse(runs, quiet=True).squeeze()


@pytest.mark.parametrize("boundary", ["reflecting", "periodic"])
def test_a_disk_without_collisions_leaves_after_radius_over_speed(boundary):
    scene = make_scene(disks=ALONE, particles=1, boundary=boundary)
    runs = bp.simulate(scene, observables=PASSAGE, quiet=True)
    assert runs.first_passage_time.item() == pytest.approx(0.5 / 5.0, rel=1e-15)
    assert "events" not in runs.children


def test_a_disk_that_stays_does_not_leave():
    scene = make_scene(disks=AT_REST, particles=1)
    runs = bp.simulate(scene, observables=PASSAGE, quiet=True)
    assert np.isnan(runs.first_passage_time.item())
    result = bp.analyse(runs, quiet=True).squeeze()
    assert (result.first_passage_survival == 1).all()
    assert np.isnan(result.first_passage_median)
    assert result.first_passage_survival_low.isnull().all()


def test_a_path_that_turns_back_and_leaves_elsewhere():
    """Out to 0.6, back through the start, and out on the other side at R = 1."""
    velocity = np.array([[1.0, 0.0], [-2.0, 0.0], [-2.0, 0.0]])
    position = np.array([[5.0, 1.0], [5.6, 1.0], [2.0, 1.0]])
    path = DiskPath(np.array([0.0, 0.6, 2.4]), position, velocity)
    assert exit_time(path, 1.0) == pytest.approx(0.6 + 1.6 / 2.0, rel=1e-15)
    assert exit_time(path, 0.25) == 0.25
    assert math.isnan(exit_time(path, 3.5))


def test_samples_see_the_passage_late_by_less_than_an_interval(runs):
    """Unless the tracer comes back before the next sample, as few do."""
    way = runs.unwrapped - runs.unwrapped.isel(time=0)
    is_outside = np.hypot(*way.transpose("component", ...)) > 0.3
    first_sample = runs.time.where(is_outside).min("time")
    passages = runs.first_passage_time
    lateness = (first_sample - passages).dropna("seed")
    assert 20 < lateness.size < 40
    assert (lateness >= 0).all()
    assert (lateness < runs.time[1]).mean() > 0.8
    assert first_sample.where(passages.isnull()).isnull().all()


def test_the_tracer_is_at_the_rim_at_its_passage(runs):
    passages = runs.first_passage_time.dropna("seed")
    for seed in passages.seed.values.tolist():
        path = bp.path(runs, seed)
        way = path.position - path.position[0]
        time = float(passages.sel(seed=seed))
        x, y = (np.interp(time, path.time, column) for column in way.values.T)
        assert math.hypot(x, y) == pytest.approx(0.3, rel=1e-12)


def test_the_curve_is_that_of_scipy(runs, result):
    passages = runs.first_passage_time.values
    has_left = np.isfinite(passages)
    ends = np.full(np.count_nonzero(~has_left), 0.4)
    survival = stats.ecdf(stats.CensoredData(passages[has_left], right=ends)).sf
    curve = result.first_passage_survival
    assert np.array_equal(curve, survival.evaluate(runs.time))
    # all runs are as long: the share of those that are inside
    inside = [np.mean(~(passages <= time)) for time in runs.time.values]
    assert np.allclose(curve, inside, rtol=1e-14, atol=0)
    known = result.first_passage_survival_low.notnull().values
    assert np.array_equal(known, runs.time >= passages[has_left].min())
    interval = survival.confidence_interval(0.95, method="log-log")
    assert np.array_equal(
        result.first_passage_survival_low[known], interval.low.evaluate(runs.time[known])
    )
    assert np.array_equal(
        result.first_passage_survival_high[known], interval.high.evaluate(runs.time[known])
    )


def test_the_median_is_that_of_the_runs(runs, result):
    ordered = np.sort(runs.first_passage_time.fillna(np.inf).values)
    assert result.first_passage_median == ordered[19]  # the 20th of 40
    assert result.first_passage_median_low < ordered[19] < result.first_passage_median_high


def test_the_figure_has_curve_median_and_share_of_censored_runs(runs, result, tmp_path):
    of_runs = bp.analyse(runs, quiet=True)
    (axes,) = bp.plot(of_runs, "first_passage").axes
    _, curve, median = axes.lines
    np.testing.assert_array_equal(curve.get_ydata(), result.first_passage_survival)
    ends = [result.first_passage_median_low.item(), result.first_passage_median_high.item()]
    assert (median.get_xdata().tolist(), median.get_ydata().tolist()) == (ends, [0.5, 0.5])
    share = runs.first_passage_time.isnull().mean().item()
    low, high = ends
    words = f"{result.first_passage_median.item():.3g} [{low:.3g}, {high:.3g}]"
    assert curve.get_label() == f"median {words}; inside at the end {share:.1%}"
    text = summary(of_runs)
    assert text.splitlines()[0].endswith("first passage")
    assert text.splitlines()[1].endswith(words)
    footnote = "first passage: median of when the tracer first leaves the circle of its radius"
    assert footnote in text and "In brackets: 95 % interval" in text
    table = bp.table(of_runs)
    assert table.first_passage_median_high.tolist() == [high]


@pytest.mark.parametrize(
    ("disks", "words"),
    [(ALONE, "median 0.1; all leave"), (AT_REST, "inside at the end 100.0%")],
)
def test_the_figure_of_runs_of_which_all_or_none_leave(disks, words):
    scene = make_scene(disks=disks, particles=1)
    result = bp.analyse(bp.simulate(scene, observables=PASSAGE, quiet=True), quiet=True)
    (axes,) = bp.plot(result, "first_passage").axes
    assert words in axes.lines[1].get_label()
    assert ("first passage" in summary(result)) == (disks is ALONE)


def test_a_study_with_the_observable_has_its_figure(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(f"scenes: [{Path(NOTE).resolve()}]\nseeds: 2\nobservables: [first_passage]\n")
    assert "first_passage" in read_study(path).figures
    path.write_text(f"scenes: [{Path(NOTE).resolve()}]\nseeds: 2\n")
    assert "first_passage" not in read_study(path).figures


def test_it_is_measured_alike_whatever_is_recorded(runs):
    scene = read_scene(NOTE).replace(duration=0.4)
    again = bp.simulate(scene, 40, record="none", observables=PASSAGE, quiet=True)
    assert again.first_passage_time.equals(runs.first_passage_time)


@pytest.mark.parametrize(
    ("engine", "settings"),
    [("timestep", {"time_step": 1e-3}), ("langevin", {"friction": "enskog"})],
)
def test_engines_without_collisions_are_refused(engine, settings):
    scene = read_scene(NOTE)
    message = f"first_passage needs collisions: --record events: the {engine} engine"
    with pytest.raises(RequestError, match=message):
        bp.simulate(scene, engine=engine, observables=PASSAGE, **settings)


def test_collisions_in_memory_are_forecast():
    scene = make_scene(particles=40)
    exact = Engine("exact")
    with_paths = exact.forecast(scene, {"tracer"}, ("first_passage",), "runs")
    without = exact.forecast(scene, {"tracer"}, (), "runs")
    assert with_paths.working_bytes > without.working_bytes
    assert with_paths.bytes_in_file == without.bytes_in_file + 8
