"""Draw the figures of a dataset."""

from __future__ import annotations

import re
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.errors import FigureError
from brownpipe.figures.cases import axis_of, cases_of, differs, has, one_count, own_names
from brownpipe.figures.catalogue import FIGURES, OWN, SCAN
from brownpipe.figures.style import drawing, image_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from types import ModuleType

    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset


class Drawing(NamedTuple):
    """One figure in all its forms."""

    name: str  # of its files
    images: Mapping[str, bytes]  # PNG and SVG
    table: DataFrame


def drawn(shown: Mapping[str, list[Dataset]], metadata: Mapping[str, str], name: str) -> Drawing:
    """Draw the figure of this name with these metadata; `shown` are the cases of each figure (`cases_shown`)."""
    with _module(name) as module:
        return drawing_of(name, module.draw(shown[name]), module.table(shown[name]), metadata)


def drawing_of(name: str, figure: Figure, table: DataFrame, metadata: Mapping[str, str]) -> Drawing:
    """Lay out a figure and make its pictures with these metadata; to be called within `style.drawing()`."""
    return Drawing(name, {suffix: image_bytes(figure, suffix, metadata) for suffix in ("png", "svg")}, table)


def draw(dataset: Dataset, name: str, particles: int | None = None) -> Figure:
    """Return one figure of a dataset, as `drawn` draws it; `particles` and errors as of `cases_shown`."""
    shown = cases_shown(dataset, particles, [name])
    with _module(name) as module:
        return module.draw(shown[name])


@contextmanager
def _module(name: str) -> Iterator[ModuleType]:
    """Yield the module of a figure in the style of all figures.

    Raise FigureError for a variable that the dataset lacks, in words of xarray: KeyError or AttributeError.
    """
    try:
        with drawing():
            yield import_module(f"brownpipe.figures.{name}")
    except (AttributeError, KeyError) as error:
        found = re.search(r"(?:'Dataset' object has no attribute|No variable named) '(\w+)'", str(error))
        if found is None:
            raise
        raise FigureError(f"{name}: cannot be drawn: the dataset has no variable {found[1]}") from error


def cases_shown(
    dataset: Dataset, particles: int | None = None, names: Sequence[str] | None = None
) -> dict[str, list[Dataset]]:
    """Return the cases that each figure shows: those with data for it, of one particle count or of all.

    `names` selects the figures; the default is every figure that the dataset has data for. Most figures show one
    particle count of each scene: `particles`, or by default its largest.

    Raise FigureError for a figure of `names` that the dataset has no data for, and for a particle count that it lacks.
    """
    cases = cases_of(dataset)
    counts = sorted({int(case.particles) for case in cases})
    if particles not in (None, *counts):
        raise FigureError(f"particles: {particles} is not in the dataset; choose one of {counts}")
    shown: dict[str, list[Dataset]] = {}
    for name in names or FIGURES:
        _, needs, variables, every_count = FIGURES[name]
        selected = [case for case in cases if has(case, *variables)]
        selected = selected if every_count else one_count(selected, particles)
        if OWN in needs:
            selected = [case for case in selected if own_names(case)]
        if SCAN in needs and not (selected and differs(selected, axis_of(selected))):
            selected = []
        if names and not selected:
            needed = "; ".join(needs) or "runs"
            raise FigureError(f"{name}: cannot be drawn from this dataset, whose study must have {needed}")
        shown |= {name: selected} if selected else {}
    return shown
