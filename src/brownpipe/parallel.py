"""Independent pieces of work on several cores, in processes that are forked from this one and inherit all it has read.

They only calculate: this process alone writes files and shows progress.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from typing import Any, TypeVar

from brownpipe import stages
from brownpipe.interrupts import SIGNALS

Item = TypeVar("Item")
Result = TypeVar("Result")
_inherited: list[tuple[Callable, Sequence]] = []  # in a forked process: the work and its items


def calculated(work: Callable[[Item], Result], items: Sequence[Item], unit: str, cores: int) -> list[Result]:
    """Return the work of each item, done on up to so many cores; `unit` is the plural of an item.

    Where processes cannot be forked (on macOS its own libraries may fail then), one core does the work.
    """
    if min(cores, len(items)) < 2 or sys.platform != "linux":
        return [work(item) for item in stages.tracked(items, unit)]
    fork, results = multiprocessing.get_context("fork"), list[Result]()
    pool = ProcessPoolExecutor(min(cores, len(items)), fork, _begin, (work, items))
    try:
        with suppress(Exception):  # of the work, raised again below, with its causes; or a process was killed
            for result in pool.map(_do, range(len(items))):
                results.append(result)
                stages.report(unit, len(results), len(items))
    finally:
        for process in multiprocessing.active_children():
            process.kill()
        pool.shutdown(cancel_futures=True)
    return results + [work(item) for item in items[len(results) :]]


def _begin(work: Callable, items: Sequence) -> None:
    """Begin a forked process, which a signal ends at once, as does the end of the first process."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    stages.listeners.clear()
    _inherited[:] = [(work, items)]


def _do(number: int) -> Any:
    work, items = _inherited[0]
    return work(items[number])


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
    os._exit(1)
