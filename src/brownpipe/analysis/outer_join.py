"""Results of single cases, joined into one labelled dataset over the union of their axes."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from brownpipe.analysis.variables import SAME_TIME, Variable

if TYPE_CHECKING:
    import xarray

Part = dict[str, Any]  # results of one case: variable or coordinate -> array whose size is that of its dimensions


def joined(
    parts: Sequence[Part],
    variables: Mapping[str, Variable],
    coordinates: Mapping[str, Variable],
    attributes: dict,
    always: Collection[str] = (),
) -> "xarray.Dataset":
    """Return the outer join of `parts`; where a part has no value, a variable has its value `absent`.

    A variable is there if a part has it, or if it is one of `always`. Labels and particle counts come in order of
    appearance; other numbers ascend. Numbers that differ by less than SAME_TIME count as equal.
    `xarray.concat` and `unstack` give the same values, but sort all labels and hold every array twice.
    """
    import xarray

    held = {name: one for name, one in variables.items() if name in always or any(name in part for part in parts)}
    dims = {dim for one in held.values() for dim in one.dims}
    held |= {name: one for name, one in coordinates.items() if dims.issuperset(one.dims)}
    axes = {dim: _union([part[dim] for part in parts if dim in part], dim == "particles") for dim in dims}
    data = {}
    for name, variable in held.items():
        full: np.ndarray = np.full([len(axes[dim]) for dim in variable.dims], variable.absent, variable.dtype)
        for part in (part for part in parts if name in part and name not in axes):
            places = [_positions(part[dim], axes[dim]) for dim in variable.dims]
            full[np.ix_(*places)] = np.reshape(part[name], [len(rows) for rows in places])
        data[name] = (variable.dims, axes.get(name, full), variable.attributes)
    return xarray.Dataset(data, attrs=attributes).set_coords([name for name in coordinates if name in data])


def _union(parts: Sequence[Any], in_order: bool) -> list | np.ndarray:
    """All labels in order of appearance, or all numbers ascending unless `in_order`, each once."""
    axis = np.concatenate(parts)
    if in_order or axis.dtype.kind == "U":
        return list(dict.fromkeys(axis.tolist()))
    axis = np.unique(axis)
    return axis if axis.dtype.kind in "iu" else axis[np.append(True, np.diff(axis) > SAME_TIME * np.abs(axis[1:]))]


def _positions(values: Any, axis: list | np.ndarray) -> np.ndarray:
    """Indices of a part's values in the union."""
    if isinstance(axis, list):
        return np.array([axis.index(label) for label in values])
    values = np.asarray(values)
    return np.searchsorted(axis, values - SAME_TIME * np.abs(values) if values.dtype.kind == "f" else values)
