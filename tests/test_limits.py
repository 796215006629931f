"""A full disk: one line, and nothing half-written. Workers that are killed: one line, and the others finish."""

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED
from test_failures import CROWD
from test_workflow import snakemake

pytestmark = pytest.mark.usefixtures("elsewhere")
ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """A folder with the files of a few runs, their dataset and its figures, made without limits."""
    folder = tmp_path_factory.mktemp("expected")
    (folder / "crowd.yaml").write_text(CROWD)
    path, dataset = f"{folder}/a.h5", f"{folder}/a.nc"
    assert main(["simulate", f"{folder}/crowd.yaml", "--seeds", "0-5", "--output", path]) == DONE
    assert main(["aggregate", path, "--output", dataset]) == DONE
    assert main(["figures", dataset, "--output", f"{folder}/figures", "--figures", "health"]) == DONE
    return folder


def limited(size, words):
    """Run the command line where no file may be larger than `size` bytes, which to a program is as a full disk."""
    command = [sys.executable, "-m", "brownpipe", *words]

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return subprocess.run(command, preexec_fn=limit, capture_output=True, text=True, timeout=120)


COMMANDS = {
    "simulate": (["simulate", "{}/crowd.yaml", "--seeds", "0-5", "--output", "out/a.h5"], ["a.h5"]),
    "figures": (
        ["figures", "{}/a.nc", "--output", "out/figures", "--figures", "health"],
        ["figures/health.svg", "figures/health.csv", "figures/summary.txt", "figures/summary.csv"],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("verb", COMMANDS)
def test_without_space_there_is_one_line_and_no_half_a_file(verb, expected, faults):
    words, outputs = COMMANDS[verb]
    done = limited(faults.random.randint(0, 100_000), [word.format(expected) for word in words])
    assert not list(Path().rglob("*.part"))
    assert "Traceback" not in done.stderr, done.stderr
    if done.returncode != DONE:
        lines = [line for line in done.stderr.splitlines() if not line.startswith("brownpipe: compiling ")]
        assert len(lines) == 1 and "not written: File too large" in lines[0], done.stderr
    for name in outputs:
        written = Path("out", name)
        assert not written.exists() or written.read_bytes() == (expected / name).read_bytes(), name
        assert written.exists() or done.returncode == FAILED, name


def test_figures_that_cannot_all_be_written_replace_none(expected):
    """They would be of another dataset than the rest of the folder."""
    words = ["figures", f"{expected}/a.nc", "--output", "figures", "--figures"]
    assert main([*words, "health"]) == DONE
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in Path("figures").iterdir()}
    least = max(len(contents) for _, contents in before.values())
    done = limited(least - 1, [*words, "health,msd"])
    assert done.returncode != DONE
    assert "not written: File too large" in done.stderr
    assert before == {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in Path("figures").iterdir()}


# -- workers --------------------------------------------------------------------------------------------------------

WORKERS = """#!/bin/bash
case "$*" in *"--seeds 2-3 "*) kill -KILL $$ ;; esac
exec {} "$@"
"""  # in place of `brownpipe`


@pytest.mark.slow
def test_a_study_survives_a_killed_worker_and_runs_that_cannot_go_on(tmp_path):
    """The runs of the seeds 0 and 2 find no place; the job of the seeds 2 and 3 is killed at first."""
    folder = tmp_path / "study"
    (folder / "bin").mkdir(parents=True)
    (folder / "crowd.yaml").write_text(CROWD)
    (folder / "study.yaml").write_text("scenes: crowd.yaml\nseeds: 6\nbatch: 2\nfigures: [health]\n")
    program = folder / "bin" / "brownpipe"
    path = {"PATH": f"{program.parent}:{forked.programs()}:{os.environ['PATH']}"}
    program.write_text(WORKERS.format(f"{forked.programs()}/brownpipe"))
    program.chmod(0o755)
    printed = snakemake(folder, "--cores", "1", fails=True, **path)
    last = printed.splitlines()[-1]
    assert last.startswith("    brownpipe: killed, most likely out of memory") and "Traceback" not in printed, printed
    assert {file.name for file in (folder / "results/runs").rglob("*.h5")} == {"0-1.h5", "4-5.h5"}
    program.unlink()
    told = r"study\.nc: 2 of 6 runs failed and are in no average, {}: crowd, N = 40: seeds 0,2"
    printed = snakemake(folder, "--cores", "1", fails=True, **path)
    assert re.search(told.format("allow_failed: 0 accepts no more"), printed.splitlines()[-1]), printed
    answer = (folder / "results/study/figures/summary.txt").read_text()
    assert answer in printed and "failed and left out: 2 of 6 seeds (0,2)" in answer
    again = snakemake(folder, "--cores", "1", fails=True, **path)
    assert again.partition("\n")[2] == printed[printed.index(answer) :]
    accepted = snakemake(folder, "--cores", "1", "--config", "allow_failed=2", **path)
    assert re.search(told.format("accepted by allow_failed: 2").replace("study", "study.allow_failed=2"), accepted)
