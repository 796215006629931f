"""Arrays that were measured in every run, in /observables/run beside its numbers, with the values along their axes."""

import h5py
import numpy as np

from brownpipe.engines.state import Ensemble
from brownpipe.observables import ARRAYS, AXES, axes, observables_making
from brownpipe.scene import Scene
from brownpipe.storage.hdf5 import Node


def layout(group: str, scene: Scene, ensemble: Ensemble) -> dict[str, Node]:
    """The nodes of all arrays, and of their scales: one for each dimension."""
    measured = [name for name in ensemble.observables if name in ARRAYS]
    scales = {dim: values for name in measured for dim, values in axes(scene, name).items()}
    nodes = {f"{group}/{dim}": _scale(dim, values, ensemble) for dim, values in scales.items()}
    for name in measured:
        variable = ARRAYS[name]
        meaning = {"units": variable.units, "long_name": variable.long_name}
        nodes[f"{group}/{name}"] = Node(ensemble.observables[name], meaning, ("seed", *variable.dims))
    return nodes


def _scale(dim: str, values, ensemble: Ensemble) -> Node:
    values = np.array(values, h5py.string_dtype()) if isinstance(values, list) else values
    units, long_name = AXES[dim]
    return Node(ensemble.times if dim == "time" else values, {"units": units, "long_name": long_name}, (dim,))


def command_options(ensemble: Ensemble) -> str:
    """The words of a command that measures the same."""
    names = observables_making(ensemble.observables)
    average = f" --average {ensemble.average}" if ensemble.average != "runs" else ""
    return f" --observables {','.join(names)}{average}" if names else ""


def listing(ensemble: Ensemble) -> list[str]:
    """A line for each array: its shape and its meaning."""
    found = {name: value for name, value in ensemble.observables.items() if name in ARRAYS}
    over = f" (displacements and autocorrelations: average over {ensemble.average})"
    lines = ["arrays" + (over if ensemble.average != "runs" else "")] if found else []
    for name, value in found.items():
        sizes = zip(("seed", *ARRAYS[name].dims), value.shape, strict=True)
        shape = ", ".join(f"{dim} {size}" for dim, size in sizes)
        lines.append(f"  {name:<30} {ARRAYS[name].long_name} ({shape})")
    return lines
