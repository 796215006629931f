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
from brownpipe.errors import FigureError
from brownpipe.figures import style
from brownpipe.figures import tradeoff as drawing
from brownpipe.figures.cases import cases_of
from brownpipe.figures.render import cases_shown
from brownpipe.figures.summary import answer, summary_table
from brownpipe.report.answer import answer_in_words
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.tradeoff import bias, dataset, front, timing
from brownpipe.tradeoff.compare import join_blocks, runs_of
from brownpipe.tradeoff.front import Interval, MeasuredSetting, SettingRange
from ensembles import make_runs, make_scene, write
from scenes import CHANNEL_X, CHANNEL_Y, WALLS

ENSEMBLES = 800
UNRESOLVED = "The runs do not tell whether it is smaller"
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


def best_at(intervals, time):
    """The only setting that is on the front at this CPU time."""
    (best,) = [interval.label for interval in intervals if interval.start <= time < interval.end]
    return best


def test_front_is_the_smallest_error_at_every_time():
    rng = np.random.default_rng(5)
    settings = [MeasuredSetting("exact", 0.0, 1.0, 0.01)]
    for k, (size, cost) in enumerate(rng.lognormal(-5, 2, (12, 2))):
        settings.append(MeasuredSetting(f"{k}", size**2, 1 + k / 9, cost))
    intervals = front.pareto_front(settings)
    assert intervals[-1].end == np.inf
    for before, after in pairwise(intervals):
        assert before.end == after.start
    for time in np.geomspace(intervals[0].start * 1.001, 1e6, 999):
        errors = {setting.label: front.total_error(setting, time) for setting in settings}
        least = np.nanmin([*errors.values()])
        assert errors[best_at(intervals, time)] == pytest.approx(least)


def test_a_total_error_is_that_of_bias_and_scatter():
    fast = MeasuredSetting("fast", 0.02**2, 1.0, 1e-4)
    assert front.total_error(fast, 1e-4 * 400) == pytest.approx(math.hypot(0.02, 1 / 20))
    assert np.isnan(front.total_error(fast, 9e-4)), "of fewer than ten runs it is not stated"


def test_a_setting_is_on_no_front_while_it_alone_has_ten_runs():
    """Of 1 ms with a bias of 3, which exact runs of 1 s end; alone it is compared with none."""
    exact = MeasuredSetting("exact", 0.0, 1.0, 1.0)
    coarse = MeasuredSetting("coarse", 3.0**2, 1.0, 1e-3)
    assert front.pareto_front([exact, coarse]) == [Interval("exact", 10.0, np.inf)]
    assert front.pareto_front([coarse]) == [Interval("coarse", 0.01, np.inf)]
    good = MeasuredSetting("good", 0.3**2, 1.0, 1e-2)
    assert [interval.label for interval in front.pareto_front([exact, coarse, good])] == [
        "good",
        "exact",
    ]


def test_an_engine_that_alone_has_ten_runs_is_no_best_one_in_words_either(measured):
    """Its line, of errors above 1, is not in the panel, and its sentence does not name it."""
    coarse = with_engine(measured.sel(engine=[FAST]), FAST, 3.0)
    joined = xarray.concat([measured.sel(engine=["exact"]), coarse], "engine", data_vars="minimal")
    (text,) = answer_in_words(joined)
    assert text.endswith("is smallest with exact, for any CPU time.")
    assert FAST not in text


def test_a_setting_that_is_on_the_front_twice_is_there_from_its_first_time_to_its_last(monkeypatch):
    intervals = [Interval("a", 1.0, 2.0), Interval("b", 2.0, 3.0), Interval("a", 3.0, np.inf)]
    monkeypatch.setattr(front, "pareto_front", lambda _: intervals)
    assert front.front_spans([]) == {"a": (1.0, np.inf), "b": (2.0, 3.0)}


def setting_between(label, biases, costs):
    """A setting whose squared bias and whose cost are between two values; its spread is 1."""
    least_bias, largest_bias = biases
    lowest, highest = costs
    best = MeasuredSetting(label, least_bias**2, 1.0, lowest)
    return SettingRange(best, MeasuredSetting(label, largest_bias**2, 1.0, highest))


def test_settings_that_may_be_the_best_are_those_that_bias_and_cost_do_not_exclude():
    """Exact runs of 1 s. With a bias of 0 or 10 % a setting of 0.5 s is better until
    (1 - 0.5)/0.1^2 = 50 s, or for good; of 1.2 s never, of 0.9 to 1.2 s perhaps. A setting with a
    bias of 0.5 that is worth nothing once there are exact runs does not count.
    """
    exact = setting_between("exact", (0.0, 0.0), (1.0, 1.0))
    fast = setting_between("fast", (0.0, 0.1), (0.5, 0.5))
    slow = setting_between("slow", (0.0, 0.1), (1.2, 1.2))
    equal = setting_between("equal", (0.0, 0.1), (0.9, 1.2))
    coarse = setting_between("coarse", (0.5, 0.5), (0.99, 1.0))
    assert front.possible_spans([exact, fast]) == {
        "exact": (pytest.approx(50.0), np.inf),
        "fast": (10.0, np.inf),
    }
    assert [*front.possible_spans([exact, slow])] == ["exact"]
    assert [*front.possible_spans([exact, equal])] == ["exact", "equal"]
    assert [*front.possible_spans([exact, coarse])] == ["exact"]


def test_a_setting_at_its_best_has_no_bias_that_is_not_resolved(measured):
    """The bias of 10 % is resolved, that of the stand-in is not."""
    case = case_of(measured, STAND_IN).assign(cost_ratio_low=0.4, cost_ratio_high=0.7)
    best, worst = front.setting_range(STAND_IN, case)
    assert best.bias_square == 0.0
    assert worst.bias_square == max(-case.msd_bias_low, case.msd_bias_high) ** 2
    assert [best.seconds, worst.seconds] == pytest.approx([0.4e-3, 0.7e-3])
    best, worst = front.setting_range(FAST, case_of(measured, FAST))
    assert best.bias_square == worst.bias_square == pytest.approx(0.01, rel=0.5)


def test_the_answer_names_settings_that_the_runs_do_not_exclude(measured):
    (text,) = answer_in_words(measured)
    assert text.startswith("full, N = 20: the expected error of the MSD is smallest with ")
    assert text.endswith(f" of CPU, then with exact. {UNRESOLVED} with {STAND_IN}.")
    (text,) = answer_in_words(measured.sel(engine=["exact", FAST]))
    assert UNRESOLVED not in text, "its bias is resolved, and its cost is known"


def test_too_few_runs_for_intervals_have_no_front(tmp_path):
    """Without an interval nothing is known of a bias."""
    scene = make_scene("full")
    runs = [make_runs(scene, range(4)), stretched(make_runs(scene, range(4)), 1.05)]
    few = tradeoff.measure(runs, seconds_per_run=cost)
    assert few.pays_from.isnull().all()
    assert answer_in_words(few) == [
        "full, N = 20: there are too few runs to tell which engine has the smallest error."
    ]
    figure = drawing.draw_tradeoff(cases_of(few))
    assert len(figure.axes[0].lines) == 6


def test_runs_for_a_tolerance():
    assert front.runs_for(0.02, 0.0, 1.0) == 2500
    assert front.runs_for(0.02, 0.01**2, 1.0) == math.ceil(1 / (0.02**2 - 0.01**2))
    assert front.runs_for(0.02, 0.02**2, 1.0) is None
    assert front.runs_for(0.9, 0.0, 1.0) == front.FEWEST_RUNS
    assert front.runs_for(1e-4, 0.0, 1.0) == front.runs_for(1e-4, 0.0, 1.0, 1.0) == 10**8
    assert front.runs_for(0.02, 0.0, 1.0, 0.25) == 4 * 2500, "failing ones are added"


@pytest.mark.parametrize("terms", [(0.0, 1.0), (0.01**2, 1.2), (0.01**2, 1.2, 0.25, 10)])
def test_the_error_of_a_number_of_runs_is_the_tolerance_that_needs_them(terms):
    assert front.runs_for(front.error_of(2500, *terms), *terms) == 2500


# -- from trajectory files to a dataset ------------------------------------------------------------

STEP = {"time_step": 0.01, "collisions": "at_contact"}
FAST = "timestep-0.01"
STAND_IN = "exact in small_N10"
ENGINES = ["exact", FAST, STAND_IN]
CASE_DIMS = ("scene", "particles", "engine")
COSTS = {"exact": 1e-3, FAST: 2e-4}
COST_RATIOS = ["cost_ratio", "cost_ratio_low", "cost_ratio_high"]
FRONT_TIMES = ["pays_from", "pays_to", "may_pay_from", "may_pay_to"]


def cost(engine, scene):
    return COSTS[engine.label] * scene.particles / 20


def stretched(trajectories, by):
    """The same runs by an engine whose displacements are larger by a factor."""
    ensemble = trajectories.ensemble
    exact_position = ensemble.tracer.position
    position = exact_position * by
    # of all runs but one the second sample is within 0.001 R, R = 0.3
    position[1, 1:] = exact_position[1, 1:] + 2e-4
    track = ensemble.tracer._replace(position=position)
    engine = Engine("timestep", tuple(STEP.items()))
    return trajectories._replace(engine=engine, ensemble=ensemble._replace(tracer=track))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """400 exact runs, the first 200 of them again with 5 % larger steps, and other exact runs to be
    taken instead.
    """
    folder = tmp_path_factory.mktemp("files")
    scene = make_scene("full")
    small = make_scene("small", particles=10)
    all_runs = [
        make_runs(scene, range(300), failed=(7,)),
        make_runs(scene, range(300, 400)),
        stretched(make_runs(scene, range(200), failed=(11,)), 1.05),
        make_runs(small, range(100, 400)),
    ]
    paths = []
    for k, runs in enumerate(all_runs):
        folder_of_runs = folder / str(k)
        folder_of_runs.mkdir()
        paths.append(write(folder_of_runs, runs))
    return paths


@pytest.fixture(scope="module")
def measured(files):
    return tradeoff.measure(files, {"full": ["small"]}, seconds_per_run=cost)


def case_of(dataset, engine):
    """The case of one engine in the only scene that is compared."""
    return dataset.sel(scene="full", particles=20, engine=engine)


def test_all_variables_are_on_the_dimensions_of_an_analysis(measured):
    assert [variable.dims for variable in measured.data_vars.values()] == [CASE_DIMS] * 34
    labels = {dim: measured[dim].values.tolist() for dim in CASE_DIMS}
    assert labels == {"scene": ["full"], "particles": [20], "engine": ENGINES}
    assert tradeoff.is_tradeoff(measured)
    assert not tradeoff.is_tradeoff(measured.drop_vars("cost_ratio"))


@pytest.mark.parametrize(
    ("boundary", "names"), [(CHANNEL_X, ["d_x"]), (CHANNEL_Y, ["d_y"]), (WALLS, ["d_x", "d_y"])]
)
def test_the_bias_of_d_is_that_along_the_axes_whose_d_is_stated(boundary, names):
    """Displacements are longer by 5 % along x and by 50 % along y: regression on the same runs
    leaves no error.
    """
    scene = make_scene(box={"x": [-3.0, 3.0], "y": [-2.0, 2.0], "boundary": boundary})
    exact = make_runs(scene, range(100))
    longer = stretched(exact, np.array([1.05, 1.5]))
    measured = tradeoff.measure([exact, longer], seconds_per_run=lambda *_: 1.0)
    fast = measured.sel(engine=FAST).squeeze()
    stated = [name for name in ("d", "d_x", "d_y") if np.isfinite(fast.get(f"{name}_bias", np.nan))]
    assert stated == names
    square = {"d_x": 1.05**2, "d_y": 1.5**2}
    for name in names:
        assert fast[f"{name}_bias"] == pytest.approx(square[name] - 1, rel=0.01)
    headings = [column[0] for column in answer(measured).columns]
    assert [name for name in headings if name.startswith("D")] == [
        f"D{name[1:]} bias" for name in names
    ]


def test_bias_of_paired_runs_is_found_to_the_last_digits(measured):
    fast = case_of(measured, FAST)
    numbers = [fast[name].item() for name in ("runs", "failed_runs", "paired_runs")]
    assert numbers == [199, 1, 198], "seed 7 failed in the exact engine, seed 11 in this one"
    # the same runs, stretched: regression leaves nothing but what 198 of them say about 399
    for name in ("msd_bias", "d_bias"):
        error = fast[f"{name}_standard_error"].item()
        assert fast[name].item() == pytest.approx(1.05**2 - 1, abs=4 * error)
    assert fast.msd_bias_standard_error < 0.2 * float(fast.msd_spread) / math.sqrt(199)


def test_departure_scatter_and_overlap_are_those_of_the_runs(measured):
    fast = case_of(measured, FAST)
    assert fast.departure_time == pytest.approx(0.1), "the second sample, of all runs but one"
    runs = make_runs(make_scene("full"), range(400)).ensemble
    square = (runs.tracer.position[-1] ** 2).sum(axis=1)
    exact_mean = np.delete(square, 7).mean()
    fast_scatter = 1.05**2 * np.delete(square[:200], 11).std(ddof=1)
    assert fast.msd_spread == pytest.approx(fast_scatter / exact_mean, rel=1e-12)
    overlap = runs.observables["worst_overlap"]
    assert fast.worst_overlap == np.delete(overlap[:200], 11).max()


def test_stand_in_is_compared_unpaired(measured):
    stand_in = case_of(measured, STAND_IN)
    assert stand_in.runs == 300
    assert stand_in.paired_runs == 0
    assert np.isnan(stand_in.departure_time)
    assert abs(stand_in.msd_bias) < 4 * stand_in.msd_bias_standard_error
    expected_error = math.sqrt(1 / 300 + 1 / 399)
    assert stand_in.msd_bias_standard_error == pytest.approx(expected_error, rel=0.2)
    assert stand_in.seconds == pytest.approx(0.5e-3)


def test_exact_runs_are_off_by_nothing(measured):
    exact = case_of(measured, "exact")
    assert exact.msd_bias == exact.displacement_bias == exact.d_bias == 0.0
    assert exact.departure_time == np.inf
    assert exact.window_start == pytest.approx(exact.window_end / 10)
    # r^2 of a Gaussian displacement; 400 runs say so to 7 %
    assert exact.msd_spread == pytest.approx(1.0, rel=0.2)


@pytest.mark.parametrize(("name", "careful"), [("pays", True), ("may_pay", False)])
def test_what_pays_is_the_front_of_the_settings(measured, name, careful):
    cases = [case_of(measured, engine) for engine in ENGINES]
    intervals = {}
    for interval in front.pareto_front([drawing.setting_of(case, careful) for case in cases]):
        intervals[interval.label] = [interval.start, interval.end]
    for case in cases:
        times = [case[f"{name}_from"].item(), case[f"{name}_to"].item()]
        expected = intervals.get(case.engine.item(), [np.nan, np.nan])
        assert times == pytest.approx(expected, nan_ok=True)


def test_a_cheaper_stand_in_whose_bias_is_not_resolved_may_pay_and_is_not_known_to(measured):
    stand_in = case_of(measured, STAND_IN)
    assert np.isnan(stand_in.pays_to)
    assert stand_in.may_pay_to == np.inf


def test_what_may_pay_has_the_lowest_cost_ratio(files, measured, monkeypatch):
    """Costs from half to three times the median, also of exact runs: all that may pay do so at half
    the CPU time.
    """

    def ratio_range(runs, exact, exact_seconds, seconds_per_run):
        median = cost(runs.engine, runs.scene) / exact_seconds
        return timing.Ratio(median, median / 2, median * 3)

    monkeypatch.setattr(dataset, "_cost", ratio_range)
    again = tradeoff.measure(files, {"full": ["small"]}, seconds_per_run=cost)
    for name in FRONT_TIMES:
        factor = 2 if name.startswith("may") else 1
        assert np.allclose(again[name], measured[name] / factor, equal_nan=True)


@pytest.mark.slow
def test_dataset_is_the_same_but_for_cpu_times_and_goes_into_a_file(files, measured, tmp_path):
    again = tradeoff.measure(files[::-1], {"full": ["small"]}, seconds_per_run=lambda *_: 1.0)
    timed = ["seconds", *COST_RATIOS, *FRONT_TIMES]
    assert again.reindex_like(measured).drop_vars(timed).equals(measured.drop_vars(timed))
    assert again.engine.values[0] == "exact"
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
        delays = {0: 5.0, 4: 1.0}  # the first call compiles, another is disturbed
        delay = delays.get(len(self.calls), 0.0)
        self.calls.append(list(seeds))
        self.clock[0] += 1.0 + delay + 3e-3 * len(seeds)


def test_a_cost_ratio_is_to_the_exact_engine(monkeypatch):
    seconds = {"exact": iter([2.0] * 3), "fast": iter([1.0, 0.5, 4.0])}
    monkeypatch.setattr(timing, "_ready", lambda engine, _: (lambda: next(seconds[engine]), 3))
    fast = SimpleNamespace(engine="fast", scene=None)
    exact = SimpleNamespace(engine="exact", scene=None)
    assert dataset._cost(fast, exact, 1.0, None) == timing.Ratio(0.5, low=0.25, high=2.0)


def test_a_cost_leaves_out_compiling_what_a_call_takes_once_and_what_disturbs(monkeypatch):
    engine = Clocked([0.0], [])
    monkeypatch.setattr(timing.time, "process_time", lambda: engine.clock[0])
    assert timing.seconds_per_run(engine, None) == pytest.approx(3e-3)
    repeats = engine.calls[4::2]
    assert len(repeats) == timing.REPEATS
    once = 1.0  # second, of each call; it is to be small beside a measurement
    runs = math.ceil(max(timing.LEAST, timing.LONGER * once) / 3e-3)
    assert {len(seeds) for seeds in repeats} == {1 + runs}
    seeds = [seed for call in engine.calls for seed in call]
    assert len(set(seeds)) == len(seeds), "new runs each time"
    assert min(seeds) > 10**9, "none of a study"


@pytest.mark.slow
def test_pairs_counted_in_the_runs_are_compared(tmp_path):
    """Steps as long as a disk takes across its radius let pairs overlap and thin them out near
    contact.
    """
    scene = tmp_path / "crowd.yaml"
    scene.write_text(CROWD)
    exact = str(tmp_path / "exact.h5")
    steps = str(tmp_path / "steps.h5")
    request = ["simulate", str(scene), "--seeds", "0-99", "--observables", "pair_distribution"]
    assert cli.main([*request, "--output", exact]) == 0
    engine = ["--engine", "timestep", "--time-step", "0.03"]
    assert cli.main([*request, *engine, "--output", steps]) == 0
    window = (0.1, 0.4)
    measured = tradeoff.measure([exact, steps], window=window, seconds_per_run=lambda *_: 1.0)
    found = measured.sel(scene="crowd", particles=50, engine="timestep-0.03")
    assert (found.window_start, found.window_end) == window
    assert found.contact_bias_high < 0.0 or found.contact_bias_low > 0.0
    assert found.contact_bias_standard_error < 0.1


# -- the figure and the text -----------------------------------------------------------------------


def with_engine(fast, label, msd_bias):
    """The fast engine under another label, with this bias and no uncertainty."""
    names = ("msd_bias", "msd_bias_low", "msd_bias_high")
    biases = dict.fromkeys(names, msd_bias + 0 * fast.msd_bias)
    return fast.assign(biases).assign_coords(engine=[label])


def labels_beside(axes):
    """The labels of lines, with their leaders."""
    texts = [text for text in axes.texts if isinstance(text, Annotation)]
    return [text for text in texts if text.arrow_patch is not None]


@pytest.mark.parametrize("count", [1, 4, 11])
def test_every_line_has_its_name_beside_it(measured, count):
    """Of settings of one cost, nearly as good, names cover nothing, and lines lead to them without
    crossing.
    """
    fast = measured.sel(engine=[FAST])
    compared = [measured.sel(engine=["exact"])]
    for k in range(count):
        compared.append(with_engine(fast, f"timestep-{k}e-3-late", 0.02 + 0.001 * k))
    joined = xarray.concat(compared, "engine", data_vars="minimal")
    with style.drawing():
        figure = drawing.draw_tradeoff(cases_of(joined))
        FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    labels = labels_beside(axes)
    assert sorted(label.get_text() for label in labels) == sorted(joined.engine.values)
    words = [*labels, axes.xaxis.label, axes.yaxis.label]
    boxes = [Text.get_window_extent(text) for text in words]
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in (axes.bbox, *boxes[:k]))
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
        assert box.y0 >= 0
        assert box.y1 <= figure.bbox.y1
    ends = [label.xy[1] for label in labels]
    places = [label.xyann[1] for label in labels]
    assert np.argsort(ends, kind="stable").tolist() == np.argsort(places, kind="stable").tolist()


def test_lines_are_the_errors_bold_on_the_front_and_dotted_below_the_bound(measured):
    """The front with unresolved biases at their bounds; that of the stand-in is the lower one."""
    is_stand_in = measured.engine == STAND_IN
    wide = measured.assign(msd_bias_low=measured.msd_bias_low.where(~is_stand_in, -0.3))
    cases = cases_of(wide)
    (axes,) = drawing.draw_tradeoff(cases).axes
    intervals = front.pareto_front([drawing.setting_of(case, careful=True) for case in cases])
    assert [interval.label for interval in intervals] == [FAST, "exact"]
    for k, case in enumerate(cases):
        setting = drawing.setting_of(case)
        thin, dotted, bold = axes.lines[3 * k : 3 * k + 3]
        times = thin.get_xdata()
        error = front.total_error(setting, times)
        is_below = error < (0.3 if setting.label == STAND_IN else 0.0)
        is_on_front = np.zeros(len(times), bool)
        for interval in intervals:
            if interval.label == setting.label:
                is_on_front = (times >= interval.start) & (times <= interval.end)
        for line, is_shown in ((thin, ~is_below), (dotted, is_below), (bold, is_on_front)):
            expected = np.where(is_shown, error, np.nan)
            assert np.array_equal(line.get_ydata(), expected, equal_nan=True)


def test_each_scene_and_number_of_disks_has_a_panel(measured, monkeypatch):
    several = [measured.assign_coords(scene=[name]) for name in ("a", "b", "c")]
    cases = cases_of(xarray.concat(several, "scene"))
    with style.drawing():
        whole = drawing.draw_tradeoff(cases)
        monkeypatch.setattr(drawing, "MOST_PANELS", 2)
        reduced = drawing.draw_tradeoff(cases)
    titles = [axes.get_title("left") for axes in whole.axes]
    assert titles == [f"{name}, N = 20: cost-accuracy trade-off" for name in "abc"]
    assert [axes.get_title("left") for axes in reduced.axes] == [titles[0], titles[2]]
    assert reduced.get_suptitle() == "2 of 3 cases, at equal steps; the table has all"


NUMBERS = {  # of the exact engine, the fast one and the stand-in
    "msd_bias": [0.0, 0.0523, 0.01],
    "msd_bias_standard_error": [0.0, 0.0123, 0.02],
    "msd_bias_low": [0.0, 0.03, -0.031],
    "msd_bias_high": [0.0, 0.08, 0.02],
    "d_bias": [0.0, -0.0234, 0.2],
    "d_bias_standard_error": [0.0, 0.0056, 0.1],
    "d_bias_low": [0.0, -0.04, -0.1],
    "d_bias_high": [0.0, -0.01, 1.5],
    "displacement_bias": [0.0, 0.0712, 0.3],
    "displacement_bias_low": [0.0, 0.01, 0.0],
    "displacement_bias_high": [0.0, 0.2, 0.0444],
    "contact_bias": [0.0, -0.31, np.nan],
    "contact_bias_standard_error": [0.0, 0.012, np.nan],
    "contact_bias_low": [0.0, -0.4, np.nan],
    "contact_bias_high": [0.0, -0.2, np.nan],
    "runs": [401, 203, 302],
    "failed_runs": [0, 1, 0],
    "seconds": [2e-3, 1e-4, 5e-4],
    "cost_ratio": [1.0, 0.05, 0.25],
    "worst_overlap": [1e-15, 0.03, np.nan],
    "departure_time": [np.inf, 0.15, np.nan],
    "pays_from": [0.7, 0.002, np.nan],
    "pays_to": [np.inf, 0.5, np.nan],
    "may_pay_from": [0.9, 0.01, 0.03],
    "may_pay_to": [8.0, 0.3, np.inf],
}


@pytest.fixture
def made_up(measured):
    """The trade-off with NUMBERS in place of those measured."""
    return measured.assign({name: (CASE_DIMS, [[values]]) for name, values in NUMBERS.items()})


def test_the_summary_has_each_number_in_its_column_its_row_and_its_unit(made_up):
    results = answer(made_up)
    assert results.columns == [
        ("scene", "full", "full", "full"),
        ("N", "20", "20", "20"),
        ("engine", "exact", FAST, STAND_IN),
        ("runs", "401", "203", "302"),
        ("ms/run", "2", "0.1", "0.5"),
        ("cost", "1", "0.05", "0.25"),
        ("MSD bias", "-", "+5.2 ± 1.2 %", "< 3.1 %"),
        ("front, s", "0.7 on", "0.002 to 0.5", "perhaps"),
        ("D bias", "-", "-2.34 ± 0.56 %", "< 150 %"),
        ("distance", "-", "7.1 %", "< 4.4 %"),
        ("g(contact)", "-", "-31.0 ± 1.2 %", "-"),
        ("overlap", "1e-15", "0.03", "-"),
        ("departs", "never", "0.15", "-"),
    ]
    explained = [line.partition(": ")[0] for line in results.legend]
    for heading, *_ in results.columns[4:]:
        assert heading in explained
    (failed,) = results.missing
    assert failed.startswith("The averages leave out 1 failed run; ")


def test_a_column_without_any_number_is_left_out(measured):
    headings = [column[0] for column in answer(measured).columns]
    assert "g(contact)" not in headings
    assert "departs" in headings


def test_the_tables_have_every_number_of_the_dataset(made_up):
    table = summary_table(made_up)
    assert [*table] == [*CASE_DIMS, *made_up.data_vars]
    assert table.engine.tolist() == ENGINES
    for name in made_up.data_vars:
        assert np.array_equal(table[name], made_up[name].values.ravel(), equal_nan=True), name
    drawn = drawing.FIGURE.table(cases_of(made_up))
    for name in ("seconds", "msd_bias", "msd_spread", "pays_from"):
        assert drawn[name].equals(table[name]), name


def test_no_figure_of_an_analysis_is_drawn_of_a_trade_off(measured):
    assert [*cases_shown(measured)] == ["tradeoff"]
    with pytest.raises(FigureError, match=r"^health: cannot be drawn from this dataset"):
        cases_shown(measured, names=["health"])


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
