"""Ctrl-C, SIGTERM and kill: status, one line, no half-written file; a killed study goes on where it
was.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

import psutil
import pytest

from brownpipe.cli import main
from brownpipe.errors import DONE
from brownpipe.processes import held
from brownpipe.storage.files import verified
from brownpipe.study import read_study
from brownpipe.study.run_sets import commands, files_of
from pipeline import SCENE, command, environment, snakemake

KILLS = ("kill snakemake", "interrupt snakemake", "kill a worker", "kill all", "interrupt all")
LONGEST = 60.0  # s for a busy machine to compile the kernels and to end a process
MODULE = (sys.executable, "-m", "brownpipe")
ENDS = [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]


def test_ctrl_c_waits_for_the_compiler_in_the_main_thread():
    done = []

    def compiled(interrupt):
        with held():
            if interrupt:
                signal.raise_signal(signal.SIGINT)
            done.append("compiled")
        done.append("run")

    thread = threading.Thread(target=compiled, args=[False])
    thread.start()
    thread.join()
    assert done == ["compiled", "run"]
    with pytest.raises(KeyboardInterrupt):
        compiled(True)
    assert done == ["compiled", "run", "compiled"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


IN_A_DESTRUCTOR = """
import signal, sys, time
from brownpipe import cli
from brownpipe.verbs import files

class Late:
    def __del__(self):
        signal.raise_signal({number})

def main(arguments):
    late = Late()
    del late
    time.sleep({seconds})

files.VERIFY = files.VERIFY._replace(run=main)
sys.argv = ["brownpipe", "verify", "anything"]
sys.exit(cli.main())
"""


@pytest.mark.parametrize(("number", "status", "word"), ENDS)
@pytest.mark.parametrize("seconds", [0, 20])
def test_a_signal_while_an_object_is_destroyed_is_not_lost(number, status, word, seconds):
    """There Python ignores any exception; at the end of the work that is right, without a word."""
    code = IN_A_DESTRUCTOR.format(number=int(number), seconds=seconds)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if seconds:
        assert (done.returncode, done.stderr) == (status, f"brownpipe: {word}\n")
    else:
        assert (done.returncode, done.stderr) == (DONE, "")


BATH = {"name": "bath", "count": 999, "radius": 0.5, "mass": 1.0}
CROWD = {
    "box": {"x": [0.0, 55.0], "y": [0.0, 55.0], "boundary": "periodic"},
    "disks": {"tracer": {"radius": 0.5, "mass": 5.0}, "species": [BATH], "placement": "random"},
    "velocities": {"temperature": 1.0},
    "duration": 200.0,
    "sample_interval": 200.0,
}


@pytest.mark.slow
def test_a_signal_at_a_random_moment_ends_a_simulation(tmp_path, faults):
    """While it compiles or loads machine code, runs and writes."""
    (tmp_path / "scene.yaml").write_text(json.dumps(CROWD))
    number, status, word = faults.random.choice(ENDS)
    ways = (
        (["--record", "all"], {}),
        (["--engine", "langevin", "--friction", "enskog"], {"NUMBA_CACHE_DIR": "cache"}),
    )
    words, apart = faults.random.choice(ways)
    command = [*MODULE, "simulate", "scene.yaml", *words]
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        command, cwd=tmp_path, env=os.environ | apart, stderr=pipe, text=True
    )
    time.sleep(faults.random.uniform(1.0, 3.0))
    process.send_signal(number)
    _, err = process.communicate(timeout=LONGEST)
    assert process.returncode in (0, status) and "Traceback" not in err, err
    assert process.returncode == 0 or re.search(rf"^brownpipe: {word}\n\Z", err, re.MULTILINE)
    left = {
        path.name for path in tmp_path.glob("*.*") if path.suffix in (".h5", ".part", ".checkpoint")
    }
    assert left == {"scene.h5"} if process.returncode == 0 else left <= {"scene.h5"}, (
        left,
        process.returncode,
    )
    for file in left:
        verified(tmp_path / file)


def test_a_study_that_is_interrupted_while_snakemake_starts_ends_with_one_line(tmp_path):
    """In the seconds before it reads signals itself; a module of its name is interrupted here."""
    program = tmp_path / "snakemake"
    program.mkdir()
    (program / "__init__.py").touch()
    interrupt = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    (program / "__main__.py").write_text(interrupt)
    (tmp_path / "study.yaml").write_text("scenes: scene.yaml\nseeds: 2\n")
    process = subprocess.run(
        [*MODULE, "run", "study.yaml"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert (process.returncode, process.stderr) == (130, "brownpipe: interrupted\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of one case in four batches, and in `whole` its trajectory files, made without a
    workflow.
    """
    folder = tmp_path_factory.mktemp("killed") / "study"
    (folder / "scenes").mkdir(parents=True)
    (folder / "scenes" / "hot.yaml").write_text(SCENE)
    (folder / "study.yaml").write_text(
        "scenes: scenes/hot.yaml\nseeds: 8\nbatch: 2\nfigures: [health]\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        (command,) = commands(read_study("study.yaml")).values()
        for file in files_of(read_study("study.yaml")):
            words = ["--seeds", file.path.stem, "--output", f"whole/{file.path.name}"]
            assert main(["simulate", *command.split(), *words]) == DONE
    return folder


@pytest.mark.slow
def test_a_killed_study_goes_on_where_it_was(folder, tmp_path, faults):
    study = shutil.copytree(folder, tmp_path / "study")
    kill = faults.random.choice(KILLS)
    wanted = faults.random.randint(1, 3)
    lost = killed(study, kill, wanted, faults.random.uniform(0, 1))
    assert len(lost) <= 2, kill  # at most one for each core
    there = batches(study)
    snakemake(study, "--cores", "2")
    after = batches(study)
    assert len(after) == 4 and len(there.items() - after.items()) <= 2, kill
    assert all(
        file.read_bytes() == (folder / "whole" / file.name).read_bytes()
        for file in trajectories(study)
    )
    assert main(["verify", str(study / "results" / "study")]) == DONE


def killed(study, kill, wanted, pause):
    """Start a study, kill it a while after the first `wanted` batches are there; return those that
    then disappear.
    """
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
    """When each trajectory file was written: later if it was made again."""
    return {file.name: file.stat().st_mtime_ns for file in trajectories(study)}


def trajectories(study):
    return (study / "results").glob("runs/**/*.h5")


def wait_until(condition, seconds):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def members(session):
    """The processes of a session that are not zombies."""
    alive = (
        one.pid
        for one in psutil.process_iter(["status"])
        if one.info["status"] != psutil.STATUS_ZOMBIE
    )
    return [pid for pid in alive if session_of(pid) == session]


def session_of(pid):
    with suppress(ProcessLookupError):
        return os.getsid(pid)


def harm(process, kill):
    number = signal.SIGINT if kill.startswith("interrupt") else signal.SIGKILL
    if kill.endswith("all"):
        for member in members(process.pid):
            send(member, number)
    else:
        send(members(process.pid)[-1] if kill.endswith("worker") else process.pid, number)


def send(pid, number):
    with suppress(ProcessLookupError):
        os.kill(pid, number)
