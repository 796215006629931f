"""Figure `own_observables`: the averages of the user's own observables, one panel for each array."""

from itertools import product

import pandas
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.cases import has, own_names, title_of
from brownpipe.figures.style import band, grid, heads, points, shades
from brownpipe.figures.tables import frame_of

MOST_CURVES = 6  # of a case in a panel: those at the first places of the other dimensions


def draw(cases: list[Dataset]) -> Figure:
    """Draw each array of all cases against its first dimension, with its 95 % band; numbers as points."""
    names = _names(cases)
    figure, axes = grid(len(names), 1, 6.2, 3.4)
    for name, panel in zip(names, axes[:, 0], strict=True):
        of_name = [case for case in cases if has(case, name)]
        first, *others = cases[0][name].dims or (None,)
        sizes = [range(cases[0].sizes[dim]) for dim in others]
        curves = [(case, place) for case in of_name for place in [*product(*sizes)][:MOST_CURVES]]
        for (case, place), colour in zip(curves, shades(len(curves)), strict=True):
            part = case.isel(dict(zip(others, place, strict=True)))
            places = zip(others, place, strict=True)
            at = [f"{dim} {part[dim].item() if dim in part.coords else k}" for dim, k in places]
            label = ", ".join([title_of(case), *at])
            if first is None:
                looks = {"color": colour, "marker": "o", "linestyle": "", "label": label}
                points(panel, [len(panel.containers)], [part], name, **looks)
            else:
                band(panel, part.dropna(first, subset=[name]), name, colour, label=label)
        if first is None:
            panel.set_xticks([])
        panel.set(xlabel=first or "case", ylabel=f"{name} [{cases[0][name].units}]")
    heads(axes[:, 0], (f"{cases[0][name].observable}: {cases[0][name].long_name}" for name in names))
    return figure


def table(cases: list[Dataset]) -> pandas.DataFrame:
    """Return one row per case, array and point along its dimensions."""
    return pandas.concat([frame_of(cases, [*map(str, cases[0][name].dims)], [name]) for name in _names(cases)])


def _names(cases: list[Dataset]) -> list[str]:
    return [*dict.fromkeys(name for case in cases for name in own_names(case))]
