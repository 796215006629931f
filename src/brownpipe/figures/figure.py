"""The record of a figure: what a dataset must have for it, and how its cases are drawn.

Each figure of a study is the constant `FIGURE` at the foot of the module of its name; its caption
is NAME.rst beside it, and what a study must have for it in `brownpipe.needs`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, Unpack

from brownpipe.errors import FigureError
from brownpipe.figures.cases import SPECIES, frame_of
from brownpipe.figures.looks import Looks

if TYPE_CHECKING:
    import numpy as np
    from matplotlib import figure as matplotlib_figure
    from matplotlib.axes import Axes
    from pandas import DataFrame
    from xarray import Dataset

MOST_ROWS = 2  # of panels with the same cases
ALL_CASES = sys.maxsize  # most cases of a figure that draws all


class DrawCurves(Protocol):
    """Draws all curves of a panel, one or more for each of its cases or of their components."""

    def __call__(self, axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None: ...


@dataclass(frozen=True)
class Columns:
    """The table of variables as they are: a row for each case and each point along dimensions."""

    dims: Sequence[str]
    variables: Sequence[str]

    def __call__(self, cases: list[Dataset]) -> DataFrame:
        return frame_of(cases, self.dims, self.variables)


def no_table(cases: list[Dataset]) -> DataFrame:
    """Return a table without rows and columns, of a figure that is not one of a study."""
    import pandas

    return pandas.DataFrame()


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of an analysis: one of your own for `bp.plot`, made like the built-in ones.

    curves: a function of axes and a list of cases that draws all curves of one panel into the
    axes, of each case one or more. A case is the part of the analysis with one scene, particle
    count and engine. Looks of lines that follow by name, such as color="red", are those that are
    to replace its own (`ax` of `plot`).
    draw: in place of curves, for other panels than one for each few cases: a function of a list of
    cases that returns a matplotlib figure.
    labels: of the vertical axis of the panels that `curves` draws; of those below them, too, if
    there are two.
    labels_of: a function of the list of cases that are drawn, which returns labels in their place,
    where they depend on what is drawn.
    variables: of the analysis; cases without a value of each of them are left out.
    below: draws the second row of panels: a function of all axes (2, panels) and the list of cases
    of each panel.
    table: of the figures of a study, a function of a list of cases that returns their numbers as a
    pandas table.
    component: `species` or `species_pair`: dimension of the first of the variables, along which
    each point has curves of its own.
    every_count: show all particle counts of a scene; otherwise the largest alone.
    selection: a function of a list of cases that returns those to be shown, for what `variables`
    cannot say.
    most_cases: of more cases so many are drawn, at equal steps.

    Raises FigureError for a combination that cannot be drawn.

    >>> def draw_msd(axes, cases, **looks):
    ...     for case in cases:
    ...         axes.plot(case.time, case.msd, **looks)
    >>> msd = bp.Figure(curves=draw_msd, labels=["MSD"], variables=["msd"])
    >>> bp.plot(result, msd).axes[0].get_ylabel()
    'MSD'
    """

    curves: DrawCurves | None = None
    draw: Callable[[list[Dataset]], matplotlib_figure.Figure] | None = None
    labels: Sequence[str] = ()
    labels_of: Callable[[list[Dataset]], Sequence[str]] | None = None
    variables: Sequence[str] = ()
    below: Callable[[np.ndarray, list[list[Dataset]]], None] | None = None
    table: Callable[[list[Dataset]], DataFrame] = no_table
    component: str = ""
    every_count: bool = False
    selection: Callable[[list[Dataset]], list[Dataset]] | None = None
    most_cases: int = 36

    def axis_labels(self, cases: list[Dataset]) -> Sequence[str]:
        """Return the labels of the vertical axes of panels with these cases."""
        return self.labels if self.labels_of is None else self.labels_of(cases)

    def __post_init__(self) -> None:
        for name in ("labels", "variables"):
            if isinstance(getattr(self, name), str):
                raise FigureError(f"{name}: must be a list of texts, not one")
        if (self.curves is None) == (self.draw is None):
            raise FigureError("curves: must be given, or draw in its place; not both")
        if self.curves is not None:
            if not 1 <= len(self.labels) <= MOST_ROWS:
                raise FigureError("labels: must be one or two, of the rows of panels")
            if (len(self.labels) > 1) != (self.below is not None):
                raise FigureError("below: must go with a second one of labels")
        if self.component and (self.component not in SPECIES or not self.variables):
            raise FigureError(f"component: must be {' or '.join(SPECIES)}, and go with variables")


def figure_named(name: str) -> Figure:
    """Return a figure by one of the names in `needs.FIGURES`."""
    figure: Figure = import_module(f"brownpipe.figures.{name}").FIGURE
    return figure
