"""Signals, and independent pieces of work on several cores.

Ctrl-C and SIGTERM raise exceptions, except while kernels are compiled. Another program that is run
here, such as Snakemake, ends with one line, too, if it is interrupted. Work on several cores is
done in processes that are forked from this one and inherit its data. They only calculate: this
process alone writes files and shows progress.
"""

import multiprocessing
import os
import runpy
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any, NoReturn, TypeVar

from brownpipe import progress
from brownpipe.errors import RunError

SIGNALS = (signal.SIGINT, signal.SIGTERM)
SEND_AGAIN = 0.01  # s after a signal that was ignored
Item = TypeVar("Item")
Result = TypeVar("Result")
_inherited: list[tuple[Callable, Sequence]] = []  # in a forked process: the work and its items


class Terminated(SystemExit):
    """SIGTERM has arrived."""


def terminate(*_: object) -> NoReturn:
    """Raise Terminated, as Ctrl-C raises KeyboardInterrupt."""
    raise Terminated(128 + signal.SIGTERM)


def send_again(ignored: "sys.UnraisableHookArgs") -> None:
    """In place of `sys.unraisablehook`: send a signal once more that arrived while an object was
    destroyed.

    Python ignores any exception there, and would go on after the words "Exception ignored in".
    """
    numbers = {KeyboardInterrupt: signal.SIGINT, Terminated: signal.SIGTERM}
    number = numbers.get(ignored.exc_type)
    if number is None:
        sys.__unraisablehook__(ignored)
        return
    later = threading.Timer(SEND_AGAIN, os.kill, (os.getpid(), number))
    later.daemon = True
    later.start()


@contextmanager
def held() -> Iterator[None]:
    """Defer signals that arrive in this context to its end; in a thread other than the main one
    nothing changes.
    """
    arrived: list[int] = []
    try:
        with handled(dict.fromkeys(SIGNALS, lambda number, _: arrived.append(number))):
            yield
    finally:
        for number in arrived[:1]:
            signal.raise_signal(number)


@contextmanager
def handled(handlers: dict) -> Iterator[None]:
    """Handle signals by these handlers in this context; in a thread other than the main one nothing
    changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_program(module: str, name: str) -> None:
    """Run the module of another program, as `python -m` does; in its messages it has this name.

    An interruption that the program does not handle, such as one while it starts, is one line, as
    that of brownpipe.
    """
    sys.argv[0] = name
    try:
        runpy.run_module(module, run_name="__main__")
    except KeyboardInterrupt:
        progress.Display().say("brownpipe: interrupted")
        sys.exit(128 + signal.SIGINT)


# -- several cores ---------------------------------------------------------------------------------


def calculated(
    work: Callable[[Item], Result], items: Sequence[Item], unit: str, cores: int
) -> list[Result]:
    """Return `work(item)` for each item, done on up to `cores` cores; `unit` names the items in
    progress messages.

    Where processes cannot be forked (on macOS its own libraries may fail then), one core does the
    work. Raises the first error of the work, in the order of the items, and RunError if one of the
    processes was killed.
    """
    cores = min(cores, len(items))
    if cores < 2 or sys.platform != "linux":
        return [work(item) for item in progress.tracked(items, unit)]
    fork = multiprocessing.get_context("fork")
    others = {*fork.active_children()}
    pool = ProcessPoolExecutor(cores, fork, _begin, (work, items))
    results = list[Result]()
    try:
        for result in pool.map(_do, range(len(items))):
            results.append(result)
            progress.report(unit, len(results), len(items))
    except BrokenProcessPool:
        raise RunError(
            f"one of {cores} processes was killed, most likely out of memory; try fewer cores"
        ) from None
    finally:
        for process in {*multiprocessing.active_children()} - others:
            process.kill()
        pool.shutdown(cancel_futures=True)
    return results


def _begin(work: Callable, items: Sequence) -> None:
    """Set up a forked process: it ends at once on a signal, and when its parent process ends."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    progress.listeners.clear()
    _inherited[:] = [(work, items)]


def _do(number: int) -> Any:
    work, items = _inherited[0]
    return work(items[number])


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
