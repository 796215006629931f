"""Limits of memory, CPU time, files and space: the same bytes as without, or one line, and nothing half-written."""

import logging
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from snakemake_interface_logger_plugins.common import LogEvent

import forked
import hostile
from brownpipe import errors
from brownpipe.cli import main
from brownpipe.engines import compiled, compiling
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, WrongFileError
from brownpipe.storage import admission, files, hdf5, read_dataset, read_trajectories
from test_failures import CROWD
from test_screen import begin, display, send
from test_workflow import snakemake

pytestmark = pytest.mark.usefixtures("elsewhere")
ROOT = Path(__file__).parent.parent
MB = 2**20
LIMITED = pytest.mark.promise(
    "memory, CPU time, open files or space run out",
    "The command ends by one line and a status other than 0, without a traceback, or with the same bytes as without "
    "the limit; no part of a file stays. If the system kills the command, the next one removes the parts.",
)
WORKER = pytest.mark.promise(
    "a worker of a study is killed",
    "One line names its seeds, the limits and what helps; the other jobs finish, the study ends by 1, and the same "
    "command makes what is missing.",
)
OUTPUT = pytest.mark.promise(
    "an output cannot be written", "This is found before the work begins, and said in one line with the path."
)


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


def limited(limits, words):
    """Run the command line under limits of the system."""

    def limit():
        for kind, value in {"RLIMIT_CORE": 0, **limits}.items():
            resource.setrlimit(getattr(resource, kind), (value, value))

    command = [sys.executable, "-m", "brownpipe", *words]
    return subprocess.run(command, preexec_fn=limit, capture_output=True, text=True, timeout=120)


COMMANDS = {
    "simulate": (["simulate", "{}/crowd.yaml", "--seeds", "0-5", "--output", "out/a.h5"], ["a.h5"]),
    "figures": (
        ["figures", "{}/a.nc", "--output", "out/figures", "--figures", "health"],
        ["figures/health.svg", "figures/health.csv", "figures/summary.txt", "figures/summary.csv"],
    ),
}
RANGES = {  # from where Python starts to where all is enough
    "RLIMIT_AS": (16 * MB, 1000 * MB),
    "RLIMIT_NOFILE": (5, 12),
    "RLIMIT_FSIZE": (0, 100_000),
    "RLIMIT_CPU": (1, 3),
}


@LIMITED
@pytest.mark.parametrize("verb", ["inspect", "aggregate"])
def test_where_the_libraries_cannot_be_loaded_nothing_is_tried(verb):
    """At three limits from 283 to 300 MB OpenBLAS never returned: it waits for memory when SciPy is imported."""
    done = limited({"RLIMIT_AS": 300 * MB}, [verb, "a.h5"])
    said = "brownpipe: out of memory (address space is limited to 300 MB by ulimit -v); must be at least 512 MB\n"
    assert (done.returncode, done.stderr) == (FAILED, said)


@pytest.mark.slow
@pytest.mark.promise("too little memory while an intact file is read", "The file is not called damaged.")
def test_a_lack_of_memory_is_not_taken_for_a_damaged_file(expected, monkeypatch):
    def without_memory(_):
        raise KeyError("Unable to synchronously open object (memory allocation failed for chunk)")  # by HDF5

    monkeypatch.setattr(admission, "address_of", without_memory)
    for read, name in ((read_dataset, "a.nc"), (read_trajectories, "a.h5")):
        with pytest.raises((MemoryError, WrongFileError), match=r"^$|does not fit into memory"):
            read(expected / name)


@LIMITED
def test_hdf5_is_not_called_without_memory(expected, tmp_path):
    """It may crash then. (Tried with 110 limits from 245 to 300 MB: 2 crashes, and 6 intact files called damaged.)"""
    nodes = {"values": hdf5.Node(np.zeros(2**10), {})}

    def call():
        for function, argument in ((read_dataset, expected / "a.nc"), (hdf5.to_bytes, nodes)):
            with pytest.raises(MemoryError):
                function(argument)
        return DONE

    read_dataset(expected / "a.nc")
    ended = hostile.in_child(call, tmp_path, memory=20 * MB)
    assert ended.status == DONE, ended


@LIMITED
@pytest.mark.slow
@pytest.mark.parametrize("kind", RANGES)
def test_any_limit_gives_the_same_bytes_or_one_line(kind, expected, faults):
    for _ in faults.tries(1):
        words, outputs = COMMANDS[faults.random.choice([*COMMANDS])]
        limit = faults.random.randint(*RANGES[kind])
        done = limited({kind: limit}, [word.format(expected) for word in words])
        told = f"{words[0]} with {kind} = {limit}: {done.returncode}\n{done.stderr}"
        if done.returncode == -signal.SIGKILL:
            assert limited({}, [word.format(expected) for word in words]).returncode == DONE, told
        assert not list(Path().rglob("*.part")), told
        assert "Traceback" not in done.stderr, told
        if done.returncode == DONE:
            assert all(Path("out", name).read_bytes() == (expected / name).read_bytes() for name in outputs), told
        elif done.returncode == -signal.SIGKILL:  # one second of CPU time is too little for a last line
            assert (kind, limit) == ("RLIMIT_CPU", 1), told
        else:
            lines = [line for line in done.stderr.splitlines() if not line.startswith("brownpipe: compiling ")]
            assert len(lines) == 1 and re.match("brownpipe: |OpenBLAS error: ", lines[0]), told
        for name in outputs:
            written = Path("out", name)
            assert not written.exists() or written.read_bytes() == (expected / name).read_bytes(), told


@LIMITED
def test_figures_that_cannot_all_be_written_replace_none(expected):
    """They would be of another dataset than the rest of the folder."""
    words = ["figures", f"{expected}/a.nc", "--output", "figures", "--figures"]
    assert main([*words, "health"]) == DONE
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in Path("figures").iterdir()}
    least = max(len(contents) for _, contents in before.values())
    done = limited({"RLIMIT_FSIZE": least - 1}, [*words, "health", "msd"])
    assert done.returncode != DONE
    assert "not written: File too large" in done.stderr
    assert before == {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in Path("figures").iterdir()}


@LIMITED
@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        MemoryError("Unable to allocate 3. GiB for an array with shape (20000, 20000) and data type float64"),
        OSError(12, "Cannot allocate memory"),
        ImportError("libtiff.so.6: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_a_lack_of_memory_is_one_line_whatever_reports_it(error, expected, capsys, monkeypatch):
    def fail(*_, **__):
        raise ValueError("while drawing") from error

    monkeypatch.setattr("brownpipe.report.products.read_dataset", fail)
    monkeypatch.setattr(errors, "limits", lambda: "")
    assert main(["figures", f"{expected}/a.nc", "--output", "figures"]) == FAILED
    assert capsys.readouterr() == ("", "brownpipe: out of memory\n")


def test_kernels_are_neither_compiled_nor_loaded_in_too_little_memory(monkeypatch):
    """LLVM would abort."""
    monkeypatch.setattr(compiling, "LEAST_MEMORY", 2**60)
    with pytest.raises(OSError, match="allocate memory") as caught:
        compiling.compile_all([compiled.KernelCall(lambda: pytest.fail("called"), (), 0.0)])
    assert errors.ran_out_of_memory(caught.value)


# -- outputs --------------------------------------------------------------------------------------------------------


@pytest.fixture
def no_work(monkeypatch):
    """Nothing may be calculated."""
    for work in ("engines.exact.simulation.simulate", "analysis.aggregate", "report.products.write"):
        monkeypatch.setattr(f"brownpipe.{work}", lambda *_, **__: pytest.fail("begins the work"))


@pytest.fixture(params=["name too long", "full disk", "limit of file sizes", "folder in its place", "file as folder"])
def hindrance(request, monkeypatch):
    """Something that makes it impossible to write a file: its path without the suffix, and what is said."""
    if request.param == "name too long":
        return "a" * 245, "File name too long"
    if request.param == "file as folder":
        Path("there").write_text("")
        return "there/a", "(Not a directory|File exists)"
    if request.param == "folder in its place":
        for suffix in (".h5", ".nc"):
            Path(f"a{suffix}").mkdir()
        return "a", "is a folder"
    reason, message = {"full disk": (28, "No space left"), "limit of file sizes": (27, "File too large: no file")}[
        request.param
    ]
    monkeypatch.setattr(files, "_write_through", lambda *_: (_ for _ in ()).throw(OSError(reason, os.strerror(reason))))
    return "a", message


@OUTPUT
@pytest.mark.parametrize("verb", ["simulate", "aggregate"])
def test_an_output_that_cannot_be_written_is_found_before_the_work(verb, hindrance, expected, no_work, capsys):
    name, message = hindrance
    source, suffix = {"simulate": ("crowd.yaml", ".h5"), "aggregate": ("a.h5", ".nc")}[verb]
    before = {*Path().rglob("*")}
    status = main([verb, f"{expected}/{source}", "--output", name + suffix])
    out, err = capsys.readouterr()
    assert status in (FAILED, WRONG_REQUEST) and out == ""
    assert err.count("\n") == 1 and err.startswith(f"brownpipe: {name}{suffix}: ") and re.search(message, err)
    assert {*Path().rglob("*")} == before


@OUTPUT
def test_figures_finds_a_folder_in_the_place_of_a_file(expected, no_work, capsys):
    Path("figures/health.csv").mkdir(parents=True)
    assert main(["figures", f"{expected}/a.nc", "--output", "figures"]) == FAILED
    line = "brownpipe: figures/health.csv: not written: is a folder; choose another --output\n"
    assert capsys.readouterr() == ("", line)


@OUTPUT
def test_a_file_larger_than_the_disk_is_refused_before_the_work(expected, no_work, capsys, monkeypatch):
    monkeypatch.setattr("brownpipe.storage.free_space", lambda _: 1e6)
    assert main(["simulate", f"{expected}/crowd.yaml", "--seeds", "0-99999", "--output", "a.h5"]) == FAILED
    err = capsys.readouterr().err
    assert re.fullmatch(
        r"brownpipe: a\.h5: some [0-9.]+ MB are expected, and there is room for 1 MB; must be .*\n", err
    )


# -- workers --------------------------------------------------------------------------------------------------------

ENDED = "RuleException:\nCalledProcessError in file \"Snakefile\", line 3:\nCommand 'set -euo pipefail;  {}' {}."


@WORKER
@pytest.mark.parametrize(
    ("end", "said", "message"),
    [
        ("returned non-zero exit status 137", "", "killed, most likely as memory ran out"),
        ("died with <Signals.SIGKILL: 9>", "", "killed, most likely as memory ran out"),
        ("returned non-zero exit status 152", "", "its CPU time ran out"),
        ("returned non-zero exit status 134", "LLVM ERROR: out of memory\n", "out of memory"),
        ("returned non-zero exit status 139", "", "ended by SIGSEGV"),
        ("returned non-zero exit status 1", "brownpipe: out of memory\n", "out of memory"),
    ],
)
def test_a_killed_worker_is_said_at_once_and_at_the_end_with_its_seeds(monkeypatch, tmp_path, end, said, message):
    handler, screen = display(monkeypatch)
    log = tmp_path / "1.log"
    log.write_text(said)
    words = "brownpipe simulate x.yaml --seeds 100-199"
    begin(handler, 1, log=log, first=100)
    send(handler, LogEvent.ERROR, ENDED.format(words, end), logging.ERROR)
    send(
        handler, LogEvent.JOB_ERROR, level=logging.ERROR, rule_name="simulate", shellcmd=words, log=[str(log)], jobid=1
    )
    line = rf"brownpipe: seeds 100-199 of .*: {message}.*; the same command goes on from here"
    assert re.search(f"^{line}$", screen.getvalue(), re.MULTILINE) and not handler.running
    handler.close()
    assert re.fullmatch(f"    {line}", screen.getvalue().splitlines()[-1])
    assert "RuleException" not in screen.getvalue()


WORKERS = """#!/bin/bash
case "$*" in *"--seeds 2-3 "*) {}; exec {} -m brownpipe "$@" ;; esac
exec {} "$@"
"""  # in place of `brownpipe`
ENDS = {
    "kill -KILL $$": "killed, most likely as memory ran out",
    "kill -ABRT $$": "ended by SIGABRT",
    "kill -XCPU $$": "its CPU time ran out",
    "ulimit -v 300000": "out of memory",
}


@WORKER
@pytest.mark.promise(
    "runs of a study fail", "The same command computes nothing again, says the same and ends by 1 again."
)
@pytest.mark.slow
def test_a_study_survives_a_killed_worker_and_runs_that_cannot_go_on(tmp_path, faults):
    """The runs of the seeds 0 and 2 find no place; the job of the seeds 2 and 3 comes to a random end at first."""
    folder = tmp_path / "study"
    (folder / "bin").mkdir(parents=True)
    (folder / "crowd.yaml").write_text(CROWD)
    (folder / "study.yaml").write_text("scenes: crowd.yaml\nseeds: 6\nbatch: 2\nfigures: [health]\n")
    program = folder / "bin" / "brownpipe"
    path = {"PATH": f"{program.parent}:{forked.programs()}:{os.environ['PATH']}"}
    end, message = faults.random.choice([*ENDS.items()])
    program.write_text(WORKERS.format(end, sys.executable, f"{forked.programs()}/brownpipe"))
    program.chmod(0o755)
    printed = snakemake(folder, "--cores", "1", fails=True, **path)
    line = rf"    brownpipe: seeds 2-3 of crowd 40 exact: {message}.*; the same command goes on from here"
    assert re.fullmatch(line, printed.splitlines()[-1]) and "Traceback" not in printed, printed
    made = folder / "results/study/simulate/crowd/N40/exact"
    assert {file.name for file in made.iterdir()} == {"0-1.h5", "4-5.h5"}
    program.unlink()
    told = r"study\.nc: 2 of 6 runs failed and are in no average, {}: crowd, N = 40: seeds 0,2"
    printed = snakemake(folder, "--cores", "1", fails=True, **path)
    assert re.search(told.format("allow_failed: 0 accepts no more"), printed.splitlines()[-1]), printed
    answer = (folder / "results/study/figures/summary.txt").read_text()
    assert answer in printed and "failed and left out: 2 of 6 seeds (0,2)" in answer

    def times():  # when all results were made; how the study was run is noted anew
        files = (file for file in (folder / "results").rglob("*.*") if file.name != "run.yaml")
        return {file: file.stat().st_mtime_ns for file in files}

    before = times()
    again = snakemake(folder, "--cores", "1", fails=True, **path)
    assert again.partition("\n")[2] == printed[printed.index(answer) :]
    accepted = snakemake(folder, "--cores", "1", "--config", "allow_failed=2", **path)
    assert re.search(told.format("accepted by allow_failed: 2"), accepted.splitlines()[-1])
    assert before == times()
