"""Kernels are compiled by one process at a time."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise

import numba
import numpy as np
import pytest

from brownpipe import kernels

HOLD = """
import sys, time
from pathlib import Path
from brownpipe import kernels
kernels.CACHE = sys.argv[1]
with kernels.one_compiler():
    begin = time.monotonic()
    time.sleep(0.2)
    print(begin, time.monotonic())
"""


def test_one_compiler_at_a_time(tmp_path):
    processes = [
        subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    times = sorted(tuple(map(float, process.communicate(timeout=60)[0].split())) for process in processes)
    assert len(times) == 3
    assert all(end <= begin for (_, end), (begin, _) in pairwise(times))


def test_a_prefetch_is_compiled_to_one():
    """No result can tell."""

    @numba.njit
    def ask(array, index):
        kernels.prefetch(array, index)

    ask(np.zeros(4, np.uint32), 2)
    (compiled,) = ask.inspect_llvm().values()
    assert "call void @llvm.prefetch" in compiled


def test_without_a_place_to_write_nothing_is_locked(monkeypatch):
    monkeypatch.setattr(kernels, "CACHE", "")
    with kernels.one_compiler():
        pass


def test_machine_code_is_not_taken_from_others(tmp_path):
    folder = tmp_path / "code"
    folder.mkdir(mode=0o700)
    assert kernels._private(folder)
    folder.chmod(0o777)
    assert not kernels._private(folder)
    (tmp_path / "link").symlink_to(tmp_path)
    assert not kernels._private(tmp_path / "link")


def test_machine_code_that_nobody_uses_is_removed(tmp_path):
    """Of three folders the one unused for a day; not one whose lock is held, nor what is not ours."""
    for name in ("kernels-old", "kernels-new", "kernels-held", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / kernels.LOCK).touch()
        (tmp_path / name / "code.nbc").touch()
    for name in ("kernels-old", "kernels-held", "other"):
        os.utime(tmp_path / name / kernels.LOCK, (time.time() - 2 * kernels.UNUSED,) * 2)
    with open(tmp_path / "kernels-held" / kernels.LOCK) as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        kernels._prune(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kernels-held", "kernels-new", "other"]


def test_using_machine_code_keeps_it_from_being_removed(tmp_path, monkeypatch):
    folder = tmp_path / "kernels-used"
    monkeypatch.setattr(kernels, "CACHE", str(folder))
    for _ in range(2):
        with kernels.one_compiler():
            pass
        os.utime(folder / kernels.LOCK, (0, 0))
    with kernels.one_compiler():
        pass
    kernels._prune(tmp_path)
    assert folder.exists()


def test_a_signal_while_compiling_is_answered_after_it():
    done = []

    def compiled():
        with kernels.one_compiler():
            signal.raise_signal(signal.SIGINT)
            done.append("compiled")

    with pytest.raises(KeyboardInterrupt):
        compiled()
    assert done == ["compiled"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
