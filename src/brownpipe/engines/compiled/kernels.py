"""Compile kernels with Numba.

An `entry_point` is called from Python; all functions marked `kernel` that it calls are inlined into
it. Numba keeps its machine code on disk (`FOLDER`). `compile_all` compiles it before the first run.
"""

import fcntl
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.cpu import CPUContext
from numba.core.typing import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic, register_jitable

from brownpipe import progress
from brownpipe.engines.compiled import compiler
from brownpipe.processes import held
from brownpipe.provenance import PACKAGE

# Numba sets its attributes from the environment, unseen by type checkers
config: Any = numba.config

# error_model="numpy": x / 0 is inf, as for arrays, and no division needs a branch.
# forceinline: of all kernels an entry point becomes one function, with the workspace in registers
# (3.4 times faster). _nrt=False: no reference counts of array arguments (1.6 times faster); private
# to Numba.
# fastmath is never used: results would depend on the model of the CPU.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
if compiler.IS_TESTED:
    OPTIONS["_nrt"] = False
    OPTIONS["pipeline_class"] = compiler.Compiler
    compiler.simplify_inlined()
Function = TypeVar("Function", bound=Callable[..., object])  # whose callers are checked
NEWEST = 4  # folders of machine code that are kept, each of another version of the source


def kernel(function: Callable) -> Callable:
    """Inline a function into the entry points that call it. Called from Python, it stays a Python
    function.
    """
    return register_jitable(**OPTIONS)(function)


def entry_point(function: Function) -> Function:
    """Compile a function with all kernels that it calls at its first call from Python, once per
    machine.
    """
    dispatcher = numba.njit(**OPTIONS, nogil=True)(function)
    if FOLDER is not None and not config.DISABLE_JIT:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(FOLDER)  # read when the cache is made
        dispatcher._cache = DiskCache(function, FOLDER)
        config.CACHE_DIR = before
    return dispatcher


class DiskCache(FunctionCache):
    """Numba's own cache. Without a lock two processes may save different variants in one file."""

    def __init__(self, function: Callable, folder: Path) -> None:
        super().__init__(function)
        self.folder = folder

    def load_overload(self, *variant: object) -> object:
        """Return a variant; None if it is not there. Files that a loss of power has truncated are
        forgotten.

        Numba's own method first imports all that machine code may call: 0.3 s. In ours everything
        is inlined.
        """
        load = self._load_overload if compiler.IS_TESTED else super().load_overload
        try:
            return load(*variant)
        except (EOFError, UnpicklingError):
            self.flush()
            return None

    def save_overload(self, *variant: object) -> None:
        """Save a variant. If that fails, it stays in memory, and other processes compile it
        again.
        """
        with suppress(OSError), _locked(self.folder):
            super().save_overload(*variant)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let no other process write to the folder; raise OSError if it cannot be written to or has no
    locks.
    """
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _folder() -> tuple[Path | None, str]:
    """Return the folder of machine code, the first place that can be written to and has file locks;
    None if there is none, and why.

    It is named after a digest of all that kernels are made from. Numba itself compares the source
    of the file with the entry point alone, and would execute outdated code after an edit of another
    one.
    """
    sources = sorted(PACKAGE.glob("engines/**/*.py"))
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()
    name = f"kernels-{digest[:16]}"
    places = [Path(config.CACHE_DIR)] if config.CACHE_DIR else [PACKAGE / "__pycache__"]
    with suppress(RuntimeError):  # the user has no home
        if not config.CACHE_DIR:
            user_cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
            places.append(Path(user_cache, "brownpipe"))
    problem = ""
    for place in places:
        try:
            folder = place.absolute() / name
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)  # the newest from now on
            with _locked(folder):
                for old in sorted(place.glob("kernels-*"), key=os.path.getmtime)[:-NEWEST]:
                    shutil.rmtree(old, ignore_errors=True)
            return folder, ""
        except OSError as error:
            problem = f"{place}: {error.strerror}"
    return None, problem


FOLDER, NO_FOLDER = _folder()


def compile_all(*calls: Callable[[], object]) -> None:
    """Compile the entry points that are called, or load their machine code; the calls do little
    else.

    Ctrl-C and SIGTERM wait until all are compiled: an exception would leave objects of llvmlite
    half made.
    """
    if not compiler.IS_TESTED:
        first, last = (".".join(map(str, version)) for version in compiler.TESTED)
        _say_once(
            f"kernels are slower with Numba {numba.__version__}; must be {first} to {last} for "
            "full speed"
        )
    with held(), event.install_listener("numba:compile", _Compiling()):
        for call in calls:
            call()


class _Compiling(event.Listener):
    """Say when the first kernel is compiled, because there is no machine code of it, or none can be
    kept.
    """

    def on_start(self, _: event.Event) -> None:
        _say_once("compiling the kernels for this kind of scene, once per machine: about 8 s")
        if FOLDER is None:
            _say_once(
                f"machine code cannot be kept, every process compiles: {NO_FOLDER}; "
                "NUMBA_CACHE_DIR must be a folder of yours with file locks"
            )

    def on_end(self, _: event.Event) -> None:
        pass


@cache
def _say_once(line: str) -> None:
    progress.remark(line)


def prefetch(array: np.ndarray, index: int | np.integer) -> None:
    """Load the cache line of array[index] into the processor's cache without waiting; changes only
    the speed.
    """


if not config.DISABLE_JIT:

    @intrinsic
    def prefetch(
        typing: Context, array: types.Array, index: types.Type
    ) -> tuple[Signature, Callable]:
        """Compile to LLVM's prefetch instruction."""

        def code(
            context: CPUContext,
            builder: ir.IRBuilder,
            signature: Signature,
            arguments: list[ir.Value],
        ) -> ir.Value:
            start = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            pointer = ir.IntType(8).as_pointer()
            word = ir.IntType(32)
            address = builder.bitcast(builder.gep(start, [arguments[1]]), pointer)
            instruction_type = ir.FunctionType(ir.VoidType(), [pointer, word, word, word])
            instruction = builder.module.declare_intrinsic(
                "llvm.prefetch", [pointer], instruction_type
            )
            for_reading = word(0)
            into_all_caches = word(3)
            data_cache = word(1)
            builder.call(instruction, [address, for_reading, into_all_caches, data_cache])
            return context.get_dummy_value()

        return types.void(array, types.intp), code
