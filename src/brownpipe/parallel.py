"""Independent pieces of work on several cores, each done by a process that is forked from this one, a worker.

A worker has everything that this process has imported and read. It only calculates, and sends its results back: this
process alone writes files and shows progress. SIGINT and SIGTERM end a worker at once, as does the end of this process,
of whatever kind. If a worker fails or is killed, this process itself does the work that is left, so that an error is
raised here, as on one core.
"""

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import NoReturn, TypeVar

from brownpipe import stages

Item = TypeVar("Item")
Result = TypeVar("Result")
Report = Callable[[int], object]  # to be called with the number of pieces of an item that are done
Work = Callable[[Item, Report], Result]

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGXCPU)  # which the command line handles


def limit_threads(cores: int) -> None:
    """Give each of several processes one thread for linear algebra; to be called before NumPy is imported.

    Snakemake gives every process as many threads as its job has cores.
    """
    if cores > 1:
        os.environ["OPENBLAS_NUM_THREADS"] = "1"


def calculated(work: Work[Item, Result], items: Sequence[Item], sizes: Sequence[int], unit: str, cores: int) -> list:
    """Return `work(item, report)` of each item, calculated on up to so many cores.

    sizes: the number of pieces of each item, such as its runs, by which progress is reported; `unit` is their name.
    Where processes cannot be forked (on macOS its own libraries may fail then), one core does the work.
    """
    done = [0] * len(items)
    results: dict[int, Result] = {}

    def report(number: int, pieces: int) -> None:
        if pieces != done[number]:
            done[number] = pieces
            stages.report(unit, sum(done), sum(sizes))

    workers = min(cores, len(items))
    if workers > 1 and sys.platform == "linux":
        results = _by_workers(work, items, sizes, workers, report)
    for number, item in enumerate(items):
        if number not in results:
            results[number] = work(item, partial(report, number))
            report(number, sizes[number])
    return [results[number] for number in range(len(items))]


def _by_workers(
    work: Work[Item, Result],
    items: Sequence[Item],
    sizes: Sequence[int],
    count: int,
    report: Callable[[int, int], object],
) -> dict[int, Result]:
    """Return the results of workers by the number of the item: all of them, unless a worker has failed."""
    results: dict[int, Result] = {}
    waiting = iter(range(len(items)))
    with _workers(count, work, items, sizes) as connections, suppress(EOFError, OSError):  # of a worker that has ended
        busy = [connection for connection in connections if _sent(connection, waiting)]
        while busy:
            ready = wait(busy)
            for connection in [one for one in busy if one in ready]:
                number, pieces, is_done, result = connection.recv()
                report(number, pieces)
                if is_done:
                    results[number] = result
                    if not _sent(connection, waiting):
                        busy.remove(connection)
    return results


def _sent(connection: Connection, waiting: Iterator[int]) -> bool:
    """Send the number of the next item that is waiting to a worker; return whether there was one."""
    for number in waiting:
        connection.send(number)
        return True
    return False


@contextmanager
def _workers(count: int, work: Work, items: Sequence, sizes: Sequence[int]) -> Iterator[list[Connection]]:
    """Have so many workers in this context, or as many as there is memory for; yield a connection to each."""
    context = multiprocessing.get_context("fork")
    processes, connections = [], []
    try:
        with _signals_held(), suppress(OSError):
            for _ in range(count):
                here, there = context.Pipe()
                connections.append(here)
                process = context.Process(target=_serve, args=(there, work, items, sizes), daemon=True)
                process.start()
                processes.append(process)
                there.close()
        yield connections[: len(processes)]
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.join()
        for connection in connections:
            connection.close()


@contextmanager
def _signals_held() -> Iterator[None]:
    """Hold signals back in this context, in which processes are forked; such a process has to let them through."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        with warnings.catch_warnings():  # since Python 3.12; the other threads only show progress and wait for signals
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def _serve(connection: Connection, work: Work, items: Sequence, sizes: Sequence[int]) -> NoReturn:
    """Calculate the items whose numbers arrive, in a forked process, until it is killed."""
    signal.set_wakeup_fd(-1)  # it is that of the first process
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    stages.listeners.clear()
    with suppress(Exception):  # the first process makes the same error
        while True:
            number = connection.recv()
            result = work(items[number], partial(_send, connection, number))
            _send(connection, number, sizes[number], True, result)
    os._exit(1)


def _send(connection: Connection, number: int, pieces: int, is_done: bool = False, result: object = None) -> None:
    connection.send((number, pieces, is_done, result))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
