"""Arrays that observables yield in every run: their place in /observables/run, with coordinates along their axes."""

import h5py
import numpy as np

from brownpipe.engines.state import Ensemble
from brownpipe.observables import ARRAYS, AXES, axes
from brownpipe.scene import Scene
from brownpipe.storage.hdf5 import Node


def layout(group: str, scene: Scene, ensemble: Ensemble) -> dict[str, Node]:
    """Return the nodes of all arrays (S, ...) of an ensemble and of their scales, one for each dimension."""
    names = [name for name in ensemble.observables if name in ARRAYS]
    scales = {dim: values for name in names for dim, values in axes(scene, name).items()}
    nodes = {f"{group}/{dim}": _scale(dim, values, ensemble) for dim, values in scales.items()}
    for name in names:
        array = ARRAYS[name]
        attributes = {"units": array.units, "long_name": array.long_name}
        nodes[f"{group}/{name}"] = Node(ensemble.observables[name], attributes, ("seed", *array.dims))
    return nodes


def _scale(dim: str, values: np.ndarray | list[str], ensemble: Ensemble) -> Node:
    """Return the scale of a dimension; the times are those of the ensemble."""
    values = np.array(values, h5py.string_dtype()) if isinstance(values, list) else values
    attributes = {"units": AXES[dim].units, "long_name": AXES[dim].long_name}
    return Node(ensemble.times if dim == "time" else values, attributes, (dim,))
