"""What `brownpipe check` says, and whether the expected costs are near the real ones."""

import json
import re
import subprocess
import sys
import time
from functools import cache
from itertools import islice
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from brownpipe.engines import DEFINITIONS, Engine, configured, forecast
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.initial_state import draw
from brownpipe.engines.placement import ALL_FAIL, SOME_FAIL, crowding
from brownpipe.errors import RequestError
from brownpipe.observables import OBSERVABLES
from brownpipe.scene import parse_scene, read_scene
from brownpipe.storage.files import HDF5
from brownpipe.study import check, read_study
from brownpipe.study.check import describe_scene_or_study

CONFIG = Path(__file__).parent.parent / "config"


def test_scene():
    lines = describe_scene_or_study(CONFIG / "scenes" / "harrison2020.yaml").splitlines()
    said = {line.split()[0]: line for line in lines[1:]}
    assert lines[0].endswith("harrison2020.yaml: a valid scene")
    assert said["box"] == "box         6 x 6, reflecting"
    assert (
        "150: 1 tracer (radius 0.3, mass 1), 149 bath (radius 0.1, mass 0.4); packing fraction 0.1379" in said["disks"]
    )
    assert "t = 0 to 1, 101 samples" in said["run"]
    assert "563 between disks, 108 with walls per run" in said["collisions"]
    engines = [line for line in lines if line.startswith("engine ")]
    assert "--time-step 0.02 --collisions at_contact: all disks, in time steps; some " in engines[1]
    assert "--friction enskog: the tracer alone, gamma = 7.35; no 1/t tail" in engines[2]
    assert "langevin is rough here: the tracer has only 2.5 times the mass of a bath disk" in said["caution"]


def test_other_engines_are_forecast_to_cost_as_much_more_or_less_as_measured():
    """In the note's scene time steps cost 2.0 to 2.4 exact runs, the Langevin equation 0.21 (docs/results.md)."""
    scene = read_scene(CONFIG / "scenes" / "harrison2020.yaml")

    def cost(engine, **settings):
        expected = configured(engine, **settings).forecast(scene)
        return expected.seconds / one.seconds

    one = forecast.of_run(scene)
    assert 1.4 < cost("timestep", time_step=0.035) < cost("timestep", time_step=0.001) < 3
    assert 0.15 < cost("langevin", friction="enskog") < 0.3


def test_an_engine_without_settings_has_none_to_show(monkeypatch):
    flight = DEFINITIONS["exact"]._replace(name="flight", model=lambda scenes, settings: "no collisions")
    monkeypatch.setitem(DEFINITIONS, "flight", flight)
    lines = describe_scene_or_study(CONFIG / "scenes" / "harrison2020.yaml").splitlines()
    (line,) = [line for line in lines if "flight" in line]
    assert line.startswith("engine      flight: no collisions; some ")


def test_too_few_disks_for_the_box_are_said():
    """The mean free path of equal disks is 1/(2 sqrt(2) n s) in a dilute gas, here of 4 disks in the note's box."""
    scene = parse_scene(
        {
            "box": {"x": [0.0, 6.0], "y": [0.0, 6.0]},
            "disks": {"species": [{"name": "bath", "count": 4, "radius": 0.1, "mass": 1.0}]},
            "velocities": {"temperature": 1.0},
            "duration": 1.0,
        },
        "thin.yaml",
    )
    expected = 36.0 / 3 / (2 * 2**0.5 * 0.2)  # of the three others
    assert forecast.mean_free_path(scene) == pytest.approx(expected, rel=0.01)
    remark = forecast.caution(scene)
    assert remark.startswith("thin: 4 disks are too few for Brownian motion in this box: the mean free path, 21, is")
    assert forecast.caution(read_scene(CONFIG / "scenes" / "harrison2020.yaml")) is None


def test_scene_with_another_number_of_disks():
    assert "disks       50: 1 tracer" in describe_scene_or_study(CONFIG / "scenes" / "harrison2020.yaml", 50)


def test_explicit_disks(tmp_path):
    disks = "disks: [{position: [0.5, 0.5], velocity: [1, 0], radius: 0.1, mass: 1}]"
    (tmp_path / "one.yaml").write_text(f"box: {{x: [0, 1], y: [0, 1], boundary: periodic}}\n{disks}\nduration: 1\n")
    text = describe_scene_or_study(tmp_path / "one.yaml")
    assert "disks       1, listed one by one" in text
    assert "engine      langevin: no: " in text


def test_study():
    lines = describe_scene_or_study(CONFIG / "harrison2020.yaml").splitlines()
    assert lines[0].endswith("harrison2020.yaml: a valid study")
    assert sum(line.split()[0] == "harrison2020" for line in lines) == 4
    assert "19,200 runs in 8 jobs: some " in lines[-2]
    assert lines[-1] == f"figures   {', '.join(read_study(CONFIG / 'harrison2020.yaml').figures)}"


def test_study_of_several_engines(tmp_path):
    scene = CONFIG / "scenes" / "harrison2020.yaml"
    engines = "[exact, {name: timestep, time_step: 1e-3}, {name: langevin, friction: enskog}]"
    text = f"scenes: {scene}\nparticles: [50, 150]\nseeds: 60\nengines: {engines}\n"
    (tmp_path / "study.yaml").write_text(text)
    lines = describe_scene_or_study(str(tmp_path / "study.yaml")).splitlines()
    assert [line.split(":")[0].split()[-1] for line in lines if line.startswith("engine ")] == [
        "exact", "timestep-0.001", "langevin-enskog"
    ]  # fmt: skip
    assert "gamma = 2.02 to 7.35" in "\n".join(lines)
    assert len(cautions(lines)) == 1
    assert "360 runs in 6 jobs" in lines[-2]


def test_particles_are_not_for_studies():
    with pytest.raises(RequestError, match="--particles is for scenes"):
        describe_scene_or_study(CONFIG / "small.yaml", 50)


SIZES = {"x": [0.0, 6.0], "y": [0.0, 6.0]}
TRACER = {"tracer": {"radius": 0.3, "mass": 1.0}}
BATH = {"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}
HEAVY = {"name": "heavy", "count": 40, "radius": 0.2, "mass": 3.0}


@pytest.mark.parametrize(
    ("boundary", "disks", "velocities"),
    [
        ("reflecting", TRACER | {"species": [BATH]}, {"standard_deviation": 2.0}),
        ("periodic", {"species": [BATH]}, {"temperature": 1.6}),
        ("reflecting", {"species": [HEAVY, BATH]}, {"temperature": 1.0}),
    ],
)
def test_expected_collisions_are_near_those_found(boundary, disks, velocities):
    """Pairs within 8 %: Enskog's theory leaves out that walls take room from the disks (some 5 %), and 20 runs scatter
    by 1 %. Walls within 12 %: the same, and with a fifth of the collisions they scatter by 2 %."""
    box = SIZES | {"boundary": boundary}
    mapping = {"box": box, "particles": 150, "disks": disks, "velocities": velocities, "duration": 1.0}
    scene = parse_scene(mapping, "some.yaml")
    found, expected = exact.simulate(scene, range(20), frozenset({"none"})).observables, forecast.of_run(scene)
    assert np.isclose(found["pair_collisions"].mean(), expected.pair_collisions, rtol=0.08)
    assert np.isclose(found["wall_collisions"].mean(), expected.wall_collisions, rtol=0.12)


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((CONFIG / "scenes").glob("*.yaml")), ids=lambda path: path.stem)
def test_expected_collisions_of_the_example_scenes_are_half_to_twice_those_found(path):
    """What a job asks a cluster for follows from them. One run each, cut short; some hundred collisions or more."""
    whole = read_scene(path)
    duration = min(whole.duration, whole.duration * 20_000 / forecast.of_run(whole).pair_collisions)
    scene = whole.replace(duration=duration, sample_interval=duration, samples=None, equilibrate=0.0)
    found, expected = exact.simulate(scene, [0], frozenset({"none"})).observables, forecast.of_run(scene)
    assert 0.5 < found["pair_collisions"][0] / expected.pair_collisions < 2.0
    assert found["wall_collisions"][0] < 2.0 * expected.wall_collisions + 50


def shortened(name, part):
    """An example scene with a part of its duration, in which a collision and a sample cost as much as in all of it."""
    scene = read_scene(CONFIG / "scenes" / f"{name}.yaml")
    return scene.replace(duration=scene.duration * part)


@cache
def seconds_of_runs(scene):
    """Median CPU seconds of ten runs without observables, (), and with each alone, (name,).

    By turns, so that a slow machine divides out. What a call takes once, as much as ten runs without observables, is
    left out: a call with eleven runs less one with one.
    """
    taken = {(): []} | {(name,): [] for name in OBSERVABLES}
    for names in taken:
        exact.simulate(scene, [0], observables=names)
    for _ in range(7):
        for names, seconds in taken.items():
            times = [time.process_time()]
            for runs in (11, 1):
                exact.simulate(scene, range(runs), observables=names)
                times.append(time.process_time())
            seconds.append(times[1] - times[0] - (times[2] - times[1]))
    return {names: np.median(seconds) for names, seconds in taken.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(OBSERVABLES))
@pytest.mark.parametrize("scene", [shortened("harrison2020", 1.0), shortened("dilute", 0.25)], ids=attrgetter("name"))
def test_expected_price_of_an_observable_is_near_the_real_one(scene, name):
    """CPU time of runs with the observable relative to those without.

    Within a factor of 2: the forecast is off by up to 30 %, and medians of seven repetitions differ by 10 to 20 % from
    one measurement to the next on a machine with other work: some three standard errors are left.
    """
    taken = seconds_of_runs(scene)
    found = taken[name,] / taken[()]
    expected = forecast.of_run(scene, observables=(name,)).seconds / forecast.of_run(scene).seconds
    assert found / 2 < expected < found * 2


def test_averages_and_kept_disks_have_their_price():
    def seconds(scene, record=frozenset({"tracer"}), names=(), average="runs"):
        return forecast.of_run(scene, record, names, average).seconds

    scene = read_scene(CONFIG / "scenes" / "dense.yaml")
    assert seconds(scene) < seconds(scene, names=("square_displacement",)) < seconds(scene, frozenset({"all"}))
    for name in ("square_displacement", "velocity_autocorrelation"):
        assert seconds(scene, names=(name,)) < seconds(scene, names=(name,), average="origins")
        assert seconds(scene, names=(name,)) < seconds(scene, names=(name,), average="disks")
    langevin = Engine("langevin", (("friction", "enskog"),))
    heavy = read_scene(CONFIG / "scenes" / "heavy.yaml")
    alone, measured = (langevin.forecast(heavy, frozenset(), names) for names in ((), tuple(OBSERVABLES)))
    assert alone.seconds < measured.seconds < 5 * alone.seconds  # it follows the tracer alone


@pytest.mark.parametrize(("name", "phi"), [("dilute", 0.03), ("fluid_014", 0.14), ("dense", 0.7)])
def test_a_collision_costs_more_where_disks_cross_more_cells_between(name, phi):
    """Of 1,000 disks without other load: 0.28, 0.17 and 0.16 us at phi = 0.14, 0.5 and 0.7 (docs/benchmarks.md). The
    forecast is made for a machine that is busy with other work, up to 1.5 times slower."""
    scene = read_scene(CONFIG / "scenes" / f"{name}.yaml")
    one = forecast.of_run(scene.replace(duration=10 * scene.duration))  # the start of a run does not matter
    assert scene.packing_fraction == pytest.approx(phi, abs=0.005)
    microseconds = 1e6 * one.seconds / one.pair_collisions
    lower = {0.03: 0.6, 0.14: 0.4, 0.7: 0.2}[phi]
    assert lower < microseconds < 1.7 * lower


def test_disks_at_rest_and_no_disks_cost_nothing():
    scene = read_scene(CONFIG / "scenes" / "harrison2020.yaml", 1)
    assert forecast.of_run(scene).pair_collisions == 0.0
    assert forecast.of_run(parse_scene({"box": SIZES, "disks": [], "duration": 1}, "none.yaml")).wall_collisions == 0.0


def test_a_key_of_a_study_does_not_make_a_scene_one(tmp_path):
    text = (CONFIG / "scenes" / "harrison2020.yaml").read_text()
    (tmp_path / "one.yaml").write_text(f"{text}seeds: 3\n")
    with pytest.raises(RequestError, match="seeds: unknown key"):
        describe_scene_or_study(str(tmp_path / "one.yaml"))
    with pytest.raises(RequestError, match="is a study, not a scene; run it with brownpipe run"):
        read_scene(CONFIG / "small.yaml")


def heavy(mass, velocities):
    disks = {"tracer": {"radius": 0.3, "mass": mass}, "species": [BATH]}
    box = SIZES | {"boundary": "reflecting"}
    mapping = {"box": box, "particles": 150, "disks": disks, "velocities": velocities, "duration": 1.0}
    return parse_scene(mapping, "some.yaml")


def test_a_heavy_tracer_does_not_heat_the_bath_beforehand():
    usual = forecast.of_run(heavy(1.0, {"standard_deviation": 2.0}))
    assert forecast.of_run(heavy(1e12, {"standard_deviation": 2.0})) == usual


@pytest.mark.parametrize("value", [0.0, 1e-300, 1e300])
def test_any_speed_has_a_cost(value):
    assert len(check._scene(heavy(1.0, {"standard_deviation": value}))) >= 8


# -- what a simulation would refuse, or take days for ----------------------------------------------------------------


def crowd(count, radius=0.5, side=10.0, boundary="periodic", placement="random", **more):
    """A scene of equal disks at random places."""
    disks = {"species": [{"name": "a", "count": count, "radius": radius, "mass": 1.0}], "placement": placement}
    box = {"x": [0.0, side], "y": [0.0, side], "boundary": boundary}
    velocities = {"temperature": 1.0, "zero_momentum": False}
    return {"box": box, "disks": disks, "velocities": velocities, "duration": 1.0} | more


def big_and_small(count):
    """36 disks and `count` of half their radius."""
    scene = crowd(36, 1.0, 16.0, "reflecting")
    scene["disks"]["species"].append({"name": "b", "count": count, "radius": 0.5, "mass": 1.0})
    return scene


def around_a_tracer(count):
    scene = crowd(count, side=12.0, boundary="reflecting")
    scene["disks"]["tracer"] = {"radius": 3.0, "mass": 50.0}
    return scene


def fails(scene, seed):
    try:
        draw(scene, seed)
    except RequestError:
        return True
    return False


def at_least(number, scene, seeds):
    """Whether so many of the runs fail; no more are drawn than it takes to know."""
    failed = (seed for seed in seeds if fails(scene, seed))
    return len([*islice(failed, number)]) == number


PLACED = {  # numbers of disks of which nearly all and nearly no runs are placed: measured with 15 to 60 other seeds
    "few": (lambda count: crowd(count, side=4.0), 9, 14),
    "periodic": (crowd, 64, 74),
    "walls": (lambda count: crowd(count, boundary="reflecting"), 59, 70),
    "mixture": (big_and_small, 52, 70),
    "tracer": (around_a_tracer, 67, 77),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLACED)
def test_placement_is_foreseen_to_fail_where_it_does(name):
    """Between the two numbers of disks, 10 to 20 % apart, the share that fails goes from below 4 % to above 90 %.

    With ten seeds, more than two failures at 4 % have a probability of 0.6 %, fewer than seven at 90 % of 1.3 %; as the
    seeds are fixed the test is not repeated with others.
    """
    mapping, sparse, dense = PLACED[name]
    sparse, dense = (parse_scene(mapping(count), f"{name}.yaml") for count in (sparse, dense))
    assert crowding(sparse) < SOME_FAIL and not at_least(3, sparse, range(500, 510))
    assert crowding(dense) > ALL_FAIL and at_least(7, dense, range(500, 510))


def test_a_lattice_a_list_and_a_lone_disk_always_find_a_place():
    assert crowding(parse_scene(crowd(80, placement="lattice"), "a.yaml")) == 0.0
    assert crowding(parse_scene(crowd(1, radius=5.0, boundary="reflecting"), "a.yaml")) == 0.0
    assert crowding(parse_scene({"box": SIZES, "disks": [], "duration": 1}, "none.yaml")) == 0.0


def report(folder, mapping, name="scene"):
    (folder / f"{name}.yaml").write_text(json.dumps(mapping))
    return describe_scene_or_study(folder / f"{name}.yaml").splitlines()


def cautions(lines):
    """Cautions but those of windows of fits, as these scenes are small."""
    said = [line.removeprefix("caution   ") for line in lines if line.startswith("caution ")]
    return [line for line in said if not line.startswith("the fit window")]


def test_a_density_too_high_for_random_places_is_said_with_the_cure(tmp_path):
    assert cautions(report(tmp_path, crowd(60))) == []
    (caution,) = cautions(report(tmp_path, crowd(75)))
    assert caution == (
        "scene, N = 75: random placement is expected to fail in every run (packing fraction 0.589); must be fewer or "
        "smaller disks, or `placement: auto` with `equilibrate`"
    )
    (caution,) = cautions(report(tmp_path, crowd(66)))
    assert "expected to fail in some of the runs (packing fraction 0.518)" in caution
    assert cautions(report(tmp_path, crowd(75, placement="lattice"))) == []


def test_no_time_step_is_proposed_where_nothing_moves(tmp_path):
    lines = report(tmp_path, crowd(5, velocities={"temperature": 0.0}))
    assert any("timestep: no: " in line and "needs disks that move" in line for line in lines)
    assert not any("inf" in line.split() for line in lines)


def test_remarks_are_on_the_engine_of_the_study(tmp_path):
    """The Langevin engine places no bath, has no collisions and needs no kernels of the exact engine."""
    crowded = crowd(75, tracer={"radius": 0.5, "mass": 20.0})
    crowded["disks"]["tracer"] = crowded.pop("tracer")
    report(tmp_path, crowded, "crowd")
    langevin = {"name": "langevin", "friction": "boltzmann"}
    study = {"scenes": "crowd.yaml", "seeds": 10}
    lines = report(tmp_path, study | {"engines": [langevin]}, "study")
    assert cautions(lines) == []
    assert "langevin-boltzmann" in lines[2]
    (caution,) = cautions(report(tmp_path, study | {"engines": ["exact", langevin]}, "study"))
    assert caution.startswith("crowd, N = 76: random placement is expected to fail in every run")
    crowded["disks"]["tracer"]["mass"] = 3.0
    crowded["disks"]["species"][0]["count"] = 20
    report(tmp_path, crowded, "crowd")
    assert cautions(report(tmp_path, study, "study")) == []
    (caution,) = cautions(report(tmp_path, study | {"engines": [langevin]}, "study"))
    assert caution.startswith("crowd: langevin is rough here")


def sampled(samples, particles=30, boundary="reflecting"):
    """A dilute gas, sampled so often in a unit of time."""
    disks = {"species": [{"name": "a", "count": particles, "radius": 0.1, "mass": 1.0}]}
    side = [0.0, (1.2 * particles) ** 0.5]
    box = {"x": side, "y": side, "boundary": boundary}
    times = {"duration": 1.0, "sample_interval": 1.0 / samples}
    return {"box": box, "disks": disks, "velocities": {"temperature": 1.0}} | times


MEMORY = {  # scene, runs, record, observables
    "samples of the tracer": (sampled(1_000_000), 1, "tracer", ()),
    "whole tracks": (sampled(1000, 1000), 2, "tracer,all", ()),
    "many runs": (sampled(5000), 350, "tracer", ()),
    "all disks in an observable": (sampled(1000, 1500), 1, "none", ("species_energy",)),
    "many disks": (sampled(1, 300_000, "periodic") | {"disks": crowd(300_000, 0.02)["disks"]}, 1, "tracer", ()),
    "collisions": (crowd(1000, side=40.0, placement="lattice", duration=300.0), 1, "tracer,events", ()),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MEMORY)
def test_expected_memory_is_near_that_of_the_process(tmp_path, name):
    """Peak memory above that of a process with a short run: within a factor of 1.5."""
    mapping, runs, record, names = MEMORY[name]
    (tmp_path / "scene.yaml").write_text(json.dumps(mapping))
    command = ["simulate", "scene.yaml", "--seeds", f"0-{runs - 1}", "--record", record, "--output", "runs.h5"]
    command += ["--observables", ",".join(names)] if names else []
    found = peak(tmp_path, command)
    cost = forecast.of_run(read_scene(tmp_path / "scene.yaml"), set(record.split(",")), names)
    expected = forecast.memory(cost, runs)
    assert expected > 1.5 * forecast.PROCESS or name == "many disks"
    above = max(found - forecast.PROCESS, 1.0)
    assert above / 1.5 < expected - forecast.PROCESS < 1.5 * above, (found, expected)


def peak(folder, command):
    """Peak memory [bytes] of a process of the command line; a first one compiles the kernels."""
    # VmHWM is of this program alone; ru_maxrss begins with the memory of the process that forked it
    code = "import sys; from brownpipe import cli; status = cli.main(sys.argv[1:]);"
    code += "print([line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')][0]);"
    code += "sys.exit(status)"
    for _ in range(2):
        words = [sys.executable, "-c", code, *command]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        if "compiling" not in done.stderr:
            break
    return 1024.0 * int(done.stdout.split()[-1])


@pytest.mark.slow
def test_memory_of_samples_is_said(tmp_path):
    """1e7 samples of the tracer: measured 1.13 GB of memory and a file of 100 MB; here a tenth of them is foreseen."""
    (line,) = [line for line in report(tmp_path, sampled(1_000_000)) if line.startswith("memory ")]
    assert "280 MB for one run; 15 MB of file per run" in line


def test_a_job_that_needs_more_memory_than_there_is_is_named_with_the_batch_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(forecast, "machine_memory", lambda: 1_000_000_000)
    report(tmp_path, sampled(10_000), "small")
    report(tmp_path, sampled(100_000), "large")
    study = {"scenes": ["small.yaml", "large.yaml"], "seeds": "5-1004", "batch": 500}
    (caution,) = cautions(report(tmp_path, study, "study"))
    assert caution.startswith("large, N = 30, exact: a job of 500 runs needs some ")
    assert " of memory, and this machine has 1 GB; must be at most" in caution
    (fits,) = re.findall(r"must be at most `batch: (\d+)`", caution)
    assert cautions(report(tmp_path, study | {"batch": int(fits)}, "study")) == []
    (caution,) = cautions(report(tmp_path, study | {"batch": int(fits) + 1}, "study"))
    assert f"a job of {int(fits) + 1} runs" in caution


def test_a_file_that_is_no_scene_is_named_with_what_is_expected(tmp_path):
    runs = tmp_path / "runs.h5"
    runs.write_bytes(HDF5 + b"0")
    for path, what in (
        (runs, "it is an HDF5 file: brownpipe inspect"),
        (tmp_path, "Is a directory"),
        (tmp_path / "a", "No such file"),
    ):
        with pytest.raises(RequestError, match=rf"^{re.escape(str(path))}: .*{what}"):
            describe_scene_or_study(path)
