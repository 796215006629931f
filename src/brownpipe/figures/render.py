"""Draw the figures of a dataset."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from brownpipe.errors import FigureError
from brownpipe.figures.cases import cases_shown, frame_of, panels_of, parts_of, title_of
from brownpipe.figures.catalogue import FIGURES, SCAN
from brownpipe.figures.style import columns, drawing, heads, image_bytes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset


HEIGHTS = (4.4, 3.2)  # of the panels of a column [inch]
MOST_CASES = 36  # in a figure, except that of a scan


class Drawing(NamedTuple):
    """One figure in all its forms."""

    name: str  # of its files
    images: Mapping[str, bytes]  # PNG and SVG
    table: DataFrame


def drawn(
    shown: Mapping[str, list[Dataset]], metadata: Mapping[str, str], panel: Sequence[str], name: str
) -> Drawing:
    """Draw the figure of this name with these metadata.

    shown: the cases of each figure (`cases_shown`). panel: labels, as in `cases.panels_of`.
    """
    module = import_module(f"brownpipe.figures.{name}")
    cases = shown[name]
    with drawing():
        table = module.table(cases) if hasattr(module, "table") else frame_of(cases, *module.TABLE)
        return drawing_of(name, _figure(name, cases, panel), table, metadata)


def _figure(name: str, cases: list[Dataset], panel: Sequence[str]) -> Figure:
    """Draw the cases, MOST_CASES of them at equal steps if there are more and the figure is not
    that of a scan.

    With `curves` several cases share a panel, where each of them, or each of its parts, is a curve.
    A figure that shows every particle count has one panel. Further rows of panels are drawn by
    `below`.
    """
    module = import_module(f"brownpipe.figures.{name}")
    entry = FIGURES[name]
    most = len(cases) if SCAN in entry.needs else min(MOST_CASES, len(cases))
    shown = [cases[step] for step in np.linspace(0, len(cases) - 1, most, dtype=int)]
    if hasattr(module, "curves"):
        if entry.every_count:
            groups = [shown]
        else:
            groups = panels_of(shown, panel, entry.part, entry.variables[0])
        rows = len(module.LABELS)
        figure, axes = columns(module.LABELS, len(groups), HEIGHTS[:rows], sharey=rows > 1)
        for upper, group in zip(axes[0], groups, strict=True):
            module.curves(upper, group)
        if rows > 1:
            module.below(axes, groups)
        heads(axes[0], [title_of(*group) for group in groups])
    else:
        figure = module.draw(shown)
    if len(shown) < len(cases):
        figure.suptitle(
            f"{MOST_CASES} of {len(cases)} cases, at equal steps; the table has all",
            x=0.01,
            ha="left",
        )
    return figure


def drawing_of(name: str, figure: Figure, table: DataFrame, metadata: Mapping[str, str]) -> Drawing:
    """Lay out a figure and make its pictures with these metadata; to be called within
    `style.drawing()`.
    """
    images = {suffix: image_bytes(figure, suffix, metadata) for suffix in ("png", "svg")}
    return Drawing(name, images, table)


def draw(
    dataset: Dataset, name: str, particles: int | None = None, panel: Sequence[str] = ()
) -> Figure:
    """Return one figure of a dataset, as `drawn` draws it; `particles` and errors as in
    `cases_shown`.
    """
    cases = cases_shown(dataset, particles, [name])[name]
    with drawing():
        return _figure(name, cases, panel)


def draw_into(
    axes: Axes, dataset: Dataset, name: str, particles: int | None = None, **looks: Any
) -> Axes:
    """Draw all curves of a figure into axes, whose style is the caller's; return the axes.

    looks: of its lines, as for `axes.plot`, such as color and label. Raises FigureError for a
    figure of several panels.
    """
    module = import_module(f"brownpipe.figures.{name}")
    entry = FIGURES[name]
    if not hasattr(module, "curves"):
        raise FigureError(f"ax: must not be given for {name}, which has several panels")
    cases = cases_shown(dataset, particles, [name])[name]
    parts: list[Dataset] = []
    for case in cases:
        parts += parts_of(case, entry.part, entry.variables[0])
    module.curves(axes, parts, **looks)
    axes.set_ylabel(axes.get_ylabel() or module.LABELS[0])
    return axes
