"""A study on a Slurm cluster of one node, by the profile `slurm`: make cluster-test, or pytest with --cluster."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

import slurm

pytestmark = pytest.mark.cluster
STUDY = Path(__file__).parent.parent / "config" / "small.yaml"
POLLED = ["--", "--slurm-init-seconds-before-status-checks", "1"]  # seconds between two looks at the queue, not 20
LONGEST = 300  # seconds for a study that takes 50 on two idle cores


def study(folder, *further):
    """The start of a study in a folder."""
    folder.mkdir()
    command = [sys.executable, "-m", "brownpipe", "run", str(STUDY), *further]
    with open(folder / "screen", "w") as screen:
        return subprocess.Popen(command, cwd=folder, stdout=screen, stderr=screen, start_new_session=True)


def digests(folder):
    """The SHA-256 of all results by their path, without logs."""
    results = folder / "results"
    files = {path.relative_to(results): path for path in results.rglob("*") if path.is_file() and path.suffix != ".log"}
    return {str(name): hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}


def hit(running, effect, *command):
    """Give running jobs, the last first, to a command of Slurm until one of them shows the effect: some end before."""

    def works():
        for job in map(str, reversed(slurm.jobs("RUNNING"))):
            slurm.said(*command, job)
            for _ in range(20):
                if effect in (shown := slurm.said("scontrol", "show", "job", job)):
                    return True
                if "JobState=COMPLETED" in shown:
                    break
                time.sleep(0.1)
        return False

    slurm.wait_until(works, [running], LONGEST)


@pytest.fixture(scope="module", autouse=True)
def cluster(tmp_path_factory):
    if why := slurm.lacking():
        pytest.fail(f"no cluster: {why}")
    folder = tmp_path_factory.mktemp("slurm") / "cluster"
    folder.mkdir()
    with slurm.cluster(folder):
        yield


def test_a_study_has_the_same_bytes_as_on_one_machine_though_jobs_were_killed_and_requeued(tmp_path):
    """In a folder whose name a shell would take apart."""
    folder = tmp_path / "a $HOME of studies"
    running = study(folder, "--profile", "slurm", *POLLED)
    try:
        slurm.wait_until(lambda: len(slurm.jobs("RUNNING")) > 1, [running], LONGEST)  # one job compiles the kernels
        hit(running, "JobState=CANCELLED", "scancel", "--signal=KILL", "--full")
        hit(running, "Restarts=1", "scontrol", "requeue")
        status = running.wait(LONGEST)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)  # also Snakemake, which would wait for its jobs
        running.wait()
    screen = (folder / "screen").read_text()
    assert status == 0, screen
    assert "MSD(t = " in screen, "the answer is printed here, not on the node"
    assert study(tmp_path / "local").wait(LONGEST) == 0
    assert len(digests(folder)) > 25
    assert digests(folder) == digests(tmp_path / "local")
