"""Kernels are compiled correctly and once: a second process finds the machine code, which is never
outdated.
"""

import errno
import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest

from brownpipe import provenance
from brownpipe.engines.compiled import compiler, kernels
from brownpipe.engines.compiled.fours import four, least_of_four
from brownpipe.engines.compiled.kernels import entry_point, kernel
from brownpipe.engines.compiled.records import by_reference, local_copy


@by_reference
class Inner(NamedTuple):
    number: int
    values: object


@by_reference
class Outer(NamedTuple):
    scale: float
    inner: Inner
    missing: object
    values: object


@kernel
def part(missing, outer, k):
    """A kernel in which what is None is left out."""
    if missing is None:
        return outer.scale * outer.inner.values[k] + outer.inner.number
    return missing.no_such_field


@entry_point
def work(outer):
    """Reads scalars, arrays and nested records; writes through the arrays of both."""
    outer = local_copy(outer)
    total = 0.0
    for k in range(len(outer.values)):
        outer.values[k] = part(outer.missing, outer, k)
        outer.inner.values[k] += 1.0
        total += outer.values[k]
    return total


def test_a_record_is_passed_by_reference():
    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    assert work(record) == 2.0 * (0 + 1 + 2 + 3) + 4 * 3
    assert record.values.tolist() == [3.0, 5.0, 7.0, 9.0] and record.inner.values.tolist() == [
        1.0,
        2.0,
        3.0,
        4.0,
    ]


def product_and_sum(a, b, c):
    return a * b + c


def product_and_sum_of_fours(a, b, c):
    return least_of_four(four(a) * four(b) + four(c))


@pytest.mark.parametrize("function", [product_and_sum, product_and_sum_of_fours])
def test_a_product_is_rounded_before_a_sum(function):
    """Fused to one instruction (FMA), which every arm64 and most x86-64 processors have, the two
    are rounded once: -(2**-60). Bits of trajectories would depend on what the compiler fuses.
    """
    compiled = entry_point(function)
    assert compiled(1 + 2.0**-30, 1 - 2.0**-30, -1.0) == 0.0


def test_a_record_leaves_no_references_to_its_arrays():
    """Neither with reference counts nor without."""

    @numba.njit
    def counted(outer):
        return outer.values[0] + outer.inner.values[0]

    record = Outer(2.0, Inner(3, np.arange(4.0)), None, np.zeros(4))
    for function in (work, counted):
        function(record)
        before = [sys.getrefcount(array) for array in (record.values, record.inner.values)]
        for _ in range(10):
            function(record)
        assert [sys.getrefcount(array) for array in (record.values, record.inner.values)] == before


# -- machine code on disk --------------------------------------------------------------------------

FOLLOW = """
import sys
import numpy as np
from numba.core.codegen import JITCPUCodegen
from brownpipe import progress
from brownpipe.engines.compiled import compiler
if "untested" in sys.argv:
    compiler.IS_TESTED = False
from brownpipe.engines.compiled import kernels
from brownpipe.engines.langevin.simulation import follow
progress.remark_listeners.append(lambda line: print(line.split()[1]))
path = np.random.default_rng(1).standard_normal((50, 2, 2))
normal = np.random.default_rng(1).standard_normal((49, 2, 2))
weights = np.random.default_rng(1).standard_normal((49, 4))
for _ in range(2):
    kernels.compile_all(lambda: follow(path, normal, weights))
print(kernels.FOLDER, JITCPUCodegen._library_class.__module__, path.tobytes().hex())
"""


@pytest.fixture
def copied(tmp_path):
    """A copy of the package, without machine code."""
    without = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(provenance.PACKAGE, tmp_path / "copy" / "brownpipe", ignore=without)


def follows(package, *words, **environment):
    """What a process says that compiles a small kernel, unless there is machine code; folder,
    compiler and result.
    """
    apart = os.environ | {"PYTHONPATH": str(package.parent), "NUMBA_CACHE_DIR": ""} | environment
    command = [sys.executable, "-c", FOLLOW, *words]
    return subprocess.run(
        command, env=apart, capture_output=True, text=True, check=True
    ).stdout.split()


@pytest.mark.slow
def test_kernels_are_compiled_once_and_again_after_an_edit_of_any_source(copied, monkeypatch):
    said, first, changed, result = follows(copied)
    assert said == "compiling" and first.startswith(str(copied / "__pycache__" / "kernels-"))
    assert follows(copied) == [first, changed, result]
    *said, _, usual, same = follows(copied, "untested", NUMBA_CPU_NAME="generic")
    assert said[0] == "kernels", "the line of a version of Numba that was not tested"
    assert "compiling" in said, "there is code, but for another processor"
    assert usual == "numba.core.codegen" and same == result
    assert changed == ("brownpipe.engines.compiled.compiler" if compiler.IS_TESTED else usual)
    monkeypatch.setattr(kernels, "PACKAGE", copied)
    with open(copied / "engines" / "units.py", "a") as file:
        file.write("# edited\n")
    folder, _ = kernels._folder()
    assert folder.parent == copied / "__pycache__" and not [*folder.rglob("*.nb?")]


def test_where_the_package_cannot_be_written_to_the_users_cache_is_taken(
    copied, tmp_path, monkeypatch
):
    """Here a file is in the place of the folder, as root can write to any."""
    (copied / "__pycache__").touch()
    monkeypatch.setattr(kernels, "PACKAGE", copied)
    monkeypatch.setattr(kernels.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    folder, _ = kernels._folder()
    assert folder.parent == tmp_path / "own" / "brownpipe"
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    assert kernels._folder() == (None, "/dev/null/brownpipe: Not a directory")


def test_a_folder_without_file_locks_is_named_with_the_cure(tmp_path, monkeypatch):
    """As on some network file systems; the folder that the user has set is writable."""
    own = tmp_path / "own"

    def flock(*_):
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(kernels.fcntl, "flock", flock)
    monkeypatch.setattr(kernels.config, "CACHE_DIR", str(own))
    folder, problem = kernels._folder()
    assert folder is None and problem == f"{own}: Operation not supported"
    remarks = []
    monkeypatch.setattr(kernels, "FOLDER", folder)
    monkeypatch.setattr(kernels, "NO_FOLDER", problem)
    monkeypatch.setattr(kernels, "_say_once", remarks.append)
    kernels._Compiling().on_start(None)
    assert remarks[1:] == [
        f"machine code cannot be kept, every process compiles: {problem}; NUMBA_CACHE_DIR must be "
        "a folder of yours with file locks"
    ]


def test_a_user_without_a_home_needs_no_cache(copied, monkeypatch):
    def no_home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(kernels, "PACKAGE", copied)
    monkeypatch.setattr(kernels.config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(kernels.Path, "home", no_home)
    folder, _ = kernels._folder()
    assert folder.parent == copied / "__pycache__"


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """An entry point made anew, as in another process, with an empty folder."""
    monkeypatch.setattr(kernels, "FOLDER", tmp_path)
    return lambda: kernels.entry_point(work.py_func)


def outer(kind=float):
    return Outer(2.0, Inner(3, np.arange(4, dtype=kind)), None, np.zeros(4, kind))


def is_compiled_again(function):
    """Whether there is no machine code of it on disk; it calculates the same with it and
    without.
    """
    assert function(outer()) == 24.0
    return function.stats.cache_misses != {}


@pytest.mark.slow
def test_truncated_machine_code_is_made_again(kept, tmp_path):
    assert [is_compiled_again(kept()) for _ in range(2)] == [True, False]
    for pattern in ("*.nbi", "*.nbc"):
        for cut in (0, 0.5):
            (file,) = tmp_path.rglob(pattern)
            os.truncate(file, int(cut * file.stat().st_size))
            assert [is_compiled_again(kept()) for _ in range(2)] == [True, False]


def test_if_machine_code_cannot_be_written_the_run_goes_on(kept, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert [is_compiled_again(kept()) for _ in range(2)] == [True, True]
    said = []
    monkeypatch.setattr(kernels, "FOLDER", None)
    monkeypatch.setattr(kernels, "_say_once", said.append)
    kernels.compile_all(lambda: kept()(outer()))
    assert {line.partition(" ")[0] for line in said} == {"compiling", "machine"}
