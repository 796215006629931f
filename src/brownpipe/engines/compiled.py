"""Which kernels have their machine code on disk; nothing is compiled or loaded to find out."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple


class KernelCall(NamedTuple):
    """A call of an entry point that compiles it for a kind of scene, or loads its machine code, and does nothing."""

    function: Callable
    arguments: tuple
    seconds: float  # of CPU to compile


def seconds_to_compile(calls: Iterable[KernelCall]) -> dict[str, float]:
    """Return the CPU seconds to compile each kernel that has no machine code yet, by its name and types."""
    return {_name(call): call.seconds for call in calls if not is_compiled(call)}


def is_compiled(call: KernelCall) -> bool:
    """Whether the machine code is in memory or on disk. Without Numba's compiler (NUMBA_DISABLE_JIT) none is needed."""
    function: Any = call.function
    if not hasattr(function, "overloads") or _types(call) in function.overloads:
        return True
    file = file_of(call)
    return file is not None and disk_cache(call).holds(file)


def file_of(call: KernelCall) -> Path | None:
    """Return the file of the machine code; None if there is none, because no folder can be used (`kernel_cache`)."""
    function: Any = call.function
    cache = disk_cache(call)
    return None if cache is None else cache.file(_types(call), function.targetctx.codegen())


def disk_cache(call: KernelCall) -> Any:
    """Return the `kernel_cache.DiskCache` of the entry point; None if it has none."""
    cache = getattr(call.function, "_cache", None)
    return cache if hasattr(cache, "file") else None


def _types(call: KernelCall) -> tuple:
    """Return Numba's types of the arguments."""
    function: Any = call.function
    return tuple(map(function.typeof_pyval, call.arguments))


def _name(call: KernelCall) -> str:
    return f"{call.function.__module__}.{call.function.__name__}{_types(call)}"
