"""Runs in memory as `xarray.DataTree`: the groups, names and attributes of a trajectory file, drawn in `storage`."""

import json
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.engines.state import Track
from brownpipe.errors import RequestError, StorageError
from brownpipe.scene import Scene
from brownpipe.storage.layout import LOG, described, dims_of, ensemble_of, groups_of
from brownpipe.storage.trajectories import Trajectories, setting_of

if TYPE_CHECKING:
    from xarray import DataTree


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
        _refuse_part(scene, tree)
        groups = {
            path: {
                name: tree[path][name].transpose(*dims_of(path, name)).values
                for name in names & tree[path].variables.keys()
            }
            for path, names in _own_names(tree).items()
            if path in tree.groups
        }
        ensemble = ensemble_of(scene, groups, tree.attrs["average"])
        return Trajectories(scene, engine, ensemble, tree.attrs["source_digest"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, RequestError, StorageError) as error:
        wrong = "runs: must be what simulate or open returns, or a selection of its seeds"
        raise RequestError(f"{wrong} ({error})") from error


def refuse_foreign(tree: "DataTree") -> None:
    """Raise RequestError for a variable that a trajectory file has no place for."""
    own = _own_names(tree)
    names = [(node.path, name) for node in tree.subtree for name in node.data_vars]
    foreign = [f"{path}/{name}".lstrip("/") for path, name in names if name not in own.get(path, ())]
    if foreign:
        wrong = f"a trajectory file has no place for {foreign[0]}"
        raise RequestError(f"data: {wrong}; remove this variable, or save it apart")


def _own_names(tree: "DataTree") -> dict[str, set[str]]:
    """Return the names that runs have in each group."""
    return {
        "/": {*json.loads(tree.attrs["variables"]), *Track._fields, "stopped", "time", "seed"},
        "/disks": {*Track._fields, "radius", "mass"},
        "/events": {"event_seed", *LOG},
    }


def _refuse_part(scene: Scene, tree: "DataTree") -> None:
    """Raise ValueError for a selection of other things than seeds."""
    if "seed" not in tree.dims:
        raise ValueError("without the dimension seed; select seeds by a list, as in sel(seed=[3])")
    seeds = tree.seed.values
    if seeds.dtype != np.int64 or not seeds.size or seeds.min() < 0 or len(np.unique(seeds)) < len(seeds):
        raise ValueError("its seeds must be one or several different integers")
    complete = {"time": scene.times, "component": np.array(["x", "y"]), "disk": np.arange(scene.particles)}
    for node in tree.subtree:
        for dim, values in complete.items():
            if dim in node.coords and not np.array_equal(node.coords[dim].values, values):
                raise ValueError(f"of {dim} it must hold all {len(values)} in order; select from the analysis instead")
    if "position" in tree:
        if not np.isfinite(tree.position.transpose("seed", ...).values[tree.failed.values == 0]).all():
            raise ValueError("holds positions that are not finite in a run that did not fail")
        if scene.box.periodic and "image" not in tree:
            raise ValueError("lacks image, which a periodic box needs")
