"""How the kernels are compiled, where the machine code is kept, and that only one process compiles at a time."""

import fcntl
import hashlib
import os
import stat
import tempfile
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numba
from numba.core.cpu import CPUTargetOptions

PACKAGE = Path(__file__).parent

# cache: compiled once per machine.
# error_model="numpy": x / 0 is inf, as for arrays, and no division needs a branch.
# forceinline: a call that passes a workspace copies some hundred words; inlined it costs nothing (3.4 times faster).
# _nrt=False: no reference counts around array arguments (1.6 times faster); private to Numba, so left out if unknown.
# Never fastmath: results would depend on the model of the CPU.
OPTIONS = {"cache": True, "error_model": "numpy", "forceinline": True}
if hasattr(CPUTargetOptions, "_nrt"):
    OPTIONS["_nrt"] = False


@cache
def _cache_folder(engine: str) -> str:
    """Return a folder for the machine code of exactly this source: an engine's, and what all engines share.

    Numba looks only at the file of the outermost kernel to see whether its machine code is out of date; an edited
    callee in another file would go unnoticed, and with it wrong results.
    """
    shared = [PACKAGE / "kernels.py", PACKAGE / "collisions.py", PACKAGE / "placement.py"]
    sources = [*shared, *PACKAGE.glob(f"{engine}/*.py")]
    text = b"".join(path.read_bytes() for path in sorted(sources))
    name = f"kernels-{hashlib.sha256(text).hexdigest()[:16]}"
    usual = os.environ.get("NUMBA_CACHE_DIR") or PACKAGE / "__pycache__"
    shared = Path(tempfile.gettempdir()) / f"brownpipe-{os.getuid()}"
    for base in (Path(usual), shared):
        try:
            base.mkdir(mode=0o700 if base == shared else 0o777, parents=True, exist_ok=True)
            (base / name).mkdir(exist_ok=True)
        except OSError:
            continue
        if os.access(base / name, os.W_OK) and (base != shared or _private(base)):
            return str(base / name)
    return ""


def _private(folder: Path) -> bool:
    """Numba runs what lies in its cache: nobody else may put anything there."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


CACHE = _cache_folder("exact")  # where the lock of all compilers is


def kernel(function):
    """Compile a function at its first call, once per machine."""
    engine = function.__module__.split(".")[1]  # or a module that all engines share
    saved, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _cache_folder(engine)
    try:
        return numba.njit(**OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = saved


class RunError(Exception):
    """A run that cannot go on. One line."""


@contextmanager
def one_compiler():
    """Let one process at a time compile, so that the others find the result in the cache."""
    if not CACHE:
        yield
        return
    with open(Path(CACHE) / "compiling", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
