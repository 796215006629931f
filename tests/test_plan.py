"""Plans: so many runs for a tolerance, the same each time; the cheapest engine; what cannot be is refused."""

import math
import os
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml

from brownpipe import cli, storage, tradeoff
from brownpipe.analysis.displacement import squared_displacement
from brownpipe.engines import Engine, configured, forecast
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.saturation import share_failing
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, AnalysisError, RequestError
from brownpipe.scene import parse_scene
from brownpipe.study import performance, pilot, plan, read_study, run_count, writing
from brownpipe.study.batches import automatic_batches
from brownpipe.study.offers import cores, offers
from brownpipe.study.performance import CasePerformance, EnginePerformance
from brownpipe.verbs import values
from ensembles import make_runs, make_scene, write

EXACT = Engine("exact")
COARSE = Engine("timestep", (("time_step", 0.03), ("precision", "double"), ("collisions", "at_contact")))
FINE = Engine("timestep", (("time_step", 0.001), ("precision", "double"), ("collisions", "at_contact")))
SCENE = """\
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 12
disks:
  tracer: {radius: 0.3, mass: 1.0, position: [0.0, 0.0]}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {standard_deviation: 2.0}
duration: 0.5
sample_interval: 0.05
"""


def case_of(*engines, **scene):
    return CasePerformance(make_scene(**scene), "a test", {one.engine: one for one in engines})


@pytest.fixture
def study_file(tmp_path):
    """A function that writes a study of one small scene; returns its path."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "few.yaml").write_text(SCENE)

    def make(**keys):
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump({"scenes": "scenes/few.yaml"} | keys))
        return path

    return make


# -- the choice -----------------------------------------------------------------------------------------------------


def test_cheapest_that_meets_the_tolerance_comes_first():
    """Biases of 1 % in half the time: for 2 % it is cheaper, 1/(1 - 1/4) = 4/3 of the runs; for 1 % it cannot do."""
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(COARSE, 0.01, 1e-4, 1.0, 0.01))
    first, second = offers([case], 0.02, None)
    assert (first.engine, first.runs, second.engine, second.runs) == (COARSE, 3334, EXACT, 2500)
    assert first.error == pytest.approx(0.02, rel=1e-3) and second.error == pytest.approx(0.02)
    assert [one.engine for one in offers([case], 0.01, None)] == [EXACT]


def test_what_is_not_known_of_a_bias_counts_as_error():
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(COARSE, 0.001, 0.03, 1.0, 0.01))
    assert [one.engine for one in offers([case], 0.02, None)] == [EXACT]
    assert offers([case], 0.05, None)[0].runs == math.ceil(1 / (0.05**2 - 0.03**2))


def test_costlier_engines_that_were_not_compared_offer_nothing():
    case = case_of(
        EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(FINE, math.nan, math.nan, 1.0, 0.05)
    )
    assert [one.engine for one in offers([case], 0.02, None)] == [EXACT]
    assert "no         timestep-0.001: a run costs 2.5 times" in plan.recommendation([case], "msd", 0.02, None)


def test_an_engine_that_costs_more_than_the_exact_one_is_named_once():
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(FINE, 0.001, 1e-4, 1.0, 0.05))
    text = plan.recommendation([case], "msd", 0.02, None)
    assert text.count("timestep-0.001") == 1 and "no         timestep-0.001: a run costs 2.5 times" in text


def test_an_engine_that_costs_more_in_all_cases_together_is_no_offer_for_all():
    dear = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(FINE, 0.001, 1e-4, 1.0, 0.05))
    nearly = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(FINE, 0.001, 1e-4, 1.0, 0.019))
    assert [one.engine for one in offers([dear, nearly], 0.02, None)] == [EXACT]
    assert [one.engine for one in offers([nearly], 0.02, None)] == [FINE, EXACT]


def test_a_budget_buys_the_smallest_error_and_may_be_too_small_for_a_tolerance():
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(COARSE, 0.05, 1e-4, 1.0, 0.002))
    best, other = offers([case], None, 10.0)
    assert best.engine == EXACT and best.seconds <= 10.0 and best.error == pytest.approx(1 / math.sqrt(best.runs))
    assert other.error > 0.05
    assert offers([case], None, 2.0)[0].engine == COARSE
    assert offers([case], 0.02, 10.0) == []
    text = plan.recommendation([case], "msd", 0.02, 10.0)
    assert "cannot be met within 10 s of CPU" in text and f"instead    exact: {best.runs:,} runs" in text


def test_one_engine_for_all_cases_has_the_most_runs_of_any():
    cases = [
        case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02), EnginePerformance(COARSE, 0.01, 1e-4, 1.0, 0.01)),
        case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.2, 0.05)),
    ]
    (only,) = offers(cases, 0.02, None)
    assert (only.engine, only.runs, only.error) == (EXACT, 3600, pytest.approx(0.02))
    assert only.seconds == pytest.approx(3600 * 0.07, rel=0.15)  # and some starts of processes
    assert "the same engine in all cases" in plan.recommendation(cases, "msd", 0.02, None)


def test_an_offer_takes_as_long_as_the_jobs_of_the_study_that_it_becomes():
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02))
    for tolerance in (0.1, 0.001):
        (one,) = offers([case], tolerance, None)
        batches = automatic_batches(range(one.runs), EXACT.forecast(case.scene))
        started = len(batches) * forecast.START_UP
        assert one.seconds == pytest.approx(one.runs * 0.02 + started, rel=1e-3)  # and some writing
        longest = 0.02 * max(last - first + 1 for first, last in batches)
        assert one.wall_seconds == pytest.approx(max(longest, one.seconds / cores()), rel=1e-3)


# -- the number of runs of a study ----------------------------------------------------------------------------------


def test_number_of_runs_is_a_function_of_scene_tolerance_and_target(study_file, tmp_path, monkeypatch):
    study = read_study(study_file(tolerance="4%"))
    settled = run_count.settle(study, tmp_path / "plan.yaml", print)
    again = run_count.settle(study, tmp_path / "again.yaml", print)
    assert (
        settled.seeds == again.seeds and (tmp_path / "plan.yaml").read_bytes() == (tmp_path / "again.yaml").read_bytes()
    )
    half = run_count.settle(read_study(study_file(tolerance=0.08)), tmp_path / "half.yaml", print)
    assert len(settled.seeds) / len(half.seeds) == pytest.approx(4, rel=0.02)  # rounded up to whole runs
    monkeypatch.setattr(run_count, "run_pilot", None)  # what is written down is not worked out again
    assert run_count.settle(study, tmp_path / "plan.yaml", print).seeds == settled.seeds


def test_number_of_runs_is_worked_out_again_when_the_scene_or_the_wish_changes(study_file, tmp_path):
    first = run_count.settle(read_study(study_file(tolerance=0.1)), tmp_path / "plan.yaml", print)
    other = run_count.settle(
        read_study(study_file(tolerance=0.1, target="displacement_distribution")), tmp_path / "plan.yaml", print
    )
    assert len(other.seeds) == math.ceil((tradeoff.bias.spread_of_shares() / 0.1) ** 2) != len(first.seeds)
    (tmp_path / "scenes" / "few.yaml").write_text(SCENE.replace("12", "13"))
    again = run_count.settle(read_study(study_file(tolerance=0.1)), tmp_path / "plan.yaml", print)
    digests = yaml.safe_load((tmp_path / "plan.yaml").read_text())["scenes"]
    assert digests == {"few, N = 13": again.cases[0].digest} and again.seeds != ()


def test_runs_that_fail_are_made_up_for(study_file, tmp_path, monkeypatch):
    """Three of four runs of the pilot failed: four times as many runs are needed."""
    needed = run_count.settle(read_study(study_file(tolerance=0.05)), tmp_path / "all.yaml", print).seeds
    pilot = run_count.run_pilot
    monkeypatch.setattr(
        run_count, "run_pilot", lambda *case: (runs := pilot(*case))._replace(failed=3 * len(runs.seeds))
    )
    more = run_count.settle(read_study(study_file(tolerance=0.05)), tmp_path / "few.yaml", print).seeds
    assert len(more) == 4 * len(needed)
    sound, failing = (EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02, share) for share in (1.0, 0.25))
    (one,), (other,) = (offers([case_of(each)], 0.02, None) for each in (sound, failing))
    assert (one.runs, one.failing, other.runs, other.failing) == (2500, 0, 10_000, 7500)
    assert other.error == pytest.approx(one.error)
    assert "10,000 runs, of which some 7,500 fail" in plan.recommendation([case_of(failing)], "msd", 0.02, None)


def crowd(count):
    """Disks at random places, for 56 of which a share of 3e-10 of the runs is expected to fail, for 72 nine of ten."""
    disks = {"species": [{"name": "a", "count": count, "radius": 0.5, "mass": 1.0}]}
    box = {"x": [0, 10], "y": [0, 10], "boundary": "periodic"}
    return {"box": box, "disks": disks, "velocities": {"temperature": 1.0}, "duration": 0.01}


def test_a_pilot_has_runs_that_do_not_fail():
    few, many = (parse_scene(crowd(count), "crowd") for count in (40, 72))
    assert pilot.pilot_runs(many) * (1 - share_failing(many)) > 40
    assert pilot.pilot_seconds(many) > 100 * pilot.pilot_seconds(few)


def test_failing_runs_are_added_where_they_are_more_than_none(study_file, tmp_path):
    assert 0 < share_failing(parse_scene(crowd(56), "crowd")) < 1e-6
    counts = {}
    for count in (40, 56, 72):
        (tmp_path / "scenes" / "few.yaml").write_text(yaml.safe_dump(crowd(count)))
        study = read_study(study_file(tolerance=0.05, target="displacement_distribution"))
        counts[count] = len(run_count.settle(study, tmp_path / f"{count}.yaml", print).seeds)
    assert counts[40] == counts[56] < counts[72] / 5
    (tmp_path / "scenes" / "few.yaml").write_text(yaml.safe_dump(crowd(80)))
    with pytest.raises(RequestError, match=r"few, N = 80: 100 % of the runs are expected to fail; must be fewer"):
        run_count.settle(read_study(study_file(tolerance=0.05, target="displacement_distribution")), "none.yaml", print)
    assert tradeoff.runs_for(1e-4, 0.0, 1.0) == tradeoff.runs_for(1e-4, 0.0, 1.0, 1.0) == 10**8
    assert tradeoff.runs_for(0.02, 0.0, 1.0, 0.25) == 4 * tradeoff.runs_for(0.02, 0.0, 1.0)


def test_a_budget_for_too_few_runs_that_do_not_fail_offers_nothing():
    case = case_of(EnginePerformance(EXACT, 0.0, 0.0, 1.0, 0.02, share_sound=0.1))
    assert offers([case], None, 0.8) == []
    (one,) = offers([case], None, 10.0)
    assert one.runs - one.failing >= 10


@pytest.mark.parametrize("target", ["msd", "d", "displacement_distribution"])
def test_a_tracer_that_does_not_move_has_no_relative_error(study_file, tmp_path, here, capsys, target):
    (tmp_path / "scenes" / "few.yaml").write_text(SCENE.replace("standard_deviation: 2.0", "temperature: 0.0"))
    with pytest.raises(RequestError, match="tolerance: in few nothing moves; must be seeds: 1"):
        read_study(study_file(tolerance=0.05, target=target))
    path = study_file(seeds=5)
    assert cli.main(["plan", str(path), "--tolerance", "5%", "--target", target]) == WRONG_REQUEST
    said = capsys.readouterr().err
    assert "in few nothing moves" in said and said.count("\n") == 1
    scene = read_study(path).cases[0]
    runs = tradeoff.runs_of(scene, EXACT, EXACT.simulate(scene, range(5), {"tracer"}))
    with pytest.raises(AnalysisError, match="few: the tracer does not move"):
        tradeoff.compare(runs, runs, (0.1, 0.5), 1.0)


def test_plan_replaces_no_scene_and_refuses_one_without_chance(study_file, tmp_path, here, capsys):
    path, scene = study_file(seeds=5), tmp_path / "scenes" / "few.yaml"
    for name in (scene, tmp_path / "scenes" / ".." / "scenes" / "few.yaml"):
        assert cli.main(["plan", str(path), "--tolerance", "20%", "--write", str(name)]) == WRONG_REQUEST
        assert "is an input; choose another name" in capsys.readouterr().err
    assert scene.read_text() == SCENE
    listed = "box: {x: [0, 9], y: [0, 9], boundary: periodic}\nduration: 1.0\n"
    scene.write_text(f"{listed}disks: [{{position: [1, 1], velocity: [1, 0], radius: 0.5, mass: 1.0}}]\n")
    assert cli.main(["plan", str(study_file(seeds=1)), "--tolerance", "20%"]) == WRONG_REQUEST
    assert "few leaves nothing to chance" in capsys.readouterr().err


def test_a_planned_study_records_what_was_planned(study_file, here):
    path = study_file(seeds=5, record="none", observables=["species_energy"])
    writing.write_yaml("planned.yaml", writing.derived_study(path, "planned.yaml", EXACT, 20), "planned")
    assert read_study("planned.yaml").record == "tracer"


def test_achieved_error_is_the_tolerance(study_file, tmp_path):
    """400 runs of the pilot and those of the study each know a spread of exponential r^2 to sqrt(2/n): 8 % here."""
    study = run_count.settle(read_study(study_file(tolerance=0.05)), tmp_path / "plan.yaml", print)
    (scene,) = study.cases
    track = exact.simulate(scene, study.seeds).tracer
    end = squared_displacement(track.position)[:, -1]
    achieved = end.std(ddof=1) / end.mean() / math.sqrt(len(end))
    known_to = math.sqrt(2 / pilot.pilot_runs(scene) + 2 / len(end))
    assert achieved == pytest.approx(0.05, rel=3.3 * known_to)  # a false alarm in 1,000


@pytest.mark.slow
def test_an_average_within_runs_needs_fewer_of_them(study_file, tmp_path):
    """Over twelve equal disks, which hardly know of each other: some twelfth of the runs of one disk."""
    text = """\
box: {x: [0.0, 6.0], y: [0.0, 6.0], boundary: periodic}
disks:
  species: [{name: gas, count: 12, radius: 0.1, mass: 1.0}]
velocities: {temperature: 1.0}
equilibrate: {time: 1.0, tracer: free}
duration: 4.0
sample_interval: 0.5
"""
    (tmp_path / "scenes" / "few.yaml").write_text(text)
    keys = {"tolerance": 0.05, "observables": ["square_displacement"]}
    runs = {}
    for average in ("runs", "disks"):
        study = read_study(study_file(**keys, average=average))
        runs[average] = len(run_count.settle(study, tmp_path / "plan.yaml", print).seeds)
        (case,) = performance.performance_of(study, "msd", tmp_path / "nothing")
        assert case.engines[EXACT].scatter == pytest.approx(0.05 * math.sqrt(runs[average]), rel=0.05)
    assert 5 < runs["runs"] / runs["disks"] < 15


def test_a_dry_run_assumes_a_number_and_writes_nothing(study_file, tmp_path, monkeypatch):
    said = []
    study = read_study(study_file(tolerance=0.1))
    with monkeypatch.context() as patch:
        patch.setattr(run_count, "run_pilot", None)
        assumed = run_count.settle(study, tmp_path / "plan.yaml", said.append, dry_run=True)
    assert len(assumed.seeds) == 100 and not (tmp_path / "plan.yaml").exists()
    settled = run_count.settle(study, tmp_path / "plan.yaml", said.append)
    assert run_count.settle(study, tmp_path / "plan.yaml", said.append, dry_run=True) == settled
    first, second = said  # what is stored is used without a word
    assert first.startswith("brownpipe: the study study: 100 runs assumed; pilot runs, some ")
    goal = "a tolerance of 10 % of msd needs"
    exact = read_study(study_file(tolerance=0.1, target="displacement_distribution"))  # known without a pilot
    dry, settled = (run_count.settle(exact, tmp_path / f"{k}.yaml", said.append, dry_run=k == 0) for k in (0, 1))
    assert dry == settled and len(said) == 2 and not (tmp_path / "0.yaml").exists()
    assert re.fullmatch(rf".*: pilot runs, some [0-9.]+ m?s of CPU .*, determine how many runs {goal}", second)


def test_too_many_jobs_take_larger_batches(study_file, tmp_path, monkeypatch):
    monkeypatch.setattr(run_count, "MOST_JOBS", 100)
    study = replace(read_study(study_file(tolerance=0.05)), batch=1)
    settled = run_count.settle(study, tmp_path / "plan.yaml", print)
    assert len(settled.jobs()) <= 100 and len(settled.seeds) == sum(job.last - job.first + 1 for job in settled.jobs())


# -- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"seeds": 5, "tolerance": 0.02}, "seeds: must not be given with a tolerance, which says how many"),
        ({}, "seeds: missing; must be given, or a tolerance instead"),
        ({"tolerance": 0}, "tolerance: must be a relative error above 0 and below 1, like 0.02 or 2%, not 0"),
        ({"tolerance": "0%"}, "tolerance: must be a relative error above 0"),
        ({"tolerance": 1e-300}, "tolerance: must be at least 0.00032, for at most some 10000000 runs, not 1e-300"),
        ({"tolerance": "200%"}, "tolerance: must be a relative error above 0"),
        ({"tolerance": True}, "tolerance: must be a relative error above 0"),
        (
            {"tolerance": 0.02, "target": "energy"},
            "target: 'energy' is unknown; must be msd or d or displacement_distribution",
        ),
        (
            {"tolerance": 0.02, "target": "d", "observable": "d"},
            "observable: is the old name of target; must be given once",
        ),
        ({"seeds": 5, "target": "msd"}, "target: must not be given without a tolerance, which is for it"),
        ({"seeds": 5, "instead_of": {"many": "few"}}, "instead_of: unknown key 'many'"),
        (
            {"seeds": 5, "instead_of": {"few": "few"}},
            "instead_of.few: must be other scenes with the sample times of few",
        ),
        ({"seeds": 5, "engines": [{"name": "exact", "scenes": "many"}]}, "engines[0].scenes: 'many' is unknown"),
        (
            {"seeds": 5, "engines": ["exact", {"name": "exact", "seeds": 3}]},
            "engines: must be engines or settings that",
        ),
    ],
)
def test_studies_that_cannot_be_are_refused(study_file, keys, message):
    with pytest.raises(RequestError) as refusal:
        read_study(study_file(**keys))
    assert message in str(refusal.value)


def test_engines_are_used_where_and_as_often_as_they_are_told(study_file, tmp_path):
    (tmp_path / "scenes" / "equal.yaml").write_text(SCENE.replace("radius: 0.3, mass: 1.0", "radius: 0.1, mass: 0.4"))
    engines = ["exact", {"name": "langevin", "friction": "enskog", "scenes": "few", "seeds": 3}]
    keys = {"scenes": ["scenes/few.yaml", "scenes/equal.yaml"], "seeds": 7}
    study = read_study(study_file(**keys, engines=engines))
    jobs = [(job.scene, job.engine, job.last) for job in study.jobs()]
    assert jobs == [("few", "exact", 6), ("few", "langevin-enskog", 2), ("equal", "exact", 6)]
    assert study.tradeoff_cases == ["few"]
    with pytest.raises(RequestError, match="langevin is for a heavy tracer"):  # equal disks
        read_study(study_file(**keys, engines=["exact", {"name": "langevin", "friction": "enskog"}]))


# -- the command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def store_tradeoff(scene, folder):
    """Store a trade-off of a scene in which time steps cost half as much and have a bias of 5 %."""
    runs = make_runs(scene, range(300))
    track = runs.ensemble.tracer._replace(position=runs.ensemble.tracer.position * math.sqrt(1.05))
    coarse = runs._replace(engine=COARSE, ensemble=runs.ensemble._replace(tracer=track))
    files = [write(folder, one) for one in (runs, coarse)]
    found = tradeoff.measure(files, seconds_per_run=lambda engine, _: 0.02 if engine == EXACT else 0.01)
    storage.write_dataset(folder / "tradeoff.nc", found)
    return found


@pytest.mark.slow
def test_stored_tradeoffs_of_the_same_scene_are_used_and_a_study_is_written(study_file, here, monkeypatch, capsys):
    path, stored = study_file(seeds=5, rings={"dr": 0.1, "count": 9}), here / "results" / "old" / "tradeoff"
    stored.mkdir(parents=True)
    store_tradeoff(read_study(path).cases[0], stored)
    monkeypatch.setattr(performance, "pilot_performance", None)
    assert cli.main(["plan", str(path), "--tolerance", "20%", "--write", "sub/mine.yaml"]) == DONE
    said = capsys.readouterr().out
    assert "from results/old/tradeoff/tradeoff.nc" in said and "use        timestep-0.03" in said
    mine = read_study("sub/mine.yaml")
    assert (
        [use.engine for use in mine.engine_uses] == [COARSE]
        and mine.cases == read_study(path).cases
        and mine.rings == 9
    )
    assert cli.main(["plan", str(path), "--tolerance", "4%"]) == DONE
    said = capsys.readouterr().out
    assert "use        exact" in said and "no         timestep-0.03: its bias is 5" in said
    assert cli.main(["plan", str(path), "--tolerance", "1%", "--budget", "5s", "--write", "not.yaml"]) == FAILED
    assert "cannot be met within 5 s" in capsys.readouterr().out and not os.path.exists("not.yaml")


@pytest.mark.slow
def test_a_stored_tradeoff_that_is_not_as_it_was_made_is_refused_in_one_line(study_file, here, monkeypatch, capsys):
    path, stored = study_file(seeds=5), here / "results" / "old" / "tradeoff"
    stored.mkdir(parents=True)
    found = store_tradeoff(read_study(path).cases[0], stored)
    monkeypatch.setattr(performance, "pilot_performance", None)
    missing = "is missing in the dataset; make it again\n"
    texts = ("?", "null", '{"name": "other"}')
    nonsense, unknown, other = (found.engine.copy(data=np.full(found.engine.shape, text)) for text in texts)
    for wrong, line in (
        *((found.drop_vars(name), f"{name}: {missing}") for name in ("msd_bias", "msd_spread", "seconds", "setting")),
        (found.isel(scene=0), f"scene: {missing}"),
        (found.isel(setting=slice(0)), f"setting: {missing}"),
        (found.isel(setting=[1]), "setting: must have exact runs in the dataset; make it again\n"),
        (found.assign(engine=nonsense), "JSONDecodeError: "),
        (found.assign(engine=unknown), "AttributeError: "),
        (found.assign(engine=other), "exact: name: 'other' is unknown; must be"),
        *(
            (found.assign({name: 0.0 * found[name] + value}), f"{name}: must be between 0 and 1e+100")
            for name in ("msd_spread", "seconds")
            for value in (math.nan, math.inf, 0.0, -1.0, 1e300)
        ),
        (found.assign(msd_bias=0.0 * found.msd_bias + 1e300), "msd_bias: must be below 1e+100"),
        (found.assign(msd_bias=0.0 * found.msd_bias - math.inf), "msd_bias: must be below 1e+100"),
        (
            found.assign(
                msd_bias=math.nan * found.msd_bias,
                msd_bias_standard_error=0.0 * found.msd_bias_standard_error + 1e300,
            ),
            "msd_bias: must be below 1e+100",
        ),
        (found.assign(failed_runs=0 * found.failed_runs - 1), "failed_runs: must be a number of runs"),
    ):
        storage.write_dataset(stored / "tradeoff.nc", wrong)
        status, said = cli.main(["plan", str(path), "--tolerance", "20%"]), capsys.readouterr().err
        assert status == WRONG_REQUEST and said.startswith(f"brownpipe: results/old/tradeoff/tradeoff.nc: {line}"), said
        assert said.count("\n") == 1


def test_a_planned_study_has_no_figures_that_its_engine_cannot_show(study_file, here):
    path, engine = study_file(seeds=5, figures=["thermodynamics"]), configured("langevin", friction="enskog")
    writing.write_yaml("kept.yaml", writing.derived_study(path, "kept.yaml", EXACT, 20), "planned")
    writing.write_yaml("other.yaml", writing.derived_study(path, "other.yaml", engine, 20), "planned")
    assert read_study("kept.yaml").figures == ("thermodynamics",)
    assert "msd" in read_study("other.yaml").figures


def test_a_pilot_tells_what_is_not_stored(study_file, here, monkeypatch, capsys):
    monkeypatch.setattr(tradeoff.timing, "seconds_per_run", lambda engine, *_, **__: 1.0 if engine == EXACT else 2.0)
    path = study_file(tolerance=0.1)
    assert cli.main(["plan", str(path)]) == DONE
    said = capsys.readouterr().out
    assert "MSD at the end to 10 %, from a pilot of 400 runs" in said
    assert said.count("no         timestep-") == 3 and "no         langevin-enskog: a run costs 2 times" in said
    number = run_count.settle(read_study(path), "plan.yaml", print).seeds[-1] + 1
    assert f"exact: {number:,} runs" in said  # as its workflow will have it


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tolerance", "0"], "--tolerance: must be a relative error above 0 and below 1, like 0.02 or 2%, not 0.0"),
        (["--tolerance", "much"], "--tolerance: must be a relative error"),
        ([], "--tolerance: missing; must be given, or --budget"),
        (
            ["--tolerance", "2%", "--target", "energy"],
            "--target: 'energy' is unknown; must be msd or d or displacement_",
        ),
        (["--tolerance", "2%", "--target", "d", "--observable", "d"], "--observable: is the old name of --target"),
        (["--budget", "5 weeks"], "argument --budget: must be a time like 60s, 5min or 2h"),
        (["--budget", "0s"], "argument --budget: must be a finite number > 0"),
    ],
)
def test_wishes_that_cannot_be_are_refused(study_file, here, capsys, words, message):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(performance, "performance_of", None)
        try:
            status = cli.main(["plan", str(study_file(seeds=5)), *words])
        except SystemExit as end:
            status = end.code
    said = capsys.readouterr().err
    assert status == WRONG_REQUEST and message in said and said.count("\n") == 1


def test_old_names_of_the_target_are_understood_with_a_hint(study_file, here, monkeypatch, capsys):
    study = read_study(study_file(tolerance=0.1, observable="displacement"))
    hints = capsys.readouterr().err.splitlines()
    path = study_file(tolerance=0.1, target="displacement_distribution")
    assert study == read_study(path)
    assert hints == [
        f"brownpipe: {path} observable: now called target",
        f"brownpipe: {path}: target displacement: now called displacement_distribution",
    ]
    targets = []
    monkeypatch.setattr(performance, "performance_of", lambda _, target: targets.append(target))
    monkeypatch.setattr(plan, "recommendation", lambda *_: "")
    monkeypatch.setattr("brownpipe.study.offers.offers", lambda *_: [])
    for words, hints in (
        (["--target", "d"], ""),
        (["--observable", "d"], "brownpipe: --observable: now called --target\n"),
        (["--target", "displacement"], "brownpipe: --target displacement: now called displacement_distribution\n"),
        ([], ""),
    ):
        assert cli.main(["plan", str(path), *words]) == FAILED
        assert capsys.readouterr().err == hints
    assert targets == ["d", "d", *["displacement_distribution"] * 2]


def test_a_plan_written_under_the_old_name_is_used(study_file, tmp_path, monkeypatch):
    study = read_study(study_file(tolerance=0.1))
    settled = run_count.settle(study, tmp_path / "plan.yaml", print)
    text = (tmp_path / "plan.yaml").read_text()
    assert text.count("target: msd\n") == 1
    (tmp_path / "plan.yaml").write_text(text.replace("target:", "observable:"))
    monkeypatch.setattr(run_count, "run_pilot", None)
    assert run_count.settle(study, tmp_path / "plan.yaml", print).seeds == settled.seeds


def test_times_are_understood():
    assert [values.seconds(text) for text in ("60s", "5min", "2h", "1.5")] == [60.0, 300.0, 7200.0, 1.5]
    assert np.isclose(values.seconds("0.1s"), 0.1)
