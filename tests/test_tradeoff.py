"""The cost-accuracy trade-off: estimators on made-up runs with known answers, and the study of them
from end to end.
"""

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import xarray
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation, Text

from brownpipe import cli, inspection, tradeoff
from brownpipe.analysis.resampling import Estimate
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import select
from brownpipe.figures import style
from brownpipe.figures import tradeoff as drawing
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.tradeoff import bias, dataset, front, timing
from brownpipe.tradeoff.compare import join_blocks, runs_of
from brownpipe.tradeoff.front import Interval, MeasuredSetting
from ensembles import make_runs, make_scene, write

ENSEMBLES = 800
CROWD = """\
box: {x: [-1.0, 1.0], y: [-1.0, 1.0]}
disks:
  species: [{name: fluid, count: 50, radius: 0.1, mass: 0.4}]
  placement: lattice
velocities: {temperature: 1.6}
duration: 0.5
equilibrate: {time: 0.5, tracer: free}
sample_interval: 0.05
"""


def skewed(rng, correlation, runs, others, mean):
    """Squared displacements of two engines, exponential ones: (S_a, 1) of the given mean, (S_e, 1)
    of mean 1.

    The first runs of both begin alike: their Gaussian displacements have this correlation.
    """
    exact = rng.standard_normal((max(runs, others), 2))
    independent = rng.standard_normal(exact.shape)
    mixed = correlation * exact + math.sqrt(1 - correlation**2) * independent
    approximate_squares = (mixed[:runs] ** 2).sum(axis=1, keepdims=True)
    exact_squares = (exact[:others] ** 2).sum(axis=1, keepdims=True)
    return mean * approximate_squares / 2, exact_squares / 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("correlation", "runs", "others"), [(0.99, 100, 100), (0.7, 100, 400), (0.0, 200, 100)]
)
def test_bias_covers_the_truth_in_95_of_100_ensembles(correlation, runs, others):
    """800 ensembles of a bias of 10 %; a coverage of 95 % is missed by 2.8 % (3.6 standard errors)
    once in 3,000.
    """
    rng = np.random.default_rng(1)
    common = np.arange(min(runs, others))
    pairs = None if correlation == 0.0 else (common, common)
    ensembles = [skewed(rng, correlation, runs, others, 1.1) for _ in range(ENSEMBLES)]
    # each ensemble as a quantity of its own
    approximate = np.hstack([first for first, _ in ensembles])
    exact = np.hstack([second for _, second in ensembles])
    found = bias.relative_bias(approximate, exact, pairs)

    is_covered = (found.low <= 0.1) & (found.high >= 0.1)
    assert abs(np.mean(is_covered) - 0.95) < 0.028
    # the scatter of 800 values is known to 2.5 % for Gaussian ones; four of that
    stated = np.sqrt(np.mean(found.standard_error**2))
    scatter = np.std(found.mean)
    assert stated == pytest.approx(scatter, rel=0.1)
    assert abs(np.mean(found.mean) - 0.1) < 4 * scatter / math.sqrt(ENSEMBLES)


def test_pairs_and_more_exact_runs_sharpen_the_bias():
    approximate, exact = skewed(np.random.default_rng(2), 0.995, 500, 5000, 1.02)
    common = np.arange(500)
    alone = bias.relative_bias(approximate, exact[:500]).standard_error.item()
    more = bias.relative_bias(approximate, exact).standard_error.item()
    paired = bias.relative_bias(approximate, exact, (common, common)).standard_error.item()
    # exponential: the spread is the mean
    expected_alone = 1.02 * math.sqrt(2 / 500)
    expected_more = 1.02 * math.sqrt(1 / 500 + 1 / 5000)
    # r^2 of both has the correlation c^2: 1 - c^4 = 0.02 of the variance is left
    expected_paired = math.sqrt(1.02**2 * 0.02 / 500 + 0.02**2 / 5000)
    assert alone == pytest.approx(expected_alone, rel=0.2)
    assert more == pytest.approx(expected_more, rel=0.2)
    assert paired == pytest.approx(expected_paired, rel=0.25)


def test_a_bias_of_two_runs_of_200_is_not_resolved():
    exact = np.random.default_rng(0).exponential(size=200)
    rows = np.arange(200)
    two_differ = np.where(rows < 2, 1.01 * exact, exact)
    found = bias.relative_bias(two_differ, exact, (rows, rows))
    assert not bias.is_resolved(found)
    bound = np.sqrt(bias.careful_square(found))
    assert 3 < bound / abs(found.mean) < 9


def test_equal_runs_have_no_bias_and_a_vanishing_mean_has_none_that_is_defined():
    exact = np.random.default_rng(3).exponential(size=(50, 2)) * [1.0, 0.0]
    rows = np.arange(50)
    found = bias.relative_bias(exact.copy(), exact, (rows, rows))
    assert abs(found.mean[0]) < 1e-15
    assert found.standard_error[0] < 1e-15
    assert np.isnan(found.mean[1])
    assert not bias.is_resolved(found)[1]


def test_the_part_of_a_square_that_is_scatter_is_taken_off():
    unresolved = Estimate(*map(np.array, (0.05, 0.03, -0.01, 0.11)))
    resolved = unresolved._replace(low=np.array(0.01))
    noisy = unresolved._replace(standard_error=np.array(0.06))
    without_scatter = pytest.approx(0.05**2 - 0.03**2)
    assert not bias.is_resolved(unresolved)
    assert bias.careful_square(unresolved) == 0.11**2
    assert bias.careful_square(resolved) == without_scatter
    assert bias.square(unresolved) == without_scatter
    assert bias.square(noisy) == 0.0


# -- distributions ---------------------------------------------------------------------------------


def radial(rng, runs, width=1.0):
    """Displacements of free diffusers: Rayleigh."""
    return width * np.sqrt(2 * rng.exponential(size=runs))


def distance_of_shares(width, rings=bias.RINGS):
    """Between Rayleigh laws of widths 1 and `width`, in rings that hold equal shares of the
    first.
    """
    share_outside = 1 - np.arange(rings) / rings
    wider_outside = share_outside ** (1 / width**2)
    shares = -np.diff(wider_outside, append=0.0)
    return np.abs(shares - 1 / rings).sum() / 2


@pytest.mark.slow
@pytest.mark.parametrize(("width", "same"), [(1.0, False), (1.0, True), (1.3, False)])
def test_distance_of_distributions(width, same, fewer_replicates):
    """An interval that covers in 95 % of the cases misses more than 6 of 40 ensembles once in
    300.
    """
    rng = np.random.default_rng(4)
    truth = distance_of_shares(width)
    rows = np.arange(400)
    pairs = (rows, rows) if same else None
    found = []
    for _ in range(40):
        exact = radial(rng, 800)
        if same:
            is_equal = rng.random(800) < 0.9
            own = np.where(is_equal, exact, radial(rng, 800))
        else:
            own = radial(rng, 800, width)
        found.append(bias.total_variation(own[:400], exact, pairs))
    assert sum(one.low <= truth <= one.high for one in found) > 33
    noise = np.mean([one.standard_error for one in found])
    # independent: 400 and 800 runs scatter together like 400 * 800 / 1200 of one
    expected = bias.spread_of_shares() / math.sqrt(400 * 800 / 1200)
    if same:
        assert noise < 0.5 * expected
    else:
        assert noise == pytest.approx(expected, rel=0.1)
    values = np.array([one.mean for one in found])
    if width > 1.0:  # squares add up if all rings differ alike; they do not, and a tenth remains
        standard_error = values.std() / math.sqrt(40)
        assert values.mean() == pytest.approx(truth, abs=0.1 * truth + 4 * standard_error)
    else:
        assert np.median(values) < 0.5 * noise


def test_largest_deviation_near_contact():
    """Poisson counts of two pairs of species, contact in bins 40 and 60; one is 10 % off in its
    first shell.
    """
    rng = np.random.default_rng(6)
    mean = np.zeros((2, 100))
    mean[0, 40:] = 30.0
    mean[1, 60:] = 20.0
    exact = rng.poisson(mean, (400, 2, 100))
    shifted_mean = mean.copy()
    shifted_mean[1, 60:63] *= 1.1
    shifted = rng.poisson(shifted_mean, (200, 2, 100))
    found = bias.contact_deviation(shifted, exact)
    assert found.low < 0.1 < found.high
    assert bias.is_resolved(found)
    pairs_in_shell = 60
    expected = math.sqrt((1.1 / 200 + 1.1**2 / 400) / pairs_in_shell)
    assert found.standard_error == pytest.approx(expected, rel=0.2)

    same = [bias.contact_deviation(rng.poisson(mean, (100, 2, 100)), exact) for _ in range(40)]
    # of 40 ensembles 5 % may stand out: more than 6 once in 300
    assert sum(map(bias.is_resolved, same)) <= 6
    assert bias.contact_deviation(exact, 0 * exact) is None


# -- the front -------------------------------------------------------------------------------------


def test_front_is_the_smallest_error_at_every_time():
    rng = np.random.default_rng(5)
    settings = [MeasuredSetting("exact", 0.0, 1.0, 0.01)]
    settings += [
        MeasuredSetting(f"{k}", b**2, 1 + k / 9, c)
        for k, (b, c) in enumerate(rng.lognormal(-5, 2, (12, 2)))
    ]
    intervals = front.pareto_front(settings)
    by_label = {one.label: one for one in settings}
    assert intervals[-1].end == np.inf and all(a.end == b.start for a, b in pairwise(intervals))
    for time in np.geomspace(intervals[0].start * 1.001, 1e6, 999):
        (best,) = [one.label for one in intervals if one.start <= time < one.end]
        errors = [front.total_error(one, time) for one in settings]
        assert front.total_error(by_label[best], time) == pytest.approx(np.nanmin(errors))
    fast = MeasuredSetting("fast", 0.02**2, 1.0, 1e-4)
    assert front.total_error(fast, 1e-4 * 400) == pytest.approx(math.hypot(0.02, 1 / 20))
    assert np.isnan(front.total_error(fast, 9e-4))


def test_runs_for_a_tolerance():
    assert front.runs_for(0.02, 0.0, 1.0) == 2500
    assert front.runs_for(0.02, 0.01**2, 1.0) == math.ceil(1 / (0.02**2 - 0.01**2))
    assert front.runs_for(0.02, 0.02**2, 1.0) is None
    assert front.runs_for(0.9, 0.0, 1.0) == front.FEWEST_RUNS
    assert front.runs_for(1e-4, 0.0, 1.0) == front.runs_for(1e-4, 0.0, 1.0, 1.0) == 10**8
    assert front.runs_for(0.02, 0.0, 1.0, 0.25) == 4 * 2500, "failing ones are added"


# -- from trajectory files to a dataset ------------------------------------------------------------

STEP = {"time_step": 0.01, "collisions": "at_contact"}
FAST, STAND_IN, SETTING = "timestep-0.01", "exact in small_N10", ("scene", "setting")
COSTS = {"exact": 1e-3, FAST: 2e-4}


def cost(engine, scene):
    return COSTS[engine.label] * scene.particles / 20


def stretched(trajectories, by):
    """The same runs by an engine whose displacements are larger by a factor."""
    ensemble = trajectories.ensemble
    position = ensemble.tracer.position * by
    position[1, 1:] = (
        ensemble.tracer.position[1, 1:] + 2e-4
    )  # of all runs but one: within 0.001 R, R = 0.3
    engine, track = (
        Engine("timestep", tuple(STEP.items())),
        ensemble.tracer._replace(position=position),
    )
    return trajectories._replace(engine=engine, ensemble=ensemble._replace(tracer=track))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """400 exact runs, the first 200 of them again with 5 % larger steps, and other exact runs to be
    taken instead.
    """
    folder, scene, small = (
        tmp_path_factory.mktemp("files"),
        make_scene("full"),
        make_scene("small", particles=10),
    )
    exact = [make_runs(scene, range(300), failed=(7,)), make_runs(scene, range(300, 400))]
    fast = stretched(make_runs(scene, range(200), failed=(11,)), 1.05)
    runs = [*exact, fast, make_runs(small, range(100, 400))]
    return [
        write(folder / str(k), one)
        for k, one in enumerate(runs)
        if (folder / str(k)).mkdir() is None
    ]


@pytest.fixture(scope="module")
def measured(files):
    return tradeoff.measure(files, {"full": ["small"]}, seconds_per_run=cost)


def test_bias_of_paired_runs_is_found_to_the_last_digits(measured):
    one = measured.sel(scene="full_N20", setting=FAST)
    assert (one.runs, one.failed_runs, one.paired_runs) == (
        199,
        1,
        198,
    )  # seed 7 failed in the exact engine
    # the same runs, stretched: regression leaves nothing but what 198 of them say about 399
    assert one.msd_bias == pytest.approx(1.05**2 - 1, abs=4 * float(one.msd_bias_standard_error))
    assert one.msd_bias_standard_error < 0.2 * float(one.msd_spread) / math.sqrt(199)
    assert one.d_bias == pytest.approx(1.05**2 - 1, abs=4 * float(one.d_bias_standard_error))
    assert one.departure_time == pytest.approx(0.1)  # the second sample, of all but one
    runs = make_runs(make_scene("full"), range(400)).ensemble
    square, overlap = (runs.tracer.position[-1] ** 2).sum(axis=1), runs.observables["worst_overlap"]
    spread = (
        1.05**2 * np.delete(square[:200], 11).std(ddof=1) / np.delete(square, 7).mean()
    )  # over the exact mean
    assert one.msd_spread == pytest.approx(spread, rel=1e-12)
    assert one.worst_overlap == np.delete(overlap[:200], 11).max()


def test_stand_in_is_compared_unpaired(measured):
    one = measured.sel(scene="full_N20", setting=STAND_IN)
    assert (one.runs, one.paired_runs) == (300, 0) and np.isnan(one.departure_time)
    assert abs(one.msd_bias) < 4 * one.msd_bias_standard_error
    assert one.msd_bias_standard_error == pytest.approx(math.sqrt(1 / 300 + 1 / 399), rel=0.2)
    assert one.seconds == pytest.approx(0.5e-3)


def test_exact_runs_are_off_by_nothing(measured):
    one = measured.sel(scene="full_N20", setting="exact")
    assert one.msd_bias == one.displacement_bias == one.d_bias == 0.0
    assert one.departure_time == np.inf
    assert one.window_start == pytest.approx(one.window_end / 10)
    assert one.msd_spread == pytest.approx(
        1.0, rel=0.2
    )  # r^2 of a Gaussian displacement; 400 runs say so to 7 %


def test_what_pays_is_the_front_of_the_settings(measured):
    for name, careful in (("pays", True), ("may_pay", False)):
        settings = front.settings_of(measured, "full_N20", careful=careful)
        assert [one.label for one in settings] == ["exact", FAST, STAND_IN]
        intervals = {one.label: one for one in front.pareto_front(settings)}
        for one in settings:
            found = measured.sel(scene="full_N20", setting=one.label)
            interval = intervals.get(one.label, Interval("", np.nan, np.nan))
            times = [float(found[f"{name}_{end}"]) for end in ("from", "to")]
            assert times == pytest.approx([interval.start, interval.end], nan_ok=True)
    # the stand-in is cheaper and its bias not resolved: it may pay in the end, and is not known to
    small = measured.sel(scene="full_N20", setting=STAND_IN)
    assert np.isnan(small.pays_to) and small.may_pay_to == np.inf
    times = [f"{name}_{end}" for name in ("pays", "may_pay") for end in ("from", "to")]
    ranges = {"cost_ratio_low": measured.cost_ratio / 2, "cost_ratio_high": measured.cost_ratio * 3}
    again = dataset._with_front(
        measured.assign(ranges | {name: np.nan * measured[name] for name in times})
    )
    for name in times:  # the lower cost ratio counts
        assert np.allclose(
            again[name], measured[name] / (2 if name.startswith("may") else 1), equal_nan=True
        )


@pytest.mark.slow
def test_dataset_is_the_same_but_for_cpu_times_and_goes_into_a_file(files, measured, tmp_path):
    again = tradeoff.measure(files[::-1], {"full": ["small"]}, seconds_per_run=lambda *_: 1.0)
    costs = [f"cost_ratio{part}" for part in ("", "_low", "_high")]
    timed = ["seconds", *costs, "pays_from", "pays_to", "may_pay_from", "may_pay_to"]
    assert again.reindex_like(measured).drop_vars(timed).equals(measured.drop_vars(timed))
    write_dataset(tmp_path / "tradeoff.nc", measured)
    assert read_dataset(tmp_path / "tradeoff.nc").identical(measured)
    assert ", that of this installation\n" in inspection.file_report(tmp_path / "tradeoff.nc")


class Clocked(NamedTuple):
    """An engine whose runs take 3 ms each by a clock of its own, and every call another second; two
    calls take more.
    """

    clock: list
    calls: list

    def simulate(self, scene, seeds, record):
        late = {0: 5.0, 4: 1.0}.get(
            len(self.calls), 0.0
        )  # the first compiles, another is disturbed
        self.calls.append(list(seeds))
        self.clock[0] += 1.0 + late + 3e-3 * len(seeds)


def test_a_cost_ratio_is_to_the_exact_engine(monkeypatch):
    seconds = {"exact": iter([2.0] * 3), "fast": iter([1.0, 0.5, 4.0])}
    monkeypatch.setattr(timing, "_ready", lambda engine, _: (lambda: next(seconds[engine]), 3))
    fast, exact = (
        SimpleNamespace(engine="fast", scene=None),
        SimpleNamespace(engine="exact", scene=None),
    )
    assert dataset._cost(fast, exact, 1.0, None) == timing.Ratio(0.5, low=0.25, high=2.0)


def test_a_cost_leaves_out_compiling_what_a_call_takes_once_and_what_disturbs(monkeypatch):
    engine = Clocked([0.0], [])
    monkeypatch.setattr(timing.time, "process_time", lambda: engine.clock[0])
    assert timing.seconds_per_run(engine, None) == pytest.approx(3e-3)
    repeats = engine.calls[4::2]
    assert len(repeats) == timing.REPEATS
    once = 1.0  # second, of each call; it is to be small beside a measurement
    assert {len(seeds) for seeds in repeats} == {
        1 + math.ceil(max(timing.LEAST, timing.LONGER * once) / 3e-3)
    }
    seeds = [seed for call in engine.calls for seed in call]
    assert (
        len(set(seeds)) == len(seeds) and min(seeds) > 10**9
    )  # new runs each time, none of a study


@pytest.mark.slow
def test_pairs_counted_in_the_runs_are_compared(tmp_path):
    """Steps as long as a disk takes across its radius let pairs overlap and thin them out near
    contact.
    """
    scene = tmp_path / "crowd.yaml"
    scene.write_text(CROWD)
    words = [
        "simulate",
        str(scene),
        "--seeds",
        "0-99",
        "--observables",
        "pair_distribution",
        "--output",
    ]
    files, steps = (
        [str(tmp_path / f"{name}.h5") for name in ("exact", "steps")],
        ["--engine", "timestep"],
    )
    assert (
        cli.main([*words, files[0]])
        == cli.main([*words, files[1], *steps, "--time-step", "0.03"])
        == 0
    )
    measured = tradeoff.measure(files, window=(0.1, 0.4), seconds_per_run=lambda *_: 1.0)
    found = measured.sel(scene="crowd_N50", setting="timestep-0.03")
    assert (found.window_start, found.window_end) == (0.1, 0.4)
    assert found.contact_bias_high < 0.0 or found.contact_bias_low > 0.0
    assert found.contact_bias_standard_error < 0.1


# -- the figure and the text -----------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 4, 11])
def test_every_line_has_its_name_beside_it(measured, count):
    """Of settings of one cost, nearly as good, names cover nothing, and lines lead to them without
    crossing.
    """
    fast = measured.sel(setting=[FAST])
    others = [
        fast.assign(
            {
                f"msd_bias{part}": 0.02 + 0.001 * k + 0 * fast.msd_bias
                for part in ("", "_low", "_high")
            }
        ).assign_coords(setting=[f"timestep-{k}e-3-late"])
        for k in range(count)
    ]
    labels = ["exact", *(str(one.setting.item()) for one in others)]
    dataset = xarray.concat(
        [measured.sel(setting=["exact"]), *others], "setting", data_vars="minimal"
    )
    with style.drawing():
        figure = drawing.draw(dataset, "full_N20")
        FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    named = [
        one for one in axes.texts if isinstance(one, Annotation) and one.arrow_patch is not None
    ]
    assert sorted(one.get_text() for one in named) == sorted(labels)
    boxes = [Text.get_window_extent(one) for one in (*named, axes.xaxis.label, axes.yaxis.label)]
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in (axes.bbox, *boxes[:k]))
        assert box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y0 >= 0 and box.y1 <= figure.bbox.y1
    ends, places = ([getattr(one, name)[1] for one in named] for name in ("xy", "xyann"))
    assert np.argsort(ends, kind="stable").tolist() == np.argsort(places, kind="stable").tolist()


def test_lines_are_the_errors_bold_on_the_front_and_dotted_below_the_bound(measured):
    """The front with unresolved biases at their bounds; that of the stand-in is the lower one."""
    wide = measured.assign(
        msd_bias_low=measured.msd_bias_low.where(measured.setting != STAND_IN, -0.3)
    )
    (axes,) = drawing.draw(wide, "full_N20").axes
    intervals = front.pareto_front(front.settings_of(wide, "full_N20", careful=True))
    assert [one.label for one in intervals] == [FAST, "exact"]
    for k, setting in enumerate(front.settings_of(wide, "full_N20")):
        times, below = axes.lines[3 * k].get_xdata(), 0.3 if setting.label == STAND_IN else 0.0
        error = front.total_error(setting, times)
        (bold,) = [
            (times >= one.start) & (times <= one.end)
            for one in intervals
            if one.label == setting.label
        ] or [0]
        for line, shown in zip(
            axes.lines[3 * k :], (~(error < below), error < below, bold), strict=False
        ):
            assert np.array_equal(line.get_ydata(), np.where(shown, error, np.nan), equal_nan=True)


def test_text_and_table_have_each_number_in_its_column_its_row_and_its_unit(measured):
    nan, inf, parts = np.nan, np.inf, ("", "_standard_error", "_low", "_high")
    biases = {  # of the fast engine and of the stand-in
        "msd_bias": ((0.0523, 0.0123, 0.03, 0.08), (0.01, 0.02, -0.031, 0.02)),
        "d_bias": ((-0.0234, 0.0056, -0.04, -0.01), (0.2, 0.1, -0.1, 1.5)),
        "displacement_bias": ((0.0712, nan, 0.01, 0.2), (0.3, nan, 0.0, 0.0444)),
        "contact_bias": ((-0.31, 0.012, -0.4, -0.2), (nan, nan, nan, nan)),
    }
    values = {
        name + part: [0, a, b]
        for name, of in biases.items()
        for part, a, b in zip(parts, *of, strict=True)
    }
    values |= {
        "runs": [401, 203, 302],
        "seconds": [2e-3, 1e-4, 5e-4],
        "worst_overlap": [1e-15, 0.03, nan],
    }
    values |= {
        "departure_time": [inf, 0.15, nan],
        "pays_from": [0.7, 0.002, nan],
        "pays_to": [inf, 0.5, nan],
    }
    values |= {"may_pay_from": [0.9, 0.01, 0.03], "may_pay_to": [8.0, 0.3, inf]}
    one = measured.assign(
        {name: (SETTING, [of]) for name, of in values.items() if name in measured}
    )
    assert drawing.columns_of(one, "full_N20") == [
        ("setting", "exact", FAST, STAND_IN),
        ("runs", "401", "203", "302"),
        ("ms/run", "2", "0.1", "0.5"),
        ("cost", "1", "0.05", "0.25"),
        ("MSD bias", "-", "+5.2 ± 1.2 %", "< 3.1 %"),
        ("D bias", "-", "-2.34 ± 0.56 %", "< 150 %"),
        ("distance", "-", "7.1 %", "< 4.4 %"),
        ("g(contact)", "-", "-31.0 ± 1.2 %", "-"),
        ("overlap", "1e-15", "0.03", "-"),
        ("departs", "never", "0.15", "-"),
        ("front, s", "0.7 on", "0.002 to 0.5", "perhaps"),
    ]
    table, numbers = drawing.table(one), [name for name in one if "setting" in one[name].dims]
    assert [*table.setting] == ["exact", FAST, STAND_IN] and {*table} == {
        "scene",
        "particles",
        "setting",
        *numbers,
    }
    for name in numbers:
        assert np.array_equal(
            table[name], one[name].sel(setting=[*table.setting])[0], equal_nan=True
        ), name


def test_blocks_of_runs_are_joined_in_order_and_one_without_pair_counts_has_none():
    runs = make_runs(make_scene("full"), range(5)).ensemble
    first = runs_of(make_scene("full"), Engine("exact"), select(runs, slice(0, 2)))
    second = runs_of(make_scene("full"), Engine("exact"), select(runs, slice(2, 5)))
    counted = second._replace(pair_counts=np.arange(1, 13).reshape(3, 2, 2))
    joined = join_blocks([first, counted])
    assert joined.seeds.tolist() == [0, 1, 2, 3, 4]
    assert np.array_equal(joined.squared[2:], second.squared)
    assert np.array_equal(joined.pair_counts[2:], counted.pair_counts)
    assert not joined.pair_counts[:2].any()
    assert join_blocks([first, second]).pair_counts is None
