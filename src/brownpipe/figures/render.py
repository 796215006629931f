"""Draw the figures of a dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Unpack

from brownpipe.errors import FigureError
from brownpipe.figures.cases import (
    at_equal_steps,
    cases_of,
    defined,
    has,
    one_count,
    panels_of,
    parts_of,
    title_of,
)
from brownpipe.figures.figure import DrawCurves, Figure, figure_named
from brownpipe.figures.style import (
    drawing,
    drawing_for_user,
    image_bytes,
    put_titles_and_legends,
    say_shown,
    stacked_panels,
)
from brownpipe.needs import FIGURES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib import figure as matplotlib_figure
    from matplotlib.axes import Axes
    from pandas import DataFrame
    from xarray import Dataset

    from brownpipe.figures.looks import Looks

HEIGHTS = (4.4, 3.2)  # of the panels of a column [inch]


class Drawing(NamedTuple):
    """One figure in all its forms."""

    name: str  # of its files
    images: Mapping[str, bytes]  # PNG and SVG
    table: DataFrame


# -- cases -----------------------------------------------------------------------------------------


def cases_shown(
    dataset: Dataset, particles: int | None = None, names: Sequence[str] | None = None
) -> dict[str, list[Dataset]]:
    """Return the cases that each figure shows: those with data for it, of one particle count or of
    all.

    `names` selects the figures; the default is every figure that the dataset has data for. Most
    figures show one particle count of each scene: `particles`, or by default its largest.

    Raise FigureError for a figure of `names` that the dataset has no data for, and for a particle
    count that it lacks.
    """
    cases = _cases_with_count(dataset, particles)
    shown: dict[str, list[Dataset]] = {}
    for name in names or FIGURES:
        selected = _selected(cases, figure_named(name), particles)
        if selected:
            shown[name] = selected
        elif names:
            needed = "; ".join(need.text for need in FIGURES[name]) or "runs"
            raise FigureError(
                f"{name}: cannot be drawn from this dataset, whose study must have {needed}"
            )
    return shown


def cases_of_figure(
    dataset: Dataset, figure: str | Figure, particles: int | None = None
) -> list[Dataset]:
    """Return the cases that one figure shows, by its name or one of the user's own; raise as
    `cases_shown` does.
    """
    if isinstance(figure, str):
        return cases_shown(dataset, particles, [figure])[figure]
    missing = [name for name in figure.variables if name not in dataset.variables]
    if missing:
        raise FigureError(f"figure: needs {', '.join(missing)}, which this dataset does not have")
    selected = _selected(_cases_with_count(dataset, particles), figure, particles)
    if not selected:
        needed = ", ".join(figure.variables) or "its selection"
        raise FigureError(f"figure: no case of this dataset has a value of {needed}")
    return selected


def _cases_with_count(dataset: Dataset, particles: int | None) -> list[Dataset]:
    """Return all cases; raise FigureError if none has this particle count."""
    cases = cases_of(dataset)
    counts = sorted({int(case.particles) for case in cases})
    if particles not in (None, *counts):
        raise FigureError(f"particles: {particles} is not in the dataset; choose one of {counts}")
    return cases


def _selected(cases: list[Dataset], figure: Figure, particles: int | None) -> list[Dataset]:
    """Return the cases that a figure shows, none if it needs what they do not have."""
    selected = [case for case in cases if has(case, *figure.variables)]
    if figure.variables:
        selected = [defined(case, figure.variables[0]) for case in selected]
    if not figure.every_count:
        selected = one_count(selected, particles)
    if selected and figure.selection is not None:
        selected = figure.selection(selected)
    return selected


# -- pictures --------------------------------------------------------------------------------------


def drawn(
    shown: Mapping[str, list[Dataset]], metadata: Mapping[str, str], panel: Sequence[str], name: str
) -> Drawing:
    """Draw the figure of this name with these metadata.

    shown: the cases of each figure (`cases_shown`). panel: labels, as in `cases.panels_of`.
    """
    figure = figure_named(name)
    cases = shown[name]
    with drawing():
        picture = _picture(figure, cases, panel)
        return drawing_of(name, picture, figure.table(cases), metadata)


def _picture(
    figure: Figure, cases: list[Dataset], panel: Sequence[str]
) -> matplotlib_figure.Figure:
    """Draw the cases, or so many of them as the figure shows at most, at equal steps."""
    shown = at_equal_steps(cases, figure.most_cases)
    if figure.curves is not None:
        picture = _panels_of_curves(figure, figure.curves, shown, panel)
    elif figure.draw is not None:
        picture = figure.draw(shown)
    if len(shown) < len(cases):
        say_shown(picture, len(shown), len(cases))
    return picture


def _panels_of_curves(
    figure: Figure, draw_curves: DrawCurves, cases: list[Dataset], panel: Sequence[str]
) -> matplotlib_figure.Figure:
    """Draw the curves of the cases of a figure, several of which share a panel.

    A figure that shows every particle count has one panel. Further rows of panels are drawn by
    `below`.
    """
    if figure.every_count:
        groups = [cases]
    else:
        variable = figure.variables[0] if figure.variables else ""
        groups = panels_of(cases, panel, figure.component, variable)
    rows = len(figure.labels)
    labels = figure.axis_labels(cases)
    picture, axes = stacked_panels(labels, len(groups), HEIGHTS[:rows], sharey=rows > 1)
    for upper, group in zip(axes[0], groups, strict=True):
        draw_curves(upper, group)
    if figure.below is not None:
        figure.below(axes, groups)
    put_titles_and_legends(axes[0], [title_of(*group) for group in groups])
    return picture


def drawing_of(
    name: str, picture: matplotlib_figure.Figure, table: DataFrame, metadata: Mapping[str, str]
) -> Drawing:
    """Lay out a figure and make its pictures with these metadata; to be called within
    `style.drawing()`.
    """
    images = {suffix: image_bytes(picture, suffix, metadata) for suffix in ("png", "svg")}
    return Drawing(name, images, table)


def draw(
    dataset: Dataset,
    figure: str | Figure,
    particles: int | None = None,
    panel: Sequence[str] = (),
) -> matplotlib_figure.Figure:
    """Return one figure of a dataset, as `drawn` draws it but with the settings of the user;
    `particles` and errors as in `cases_shown`.
    """
    cases = cases_of_figure(dataset, figure, particles)
    record = figure_named(figure) if isinstance(figure, str) else figure
    with drawing_for_user():
        return _picture(record, cases, panel)


def draw_into(
    axes: Axes,
    dataset: Dataset,
    figure: str | Figure,
    particles: int | None = None,
    **looks: Unpack[Looks],
) -> Axes:
    """Draw all curves of a figure into axes, whose style is the caller's; return the axes.

    looks: of its lines, as for `axes.plot`, such as color and label. Raises FigureError for a
    figure of several panels.
    """
    record = figure_named(figure) if isinstance(figure, str) else figure
    if record.curves is None:
        name = figure if isinstance(figure, str) else "a figure with draw"
        raise FigureError(f"ax: must not be given for {name}, which has several panels")
    parts: list[Dataset] = []
    for case in cases_of_figure(dataset, figure, particles):
        if record.component:
            parts += parts_of(case, record.component, record.variables[0])
        else:
            parts.append(case)
    record.curves(axes, parts, **looks)
    axes.set_ylabel(axes.get_ylabel() or record.axis_labels(parts)[0])
    return axes
