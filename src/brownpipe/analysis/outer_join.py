"""Results of single cases, joined into one labelled dataset over the union of their axes."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.variables import SAME_TIME, Variable

if TYPE_CHECKING:
    import xarray

Axes = dict[str, tuple[str, Sequence | np.ndarray]]  # coordinate -> (dimension, values)


class Part(NamedTuple):
    """The results of one case."""

    values: dict[str, ArrayLike]  # variable -> array whose size is that of its dimensions
    axes: Axes  # every dimension is a coordinate


def joined(
    parts: Sequence[Part],
    variables: Mapping[str, Variable],
    coordinates: Mapping[str, dict],
    attributes: dict,
    kept: Collection[str],
) -> "xarray.Dataset":
    """Return the outer join of `parts`; where a part has no value, a variable has its value `absent`.

    `coordinates` has the attributes of every coordinate; a dimension that is not in it gets none. Labels, and numbers
    along the dimensions `kept`, come in order of appearance; other numbers ascend. Numbers that differ by less than
    SAME_TIME count as equal. `xarray.concat` and `unstack` give the same values, but sort all labels and hold every
    array twice.
    """
    import xarray

    axes = _joined_axes([part.axes for part in parts], kept)
    size = {name: len(values) for name, (dim, values) in axes.items() if name == dim}
    data = {}
    for name, variable in variables.items():
        holders = [part for part in parts if name in part.values]
        if holders or variable.always:
            full: np.ndarray = np.full([size[dim] for dim in variable.dims], variable.absent, variable.dtype)
            for part in holders:
                places = [_positions(part.axes[dim][1], axes[dim][1]) for dim in variable.dims]
                full[np.ix_(*places)] = np.reshape(part.values[name], [len(rows) for rows in places])
            data[name] = (variable.dims, full, variable.attributes)
    used = {dim for dims, _, _ in data.values() for dim in dims} & coordinates.keys()
    along = {name: (dim, values, coordinates[name]) for name, (dim, values) in axes.items() if dim in used}
    return xarray.Dataset(data, along, attributes)


def _joined_axes(axes: Sequence[Axes], kept: Collection[str]) -> Axes:
    """Every coordinate over the union of the parts' axes: name -> (dimension, values)."""
    dimensions = {name: dim for own in axes for name, (dim, _) in own.items()}
    along: Axes = {
        name: (dim, _union([own[name][1] for own in axes if name in own], name in kept))
        for name, dim in dimensions.items()
        if name == dim
    }
    for name, dim in dimensions.items():
        if name != dim:
            values = np.full(len(along[dim][1]), np.nan)
            for own in (own for own in axes if name in own):
                values[_positions(own[dim][1], along[dim][1])] = own[name][1]
            along[name] = (dim, values)
    return along


def _union(parts: Sequence[Sequence | np.ndarray], in_order: bool) -> Sequence | np.ndarray:
    """All labels in order of appearance, or all numbers ascending unless `in_order`, each once."""
    if in_order or isinstance(parts[0][0], str):
        return list(dict.fromkeys(label for part in parts for label in part))
    axis = np.unique(np.concatenate(parts))
    return axis if axis.dtype.kind in "iu" else axis[np.append(True, np.diff(axis) > SAME_TIME * np.abs(axis[1:]))]


def _positions(values: Sequence | np.ndarray, axis: Sequence | np.ndarray) -> np.ndarray:
    """Indices of a part's values in the union."""
    if isinstance(axis, list):
        return np.array([axis.index(label) for label in values])
    values = np.asarray(values)
    return np.searchsorted(axis, values - SAME_TIME * np.abs(values) if values.dtype.kind == "f" else values)
