"""What all tests need: one thread each, an order that keeps all cores busy, Ctrl-C, and random
faults.
"""

import gc
import os
import random
import re
import signal
import sys
from functools import cache

import pytest

# Before numpy is imported, and for all processes that tests start: the tests themselves are on all
# cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Hundreds of processes are started. If none of them may store its compiled source, each takes 0.2 s
# of CPU more.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Files of results are on disk before they are renamed, which takes 5 ms each: it is for a power
# cut, and no test makes one. Processes that tests start do wait for the disk.
os.fsync = lambda _: None

gc.set_threshold(50_000)  # with all the packages in memory the usual 700 take 6 % of the CPU time

# The files that take longest, before all others: each is run by one process, and none may be left
# to the end. Most kernels are compiled in `exact`; until they are there, the other process runs
# files that need few of them.
FIRST = (
    "exact",
    *("figures", "goodness", "streaming", "analysis"),
    *(
        "workflow",
        "benchmarks",
        "check",
        "wheel",
        "validation",
        "tolerance",
        "estimators",
        "provenance",
        "checkpoint",
    ),
    *(
        "documents",
        "faults",
        "cli",
        "extremes",
        "fluid",
        "kernels",
        "interruptions",
        "failures",
        "initial_state",
    ),
    *("langevin", "inspection", "storage", "tradeoff", "observables", "replay"),
)
RANK = {f"test_{name}.py": rank for rank, name in enumerate(FIRST)}

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # So it is where tests are started in the background of a shell. The processes that they start
    # inherit the default.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption(
        "--cluster",
        action="store_true",
        help="run the tests on a Slurm cluster that they start, too",
    )
    parser.addoption(
        "--fault-seed",
        type=int,
        help="the seed of the random faults; default: another one each time",
    )


def pytest_collection_finish():
    """Leave what is imported out of every later search for garbage."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure():
    """Let extension modules find their objects freed at the end; nanobind reports what is left."""
    gc.unfreeze()


def pytest_collection_modifyitems(config, items):
    """Order the files of tests by `FIRST`, and leave out those on a cluster without --cluster."""
    if not config.getoption("--cluster"):
        items[:] = [item for item in items if not item.get_closest_marker("cluster")]
    items.sort(key=lambda item: RANK.get(item.path.name, len(RANK)))


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A test in a folder of its own; SIGTERM as before."""
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def said(capsys):
    """The function from words of the command line to the exit status, standard output and standard
    error.
    """
    from brownpipe.cli import main

    def run(*words):
        capsys.readouterr()
        try:
            status = main([*map(str, words)])
        except SystemExit as left:
            status = left.code
        out, err = capsys.readouterr()
        return (
            status,
            out,
            re.sub("^brownpipe: (compiling|waiting) .*\n", "", err, flags=re.MULTILINE),
        )

    return run


@pytest.fixture
def fewer_replicates(monkeypatch):
    """A fifth of the replicates of the bootstrap: ends of an interval scatter more, and cover the
    truth as often.
    """
    from brownpipe.analysis import resampling

    monkeypatch.setattr(resampling, "REPLICATES", 399)
    monkeypatch.setattr(resampling, "_weights", cache(resampling._weights.__wrapped__))


class Faults:
    """Random faults: moments, bytes, inputs. A failing test shows its seed, and --fault-seed
    repeats it.
    """

    def __init__(self, seed):
        self.seed = random.SystemRandom().randrange(2**32) if seed is None else seed
        self.random = random.Random(self.seed)
        print(f"--fault-seed {self.seed}")  # shown if the test fails


@pytest.fixture
def faults(request):
    return Faults(request.config.getoption("--fault-seed"))
