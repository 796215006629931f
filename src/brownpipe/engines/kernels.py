"""How the kernels are compiled, where the machine code is kept, and that no two processes compile the same."""

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
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numba
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.cpu import CPUContext, CPUTargetOptions
from numba.extending import intrinsic, register_jitable

from brownpipe.engines import inlining
from brownpipe.provenance import PACKAGE, sources

inlining.install()
LOCK = "compiling"  # in each folder of machine code; its time is that of the last use
UNUSED = 86_400.0  # seconds

# error_model="numpy": x / 0 is inf, as for arrays, and no division needs a branch.
# forceinline: of all kernels an entry point becomes one function, with the workspace in registers (3.4 times faster).
# _nrt=False: no reference counts around array arguments (1.6 times faster); private to Numba, so left out if unknown.
# Never fastmath: results would depend on the model of the CPU.
OPTIONS = {"error_model": "numpy", "forceinline": True}
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

    def load(context):
        CPUContext.load_additional_registries = usual
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
                arraymath.ensure_blas = ensure_blas

    CPUContext.load_additional_registries = load


_defer_blas()


@cache
def _cache_folder(module: str) -> str:
    """Return a folder for the machine code of exactly this source: a module of kernels and all that it imports.

    Numba looks only at the file of the outermost kernel to see whether its machine code is out of date; an edited
    callee in another file would go unnoticed, and with it wrong results.
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
    """Remove machine code of sources that no process has used for a day. One that still does compiles again."""
    for lock in base.glob(f"kernels-*/{LOCK}"):
        with suppress(OSError), open(lock) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if time.time() - lock.stat().st_mtime > UNUSED:
                shutil.rmtree(lock.parent, ignore_errors=True)


def _private(folder: Path) -> bool:
    """Numba runs what lies in its cache: nobody else may put anything there."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


CACHE = _cache_folder("engines.kernels")  # where the locks of all compilers are


def kernel(function):
    """Let a function be compiled into the kernels that call it. Called from Python it stays a function of Python."""
    return register_jitable(**OPTIONS, no_cfunc_wrapper=True)(function)


def entry_point(function):
    """Compile a function, with all kernels that it calls, at its first call from Python, once per machine."""
    inside, _, module = function.__module__.partition("brownpipe.")
    module = "engines.kernels" if inside else module  # a function of another program: Numba looks at its own file
    saved, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _cache_folder(module)
    try:
        dispatcher = numba.njit(**OPTIONS, no_cfunc_wrapper=True, cache=True)(function)
    finally:
        numba.config.CACHE_DIR = saved
    if not numba.config.DISABLE_JIT:
        _save_one_by_one(dispatcher)
    return dispatcher


def prefetch(array, index):
    """Ask memory for the cache line of array[index] and do not wait for it. Changes nothing but the speed."""


if not numba.config.DISABLE_JIT:

    @intrinsic
    def prefetch(typing, array, index):
        """Compile to the processor's own instruction."""

        def code(context, builder, signature, arguments):
            start = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            line = builder.bitcast(builder.gep(start, [arguments[1]]), byte)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            ask = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
            for_reading, into_all_caches, of_data = word(0), word(3), word(1)
            builder.call(ask, [line, for_reading, into_all_caches, of_data])
            return context.get_dummy_value()

        return types.void(array, types.intp), code


on_compile = []  # functions that take a line of text, called when this process compiles or waits for one that does


def _tell(line: str) -> None:
    for listener in on_compile:
        listener(line)


@contextmanager
def one_compiler(*records):
    """Let one process at a time compile for records of these types; others then find the result in the cache.

    Kernels for other types, other scenes that is, are compiled at the same time on other cores. Ctrl-C is heeded.
    """
    if not CACHE:
        with _compiling():
            yield
        return
    Path(CACHE).mkdir(parents=True, exist_ok=True)  # it may have been removed meanwhile
    kinds = [numba.typeof(record).name for record in records]
    with open(Path(CACHE) / LOCK, "w") as in_use, open(Path(CACHE) / "-".join([LOCK, "for", *kinds]), "w") as lock:
        os.utime(in_use.fileno())
        fcntl.flock(in_use, fcntl.LOCK_SH)
        _take(lock)
        with _compiling():
            yield


def _save_one_by_one(dispatcher) -> None:
    """Let one process at a time enter machine code into the disk cache of a function, whose index they share.

    Numba gives two files the same name if two processes enter theirs at the same time.
    """
    save = dispatcher._cache.save_overload

    def save_alone(*code):
        Path(CACHE).mkdir(parents=True, exist_ok=True)
        with open(Path(CACHE) / "saving", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            save(*code)

    if CACHE:
        dispatcher._cache.save_overload = save_alone


def _take(lock) -> None:
    """Lock a file. That another process loads its kernels takes less than a second, and is not worth a word."""
    for _ in range(20):
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(0.1)
    _tell("waiting for another process that compiles its kernels")
    fcntl.flock(lock, fcntl.LOCK_EX)


class _FirstKernel(event.Listener):
    """Tells of the first kernel that is compiled and not found in the cache."""

    told = False

    def on_start(self, _):
        if not self.told:
            _tell("compiling the kernels for this kind of scene, once per machine: about 8 s")
        self.told = True

    def on_end(self, _):
        pass


@contextmanager
def _compiling():
    """Let signals like Ctrl-C end the compiling, at the latest after a call of LLVM, which takes up to a second.

    An exception raised in a callback from LLVM is lost, so a signal that arrives there is raised again after compiling.
    """
    held, usual = [], {}

    def heed(number, frame):
        if _is_callback(frame):
            held.append(number)
        elif callable(usual[number]):
            usual[number](number, frame)
        else:
            signal.signal(number, usual[number])
            signal.raise_signal(number)

    try:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                usual[number] = signal.getsignal(number) or signal.SIG_DFL
                signal.signal(number, heed)
        with event.install_listener("numba:compile", _FirstKernel()):
            yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
    for number in held:
        signal.raise_signal(number)


def _is_callback(frame) -> bool:
    """Whether a frame is within Numba's functions that LLVM calls with machine code that is made or asked for."""
    while frame is not None:
        if frame.f_code.co_name in ("_object_compiled_hook", "_object_getbuffer_hook"):
            return True
        frame = frame.f_back
    return False
