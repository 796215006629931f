"""Compile kernels with Numba.

An `entry_point` is called from Python; all functions marked `kernel` that it calls are inlined into it. Its machine
code is kept on disk (`engines/kernel_cache.py`). `engines/compiling.py` compiles it before the first run.
"""

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.cpu import CPUContext, CPUTargetOptions
from numba.extending import intrinsic, register_jitable

from brownpipe.engines import inlining, kernel_cache, passes

inlining.install()
config: Any = numba.config  # Numba sets its attributes from the environment, unseen by type checkers

# error_model="numpy": x / 0 is inf, as for arrays, and no division needs a branch.
# forceinline: of all kernels an entry point becomes one function, with the workspace in registers (3.4 times faster).
# _nrt=False: no reference counts of array arguments (1.6 times faster); private to Numba, left out where it is unknown.
# fastmath is never used: results would depend on the model of the CPU.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
if hasattr(CPUTargetOptions, "_nrt"):
    OPTIONS["_nrt"] = False
if inlining.is_tested():
    OPTIONS["pipeline_class"] = passes.KernelCompiler


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


def kernel(function: Callable) -> Callable:
    """Inline a function into the entry points that call it. Called from Python, it stays a Python function."""
    return register_jitable(**OPTIONS)(function)


def entry_point(function: Callable) -> Callable:
    """Compile a function with all kernels that it calls at its first call from Python, once per machine.

    Other threads of Python can run meanwhile (nogil), such as the one that ends the process after Ctrl-C.
    """
    dispatcher = numba.njit(**OPTIONS, nogil=True)(function)
    if not config.DISABLE_JIT:
        before, _, module = function.__module__.partition("brownpipe.")
        is_ours = not before and bool(module)
        folder = kernel_cache.folder_of(module if is_ours else "engines.kernels")
        digest = "" if is_ours else hashlib.sha256(Path(function.__code__.co_filename).read_bytes()).hexdigest()
        if folder is not None:
            dispatcher._cache = kernel_cache.DiskCache(folder, function, digest)
    return dispatcher


def prefetch(array: np.ndarray, index: int | np.integer) -> None:
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
