"""What a long calculation is doing and how much of it is done: reported here, shown on the screen by `progress`.

A stage is a number of pieces of work that take about the same time each, such as the runs of a batch or the frames of a
movie. It is reported by its unit, a noun in the plural, the pieces that are done, and all of them.
"""

from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import NamedTuple, TypeVar

Item = TypeVar("Item")


class Stage(NamedTuple):
    """A stage of a calculation and how much of it is done."""

    unit: str  # of its pieces, in the plural: runs, frames
    done: float  # pieces, with the fraction of an unfinished one if it is known
    total: float


listeners: list[Callable[[Stage], object]] = []  # called with every stage that is reported
remark_listeners: list[Callable[[str], object]] = []  # called with every remark
_enclosing: list[Stage | str | None] = []  # what `tracked`, `counted_as` and `unreported` have begun, outermost first
_piece: list[Stage] = []  # the stage that `within` refines


def report(unit: str, done: float, total: float) -> None:
    """Tell the listeners how much is done of a stage; within `tracked`, how much is done of what it tracks."""
    if listeners and None not in _enclosing:
        names = [entry for entry in _enclosing if isinstance(entry, str)]
        _tell(_tracking() or [Stage(names[0] if names else unit, done, total)])


def _tracking() -> list[Stage]:
    """Return the stages of the enclosing `tracked`, outermost first."""
    return [entry for entry in _enclosing if isinstance(entry, Stage)]


def _tell(nested: list[Stage]) -> None:
    """Tell the listeners the outermost of nested stages; each of the others is a piece of the one before."""
    stage, *inner = nested
    if inner:
        fraction = 0.0
        for part in reversed(inner):
            fraction = (part.done + fraction) / part.total
        stage = stage._replace(done=stage.done + fraction)
    for listener in listeners:
        listener(stage)


def remark(text: str) -> None:
    """Tell the listeners a sentence for the user, such as that kernels are compiled."""
    for listener in remark_listeners:
        listener(text)


def begin_piece(unit: str, done: int, total: int) -> None:
    """Begin the next piece of a stage, after `done` others; `within` reports how much of it is done."""
    _piece[:] = [Stage(unit, done, total)]


def within(fraction: float) -> None:
    """Report the fraction that is done, from 0 to 1, of the piece begun last."""
    for unit, done, total in _piece:
        report(unit, done + fraction, total)


def tracked(items: Collection[Item], unit: str) -> Iterator[Item]:
    """Yield the items, and report after each how many are done.

    Within an item, another `tracked` reports the fraction of the item that is done; other stages are not shown.
    """
    for done, item in enumerate(items):
        with _inside(Stage(unit, done, len(items))):
            yield item
        _tell([*_tracking(), Stage(unit, done + 1, len(items))])


def counted_as(unit: str) -> AbstractContextManager[None]:
    """Return a context in which stages are reported under this unit."""
    return _inside(unit)


def unreported() -> AbstractContextManager[None]:
    """Return a context in which nothing is reported, so that CPU times measured in it are of the calculation alone."""
    return _inside(None)


@contextmanager
def _inside(entry: Stage | str | None) -> Iterator[None]:
    _enclosing.append(entry)
    try:
        yield
    finally:
        _enclosing.pop()
