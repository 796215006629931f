"""Figure `own_observables`: the averages of the user's own observables, one panel for each array."""

from collections.abc import Iterator
from functools import partial
from itertools import islice, product

import pandas
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.cases import MOST_CURVES, SPECIES, axis_label, defined, frame_of, has, in_words, own_names
from brownpipe.figures.style import WIDTH, band, grid, heads, points, told_apart


def draw(cases: list[Dataset]) -> Figure:
    """Draw each array of all cases against its first dimension, with its 95 % band; numbers as points.

    Of a case are shown at most MOST_CURVES, those for the first entries of the other dimensions.
    """
    names = own_names(cases)
    figure, axes = grid(len(names), 1, WIDTH, 3.4)
    for name, panel in zip(names, axes[:, 0], strict=True):
        along, *others = map(str, cases[0][name].dims or ("case",))
        place = partial(in_words, names=[dim for dim in others if dim not in SPECIES])  # species are told apart anyway
        parts = [part for case in cases if has(case, name) for part in islice(_parts(case, others), MOST_CURVES)]
        for k, (part, line) in enumerate(told_apart(parts, place, {})):
            if cases[0][name].dims:
                band(panel, defined(part, name), name, **line)
            else:
                points(panel, [k], [part], name, **line | {"linestyle": "none", "marker": "o"})
                panel.set_xticks([])
        panel.set(xlabel=along, ylabel=axis_label(cases[0], name))
    heads(axes[:, 0], [f"{cases[0][name].observable}: {cases[0][name].long_name}" for name in names])
    return figure


def _parts(case: Dataset, dims: list[str]) -> Iterator[Dataset]:
    """Yield a case at each place along these dimensions, which need no coordinates."""
    numbered = case.assign_coords({dim: case[dim] for dim in dims})
    for place in product(*(range(case.sizes[dim]) for dim in dims)):
        yield numbered.isel(dict(zip(dims, place, strict=True)))


def table(cases: list[Dataset]) -> pandas.DataFrame:
    """Return one row per case, array and point along its dimensions."""
    return pandas.concat([frame_of(cases, [*map(str, cases[0][name].dims)], [name]) for name in own_names(cases)])
