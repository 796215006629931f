"""Compile the kernels of a scene before its first run, or load their machine code."""

from collections.abc import Callable
from functools import cache

import numba
from numba.core import event

from brownpipe import progress
from brownpipe.engines import inlining, kernels
from brownpipe.processes import held


def compile_all(*calls: Callable[[], object]) -> None:
    """Compile the entry points that are called, or load their machine code; the calls do nothing else.

    Ctrl-C and SIGTERM wait until all are compiled: an exception would leave objects of llvmlite half made.
    """
    if not inlining.is_tested():
        first, last = (".".join(map(str, version)) for version in inlining.TESTED)
        _say_once(f"kernels are slower with Numba {numba.__version__}; must be {first} to {last} for full speed")
    with held(), event.install_listener("numba:compile", _Compiling()):
        for call in calls:
            call()


class _Compiling(event.Listener):
    """Say when the first kernel is compiled, because there is no machine code of it, or none can be kept."""

    def on_start(self, _: event.Event) -> None:
        _say_once("compiling the kernels for this kind of scene, once per machine: about 8 s")
        if kernels.FOLDER is None:
            _say_once("machine code cannot be kept: every process compiles; set NUMBA_CACHE_DIR to a folder of yours")

    def on_end(self, _: event.Event) -> None:
        pass


@cache
def _say_once(line: str) -> None:
    progress.remark(line)
