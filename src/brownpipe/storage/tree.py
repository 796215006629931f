"""Runs in memory as `xarray.DataTree`: the groups, names and attributes of a trajectory file, drawn in `storage`."""

import json
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.engines.ensemble import Track
from brownpipe.errors import RequestError, StorageError
from brownpipe.scene import Scene
from brownpipe.storage.layout import LOG, described, dims_of, ensemble_of, groups_of
from brownpipe.storage.trajectories import Trajectories, setting_of

if TYPE_CHECKING:
    from xarray import Dataset, DataTree


def to_tree(trajectories: Trajectories) -> "DataTree":
    """Return runs as a tree, which shares arrays with them as far as `groups_of` does."""
    import xarray

    scene, _, ensemble, *_ = trajectories
    nodes = {
        path: xarray.Dataset({name: (dims_of(path, name), values, described(name)) for name, values in group.items()})
        for path, group in groups_of(scene, ensemble).items()
    }
    nodes["/"].attrs = trajectories.attributes
    return xarray.DataTree.from_dict(nodes, name=scene.name)


def from_tree(tree: "DataTree") -> Trajectories:
    """Return the runs of a tree that `to_tree` made, or of a selection of its seeds.

    Variables that others have added are left out. Raises RequestError for any other tree.
    """
    import xarray

    if not isinstance(tree, xarray.DataTree):
        raise RequestError(f"runs: must be what simulate or open returns, not a {type(tree).__name__}")
    try:
        scene, engine = setting_of(tree.attrs)
        disks = tree["disks"].to_dataset() if "disks" in tree.children else xarray.Dataset()
        _refuse_part(scene, tree.to_dataset(), disks)
        groups = {
            path: {
                name: tree[path][name].transpose(*dims_of(path, name)).values
                for name in tree[path].variables
                if name in names
            }
            for path, names in _own_names(tree).items()
            if path in tree.groups
        }
        ensemble = ensemble_of(scene, groups, tree.attrs["average"])
        return Trajectories(scene, engine, ensemble, tree.attrs["source_digest"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, RequestError, StorageError) as error:
        raise RequestError(
            f"runs: must be what simulate or open returns, or a selection of its seeds ({error})"
        ) from error


def refuse_foreign(tree: "DataTree") -> None:
    """Raise RequestError for a variable that a trajectory file has no place for."""
    own = _own_names(tree)
    foreign = [
        f"{node.path}/{name}".lstrip("/")
        for node in tree.subtree
        for name in node.data_vars
        if name not in own.get(node.path, ())
    ]
    if foreign:
        raise RequestError(
            f"data: a trajectory file has no place for {foreign[0]}; remove this variable, or save it apart"
        )


def _own_names(tree: "DataTree") -> dict[str, set[str]]:
    """Return the names that runs have in each group."""
    return {
        "/": {*json.loads(tree.attrs["variables"]), *Track._fields, "stopped", "time", "seed"},
        "/disks": {*Track._fields, "radius", "mass"},
        "/events": {"event_seed", *LOG},
    }


def _refuse_part(scene: Scene, root: "Dataset", disks: "Dataset") -> None:
    """Raise ValueError for a selection of other things than seeds."""
    if "seed" not in root.dims:
        raise ValueError("without the dimension seed; select seeds by a list, as in sel(seed=[3])")
    seeds = root.seed.values
    if seeds.dtype != np.int64 or not seeds.size or seeds.min() < 0 or len(np.unique(seeds)) < len(seeds):
        raise ValueError("its seeds must be one or several different integers")
    complete = {"time": scene.times, "component": np.array(["x", "y"]), "disk": np.arange(scene.particles)}
    for dim, expected in complete.items():
        coordinates = disks.coords if dim == "disk" else root.coords
        if dim in coordinates and not np.array_equal(coordinates[dim].values, expected):
            raise ValueError(f"of {dim} it must hold all {len(expected)} in order; select from the analysis instead")
    if "position" in root:
        if not np.isfinite(root.position.transpose("seed", ...).values[root.failed.values == 0]).all():
            raise ValueError("holds positions that are not finite in a run that did not fail")
        if scene.box.periodic and "image" not in root:
            raise ValueError("lacks image, which a periodic box needs")
