"""A study that was killed: what was finished is not computed again."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import suppress

import pytest

from brownpipe.cli import main
from brownpipe.errors import DONE
from brownpipe.storage.finished import set_aside
from brownpipe.study import read_study
from test_workflow import SCENE, command, environment, snakemake

KILLS = ("kill snakemake", "interrupt snakemake", "kill a worker", "kill all", "interrupt all")
WORDS = ("simulate", "hot.yaml", "--particles", "6", "--output", "runs.h5")


@pytest.fixture
def made(tmp_path, monkeypatch, capsys):
    """The bytes of a trajectory file that was set aside, in the working directory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hot.yaml").write_text(SCENE)
    assert main([*WORDS, "--seeds", "0-1"]) == DONE
    contents = (tmp_path / "runs.h5").read_bytes()
    set_aside("runs.h5")
    assert sorted(os.listdir(tmp_path)) == ["hot.yaml", "runs.h5.kept"]
    capsys.readouterr()
    return contents


def test_a_finished_batch_is_taken_back(made, tmp_path, capsys):
    assert main([*WORDS, "--seeds", "0-1"]) == DONE
    assert sorted(os.listdir(tmp_path)) == ["hot.yaml", "runs.h5"] and (tmp_path / "runs.h5").read_bytes() == made
    assert capsys.readouterr().out.startswith(
        "runs.h5: kept, as an interrupted study had finished exactly these runs\n"
    )


def test_a_finished_batch_of_the_tracer_alone_is_taken_back(tmp_path, monkeypatch, capsys):
    """The Langevin engine leaves out observables of other disks."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hot.yaml").write_text(SCENE)
    words = [*WORDS, "--engine", "langevin", "--friction", "enskog", "--observables", "species_energy"]
    assert main(words) == DONE
    set_aside("runs.h5")
    capsys.readouterr()
    assert main(words) == DONE
    assert capsys.readouterr().out.startswith("runs.h5: kept, ")


@pytest.mark.parametrize("change", ["seeds", "scene", "record", "source", "version", "byte"])
def test_a_batch_that_differs_in_anything_is_made_again(made, tmp_path, monkeypatch, capsys, change):
    words = [*WORDS, "--seeds", "0-2" if change == "seeds" else "0-1"]
    words += ["--record", "none"] if change == "record" else []
    if change == "scene":
        (tmp_path / "hot.yaml").write_text(SCENE.replace("mass: 0.4", "mass: 0.5"))
    if change == "source":
        monkeypatch.setattr("brownpipe.storage.finished.source_digest", lambda *_: "another")
    if change == "version":
        monkeypatch.setattr("brownpipe.storage.finished.versions", lambda: {"numba_version": "99"})
    if change == "byte":
        contents = bytearray(made)
        contents[len(contents) // 2] ^= 1
        (tmp_path / "runs.h5.kept").write_bytes(contents)
    assert main(words) == DONE
    assert "kept" not in capsys.readouterr().out
    assert sorted(os.listdir(tmp_path)) == ["hot.yaml", "runs.h5"]
    assert ((tmp_path / "runs.h5").read_bytes() == made) == (change in ("source", "version", "byte"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of one case in six batches, and in `whole` its trajectory files, made without a workflow."""
    folder = tmp_path_factory.mktemp("killed") / "study"
    (folder / "scenes").mkdir(parents=True)
    (folder / "scenes" / "hot.yaml").write_text(SCENE)
    (folder / "study.yaml").write_text("scenes: scenes/hot.yaml\nseeds: 12\nbatch: 2\nfigures: [health]\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for job in read_study("study.yaml").jobs():
            words = ["--seeds", f"{job.first}-{job.last}", "--output", f"whole/{job.first}-{job.last}.h5"]
            assert main(["simulate", "scenes/hot.yaml", *words]) == DONE
    return folder


@pytest.mark.slow
@pytest.mark.promise(
    "snakemake, a worker or all processes of a study are killed or interrupted at any moment",
    "The next run keeps every batch that was finished, and ends with the same bytes as a run without interruption.",
)
def test_a_killed_study_keeps_every_finished_batch(folder, tmp_path, faults):
    for number in faults.tries(1):
        study, linked = shutil.copytree(folder, tmp_path / str(number)), tmp_path / f"linked_{number}"
        kill, wanted = faults.random.choice(KILLS), faults.random.randint(1, 4)
        lost = killed(study, kill, wanted, faults.random.uniform(0, 1))
        assert len(lost) <= 2, (kill, faults.seed)  # at most one for each core
        finished = batches(study)
        linked.mkdir()
        for file in trajectories(study):
            os.link(file, linked / file.name)  # so that no new file gets the inode of a deleted one
        snakemake(study, "--unlock")
        snakemake(study, "--cores", "2")
        after = batches(study)
        assert finished.items() <= after.items(), (kill, faults.seed)
        assert len(after) == 6 and not list(study.rglob("*.kept"))
        assert all(file.read_bytes() == (folder / "whole" / file.name).read_bytes() for file in trajectories(study))
        assert main(["verify", str(study / "results" / "study")]) == DONE


def killed(study, kill, wanted, pause):
    """Start a study, kill it a while after the first `wanted` batches are there; return those that then disappear."""
    process = subprocess.Popen(
        command(study, "--cores", "2"),
        cwd=study,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        wait_until(lambda: len(batches(study)) >= wanted or process.poll() is not None, 120)
        time.sleep(pause)
        there = batches(study)
        harm(process, kill)
        process.wait(120)
        wait_until(lambda: not members(process.pid), 120)  # workers that go on alone have ended
    finally:
        for member in members(process.pid):
            send(member, signal.SIGKILL)
        process.wait(60)
    return there.keys() - batches(study).keys()


def batches(study):
    """The inode of each trajectory file: another one if it was made again."""
    return {file.name: file.stat().st_ino for file in trajectories(study)}


def trajectories(study):
    return (study / "results").glob("*/simulate/**/*.h5")


def wait_until(condition, seconds):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def members(session):
    """The processes of a session that are not zombies."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat") as file:
                state, _, _, own = file.read().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        found += [int(name)] if int(own) == session and state != "Z" else []
    return found


def harm(process, kill):
    number = signal.SIGINT if kill.startswith("interrupt") else signal.SIGKILL
    if kill.endswith("all"):
        for member in members(process.pid):
            send(member, number)
    elif kill.endswith("worker"):
        workers = [member for member in members(process.pid) if member != process.pid]
        for worker in workers[-1:]:
            send(worker, number)
    else:
        send(process.pid, number)


def send(pid, number):
    with suppress(ProcessLookupError):
        os.kill(pid, number)
