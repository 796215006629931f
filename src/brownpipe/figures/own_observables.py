"""Figure `own_observables`: the averages of the user's own observables, one panel for each
array.
"""

from collections.abc import Iterator
from functools import partial
from itertools import islice, product

from matplotlib import figure as matplotlib_figure
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe.figures.cases import (
    MOST_CURVES,
    SPECIES,
    axis_label,
    defined,
    frame_of,
    has,
    labels_in_words,
    own_names,
)
from brownpipe.figures.figure import Figure
from brownpipe.figures.looks import Looks, replaced
from brownpipe.figures.style import (
    MARKS,
    WIDTH,
    band,
    grid,
    points,
    put_titles_and_legends,
    styled_cases,
)
from brownpipe.observables.reserved_names import RESERVED_NAMES


def draw_own_observables(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw each array of all cases against its first dimension, at the coordinates of this, with
    its 95 % band; numbers as points.

    Of a case are shown at most MOST_CURVES, those at the first places along the other dimensions.
    """
    shown = {name: _all_parts(cases, name) for name in own_names(cases)}
    most_curves = max(map(len, shown.values()))
    figure, axes = grid(len(shown), 1, WIDTH, 2.3 + 0.19 * max(6, most_curves))
    for (name, parts), panel in zip(shown.items(), axes[:, 0], strict=True):
        along, *others = map(str, cases[0][name].dims or ("case",))
        dims = [dim for dim in others if dim not in SPECIES]  # species are told apart anyway
        place = partial(labels_in_words, names=dims)
        for k, (part, line) in enumerate(styled_cases(parts, place)):
            if cases[0][name].dims:
                band(panel, defined(part, name), name, **line)
            else:
                mark: Looks = {"linestyle": "none", "marker": MARKS[k % 36]["marker"]}
                points(panel, [k], [part], name, **replaced(line, mark))
                panel.set_xticks([])
        panel.set(xlabel=_dimension_label(cases[0], along), ylabel=axis_label(cases[0], name))
    arrays = [cases[0][name] for name in shown]
    put_titles_and_legends(
        axes[:, 0], [f"{array.observable}: {array.long_name}" for array in arrays]
    )
    return figure


def _all_parts(cases: list[Dataset], name: str) -> list[Dataset]:
    """Return the parts of all cases that have this array."""
    parts: list[Dataset] = []
    for case in cases:
        if has(case, name):
            # other cases may have other coordinates
            parts += [part for part in _parts(case, name) if has(part, name)]
    return parts


def _dimension_label(case: Dataset, dim: str) -> str:
    """Return the label of the axis of a dimension: the meaning and the unit of coordinates of the
    user's own, the name of any other dimension.
    """
    if dim in RESERVED_NAMES or dim not in case.coords:
        return dim
    coordinate = case[dim]
    unit = coordinate.units
    return coordinate.long_name if unit == "1" else f"{coordinate.long_name} [{unit}]"


def _parts(case: Dataset, name: str) -> Iterator[Dataset]:
    """Yield a case at the first places along all dimensions of an array but its first; they need no
    coordinates.
    """
    dims = case[name].dims[1:]
    numbered = case.assign_coords({dim: case[dim] for dim in dims})
    places = product(*(range(case.sizes[dim]) for dim in dims))
    for place in islice(places, MOST_CURVES):
        yield numbered.isel(dict(zip(dims, place, strict=True)))


def table_of_own_observables(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, array and point along its dimensions."""
    tables = []
    for name in own_names(cases):
        dims = [*map(str, cases[0][name].dims)]
        tables.append(frame_of(cases, dims, [name]))
    return concat(tables)


def _with_own_observables(cases: list[Dataset]) -> list[Dataset]:
    """Return the cases that have an array of an observable of the user's own."""
    return [case for case in cases if own_names([case])]


FIGURE = Figure(
    draw=draw_own_observables,
    every_count=True,
    selection=_with_own_observables,
    table=table_of_own_observables,
)
