"""Machine code on disk: found by a second process, never outdated, and where it cannot be kept a line says so."""

import errno
import os
import shutil
import subprocess
import sys
import time
from multiprocessing import get_context

import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

from brownpipe import provenance
from brownpipe.engines import kernels
from test_kernels import Inner, Outer, work

FOLLOW = """
import sys
import numpy as np
from brownpipe import stages
from brownpipe.engines import compiler, kernels
from brownpipe.engines.kernels import compile_all
from brownpipe.engines.langevin.simulation import follow
if "untested" in sys.argv:
    compiler.TESTED = ((0, 0), (0, 0))
stages.remark_listeners.append(lambda line: print(line.partition(" ")[0]))
for _ in range(2):
    compile_all(lambda: follow(np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros((0, 4))))
print(kernels.FOLDER)
"""


@pytest.fixture
def copied(tmp_path):
    """A copy of the package, without machine code."""
    without = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(provenance.PACKAGE, tmp_path / "copy" / "brownpipe", ignore=without)


def follows(package, *words, **environment):
    """What a process says that compiles a small kernel, unless there is machine code; at last its folder."""
    apart = os.environ | {"PYTHONPATH": str(package.parent), "NUMBA_CACHE_DIR": ""} | environment
    command = [sys.executable, "-c", FOLLOW, *words]
    return subprocess.run(command, env=apart, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.slow
def test_kernels_are_compiled_once_and_again_after_an_edit_of_any_source(copied):
    said, first = follows(copied)
    assert said == "compiling" and first.startswith(str(copied / "__pycache__" / "kernels-"))
    assert follows(copied) == [first]
    for edited in ("engines/exact/cells.py", "elementary.py"):
        with open(copied / edited, "a") as file:
            file.write("# edited\n")
        said, folder = follows(copied)
        assert said == "compiling" and folder != first
        first = folder
    assert follows(copied, NUMBA_CPU_NAME="generic")[0] == "compiling"  # there is code, for another processor


@pytest.mark.slow
def test_where_the_package_cannot_be_written_to_the_users_cache_is_taken(copied, tmp_path):
    """Here a file is in the place of the folder, as root can write to any."""
    (copied / "__pycache__").touch()
    own = {"XDG_CACHE_HOME": str(tmp_path / "own"), "PYTHONDONTWRITEBYTECODE": "1"}
    said, folder = follows(copied, **own)
    assert said == "compiling" and folder.startswith(str(tmp_path / "own" / "brownpipe" / "kernels-"))
    assert follows(copied, **own) == [folder]
    assert follows(copied, **own | {"XDG_CACHE_HOME": "/dev/null"}) == ["compiling", "machine", "None"]


@pytest.mark.slow
def test_with_a_numba_that_was_not_tested_a_line_says_so(copied):
    assert follows(copied, "untested")[0] == "kernels"


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """An entry point made anew, as in another process, with an empty folder."""
    monkeypatch.setattr(kernels, "FOLDER", tmp_path)
    return lambda: kernels.entry_point(work.py_func)


def outer(kind=float):
    return Outer(2.0, Inner(3, np.arange(4, dtype=kind)), None, np.zeros(4, kind))


def is_compiled_again(function):
    """Whether there is no machine code of it on disk; it calculates the same with it and without."""
    assert function(outer()) == 24.0
    return function.stats.cache_misses != {}


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


def saved_slowly(kind):
    """Compile `work` for a type, unless its machine code is there; return whether it was compiled."""
    usual, function = IndexDataCacheFile._save_index, kernels.entry_point(work.py_func)

    def save(*index):
        usual(*index)
        time.sleep(0.5)

    IndexDataCacheFile._save_index = save
    assert function(outer(kind)) == 24.0
    return function.stats.cache_misses != {}


@pytest.mark.slow
@pytest.mark.usefixtures("kept")
def test_variants_saved_at_the_same_time_have_files_of_their_own(tmp_path):
    """Numba chooses the number of a file before it writes the file: another process must not choose meanwhile."""
    for expected in (True, False):
        with get_context("fork").Pool(2) as pool:
            assert pool.map(saved_slowly, [float, int], chunksize=1) == [expected] * 2
    assert len([*tmp_path.rglob("*.nbc")]) == 2
