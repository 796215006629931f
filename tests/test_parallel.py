"""Work on several cores: the same results and errors as on one core, and no process that outlives its parent."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from brownpipe import stages
from brownpipe.errors import FigureError
from brownpipe.parallel import calculated

ALONE = os.getpid()
WORKS_LONG = """\
import os, sys, time
from brownpipe import cli, parallel
from brownpipe.verbs import schema
def work(item, report):
    open(f"{item}.{os.getpid()}", "w").close()
    time.sleep(60)
def work_on_all(arguments):
    "A verb."
    parallel.calculated(work, "abc", [1, 1, 1], "items", 2)
schema.schema = work_on_all
sys.exit(cli.main(["schema", "study"]))
"""
ENDS = {  # exit status and what is said
    signal.SIGTERM: (128 + signal.SIGTERM, "brownpipe: terminated\n"),
    signal.SIGINT: (128 + signal.SIGINT, "brownpipe: interrupted\n"),
    signal.SIGKILL: (-signal.SIGKILL, ""),
}


@pytest.fixture
def reported():
    """The stages that are reported."""
    found = []
    stages.listeners.append(found.append)
    yield found
    stages.listeners.clear()


def square(number, report):
    """A piece of work in two parts."""
    report(1)
    return number**2, os.getpid()


@pytest.mark.parametrize("cores", [1, 2, 3, 8])
def test_results_are_those_of_one_core_in_order(cores, reported):
    results = calculated(square, range(5), [2] * 5, "squares", cores)
    assert [result for result, _ in results] == [0, 1, 4, 9, 16]
    assert len({process for _, process in results} - {ALONE}) <= min(cores, 5)
    assert (ALONE in {process for _, process in results}) == (cores == 1)
    assert [stage.done for stage in reported] == [*range(1, 11)] and reported[-1] == ("squares", 10, 10)
    assert multiprocessing.active_children() == []


def test_of_several_errors_the_first_item_s_is_raised_here():
    def work(number, _):
        if number in (1, 3):
            time.sleep(0.2 if number == 1 else 0)
            raise FigureError(f"item {number}, process {os.getpid()}")
        return number

    with pytest.raises(FigureError, match=f"^item 1, process {ALONE}$"):
        calculated(work, range(5), [1] * 5, "items", 4)
    assert multiprocessing.active_children() == []


def kill_worker(number):
    if os.getpid() != ALONE:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def cannot_be_sent(number):
    return (lambda: number) if os.getpid() != ALONE else number


@pytest.mark.parametrize("lose", [kill_worker, cannot_be_sent])
def test_the_work_of_a_lost_worker_is_done_here(lose):
    results = calculated(lambda number, _: lose(number) if number == 2 else number, range(6), [1] * 6, "items", 2)
    assert results == [*range(6)] and multiprocessing.active_children() == []


def test_where_no_process_can_be_forked_the_work_is_done_here(monkeypatch):
    def refused():
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(os, "fork", refused)
    assert calculated(square, range(3), [2] * 3, "squares", 2) == [(k**2, ALONE) for k in range(3)]


@pytest.mark.parametrize("number", ENDS)
def test_no_worker_outlives_its_parent(number, tmp_path):
    process = subprocess.Popen([sys.executable, "-c", WORKS_LONG], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(os.listdir(tmp_path)) == 2, process)
    workers = [int(path.suffix[1:]) for path in tmp_path.iterdir()]
    assert process.pid not in workers
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == ENDS[number]
    wait_until(lambda: not any(map(is_running, workers)))


def wait_until(happens, process=None):
    """Wait for 20 s at most."""
    end = time.monotonic() + 20
    while not happens():
        assert time.monotonic() < end and (process is None or process.poll() is None)
        time.sleep(0.02)


def is_running(process):
    """Whether a process runs; one that has ended may not have been collected yet."""
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


@pytest.mark.parametrize("output", ["figures --output missing", "aggregate --output missing.nc"])
def test_each_of_several_processes_has_one_thread(output, tmp_path):
    """Snakemake's environment asks for as many threads as a job has cores; NumPy starts them when it is imported.

    A thread that has been joined is listed by the system for a moment longer; one of NumPy's would stay.
    """
    program = (
        "import os, sys, threading, time\n"
        "from brownpipe.cli import main\n"
        "main([*sys.argv[1:], 'absent.nc', '--cores', '2'])\n"
        "for thread in threading.enumerate()[1:]:\n"
        "    thread.join(20)\n"
        "end = time.monotonic() + 10\n"
        "while len(os.listdir('/proc/self/task')) > 1 and time.monotonic() < end:\n"
        "    time.sleep(0.01)\n"
        "print('numpy' in sys.modules, len(os.listdir('/proc/self/task')))\n"
    )
    words = [sys.executable, "-c", program, *output.split()]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == "True 1\n" and "absent.nc" in done.stderr
