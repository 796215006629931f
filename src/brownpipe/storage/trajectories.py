"""A batch of runs of one scene by one engine, in a trajectory file and in memory as
`xarray.DataTree`.

Both have the same groups, names and attributes, of which `brownpipe.storage` has an overview.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.ensemble import Ensemble, Track, stopped_in_words
from brownpipe.errors import RequestError
from brownpipe.observables import OBSERVABLES
from brownpipe.observables.own import Own, own_arrays
from brownpipe.provenance import source_digest, versions
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.files import MALFORMED, TRAJECTORIES, opened, reading, writing
from brownpipe.storage.layout import (
    AXES,
    PLACES,
    SCALES,
    Groups,
    described,
    dims_of,
    ensemble_of,
    groups_of,
)

if TYPE_CHECKING:
    from xarray import DataTree

CHUNK_BYTES = 2**18
SMALL = 4096  # bytes of a variable that is not compressed: it would grow
# as netCDF4 marks such a scale
NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable."


class Trajectories(NamedTuple):
    """Contents of a trajectory file."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source code that made the runs
    header: Mapping[
        str, Any
    ] = {}  # attributes that were read: versions, and more; empty for runs just made

    @property
    def record(self) -> frozenset[str]:
        """What is recorded, in the words of `--record`: whose tracks, and whether collisions."""
        runs, tracer = self.ensemble, self.ensemble.tracer
        tracks = {
            "tracer": tracer,
            "velocity": tracer and tracer.velocity,
            "all": runs.whole or None,
        }
        return frozenset(
            name
            for name, part in (tracks | {"events": runs.events or None}).items()
            if part is not None
        )

    @property
    def measured(self) -> tuple[str, ...] | None:
        """The observables that were measured in the runs; None if none of them came to its end."""
        arrays = self.ensemble.observables.keys()
        listed = [
            name
            for name, observable in OBSERVABLES.items()
            if next(iter(observable.arrays)) in arrays
        ]
        own = dict.fromkeys(array.observable for array in self.ensemble.own.values())
        return None if arrays <= {"failed"} else (*listed, *own)

    @property
    def attributes(self) -> dict:
        """The attributes of the root: scene, engine, versions, the command that makes the runs
        again.
        """
        scene, engine, ensemble = self.scene, self.engine, self.ensemble
        made = {
            "scene": scene.text,
            "scene_name": scene.name,
            "particles": scene.particles,
            "engine": engine.name,
            "settings": json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False),
            "average": ensemble.average,
            "variables": json.dumps(sorted(ensemble.observables)),
            "command": runs_record(
                self, ensemble.seeds, ",".join(sorted(self.record - {"tracer"}))
            )["command"],
            "source_digest": self.source or source_digest("simulate", engine.name),
            TRAJECTORIES: self.header.get(TRAJECTORIES, ""),
            **({"own_arrays": json.dumps(ensemble.own)} if ensemble.own else {}),
        }
        return made | (
            {name: self.header[name] for name in self.header if name.endswith("_version")}
            or versions()
        )


def runs_record(runs: Trajectories, seeds: Sequence[int] | np.ndarray, record: str = "") -> dict:
    """Return the command that makes runs (S,) of one scene and engine again, their scene and the
    source that made them.

    record: as --record takes it; by default what was recorded of the tracer, `none` if nothing was.
    """
    record = record or next(
        (word for word in ("velocity", "tracer") if word in runs.record), "none"
    )
    options = {
        "record": record,
        "observables": ",".join(runs.measured or ()),
        "average": runs.ensemble.average,
    }
    words = [f"--particles {runs.scene.particles}"] if runs.scene.species else []
    words += [f"--seeds {seed_text(seeds)}", f"--engine {runs.engine.options}"]
    words += [
        f"--{key} {value}" for key, value in options.items() if value not in ("", "tracer", "runs")
    ]  # defaults
    return {
        "command": f"brownpipe simulate {runs.scene.name}.yaml {' '.join(words)}",
        "name": runs.scene.name,
        "scene_digest": runs.scene.digest,
        "scene": json.loads(runs.scene.text),
        "source_digest": runs.source,
    }


def write_trajectories(
    path: str | Path, scene: Scene, engine: Engine, ensemble: Ensemble, *made: Any, digest: str = ""
) -> None:
    """Write a batch of runs to a trajectory file.

    made: source and header of `Trajectories`, by default of this installation.
    digest: of all that determines the runs (`store.runs_digest`), for those that studies share.

    Raises StorageError if the file cannot be written.
    """
    attributes, own = Trajectories(scene, engine, ensemble, *made).attributes, ensemble.own
    with writing(path) as file:
        file.attrs.update(attributes | {TRAJECTORIES: digest})
        for place, variables in groups_of(scene, ensemble).items():
            group = file.require_group(place)
            for name in sorted(variables, key=lambda name: (name not in SCALES, name)):
                _write_variable(
                    group, name, variables.pop(name), own
                )  # whole runs are copies: one variable at a time


def _write_variable(group: h5py.Group, name: str, values: np.ndarray, own: Own) -> None:
    """Write a variable with units, meaning and the scales of its dimensions, which are in the group
    or in the root.
    """
    dims = dims_of(group.name, name, own)
    values = values.astype(object) if values.dtype.kind == "U" else values  # text, as h5py takes it
    filters: dict[str, Any] = {}
    if (
        values.nbytes > SMALL and values.dtype.kind in "iuf"
    ):  # a chunk: as much of a run as fits, then more runs
        chunks, items = dict.fromkeys(dims, 1), CHUNK_BYTES // values.itemsize
        for dim, size in sorted(
            zip(dims[::-1], values.shape[::-1], strict=True), key=lambda pair: pair[0] == "seed"
        ):
            chunks[dim] = max(1, min(size, items))
            items //= chunks[dim]
        filters = {
            "chunks": tuple(chunks.values()),
            "compression": "gzip",
            "compression_opts": 4,
            "shuffle": True,
        }
    dataset = group.create_dataset(name, data=values, **filters)
    dataset.attrs.update(described(name, own))
    if name in SCALES:
        dataset.make_scale(name)
        return
    for axis, dim in enumerate(dims):
        if dim not in group and dim not in group.file:  # collisions have no coordinates
            group.create_dataset(dim, values.shape[axis : axis + 1], ">f4").make_scale(
                NO_COORDINATES
            )
        dataset.dims[axis].attach_scale(group[dim] if dim in group else group.file[dim])


def read_trajectories(path: str | Path, outline: bool = False) -> Trajectories:
    """Return the contents of a trajectory file after verifying its seal.

    outline: tracks and observables are not read, and have no values; whole runs and collisions are
    left out.

    Raises StorageError, which names the file and says how to make it again; WrongFileError if the
    file does not exist or is no trajectory file.
    """
    with reading(path, TRAJECTORIES) as file:
        return trajectories_in(file, outline)


def trajectories_in(file: h5py.File, outline: bool = False) -> Trajectories:
    """Return the contents of an open trajectory file; in an `outline` tracks and observables are
    still in the file.
    """
    groups: Groups = {place: {} for place in (["/"] if outline else PLACES) if place in file}
    for place, variables in groups.items():
        for name, item in file[place].items():
            if "units" in item.attrs:  # no group, and no dimension without coordinates
                texts = item.asstr() if h5py.check_string_dtype(item.dtype) else item
                variables[name] = (
                    item if outline and texts is item and not item.is_scale else texts[()]
                )
    return _runs_of(dict(file.attrs), groups)


def open_runs(path: str | Path) -> Ensemble:
    """Return the runs of a file whose seal has been verified, without whole runs and collisions, to
    select slices of.

    Only what is selected is read. The file is open as long as the ensemble is there.
    """
    return trajectories_in(opened(path), outline=True).ensemble


def _runs_of(attributes: Mapping, groups: Groups) -> Trajectories:
    """Return the runs that the attributes of the root and the variables of each group tell.

    Raises RequestError for a scene or an engine that this version refuses.
    """
    scene = parse_scene(json.loads(attributes["scene"]), f"{attributes['scene_name']}.yaml")
    engine = recorded({"name": attributes["engine"], **json.loads(attributes["settings"])})
    ensemble = ensemble_of(groups, attributes["average"], own_arrays(attributes))
    return Trajectories(scene, engine, ensemble, attributes["source_digest"], attributes)


def chosen_seed(
    runs: Trajectories, path: str, seed: int | None, tracks: Mapping[int, Track]
) -> int:
    """Return the seed of a run in the file at `path`, by default the smallest of `tracks`.

    Raises RequestError if there are no tracks, none of this seed, or no disks.
    """
    if runs.scene.particles and tracks and seed in {None, *tracks}:
        return min(tracks) if seed is None else seed
    which = "whole runs" if seed is None else f"run of seed {seed}"
    cure = (
        f"must be of {seed_text(sorted(tracks))}"
        if tracks
        else "brownpipe simulate SCENE --record all makes some"
    )
    stopped = f"; {stopped_in_words(runs.ensemble.stopped)}" if runs.ensemble.stopped else ""
    raise RequestError(f"{path}: holds no {which}; {cure}{stopped}")


# -- as xarray.DataTree ----------------------------------------------------------------------------


def to_tree(trajectories: Trajectories) -> "DataTree":
    """Return runs as a tree, which shares with them the arrays that `groups_of` does not copy.

    Unwrapped positions are added, with the size of the box and `failed` as coordinates, which
    arrays calculated from them keep.
    """
    import xarray

    scene, ensemble, own = trajectories.scene, trajectories.ensemble, trajectories.ensemble.own
    size, nodes = np.array([scene.box.width, scene.box.height]), {}
    for place, group in groups_of(scene, ensemble).items():
        if "position" in group:
            group |= {
                "box_size": size,
                "failed": ensemble.observables["failed"],
                "unwrapped": group["position"],
            }
        if "image" in group:
            group["unwrapped"] = group["position"] + group["image"] * size
        variables = {
            name: (dims_of(place, name, own), values, described(name, own))
            for name, values in group.items()
        }
        nodes[place] = xarray.Dataset(variables).set_coords(
            {"box_size", "failed"} & variables.keys()
        )
    nodes["/"].attrs = trajectories.attributes
    return xarray.DataTree.from_dict(nodes, name=scene.name)


def from_tree(tree: "DataTree", strict: bool = False) -> Trajectories:
    """Return the runs of a tree that `to_tree` made, or of a selection of its seeds.

    Variables that others have added are left out or, if `strict`, refused. Raises RequestError for
    any other tree.
    """
    groups: Groups = {}
    try:
        own, measured = own_arrays(tree.attrs), json.loads(tree.attrs["variables"])
        for node in tree.subtree:
            names = {*PLACES.get(node.path, ()), *measured}
            if strict and (
                added := sorted(map(str, node.data_vars.keys() - {*names, "unwrapped"}))
            ):
                raise ValueError(
                    f"a file has no place for {added[0]}; remove this variable, or save it apart"
                )
            stored = sorted(names & node.variables.keys())
            groups[node.path] = {
                name: node[name].transpose(*dims_of(node.path, name, own)).values for name in stored
            }
        runs = _runs_of(tree.attrs, groups)
        _refuse_part(runs.scene, groups)
    except MALFORMED as error:
        wrong = (
            "runs: must be what simulate or open returns, or a selection of its seeds, as in "
            "sel(seed=[3])"
        )
        raise RequestError(f"{wrong} ({error})") from error
    return runs


def _refuse_part(scene: Scene, groups: Groups) -> None:
    """Raise ValueError for a selection of other things than seeds, for a part of the collisions,
    and for positions without the images they need.
    """
    for dim, values in (
        item for group in groups.values() for item in group.items() if item[0] in AXES
    ):
        complete = AXES[dim].coordinates(scene)
        if not np.array_equal(values, complete):
            raise ValueError(
                f"of {dim} it must hold all {len(complete)} in order; select from the analysis "
                "instead"
            )
    root = groups["/"]
    if root["seed"].dtype != np.int64 or not 0 < len(root["seed"]) == len(np.unique(root["seed"])):
        raise ValueError("its seeds must be one or several different integers")
    if "position" in root and scene.box.periodic and "image" not in root:
        raise ValueError("lacks image, which a periodic box needs")
    if "/events" in groups:
        collisions = root["pair_collisions"] + root["wall_collisions"]
        if not np.array_equal((~np.isnan(groups["/events"]["a"])).sum(axis=1), collisions):
            raise ValueError("of event it must hold all collisions of each run")
