"""What a long calculation is doing and how much of it is done: reported here, shown on the screen by `progress`.

A stage is a number of pieces of work that take about the same time each, such as the runs of a batch or the frames of a
movie. It is reported by its unit, a noun in the plural, the pieces that are done, with the fraction of an unfinished
one if it is known, and all of them.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

listeners: list[Callable[[str, float, int], object]] = []  # called with unit, done and total of a stage
remark_listeners: list[Callable[[str], object]] = []  # called with every remark
_tracked: list[tuple[str, int, int]] = []  # stages that `tracked` has begun, outermost first
_piece: list[tuple[str, int, int]] = []  # the stage whose next piece has begun


def report(unit: str, done: float, total: int) -> None:
    """Tell the listeners how much is done of a stage; within `tracked` it is not shown."""
    if not _tracked:
        _tell(unit, done, total)


def begin_piece(unit: str, done: int, total: int) -> None:
    """Begin the next piece of a stage, after `done` others; `within` reports how much of it is done."""
    _piece[:] = [(unit, done, total)]


def within(fraction: float) -> None:
    """Report the fraction that is done, from 0 to 1, of the piece begun last."""
    for unit, done, total in _piece:
        report(unit, done + fraction, total)


def tracked(items: Collection[Item], unit: str) -> Iterator[Item]:
    """Yield the items, and report after each how many are done; within an item, another `tracked` its fraction."""
    for done, item in enumerate(items):
        _tracked.append((unit, done, len(items)))
        try:
            yield item
        finally:
            _tracked.pop()
        _tell(unit, done + 1, len(items))


def _tell(unit: str, done: float, total: int) -> None:
    """Tell the listeners the outermost stage; each of the others is a piece of the one before."""
    for outer, before, count in reversed(_tracked):
        unit, done, total = outer, before + done / total, count
    for listener in listeners:
        listener(unit, done, total)


def remark(text: str) -> None:
    """Tell the listeners a sentence for the user, such as that kernels are compiled."""
    for listener in remark_listeners:
        listener(text)


@contextmanager
def unreported() -> Iterator[None]:
    """Report no stage in this context, so that CPU times measured in it are of the calculation alone."""
    before, listeners[:] = listeners[:], []
    try:
        yield
    finally:
        listeners[:] = before
