"""Runs that cannot go on: each is recorded with its reason, and the others are as if it had not
been there.
"""

import os
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

import brownpipe as bp
import forked
from brownpipe.analysis import aggregate
from brownpipe.analysis.runs import group_by_case
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import select
from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.exact import simulation as exact_simulation
from brownpipe.engines.exact.simulation import Checkpoints, simulate
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, RunError
from brownpipe.figures.render import draw
from brownpipe.figures.summary import summary
from brownpipe.inspection import reproduction
from brownpipe.scene import parse_scene
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.storage.trajectories import from_tree, read_trajectories, to_tree, write_trajectories
from brownpipe.tradeoff.compare import read_runs
from pipeline import snakemake

pytestmark = pytest.mark.usefixtures("elsewhere")

CROWD = """\
box: {x: [0.0, 2.0], y: [0.0, 2.0], boundary: periodic}
particles: 40
disks:
  tracer: {radius: 0.13, mass: 1.0}
  species: [{name: bath, count: rest, radius: 0.13, mass: 0.4}]
  placement: random
velocities: {temperature: 1.0}
duration: 0.2
sample_interval: 0.1
"""  # close to the density at which random insertion ends: some runs find no place for every disk
ENGINES = (Engine("exact"), Engine("timestep", (("time_step", 0.01),)))
SEEDS = range(16)


@pytest.fixture(scope="module")
def crowd():
    return parse_scene(yaml.safe_load(CROWD), "crowd.yaml")


@pytest.fixture(scope="module")
def alone(crowd):
    """The function from an engine and a seed to the ensemble of a batch of this seed alone."""

    @cache
    def simulate_alone(engine, seed):
        return engine.simulate(crowd, [seed], {"tracer", "all"})

    return simulate_alone


@pytest.fixture(scope="module")
def whole(crowd):
    """A batch of all SEEDS with all that can be recorded."""
    return simulate(crowd, SEEDS, {"tracer", "all", "events"}, observables=["species_energy"])


def part(whole, seeds):
    """A batch of some of the seeds, as the engine returns it."""
    runs = select(whole, np.array(seeds))
    if len(runs.stopped) < len(seeds):
        return runs
    return runs._replace(observables={"failed": runs.observables["failed"]})


def written(path, scene, ensemble, engine=ENGINES[0]):
    write_trajectories(path, scene, engine, ensemble)
    return path


def arrays_of(ensemble, seed):
    column = ensemble.seeds.tolist().index(seed)
    arrays = {name: values[column] for name, values in ensemble.observables.items()}
    arrays |= {
        "tracer": ensemble.tracer.position[:, column],
        "images": ensemble.tracer.image[:, column],
    }
    return arrays | {
        f"all {name}": values for name, values in ensemble.whole[seed]._asdict().items()
    }


# -- one run of a batch ----------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_a_run_that_finds_no_place_leaves_the_others_as_they_are(crowd, alone, engine, faults):
    """A batch of random seeds in random order."""
    seeds = faults.random.sample(SEEDS, 7)
    batch = engine.simulate(crowd, seeds, {"tracer", "all"})
    expected = {}
    for seed in seeds:
        expected |= alone(engine, seed).stopped
    assert dict(batch.stopped) == expected
    assert all(reason.startswith("disks: only ") for reason in expected.values())
    assert batch.observables["failed"].tolist() == [seed in expected for seed in seeds]
    assert batch.whole.keys() == set(seeds) - expected.keys()
    for seed in batch.whole:
        own = arrays_of(batch, seed)
        other = arrays_of(alone(engine, seed), seed)
        assert own.keys() == other.keys()
        for name in own:
            assert own[name].tobytes() == other[name].tobytes(), (seed, name)
    for seed in expected:
        column = seeds.index(seed)
        assert np.isnan(batch.tracer.position[:, column]).all()
        assert not batch.tracer.image[:, column].any()
        for values in batch.observables.values():
            assert values.dtype.kind != "f" or np.isnan(values[column])


def test_runs_without_progress_and_runs_that_do_not_equilibrate_are_recorded(monkeypatch):
    """In the middle of a run, by a bound on the path of a disk that some runs do not reach."""
    scene = parse_scene(yaml.safe_load(CROWD) | {"particles": 30}, "crowd.yaml")
    whole = simulate(scene, SEEDS)
    monkeypatch.setattr(exact_run, "EVENTS_PER_CALL", 100)
    monkeypatch.setattr(exact_run, "SHORTEST_PATH", 0.045 / 2**-51)
    batch = simulate(scene, SEEDS)
    assert 0 < len(batch.stopped) < len(SEEDS)
    assert all(reason.startswith("no progress at t = ") for reason in batch.stopped.values())
    going = [seed for seed in SEEDS if seed not in batch.stopped]
    unchanged = whole.tracer.position[:, going]
    assert batch.tracer.position[:, going].tobytes() == unchanged.tobytes()
    monkeypatch.undo()
    equilibrated = scene.replace(equilibrate=0.1)
    for engine in ENGINES:
        with monkeypatch.context() as patch:
            patch.setattr(exact_simulation, "run_to_end", unhealthy(exact_simulation.run_to_end))
            batch = engine.simulate(equilibrated, range(3), {"tracer"})
        assert dict(batch.stopped) == {1: "the time to equilibrate failed its health check"}


def unhealthy(to_end):
    """The function, but the second run that equilibrates comes to an end with a health check that
    has failed.
    """
    calls = []

    def fail(prepared, start, *arguments):
        result = to_end(prepared, start, *arguments)
        calls.extend([result] if start.equilibrating else [])
        return result._replace(
            observables=result.observables | {"failed": start.equilibrating and len(calls) % 2 == 0}
        )

    return fail


def test_a_friction_is_not_measured_in_runs_that_failed(monkeypatch, crowd):
    heavy = yaml.safe_load(CROWD)
    heavy["disks"]["tracer"]["mass"] = 20.0
    words = r"crowd: of the runs that measure the friction could not go on: \d of \d+ runs: 0"
    with pytest.raises(RunError, match=words):
        Engine("langevin", (("friction", "measured"),)).simulate(
            parse_scene(heavy, "crowd.yaml"), [0], {"tracer"}
        )


@pytest.mark.slow
def test_a_batch_resumed_from_any_checkpoint_has_the_same_runs_and_reasons(crowd, faults):
    stored = []
    checkpoints = Checkpoints(lambda: True, lambda arrays: stored.append(copied(arrays)))
    whole = simulate(crowd, range(4), {"tracer"}, checkpoints)
    expected = written(Path("whole.h5"), crowd, whole).read_bytes()
    for _ in range(2):
        checkpoint = faults.random.choice(stored)
        resumed = simulate(
            crowd, range(4), {"tracer"}, Checkpoints(lambda: False, lambda _: None, checkpoint)
        )
        assert dict(resumed.stopped) == dict(whole.stopped)
        assert written(Path("resumed.h5"), crowd, resumed).read_bytes() == expected


def copied(arrays):
    return {name: np.array(values) for name, values in arrays.items()}


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [[0, 1, 2, 3], [0, 2]], ids=["some", "all"])
def test_the_reason_is_in_the_file_and_in_the_python_interface(crowd, whole, seeds):
    """Of the seeds 0 to 3 the runs of 0 and 2 stop; a file of these alone has nothing but
    reasons.
    """
    batch = part(whole, seeds)
    runs = read_trajectories(written(Path("a.h5"), crowd, batch))
    assert runs.ensemble.stopped == batch.stopped and sorted(batch.stopped) == [0, 2]
    assert runs.ensemble.whole.keys() == runs.ensemble.events.keys() == set(seeds) - {0, 2}
    tree = to_tree(runs)
    assert tree.stopped.sel(seed=2).item() == batch.stopped[2]
    assert bool(tree.failed.sel(seed=2))
    bp.save(tree, "b.h5")
    assert to_tree(read_trajectories(Path("b.h5"))).identical(tree)
    assert reproduction.differing_variables(reproduction.read_original("a.h5")) == {}
    assert reproduction.differing_variables(reproduction.read_original("a.h5", seed=2)) == {}
    assert from_tree(tree).ensemble.stopped == batch.stopped
    others = read_trajectories(written(Path("c.h5"), crowd, part(whole, [1, 3])))
    assert not others.ensemble.stopped and "stopped" not in to_tree(others)


@pytest.mark.parametrize(
    ("seeds", "options", "status"),
    [
        ("0-3", (), DONE),
        ("0,2", (), FAILED),
        ("0,2", ("--allow-failed", "all"), DONE),
        ("0-3", ("--allow-failed", 1), FAILED),
        ("1,3", ("--allow-failed", 0), DONE),
    ],
)
def test_simulate_writes_the_file_and_names_seeds_and_reason_in_one_line(
    said, seeds, options, status
):
    Path("crowd.yaml").write_text(CROWD)
    found, out, err = said("simulate", "crowd.yaml", "--seeds", seeds, *options)
    assert (found, out.count("\n")) == (status, 1) and "nan" not in out
    assert Path("crowd.h5").is_file()
    number = {"0-3": 4, "0,2": 2}.get(seeds)
    names = (
        rf"brownpipe: crowd\.h5: could not go on: 2 of {number} runs: 0,2 \(seed 0: disks: only "
        r".*\)\n"
    )
    caution, *last = err.splitlines(keepends=True)
    assert "random placement is expected to fail in some of the runs" in caution
    assert re.fullmatch(names, *last) if number else last == []


@pytest.mark.slow
def test_a_stopped_run_is_described_and_neither_drawn_nor_exported(said, crowd, whole):
    written(Path("a.h5"), crowd, part(whole, [0, 1, 2, 3]))
    _, out, _ = said("inspect", "a.h5")
    assert "could not go on: 2 of 4 runs: 0,2 (seed 0: disks: only " in out and "nan" not in out
    drift = np.abs(whole.observables["energy_drift"][[1, 3]])
    assert f"worst energy drift {drift.max():.2g} (seed {[1, 3][np.argmax(drift)]})" in out
    _, out, _ = said("inspect", "a.h5", "--seed", 2)
    assert "could not go on: 1 of 1 runs: 2 (seed 2: disks: only" in out and "nan" not in out
    for words in (["movie"], ["export", "--to", "xyz"], ["export", "--to", "csv"]):
        status, _, err = said(words[0], "a.h5", *words[1:], "--seed", 2)
        message = "brownpipe: a.h5: holds no run of seed 2; must be of 1,3; 2 could"
        assert status == WRONG_REQUEST and err.startswith(message)
    written(Path("b.h5"), crowd, part(whole, [0, 1, 2, 3])._replace(whole={}, events={}))
    for name in "ab":  # all disks, and tracers alone
        _, _, err = said("export", f"{name}.h5", "--to", "csv")
        assert (
            "could not go on: 2 of 4 runs: 0,2" in err
            and "nan" not in Path(f"{name}.csv").read_text()
        )


@pytest.mark.slow
def test_the_python_interface_warns_of_runs_that_could_not_go_on(crowd):
    expected = "^crowd, N = 40: random placement is expected to fail in some of the runs"
    stopped = "^crowd: could not go on: 2 of 4 runs: 0,2 .*; analyse leaves them out$"
    with pytest.warns(UserWarning, match=expected), pytest.warns(UserWarning, match=stopped):
        runs = bp.simulate(crowd, 4, quiet=True)
    assert bp.analyse(runs).runs.item() == 2
    assert np.isnan(runs.position.sel(seed=2)).all()


# -- studies ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def batches(crowd, whole, tmp_path_factory):
    """The function from a size to trajectory files of the same runs in batches of it, some of
    stopped runs alone.
    """
    folder = tmp_path_factory.mktemp("batches")
    tracers = whole._replace(whole={}, events={})

    def in_batches(size, seeds=SEEDS):
        parts = [[*seeds[first : first + size]] for first in range(0, len(seeds), size)]
        return [written(folder / f"{size}-{own[0]}.h5", crowd, part(tracers, own)) for own in parts]

    return in_batches


@pytest.mark.slow
def test_averages_are_those_of_the_other_runs_however_the_batches_are_cut(crowd, whole, batches):
    in_threes = batches(3)
    first, *others = (aggregate(files) for files in (in_threes, batches(16), batches(1)))
    assert all(first.identical(other) for other in others)
    kept = [seed for seed in SEEDS if seed not in (0, 2, 11, 14)]
    without = aggregate([written(Path("kept.h5"), crowd, part(whole, kept))])
    assert (first.failed_runs.item(), first.runs.item()) == (4, 12)
    for name in ("msd", "msd_standard_error", "diffusion_coefficient", "displacement_counts"):
        np.testing.assert_array_equal(first[name], without[name])
    assert [runs.failed for runs in read_runs(group_by_case(in_threes))] == [4]


@pytest.mark.slow
def test_summary_health_figure_and_status_name_the_failed_runs(batches, said):
    dataset = aggregate(batches(3))
    write_dataset("a.nc", dataset)
    assert read_dataset("a.nc").identical(dataset)
    text = summary(dataset)
    assert (
        "crowd, N = 40: failed and left out: 4 of 16 seeds (0,2,11,14); 4 could not go on, seed "
        "0: disks: "
    ) in text
    assert (
        "The averages leave out 4 failed runs; they are biased if runs that fail differ from the "
        "others.\n"
    ) in text
    (label,) = draw(dataset, "health").axes[0].get_yticklabels()
    assert "(4 of 16 failed)" in label.get_text()
    line = (
        "brownpipe: a.nc: 4 of 16 runs failed and are in no average, {}: crowd, N = 40: seeds "
        "0,2,11,14\n"
    )
    refused, accepted = map(
        line.format, ("allow_failed: 3 accepts no more", "accepted by allow_failed: 4")
    )
    assert said("inspect", "a.nc", "--allow-failed", 3) == (FAILED, "", refused)
    assert said("inspect", "a.nc", "--allow-failed", 4) == (DONE, "", accepted)
    write_dataset("b.nc", aggregate(batches(1, (1, 3))))
    assert said("inspect", "b.nc", "--allow-failed", 0) == (DONE, "", "")


def test_a_study_in_which_every_run_failed_has_a_summary_and_no_average(batches):
    dataset = aggregate(batches(1, (0, 2)))
    assert (dataset.runs.item(), dataset.failed_runs.item()) == (0, 2) and "msd" in dataset
    assert np.isnan(dataset.msd).all() and "failed and left out: 2 of 2 seeds (0,2)" in summary(
        dataset
    )
    draw(dataset, "health")


@pytest.mark.slow
def test_a_study_whose_runs_all_failed_says_so(tmp_path):
    """Two disks that fill their box from wall to wall: one run, which cannot go on."""
    folder = tmp_path / "study"
    folder.mkdir()
    disks = [
        {"position": [0.75, 0.5], "velocity": [2.0, 0.0], "radius": 0.75, "mass": 1.0},
        {"position": [2.25, 0.5], "velocity": [0.0, 0.0], "radius": 0.75, "mass": 3.0},
    ]
    box = {"x": [0.0, 3.0], "y": [-1.0, 2.0]}
    scene = {"box": box, "disks": disks, "duration": 1.0, "sample_interval": 0.5}
    (folder / "pair.yaml").write_text(yaml.safe_dump(scene))
    (folder / "study.yaml").write_text("scenes: pair.yaml\nseeds: 1\n")
    printed = snakemake(folder, "--cores", "1", status=FAILED)
    last = printed.splitlines()[-1]
    assert "study.nc: all runs failed, and there is nothing to draw; brownpipe inspect" in last


WORKERS = """#!/bin/bash
case "$*" in *"--seeds 2-3 "*) kill -KILL $$ ;; esac
exec {} "$@"
"""  # in place of `brownpipe`


@pytest.mark.slow
def test_a_study_survives_a_killed_worker_and_runs_that_cannot_go_on(tmp_path):
    """The runs of the seeds 0 and 2 find no place: all of one job, half of another one, which is
    killed at first.
    """
    folder = tmp_path / "study"
    (folder / "bin").mkdir(parents=True)
    (folder / "crowd.yaml").write_text(CROWD)
    (folder / "study.yaml").write_text(
        "scenes: crowd.yaml\nseeds: 0,2-5\nbatch: 2\nfigures: [health]\n"
    )
    program = folder / "bin" / "brownpipe"
    path = {"PATH": f"{program.parent}:{forked.programs()}:{os.environ['PATH']}"}
    program.write_text(WORKERS.format(f"{forked.programs()}/brownpipe"))
    program.chmod(0o755)
    printed = snakemake(folder, "--cores", "1", status=FAILED, **path)
    last = printed.splitlines()[-1]
    assert (
        last.startswith("    brownpipe: killed, most likely out of memory")
        and "Traceback" not in printed
    ), printed
    assert {file.name for file in (folder / "results/runs").rglob("*.h5")} == {"0-0.h5", "4-5.h5"}
    program.unlink()
    told = r"study\.nc: 2 of 5 runs failed and are in no average, {}: crowd, N = 40: seeds 0,2"
    printed = snakemake(folder, "--cores", "1", status=FAILED, **path)
    assert re.search(told.format("allow_failed: 0 accepts no more"), printed.splitlines()[-1]), (
        printed
    )
    answer = (folder / "results/study/figures/summary.txt").read_text()
    assert answer in printed and "failed and left out: 2 of 5 seeds (0,2)" in answer
    with open(folder / "study.yaml", "a") as file:
        file.write("allow_failed: 2\n")  # nothing is made again, and the answer is shown
    accepted = snakemake(folder, "--cores", "1", **path)
    assert accepted.partition("\n")[2].startswith(answer)
    assert re.search(told.format("accepted by allow_failed: 2"), accepted)
