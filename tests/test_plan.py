"""Plans: so many runs for a tolerance, the same each time; the cheapest engine; what a CPU time
buys; what cannot be is refused.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from brownpipe import cli, tradeoff
from brownpipe.analysis.resampling import resample
from brownpipe.engines import Engine, engine_of_request
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.forecast import START_UP, Cost
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, AnalysisError, RequestError, StorageError
from brownpipe.observables.displacement import squared
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.study import budget, plan, read_study
from brownpipe.study.budget import Budget
from brownpipe.study.plan import MOST_PILOT_RUNS, Performance, offers
from brownpipe.study.run_sets import files_of, run_sets
from brownpipe.study.study import read_keys
from brownpipe.verbs.options import typed
from ensembles import make_scene
from pipeline import FEW_DISKS

EXACT = Engine("exact")
COARSE = Engine("timestep", (("time_step", 0.03), ("collisions", "at_contact")))


def measured(engine, runs, seconds, scene=None):
    return Performance(
        scene or make_scene(), engine, 0.0, 0.0, runs, Cost(0.0, 0.0, seconds, 0.0, 0.0, 0.0)
    )


@pytest.fixture
def study_file(tmp_path):
    """A function that writes a study of one small scene; returns its path."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "few.yaml").write_text(FEW_DISKS)

    def make(**keys):
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump({"scenes": "scenes/few.yaml"} | keys))
        return path

    return make


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


# -- the choice ------------------------------------------------------------------------------------


def test_cheapest_that_meets_the_tolerance_comes_first():
    """Biases of 1 % in half the time: for 2 % it is cheaper, 1/(1 - 1/4) = 4/3 of the runs; for 1 %
    it cannot do.
    """
    first, second = offers([measured(EXACT, 2500, 0.02), measured(COARSE, 3334, 0.01)])
    assert (first.engine, first.runs, second.engine, second.runs) == (COARSE, 3334, EXACT, 2500)
    assert [
        one.engine for one in offers([measured(EXACT, 2500, 0.02), measured(COARSE, None, 0.01)])
    ] == [EXACT]


def test_bias_and_what_is_not_known_of_it_count_as_error(study_file, here, monkeypatch):
    """Each alone is below the tolerance of 2 %; together they are sqrt(0.015^2 + 0.018^2) = 2.3
    %.
    """
    monkeypatch.setattr("brownpipe.study.plan.MOST_PILOT_RUNS", 10)
    values = {"msd_bias": 0.015, "msd_bias_standard_error": 0.018, "msd_spread": 1.0}
    compared = []
    monkeypatch.setattr(tradeoff, "compare", lambda *given: compared.append(given) or values)
    engine = {"name": "timestep", "time_step": 0.01}
    study = read_study(study_file(seeds=5, engines=engine, fit_windows=[[0.1, 0.4], [0.2, 0.5]]))
    needed = [plan.performance_of(study, "msd", tolerance)[0][0].runs for tolerance in (0.02, 0.03)]
    assert needed == [
        None,
        math.ceil((2.26216 / 1.95996) ** 2 / (0.03**2 - 0.018**2 - 0.015**2)),
    ]  # Student's, normal
    asked = {(runs.engine.name, exact.engine.name, window) for runs, exact, window, _ in compared}
    assert asked == {("timestep", "exact", (0.1, 0.4))}


def test_one_engine_for_all_cases_has_the_most_runs_of_any():
    others = make_scene(name="other")
    found = [
        measured(EXACT, 2500, 0.02),
        measured(COARSE, 3334, 0.01),
        measured(EXACT, 3600, 0.05, others),
    ]
    (only,) = offers(found)
    assert (only.engine, only.runs) == (EXACT, 3600)
    assert 3600 * 0.07 < only.seconds < 3600 * 0.07 + 20 * START_UP  # with its jobs
    assert "3,600 runs in each case" in plan.recommendation(found, [], "msd", 0.02)


# -- the number of runs of a study -----------------------------------------------------------------


def counted(study):
    """How many runs the tolerance of a study needs, as its workflow determines it."""
    return plan.write_plan(study, "counted.yaml")[0]


def test_number_of_runs_is_a_function_of_scene_tolerance_and_target(study_file, here, monkeypatch):
    study = read_study(study_file(tolerance="4%"))
    runs = counted(study)
    text = Path("counted.yaml").read_bytes()
    assert counted(study) == runs and Path("counted.yaml").read_bytes() == text
    assert plan.with_planned_seeds(study, "counted.yaml").seeds == range(runs)
    for others in (
        {"tolerance": "5%"},
        {"tolerance": "4%", "target": "d"},
        {"tolerance": "4%", "particles": 9},
    ):
        with pytest.raises(RequestError, match=r"counted.yaml: is the plan of another study"):
            plan.with_planned_seeds(read_study(study_file(**others)), "counted.yaml")
    with monkeypatch.context() as patch:
        patch.setattr(plan, "digests", lambda _: {"plan": "12345678e012"})  # in YAML a number
        assert plan.with_planned_seeds(
            study, "counted.yaml" if counted(study) else ""
        ).seeds == range(runs)
    half = counted(read_study(study_file(tolerance=0.08)))
    assert runs / half == pytest.approx(4, rel=0.02)  # rounded up to whole runs
    other = counted(read_study(study_file(tolerance=0.1, target="displacement_distribution")))
    assert other == math.ceil((tradeoff.bias.spread_of_shares() / 0.1) ** 2)
    monkeypatch.setattr(plan, "MOST_SEEDS", 100)
    with pytest.raises(RequestError, match=f"a tolerance of 0.04 needs {runs} runs; at most 100"):
        counted(study)
    Path("counted.yaml").write_bytes(text.replace(b"runs: ", b"runs: 1"))
    with pytest.raises(StorageError, match="damaged, cut short or edited"):
        plan.with_planned_seeds(study, "counted.yaml")
    with pytest.raises(RequestError, match="--plan: missing"):
        plan.with_planned_seeds(study, None)
    with pytest.raises(RequestError, match="is for a study with a tolerance"):
        counted(read_study(study_file(seeds=5)))


def test_runs_that_fail_are_made_up_for(study_file, here, monkeypatch):
    """Three of four runs of the pilot failed: four times as many runs are needed."""
    needed = counted(read_study(study_file(tolerance=0.05)))
    of_blocks = tradeoff.runs_of
    failing = lambda *given: (runs := of_blocks(*given))._replace(failed=3 * len(runs.seeds))  # noqa: E731
    monkeypatch.setattr(tradeoff, "runs_of", failing)
    assert counted(read_study(study_file(tolerance=0.05))) == 4 * needed


@pytest.mark.parametrize("target", ["msd", "d", "displacement_distribution"])
def test_a_tracer_that_does_not_move_has_no_relative_error(
    study_file, tmp_path, here, capsys, target
):
    (tmp_path / "scenes" / "few.yaml").write_text(
        FEW_DISKS.replace("standard_deviation: 2.0", "temperature: 0.0")
    )
    with pytest.raises(
        RequestError, match="tolerance: few leaves nothing to chance; must be seeds: 1"
    ):
        read_study(study_file(tolerance=0.05, target=target))
    path = study_file(seeds=5)
    assert cli.main(["plan", str(path), "--tolerance", "5%", "--target", target]) == WRONG_REQUEST
    said = capsys.readouterr().err
    assert "few leaves nothing to chance" in said and said.count("\n") == 1
    scene = read_study(path).cases[0]
    runs = tradeoff.runs_of(scene, EXACT, EXACT.simulate(scene, range(5), {"tracer"}))
    with pytest.raises(AnalysisError, match="few: the tracer does not move"):
        tradeoff.compare(runs, runs, (0.1, 0.5), 1.0)


CONFINED = """\
box: {x: [0.0, 2.4], y: [0.0, 2.4]}
disks:
  tracer: {radius: RADIUS, mass: 1.5}
  species: [{name: bath, count: 10, radius: 0.12, mass: 1.0}]
velocities: {temperature: 1.2}
duration: 80.0
sample_interval: 1.0
"""


@pytest.mark.parametrize("radius", [0.3, 0.32, 0.45])  # +0.4, -1.9 and +1.8 standard errors
def test_a_tracer_that_has_filled_its_box_has_no_d_to_plan_for(study_file, here, capsys, radius):
    (here / "scenes" / "few.yaml").write_text(CONFINED.replace("RADIUS", str(radius)))
    path = str(study_file(tolerance="4%", target="d"))
    for words in (["--count", "p.yaml"], [], ["--write", "my.yaml"]):
        assert cli.main(["plan", path, *words]) == WRONG_REQUEST
        said = capsys.readouterr().err
        assert "few, N = 11: the 400 pilot runs do not tell D from zero, " in said
        assert "in the window [" in said and "target: msd, or seeds\n" in said
        assert said.count("\n") == 1
    assert not Path("p.yaml").exists() and not Path("my.yaml").exists()
    assert cli.main(["plan", path, "--target", "msd"]) == DONE


def test_an_expensive_d_has_pilots_enough_to_tell_it_from_zero(study_file, here, monkeypatch):
    monkeypatch.setattr("brownpipe.study.plan.PILOT_SECONDS", 0.0)
    sizes = {}
    for target in ("msd", "d"):
        _, (pilot,) = plan.write_plan(read_study(study_file(tolerance="9%", target=target)), "p")
        sizes[target] = len(pilot.runs.seeds)
    assert sizes == {"msd": 10, "d": 100}


def test_a_study_that_stores_no_displacements_has_no_plan_for_them(study_file, here):
    for target, measured in (
        ("msd", "species_energy"),
        ("displacement_distribution", "square_displacement"),
    ):
        with pytest.raises(
            RequestError, match=f"the target {target} needs record: tracer, or square_displacement"
        ):
            counted(
                read_study(
                    study_file(tolerance=0.1, target=target, record="none", observables=[measured])
                )
            )
    (here / "scenes" / "few.yaml").write_text(FEW_DISKS.replace("sample_interval: 0.05", ""))
    with pytest.raises(
        AnalysisError, match=r"fit window \[0.25, 0.5\]: must .* have three samples or more"
    ):
        counted(read_study(study_file(tolerance=0.1, target="d")))


@pytest.mark.parametrize(
    "measured", [{}, {"record": "none", "observables": ["square_displacement", "my:f"]}]
)
def test_pilot_runs_are_the_first_of_the_study_which_uses_them_again(
    study_file, here, capsys, measured, monkeypatch
):
    """And a plan that is asked again makes none, and says the same."""
    (here / "my.py").write_text("def f(scene, run):\n    return {'mine': 1.0}\n")
    path = study_file(tolerance=0.04, **measured).relative_to(here)
    monkeypatch.setattr(plan, "digests", lambda _: {"plan": "502393894986"})  # as a number in YAML
    runs, (pilot,) = plan.write_plan(study := read_study(path), "counted.yaml")
    (file,) = Path("results/runs").rglob("*.h5")
    assert (file.name, pilot.new_runs, len(pilot.runs.seeds)) == (
        f"0-{MOST_PILOT_RUNS - 1}.h5",
        *2 * [MOST_PILOT_RUNS],
    )
    first, *others = files_of(plan.with_planned_seeds(study, "counted.yaml"))
    ends = "-".join(one.path.stem for one in others).split("-")
    assert first.path == file
    assert (ends[0], ends[-1]) == (f"{MOST_PILOT_RUNS}", f"{runs - 1}")
    again, (pilot,) = plan.write_plan(study, "counted.yaml")
    assert (again, pilot.new_runs) == (runs, 0)
    assert [*Path("results/runs").rglob("*.h5")] == [file]
    assert cli.main(["plan", str(path), "--write", "planned.yaml"]) == DONE
    said = capsys.readouterr().out
    assert f"exact: {runs:,} runs" in said and "0 pilot runs made" in said
    assert files_of(read_study("planned.yaml"))[0].path == file
    others = [
        "--tolerance=9%",
        "--target=d",
        "--write=plans/other.yaml",
        "--config",
        "particles=09",
    ]
    assert cli.main(["plan", str(path), *others, "fit_windows=[[.1, .4]]"]) == DONE
    assert "\nd to 9 %:" in capsys.readouterr().out and Path("results/runs/few/N9").is_dir()
    assert ((other := read_study("plans/other.yaml")).particles, other.fit_windows) == (
        (9,),
        ((0.1, 0.4),),
    )


def test_only_engines_of_the_study_are_considered_in_their_order(
    study_file, here, monkeypatch, capsys
):
    monkeypatch.setattr("brownpipe.study.plan.MOST_PILOT_RUNS", 20)
    (here / "scenes" / "few.yaml").write_text(FEW_DISKS.replace("mass: 1.0", "mass: 5.0"))
    langevin = {"name": "langevin", "friction": "enskog"}
    for first, engines in (
        (7, ["exact"]),
        (9, [langevin]),
        (5, [langevin, "exact"]),
    ):  # some runs are stored
        found, pilots = plan.performance_of(
            read_study(study_file(seeds=f"{first}-12", engines=engines)), "msd", 0.05
        )
        names = [engine if engine == "exact" else "langevin" for engine in engines]
        assert [one.engine.name for one in found] == names
        assert {pilot.runs.engine.name for pilot in pilots} == {"exact", *names}
        assert all(pilot.runs.seeds.tolist() == [*range(first, first + 20)] for pilot in pilots)


@pytest.mark.slow
def test_intervals_cover_the_truth_although_pilot_runs_decide_their_number(fewer_replicates):
    """Two-stage sampling of r^2, exponential with mean 1, to 4 %, with pilots of 100 runs.

    400 studies know a coverage of 95 % to 1.1 %, and a bias to a twentieth of the tolerance.
    """
    rng = np.random.default_rng(5)
    covered = []
    means = []
    for _ in range(400):
        pilot = rng.exponential(size=100)
        more = rng.exponential(
            size=max(0, math.ceil((pilot.std(ddof=1) / pilot.mean() / 0.04) ** 2) - 100)
        )
        found = resample(np.append(pilot, more))
        covered.append(found.low < 1.0 < found.high)
        means.append(found.mean)
    assert np.mean(covered) == pytest.approx(0.95, abs=3.3 * 0.011)
    assert np.mean(means) == pytest.approx(1.0, abs=3.3 * 0.05 * 0.04)


def test_achieved_error_is_the_tolerance(study_file, tmp_path, here):
    """400 runs of the pilot and those of the study each know a spread of exponential r^2 to
    sqrt(2/n): 8 % here.
    """
    study = read_study(study_file(tolerance=0.05))
    (scene,) = study.cases
    track = exact.simulate(scene, range(counted(study))).tracer
    end = squared(track.position - track.position[0])[-1]
    achieved = end.std(ddof=1) / end.mean() / math.sqrt(len(end))
    known_to = math.sqrt(2 / MOST_PILOT_RUNS + 2 / len(end))
    assert achieved == pytest.approx(0.05, rel=3.3 * known_to)  # a false alarm in 1,000


CHANNEL = """\
box: {x: [0, 20], y: [0, 3], boundary: {x: periodic, y: reflecting}}
disks: {species: [{name: gas, count: 12, radius: 0.5, mass: 1.0}]}
velocities: {temperature: 1.0}
duration: 4.0
sample_interval: 0.1
"""


OBLONG = CHANNEL.replace(", boundary: {x: periodic, y: reflecting}", "")


@pytest.mark.parametrize(
    ("text", "reason"), [(CHANNEL, "is a channel"), (OBLONG, "has walls of unequal lengths")]
)
def test_a_diffusion_coefficient_by_axis_is_not_planned(text, reason, study_file, tmp_path):
    """Neither by a study that is read, nor by `plan --target d`."""
    (tmp_path / "scenes" / "few.yaml").write_text(text)
    study = read_study(study_file(seeds=8))
    with pytest.raises(RequestError, match=f"the target d: few, N = 12 {reason}"):
        plan.performance_of(study, "d", 0.05)
    path = study_file(tolerance=0.05, target="d")
    with pytest.raises(RequestError, match=f"target: few, N = 12 {reason}"):
        read_study(path)


@pytest.mark.slow
def test_an_average_within_runs_needs_fewer_of_them(study_file, tmp_path, here):
    """Over twelve equal disks, which hardly know of each other: some twelfth of the runs of one
    disk.
    """
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
        runs[average] = len(range(counted(study)))
        ((found,), _) = plan.performance_of(study, "msd", 0.05)
        assert found.runs == pytest.approx(runs[average], rel=0.1)
    assert 5 < runs["runs"] / runs["disks"] < 15


# -- engines ---------------------------------------------------------------------------------------


def test_engines_are_used_where_and_as_often_as_they_are_told(study_file, tmp_path):
    (tmp_path / "scenes" / "equal.yaml").write_text(
        FEW_DISKS.replace("radius: 0.3, mass: 1.0", "radius: 0.1, mass: 0.4")
    )
    engines = ["exact", {"name": "langevin", "friction": "enskog", "scenes": "few", "seeds": 3}]
    keys = {"scenes": ["scenes/few.yaml", "scenes/equal.yaml"], "seeds": 7}
    study = read_study(study_file(**keys, engines=engines))
    sets = [(runs.case.name, runs.engine.label, [*runs.seeds]) for runs in run_sets(study)]
    few = [("few", "exact", [*range(7)]), ("few", "langevin-enskog", [*range(3)])]
    assert sets == [*few, ("equal", "exact", [*range(7)])]
    substituted = read_study(study_file(**keys, instead_of={"few": "equal"}))
    assert [case.label for case in study.compared_cases] == ["few_N12"]
    assert [case.label for case in substituted.compared_cases] == ["few_N12"]
    with pytest.raises(RequestError, match="langevin is for a heavy tracer"):  # equal disks
        read_study(
            study_file(**keys, engines=["exact", {"name": "langevin", "friction": "enskog"}])
        )


# -- a CPU time in place of a tolerance ------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seconds"), [("60s", 60.0), ("5min", 300.0), ("2h", 7200.0), (".5 h", 1800.0)]
)
def test_a_budget_is_a_time_with_its_unit(text, seconds):
    assert typed(Budget)(text) == seconds


def test_a_budget_pays_jobs_and_as_many_runs_of_each_case():
    """Two cases with jobs of START_UP, 0.5 s, and 2 s for one run of each: 9 s pay four of them."""
    costs = [Cost(0.0, 0.0, seconds, 0.0, 0.0, 0.0) for seconds in (0.5, 1.5)]
    assert [budget.affordable_runs(time, costs) for time in (0.0, 2.9, 3.0, 8.9, 9.0)] == [
        0,
        0,
        1,
        3,
        4,
    ]
    assert budget.affordable_runs(1e300, costs) == MOST_SEEDS


def test_a_tolerance_that_is_the_error_of_a_budget_needs_its_runs(study_file, here):
    """For MSD and D, with the exact engine and one that has a bias."""
    study = read_study(
        study_file(seeds=5, engines=["exact", {"name": "timestep", "time_step": 0.01}])
    )
    paid, pilots = budget.errors_within(study, budget.paid_offers(study, 60.0), "d")
    assert [runs.offer.engine.name for runs in paid] == ["exact", "timestep"]
    assert len({runs.offer.runs for runs in paid}) == 2, "the engines differ in cost"
    assert all(pilot.new_runs == MOST_PILOT_RUNS for pilot in pilots)
    for target in ("msd", "d"):
        for runs in paid:
            performances, again = plan.performance_of(study, target, runs.errors[target])
            needed = {one.engine: one.runs for one in performances}
            assert needed[runs.offer.engine] == pytest.approx(runs.offer.runs, abs=1)
            assert not any(pilot.new_runs for pilot in again), "the pilot runs are the same"


def test_the_best_engine_of_a_budget_has_the_smallest_error_in_its_worst_case(study_file):
    cheap = plan.Offer(COARSE, 200, 9.0)
    good = plan.Offer(EXACT, 100, 9.0)
    study = read_study(study_file(seeds=5, particles=[9, 12]))
    first, second = study.cases

    def paid(scene, offer, error):
        return budget.PaidRuns(scene, offer, 0.1, {"msd": error, "d": math.nan})

    good_runs = [paid(first, good, 0.03), paid(second, good, 0.03)]
    cheap_runs = [paid(first, cheap, 0.01), paid(second, cheap, 0.05)]
    assert budget.best_offer(study, [*good_runs, *cheap_runs], "msd") == good
    assert budget.best_offer(study, [good_runs[0], *cheap_runs], "msd") == cheap
    assert budget.best_offer(study, [*good_runs, *cheap_runs], "d") is None
    assert budget.best_offer(study, [good_runs[0], cheap_runs[1]], "msd") is None


def test_a_budget_names_engines_that_it_does_not_pay_and_writes_the_best(study_file, here, capsys):
    engines = ["exact", {"name": "timestep", "time_step": 1e-9}]  # 9 s of CPU a run
    path = str(study_file(seeds="7-9", engines=engines))
    assert cli.main(["plan", path, "--budget", "2s", "--write", "my.yaml"]) == DONE
    said = capsys.readouterr().out
    assert "\ntimestep-1e-09: not one run of each case\n" in said
    assert "\n2 s of CPU for all cases of an engine:\n" in said
    assert "400 pilot runs made" in said, "none of an engine that is not paid"
    planned = read_study("my.yaml")
    runs = len(planned.seeds)
    assert f"\nuse exact: {runs:,} runs in each case; 2 s of CPU\n" in said
    assert (planned.seeds[0], [use.engine for use in planned.uses]) == (7, [EXACT])


def test_the_smallest_budget_that_is_named_pays(study_file):
    study = read_study(study_file(seeds=5))
    with pytest.raises(RequestError, match=r"must be at least (0\.\d)s") as refused:
        budget.paid_offers(study, 0.01)
    smallest = float(re.search(r"at least (.*)s", str(refused.value))[1])
    assert budget.paid_offers(study, smallest)[0].runs > 0
    with pytest.raises(RequestError):
        budget.paid_offers(study, smallest - 0.1)


def test_a_budget_says_where_a_study_cannot_have_the_runs_that_it_pays(study_file, here, capsys):
    path = str(study_file(seeds=5))
    limit = "exact: 10,000,000 runs in each case are the most of a study\n"
    assert cli.main(["plan", path, "--budget", "9000h"]) == DONE
    assert limit in capsys.readouterr().out
    assert cli.main(["plan", path, "--budget", "2s"]) == DONE
    assert limit not in capsys.readouterr().out


def test_a_budget_gives_no_error_of_a_d_that_is_none(study_file, here, capsys):
    (here / "scenes" / "few.yaml").write_text(CONFINED.replace("RADIUS", "0.3"))
    path = str(study_file(seeds=5))
    assert cli.main(["plan", path, "--budget", "10s"]) == DONE
    heading, row, *_ = capsys.readouterr().out.splitlines()
    assert heading.endswith("error of msd  error of d")
    assert row.endswith("%        not told from zero")
    words = ["--budget", "10s", "--target", "d", "--write", "my.yaml"]
    assert cli.main(["plan", path, *words]) == FAILED
    assert "no engine with an error of d in all cases" in capsys.readouterr().out
    assert not Path("my.yaml").exists()


@pytest.mark.parametrize(
    ("text", "reason"), [(CHANNEL, "in channels"), (OBLONG, "for walls of unequal lengths")]
)
def test_a_budget_has_no_error_of_d_by_axis(text, reason, study_file, here, capsys):
    (here / "scenes" / "few.yaml").write_text(text)
    assert cli.main(["plan", str(study_file(seeds=5)), "--budget", "10s"]) == DONE
    _, row, *_ = capsys.readouterr().out.splitlines()
    assert row.endswith(f"%        not planned {reason}")


# -- the command -----------------------------------------------------------------------------------


def test_a_planned_study_has_no_figures_that_its_engine_cannot_show(study_file, here):
    path = study_file(seeds="7-9", figures=["thermodynamics"])
    engine = engine_of_request("langevin", {"friction": "enskog"})
    keys = read_keys(path, {"particles": 9})
    plan.write_study(
        read_study(path, {"particles": 9}),
        keys,
        "other.yaml",
        plan.Offer(engine, 20, 1.0),
        "planned",
    )
    assert "msd" in read_study("other.yaml").figures
    assert (read_study("other.yaml").particles, [*read_study("other.yaml").seeds]) == (
        (9,),
        [*range(7, 27)],
    )
    assert (
        cli.main(["plan", str(path), "--tolerance", "9%", "--write", "other.yaml"]) == WRONG_REQUEST
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tolerance", "0"], "--tolerance: must be greater than or equal to 0.000316"),
        ([], "--tolerance: missing; must be given, as the study has none"),
        (["--tolerance", "2%", "--target", "energy"], "--target: must be 'msd', 'd' or"),
        (["--count", "p.yaml", "--write", "my.yaml"], "--write: must not be given with --count"),
        (["--count", "p.yaml", "--budget", "1h"], "--budget: must not be given with --count"),
        (["--budget", "1h", "--tolerance", "2%"], "--budget: must not be given with --tolerance"),
        *(
            (
                [f"--budget={time}"],
                "--budget: must be a CPU time above zero, such as 60s, 5min or 2h",
            )
            for time in ("60", "0s", "-1s", "nan", "1d", "1 2s", "9" * 400 + "h")
        ),
        (
            ["--budget", "0.4s"],
            "--budget: 400 ms of CPU do not pay one run of each case; must be at least 0.6s",
        ),
    ],
)
def test_wishes_that_cannot_be_are_refused(study_file, here, capsys, monkeypatch, words, message):
    monkeypatch.setattr("brownpipe.verbs.studies.performance_of", None)
    monkeypatch.setattr("brownpipe.verbs.studies.errors_within", None)
    try:
        status = cli.main(["plan", str(study_file(seeds=5)), *words])
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr().err
    assert status == WRONG_REQUEST and message in said and said.count("\n") == 1


LATTICE = """\
box: {x: [0, 10.75], y: [0, 10.75], boundary: periodic}
disks: {species: [{name: bath, count: 100, radius: 0.5, mass: 1.0}], placement: lattice}
velocities: {temperature: 1.0}
equilibrate: TIME
duration: 4.0
sample_interval: 0.5
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time", "said"),
    [
        ("0.1", "within the runs: not equilibrated; try equilibrate.time: "),
        ("10", "no drift found"),
    ],
)
def test_a_plan_says_whether_its_pilot_runs_are_settled(
    study_file, here, capsys, monkeypatch, time, said
):
    monkeypatch.setattr("brownpipe.study.plan.MOST_PILOT_RUNS", 50)
    path = study_file(seeds=10)
    (path.parent / "scenes" / "few.yaml").write_text(LATTICE.replace("TIME", time))
    assert cli.main(["plan", str(path), "--tolerance", "20%"]) == DONE
    assert said in capsys.readouterr().out
