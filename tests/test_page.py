"""How the page of a study begins: a run of each scene in motion, and the answer in sentences."""

import json
import re

import numpy as np
import pytest

import brownpipe as bp
import browser
from brownpipe.analysis import aggregate, diffusive
from brownpipe.engines import Engine
from brownpipe.figures.cases import plus_minus
from brownpipe.report import page, replay, typical_run
from brownpipe.report.answer import answer_in_words, front_in_words, rivals_in_words
from brownpipe.report.typical_run import scenes_in_motion, typical_seed
from brownpipe.tradeoff.front import Interval
from ensembles import make_runs, make_scene
from scenes import CHANNEL_X

RECORD = {"made_by": {"brownpipe_version": "0"}, "dataset": {"sha256": "0" * 64, "made_from": []}}
SEEDS = range(5)
EXACT = Engine("exact")
WHOLE = frozenset({"all", "events"})
WITH_BROWSER = pytest.mark.skipif(browser.CHROMIUM is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def scene():
    return make_scene("few", 20)


@pytest.fixture(scope="module")
def dataset(scene):
    """The analysis of some exact runs of one scene."""
    return bp.analyse(bp.simulate(scene, seeds=SEEDS, quiet=True))


@pytest.fixture(scope="module")
def synthetic():
    """Two scenes with two numbers of disks, of free diffusers."""
    scenes = [make_scene(name, count) for name in ("hot", "thermal") for count in (10, 20)]
    return aggregate([make_runs(scene, range(40)) for scene in scenes])


def case_of(dataset):
    return dataset.isel(scene=0, particles=0, engine=0)


# -- in motion -------------------------------------------------------------------------------------


def test_the_run_in_motion_is_that_of_the_typical_seed(scene, dataset):
    """Its start and its collisions are those of the run of this seed, bit for bit."""
    case = case_of(dataset)
    seed = typical_seed(case)
    assert float(case.run_msd.sel(seed=seed)) == np.median(case.run_msd)
    run = EXACT.simulate(scene, [seed], WHOLE)
    (shown,) = scenes_in_motion(dataset)
    assert shown.caption.startswith("few, N = 20: a typical run ")
    assert shown.caption.endswith(f", seed {seed}")
    data = shown.replay.data
    assert data["position"] == run.whole[seed].position[0].tolist()
    assert data["velocity"] == run.whole[seed].velocity[0].tolist()
    assert data["collisions"]["time"] == run.events[seed].time.tolist()
    assert data["collisions"]["impulse"] == run.events[seed].impulse.tolist()
    assert data["end"] == scene.duration
    (x, y) = run.whole[seed].position[0, 0]
    tracer = shown.replay.still.circles[-1]
    assert tracer == (x, -y, scene.radius[0], 0)


def test_a_long_run_is_made_until_it_has_enough_collisions(scene, dataset, monkeypatch):
    for module in (typical_run, replay):
        monkeypatch.setattr(module, "MOST_COLLISIONS", 8)
    seed = typical_seed(case_of(dataset))
    (shown,) = scenes_in_motion(dataset)
    data = shown.replay.data
    assert data["end"] < scene.duration
    assert shown.caption.endswith(f", the first {data['end']:.3g} of 1")
    run = EXACT.simulate(scene, [seed], WHOLE)
    times = data["collisions"]["time"]
    assert 3 <= len(times) <= 8
    np.testing.assert_allclose(times, run.events[seed].time[: len(times)], rtol=1e-12)
    assert data["position"] == run.whole[seed].position[0].tolist()


def test_failed_runs_are_not_typical(dataset):
    case = case_of(dataset)
    middle = typical_seed(case)
    others = case.assign(run_msd=case.run_msd.where(case.seed != middle))
    assert typical_seed(others) != middle
    ascending = np.sort(others.run_msd.dropna("seed").values)
    assert float(others.run_msd.sel(seed=typical_seed(others))) == ascending[1]


def test_a_scan_shows_its_first_scene():
    scanned = bp.scan(
        make_scene("few", 20), seeds=3, vary={"disks.tracer.mass": [2, 5]}, quiet=True
    )
    (shown,) = scenes_in_motion(scanned)
    assert shown.caption.startswith("few, tracer_mass = 2, N = 20: ")
    assert shown.replay.data["mass"][0] == 2
    assert len(answer_in_words(scanned)) == 2


@pytest.mark.parametrize(
    ("limit", "value", "reason"),
    [
        ("MOST_DISKS", 19, "too many disks to be shown in motion on a page"),
        ("MOST_SECONDS", 0.0, "not shown in motion, as making a run again takes "),
        ("source_digest", lambda *_: "", "its runs were made by another version of brownpipe"),
    ],
)
def test_why_a_scene_is_not_shown_in_motion(dataset, monkeypatch, limit, value, reason):
    monkeypatch.setattr(typical_run, limit, value)
    (shown,) = scenes_in_motion(dataset)
    assert shown.replay is None
    assert reason in shown.caption
    text = page.page_of_results(dataset, [], RECORD).decode()
    assert f'<p class="remark">{shown.caption}</p>' in text
    assert "<canvas" not in text


def test_other_engines_are_not_shown_in_motion(scene):
    by_steps = bp.simulate(scene, seeds=2, engine="timestep", time_step=0.01, quiet=True)
    assert scenes_in_motion(bp.analyse(by_steps)) == []


# -- in sentences ----------------------------------------------------------------------------------


def test_the_sentences_have_the_numbers_of_the_dataset(synthetic):
    marks = synthetic.diffusion_mark * 0
    well_known = synthetic.slope_change_standard_error * 1e-3
    plain = synthetic.assign(diffusion_mark=marks, slope_change_standard_error=well_known)
    paragraphs = answer_in_words(plain)
    assert len(paragraphs) == 3
    assert paragraphs[2] == "The table has 2 further cases."
    for name, text in zip(("hot", "thermal"), paragraphs, strict=False):
        case = plain.sel(scene=name, particles=20).isel(engine=0, window=0)
        msd = case.msd.values[-1]
        root = np.sqrt(msd)
        moved = plus_minus(root, case.msd_standard_error.values[-1] / (2 * root))
        diffusion = plus_minus(
            case.diffusion_coefficient, case.diffusion_coefficient_standard_error
        )
        window = f"between t = {case.window_start.item():g} and {case.window_end.item():g}"
        assert text == (
            f"{name}, N = 20: After 1 time unit the tracer has moved by {moved} on average (root "
            f"of the MSD). It diffuses: D = {diffusion} {window}."
        )
    assert answer_in_words(plain, 10)[0].startswith("hot, N = 10: ")
    text = page.page_of_results(plain, [], RECORD).decode()
    assert f'<p class="sentence">{paragraphs[0]}</p>' in text


def test_few_runs_are_not_said_to_show_diffusion(synthetic):
    """Where not even a fall of the slope to zero would be found."""
    plain = synthetic.assign(diffusion_mark=synthetic.diffusion_mark * 0)
    text = answer_in_words(plain)[0]
    assert re.search("Nothing found speaks against D = .*, but there are few runs to find it", text)


def test_the_coefficient_of_a_channel_is_that_along_it():
    channel = aggregate([make_runs(make_scene("pore", 20, boundary=CHANNEL_X), range(40))])
    mark = channel.component_diffusion_mark * 0
    well_known = channel.component_slope_change_standard_error * 1e-3
    without_mark = channel.assign(
        component_diffusion_mark=mark, component_slope_change_standard_error=well_known
    )
    (text,) = answer_in_words(without_mark)
    along = channel.component_diffusion.sel(component="x").isel(window=0).squeeze()
    error = channel.component_diffusion_standard_error.sel(component="x").isel(window=0).squeeze()
    assert f" It diffuses along x: D_x = {plus_minus(along, error)} between t = " in text


@pytest.mark.parametrize("bit", diffusive.REASONS)
def test_a_marked_coefficient_is_not_stated(synthetic, bit):
    drift = synthetic.window_drift_diffusion * 0 + 0.1
    mark = synthetic.diffusion_mark * 0 + bit
    marked = synthetic.assign(diffusion_mark=mark, window_drift_diffusion=drift.fillna(0.1))
    text = answer_in_words(marked)[0]
    assert not re.search("D(_x)? = ", text)
    assert re.search("It is not (yet )?diffusive|Whether it diffuses", text)
    assert "nan" not in text


def test_averages_over_time_origins_are_within_a_time():
    thermal = {"temperature": 1.6}
    rest = {"time": 1.0, "tracer": "free"}
    settled = make_scene("settled", 20, boundary="periodic", velocities=thermal, equilibrate=rest)
    runs = bp.simulate(settled, 2, observables="square_displacement", average="origins", quiet=True)
    (text,) = answer_in_words(bp.analyse(runs))
    assert text.startswith("Within ")


def test_a_study_without_displacements_has_no_sentence(scene):
    runs = bp.simulate(scene, 2, record="none", observables="pair_distribution", quiet=True)
    assert answer_in_words(bp.analyse(runs)) == []


def test_a_single_run_has_no_error():
    disk = {"position": [1, 1], "velocity": [3, 4], "radius": 0.5, "mass": 1}
    alone = bp.Scene(box={"x": [0, 40], "y": [0, 40]}, disks=[disk], duration=2)
    (text,) = answer_in_words(bp.analyse(bp.simulate(alone, quiet=True)))
    assert text.startswith("After 2 time units the tracer has moved by 10 on average")


def test_the_front_of_a_trade_off_in_words():
    front = [Interval("langevin", 0.01, 2.0), Interval("exact", 2.0, np.inf)]
    assert front_in_words(front) == "with langevin up to 2 s of CPU, then with exact"
    assert front_in_words(front[1:]) == "with exact, for any CPU time"


def test_settings_that_may_be_the_best_in_words():
    front = [Interval("late", 0.01, 2.0), Interval("exact", 2.0, np.inf)]
    may_be_best = {"late": (0.01, np.inf), "exact": (2.0, np.inf), "fine": (0.1, 5.0)}
    assert rivals_in_words(front, may_be_best) == (
        " The runs do not tell whether it is smaller with fine, or with late after 2 s, too."
    )
    may_be_best = {"late": (0.01, 3.0), "exact": (1.0, np.inf)}
    assert rivals_in_words(front, may_be_best) == ""


# -- the page --------------------------------------------------------------------------------------


def test_the_page_begins_with_the_scene_and_the_answer(dataset):
    made = page.page_of_results(dataset, [], RECORD)
    assert page.page_of_results(dataset, [], RECORD) == made, "deterministic"
    text = made.decode()
    places = [
        text.index(mark)
        for mark in ('class="setup"', "<svg class", "<canvas", 'class="sentence"', "<table>")
    ]
    assert places == sorted(places)
    (data,) = re.findall('class="brownpipe-replay-data">(.*?)</script>', text)
    shown = scenes_in_motion(dataset)[0].replay.data
    assert json.loads(data) == json.loads(json.dumps(shown))


@WITH_BROWSER
@pytest.mark.slow
def test_a_small_replay_plays_when_it_is_clicked(dataset, tmp_path):
    (tmp_path / "page.html").write_bytes(page.page_of_results(dataset, [], RECORD))
    chromium = browser.Browser(tmp_path / "profile")
    chromium.show(tmp_path / "page.html", still=False)
    section = "document.querySelector('.brownpipe-replay')"
    label = f"{section}.querySelector('.brownpipe-replay-play').textContent"
    shown = "getComputedStyle({}.querySelector('.brownpipe-replay-{}')).display"
    time = f"Number({section}.querySelector('.brownpipe-replay-time').value)"
    assert chromium.value(label) == "Play"
    assert chromium.value(time) == 0
    assert chromium.value(shown.format(section, "still")) == "none"
    chromium.value(f"{section}.querySelector('.brownpipe-replay-box').click()")
    chromium.until(f"{time} > 0")
    assert chromium.value(label) == "Pause"
    chromium.call("Emulation.setEmulatedMedia", media="print")
    assert chromium.value(shown.format(section, "still")) == "block"
    assert chromium.value(shown.format(section, "box")) == "none"
    assert chromium.console == []
    chromium.close()
