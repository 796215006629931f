"""Compile kernels with Numba, cache the machine code on disk, and let no two processes compile the same kernels.

An `entry_point` is called from Python; all functions marked `kernel` that it calls are inlined into it. Its machine
code is stored in a folder named after the digest of its source. `one_compiler` holds a lock file while it compiles.
"""

import fcntl
import hashlib
import os
import shutil
import signal
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import FrameType
from typing import IO, Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.cpu import CPUContext, CPUTargetOptions
from numba.extending import intrinsic, register_jitable

from brownpipe.engines import inlining
from brownpipe.provenance import PACKAGE, sources

inlining.install()
config: Any = numba.config  # Numba sets its attributes from the environment, unseen by type checkers
LOCK = "compiling"  # a file in each folder of machine code; its modification time is that of the last use
UNUSED = 86_400.0  # seconds without use after which machine code of another source version is removed

# error_model="numpy": x / 0 is inf, as for arrays, and no division needs a branch.
# forceinline: of all kernels an entry point becomes one function, with the workspace in registers (3.4 times faster).
# _nrt=False: no reference counts of array arguments (1.6 times faster); private to Numba, left out where it is unknown.
# fastmath is never used: results would depend on the model of the CPU.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
if hasattr(CPUTargetOptions, "_nrt"):
    OPTIONS["_nrt"] = False


def _defer_blas() -> None:
    """Let Numba import scipy.linalg for the first function that needs BLAS, not for its own array functions.

    `numba.np.arraymath` calls `ensure_blas` once, when it is imported, to learn whether SciPy has a BLAS. This costs
    0.1 to 0.2 s of CPU in every process, and no kernel here calls BLAS. During that import `ensure_blas` only checks
    the width of BLAS's integers, in versions of Numba that have this check. A function with np.dot calls the original
    when it is compiled; its machine code imports SciPy's BLAS when it is executed.
    """
    usual = getattr(CPUContext, "load_additional_registries", None)
    if usual is None or not inlining.is_tested() or "scipy" not in sys.modules:  # imported by Numba if installed
        return

    def load(context: CPUContext) -> None:
        CPUContext.load_additional_registries = usual  # type: ignore[method-assign]
        from numba.np import linalg

        ensure_blas = getattr(linalg, "ensure_blas", None)
        if ensure_blas is None:
            usual(context)
            return
        linalg.ensure_blas = getattr(linalg, "_check_lapack_int_width", lambda: None)
        try:
            usual(context)
        finally:
            linalg.ensure_blas = ensure_blas
            if arraymath := sys.modules.get("numba.np.arraymath"):
                arraymath.ensure_blas = ensure_blas  # type: ignore[attr-defined]

    CPUContext.load_additional_registries = load  # type: ignore[method-assign]  # replaced on purpose


_defer_blas()


@cache
def _cache_folder(module: str) -> str:
    """Return the folder for the machine code of a module, named after the source of the module and all it imports.

    Numba itself only checks whether the file of the entry point has changed: after an edit of a kernel in another file
    it would execute outdated machine code. Returns "" if no folder is writable.
    """
    text = b"".join(path.read_bytes() for path in sources(module))
    name = f"kernels-{hashlib.sha256(text).hexdigest()[:16]}"
    usual = Path(os.environ.get("NUMBA_CACHE_DIR") or PACKAGE / "engines" / "__pycache__").absolute()
    shared = Path(tempfile.gettempdir()) / f"brownpipe-{os.getuid()}"
    for base in (usual, shared):
        try:
            base.mkdir(mode=0o700 if base == shared else 0o777, parents=True, exist_ok=True)
            if not (base / name).exists():
                (base / name).mkdir(exist_ok=True)
                _prune(base)
        except OSError:
            continue
        if os.access(base / name, os.W_OK) and (base != shared or _private(base)):
            return str(base / name)
    return ""


def _prune(base: Path) -> None:
    """Remove machine code of other source versions that no process has used for a day."""
    for lock in base.glob(f"kernels-*/{LOCK}"):
        with suppress(OSError), open(lock) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if time.time() - lock.stat().st_mtime > UNUSED:
                shutil.rmtree(lock.parent, ignore_errors=True)


def _private(folder: Path) -> bool:
    """Whether only this user can write to a folder: Numba executes what is in its cache."""
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022


CACHE = _cache_folder("engines.kernels")  # the folder of the lock files


def kernel(function: Callable) -> Callable:
    """Inline a function into the entry points that call it. Called from Python, it stays a Python function."""
    return register_jitable(**OPTIONS)(function)


def entry_point(function: Callable) -> Callable:
    """Compile a function with all kernels that it calls at its first call from Python, once per machine."""
    inside, _, module = function.__module__.partition("brownpipe.")
    module = "engines.kernels" if inside else module  # for a function of another program Numba checks its file
    saved, config.CACHE_DIR = config.CACHE_DIR, _cache_folder(module)
    try:
        dispatcher = numba.njit(**OPTIONS, cache=True)(function)
    finally:
        config.CACHE_DIR = saved
    if not config.DISABLE_JIT:
        _save_one_by_one(dispatcher)
    return dispatcher


def prefetch(array: np.ndarray, index: int) -> None:
    """Load the cache line of array[index] into the processor's cache without waiting; changes only the speed."""


if not config.DISABLE_JIT:

    @intrinsic
    def prefetch(typing: Any, array: types.Array, index: types.Type) -> tuple[Any, Callable]:
        """Compile to LLVM's prefetch instruction."""

        def code(context: CPUContext, builder: ir.IRBuilder, signature: Any, arguments: list[ir.Value]) -> Any:
            start = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            pointer, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            address = builder.bitcast(builder.gep(start, [arguments[1]]), pointer)
            instruction_type = ir.FunctionType(ir.VoidType(), [pointer, word, word, word])
            instruction = builder.module.declare_intrinsic("llvm.prefetch", [pointer], instruction_type)
            for_reading, into_all_caches, of_data = word(0), word(3), word(1)
            builder.call(instruction, [address, for_reading, into_all_caches, of_data])
            return context.get_dummy_value()

        return types.void(array, types.intp), code


on_compile: list[Callable[[str], object]] = []  # called with a line of text when this process compiles or waits


def _tell(line: str) -> None:
    for listener in on_compile:
        listener(line)


@contextmanager
def one_compiler(*records: NamedTuple) -> Iterator[None]:
    """Let only one process at a time compile kernels for records of these types; others wait and load the result.

    Kernels for records of other types (other kinds of scenes) can be compiled at the same time on other cores. Signals
    such as Ctrl-C interrupt the compiling.
    """
    if not CACHE:
        with _compiling():
            yield
        return
    Path(CACHE).mkdir(parents=True, exist_ok=True)  # it may have been removed meanwhile
    record_types = [numba.typeof(record).name for record in records]
    name = "-".join([LOCK, "for", *record_types])
    with open(Path(CACHE) / LOCK, "w") as in_use, open(Path(CACHE) / name, "w") as lock:
        os.utime(in_use.fileno())
        fcntl.flock(in_use, fcntl.LOCK_SH)
        _take(lock)
        with _compiling():
            yield


def _save_one_by_one(dispatcher: Any) -> None:
    """Let only one process at a time save machine code of a function to the disk cache, whose index they share.

    If two processes saved at the same time, Numba would give their files the same name.
    """
    save = dispatcher._cache.save_overload

    def save_alone(*code: object) -> None:
        Path(CACHE).mkdir(parents=True, exist_ok=True)
        with open(Path(CACHE) / "saving", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(*code)

    if CACHE:
        dispatcher._cache.save_overload = save_alone


def _take(lock: IO) -> None:
    """Lock a file; tell the listeners if this takes more than 2 s (another process may only be loading kernels)."""
    for _ in range(20):
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(0.1)
    _tell("waiting for another process that compiles its kernels")
    fcntl.flock(lock, fcntl.LOCK_EX)


class _FirstKernel(event.Listener):
    """Tell the listeners at the first kernel that is compiled because the cache does not have it."""

    told = False

    def on_start(self, _: event.Event) -> None:
        if not self.told:
            _tell("compiling the kernels for this kind of scene, once per machine: about 8 s")
        self.told = True

    def on_end(self, _: event.Event) -> None:
        pass


@contextmanager
def _compiling() -> Iterator[None]:
    """Let signals such as Ctrl-C interrupt the compiling, at the latest after a call of LLVM (up to a second).

    An exception raised in a callback from LLVM is lost. A signal that arrives there is therefore deferred, and raised
    again after compiling.
    """
    deferred: list[int] = []
    usual: dict[int, Any] = {}

    def handle(number: int, frame: FrameType | None) -> None:
        if _is_callback(frame):
            deferred.append(number)
        elif callable(usual[number]):
            usual[number](number, frame)
        else:
            signal.signal(number, usual[number])
            signal.raise_signal(number)

    try:
        if threading.current_thread() is threading.main_thread():
            for caught in (signal.SIGINT, signal.SIGTERM):
                usual[caught] = signal.getsignal(caught) or signal.SIG_DFL
                signal.signal(caught, handle)
        with event.install_listener("numba:compile", _FirstKernel()):
            yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
    for number in deferred:
        signal.raise_signal(number)


def _is_callback(frame: FrameType | None) -> bool:
    """Whether a frame is within one of Numba's callbacks from LLVM, which pass machine code to and from its cache."""
    while frame is not None:
        if frame.f_code.co_name in ("_object_compiled_hook", "_object_getbuffer_hook"):
            return True
        frame = frame.f_back
    return False
