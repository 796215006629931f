"""Which kernels have their machine code in Numba's cache on disk; nothing is compiled or loaded to find out."""

import mmap
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

LEAST_MEMORY = 100_000_000  # bytes of address space; to compile the kernels takes 57 MB, to load them 18 MB


class KernelCall(NamedTuple):
    """A call of an entry point that compiles it for a kind of scene, or loads its machine code, and does nothing."""

    function: Callable
    arguments: tuple
    seconds: float  # of CPU to compile


def compile_all(calls: Iterable[KernelCall]) -> None:
    """Compile the kernels, or load their machine code.

    Raises OSError (ENOMEM) if there is too little memory for LLVM, which would end the process without a word.
    """
    mmap.mmap(-1, LEAST_MEMORY).close()  # nothing of it is used
    for function, arguments, _ in calls:
        function(*arguments)


def seconds_to_compile(calls: Iterable[KernelCall]) -> dict[str, float]:
    """Return the CPU seconds to compile each kernel that has no machine code yet, by its name and types."""
    return {_name(call): call.seconds for call in calls if not _is_compiled(call)}


def _is_compiled(call: KernelCall) -> bool:
    """Whether the machine code is in the cache. Without Numba's compiler (NUMBA_DISABLE_JIT) none is needed."""
    function: Any = call.function
    if not hasattr(function, "overloads"):
        return True
    cache = getattr(function._cache, "_cache_file", None)  # None: no folder is writable
    key = None if cache is None else function._cache._index_key(_types(call), function.targetctx.codegen())
    return key is not None and key in cache._load_index()


def _types(call: KernelCall) -> tuple:
    """Return Numba's types of the arguments."""
    function: Any = call.function
    return tuple(map(function.typeof_pyval, call.arguments))


def _name(call: KernelCall) -> str:
    return f"{call.function.__module__}.{call.function.__name__}{_types(call)}"
