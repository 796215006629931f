"""A batch of runs of one scene by one engine, in a trajectory file and in memory as
`xarray.DataTree`.

Both have the same groups, names and attributes, of which `brownpipe.storage` has an overview.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypedDict

import h5py
import numpy as np

from brownpipe.engines import Engine, engine_of_record
from brownpipe.engines.definition import OwnEngine
from brownpipe.engines.ensemble import Ensemble, Track, stopped_in_words
from brownpipe.errors import RequestError
from brownpipe.observables import OBSERVABLES
from brownpipe.observables.own import OwnArrays, own_arrays, own_coordinates
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
    variables_by_group,
)

if TYPE_CHECKING:
    from xarray import DataTree

CHUNK_BYTES = 2**18
SMALL = 4096  # bytes of a variable that is not compressed: it would grow
# as netCDF4 marks such a scale
NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable."
Attributes = Mapping[str, Any]  # of the root of a file: texts and numbers
NO_ATTRIBUTES: Attributes = MappingProxyType({})


class Trajectories(NamedTuple):
    """Contents of a trajectory file."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source code that made the runs
    # attributes that were read: versions, and more; empty for runs just made
    header: Attributes = NO_ATTRIBUTES

    @property
    def record(self) -> frozenset[str]:
        """What is recorded, in the words of `--record`: whose tracks, and whether collisions."""
        ensemble = self.ensemble
        tracer = ensemble.tracer
        is_recorded = {
            "tracer": tracer is not None,
            "velocity": tracer is not None and tracer.velocity is not None,
            "all": bool(ensemble.whole),
            "events": bool(ensemble.events),
        }
        return frozenset(word for word, is_there in is_recorded.items() if is_there)

    @property
    def measured(self) -> tuple[str, ...] | None:
        """The observables that were measured in the runs; None if none of them came to its end."""
        arrays = self.ensemble.observables.keys()
        if arrays <= {"failed"}:
            return None
        listed = []
        for name, observable in OBSERVABLES.items():
            first_array = next(iter(observable.arrays))  # measured in every scene
            if first_array in arrays:
                listed.append(name)
        own_arrays = self.ensemble.own.values()
        own = dict.fromkeys(array.observable for array in own_arrays if array.observable)
        return (*listed, *own)

    @property
    def attributes(self) -> dict:
        """The attributes of the root: scene, engine, versions, the command that makes the runs
        again.
        """
        scene = self.scene
        engine = self.engine
        ensemble = self.ensemble
        attributes = {
            "scene": scene.text,
            "scene_name": scene.name,
            "particles": scene.particles,
            "engine": engine.name,
        }
        settings = dict(engine.settings)
        attributes["settings"] = json.dumps(settings, sort_keys=True, allow_nan=False)
        if engine.own is not None:
            attributes["own_engine"] = json.dumps(engine.own)
        attributes["average"] = ensemble.average
        attributes["variables"] = json.dumps(sorted(ensemble.observables))
        beside_tracer = ",".join(sorted(self.record - {"tracer"}))
        attributes["command"] = runs_record(self, ensemble.seeds, beside_tracer)["command"]
        attributes["source_digest"] = self.source or source_digest("simulate", engine.name)
        attributes[TRAJECTORIES] = self.header.get(TRAJECTORIES, "")
        if ensemble.own:
            without_values = {
                name: array._replace(coordinates=()) for name, array in ensemble.own.items()
            }
            attributes["own_arrays"] = json.dumps(without_values)
        stored_versions = {
            name: version for name, version in self.header.items() if name.endswith("_version")
        }
        return attributes | (stored_versions or versions())


class RunsRecord(TypedDict):
    """What makes some runs of one scene and engine again, as JSON."""

    command: str
    name: str  # of the scene
    scene_digest: str
    scene: dict[str, Any]  # the keys of its file
    source_digest: str


def runs_record(
    runs: Trajectories, seeds: Sequence[int] | np.ndarray, record: str = ""
) -> RunsRecord:
    """Return the command that makes runs (S,) of one scene and engine again, their scene and the
    source that made them.

    record: as --record takes it; by default what was recorded of the tracer, `none` if nothing was.
    """
    scene = runs.scene
    recorded_of_tracer = [word for word in ("velocity", "tracer") if word in runs.record]
    options = {
        "record": record or next(iter(recorded_of_tracer), "none"),
        "observables": ",".join(runs.measured or ()),
        "average": runs.ensemble.average,
    }
    words = ["brownpipe", "simulate", f"{scene.name}.yaml"]
    if scene.species:
        words.append(f"--particles {scene.particles}")
    words += [f"--seeds {seed_text(seeds)}", f"--engine {runs.engine.options}"]
    defaults = ("", "tracer", "runs")
    words += [f"--{key} {value}" for key, value in options.items() if value not in defaults]
    command = " ".join(words)
    if runs.engine.own is not None:  # which the command line does not take
        command = f"in Python, by brownpipe.simulate: {command.removeprefix('brownpipe simulate ')}"
    return {
        "command": command,
        "name": scene.name,
        "scene_digest": scene.digest,
        "scene": json.loads(scene.text),
        "source_digest": runs.source,
    }


def write_trajectories(
    path: str | Path,
    scene: Scene,
    engine: Engine,
    ensemble: Ensemble,
    source: str = "",
    header: Attributes = NO_ATTRIBUTES,
    *,
    digest: str = "",
) -> None:
    """Write a batch of runs to a trajectory file.

    source, header: as in `Trajectories`, by default of this installation.
    digest: of all that determines the runs (`store.runs_digest`), for those that studies share.

    Raises StorageError if the file cannot be written.
    """
    attributes = Trajectories(scene, engine, ensemble, source, header).attributes
    with writing(path) as file:
        file.attrs.update(attributes | {TRAJECTORIES: digest})
        for place, variables in variables_by_group(scene, ensemble).items():
            group = file.require_group(place)
            scales = {*SCALES, *own_coordinates(ensemble.own)}
            scales_first = sorted(variables, key=lambda name: (name not in scales, name))
            for name in scales_first:
                values = variables.pop(name)  # whole runs are copies: one variable at a time
                _write_variable(group, name, values, ensemble.own)


def _write_variable(group: h5py.Group, name: str, values: np.ndarray, own: OwnArrays) -> None:
    """Write a variable with units, meaning and the scales of its dimensions, which are in the group
    or in the root.
    """
    dims = dims_of(group.name, name, own)
    values = values.astype(object) if values.dtype.kind == "U" else values  # text, as h5py takes it
    is_compressed = values.nbytes > SMALL and values.dtype.kind in "iuf"
    filters = _filters(dims, values) if is_compressed else {}
    dataset = group.create_dataset(name, data=values, **filters)
    dataset.attrs.update(described(name, own))
    if dims == (name,):
        dataset.make_scale(name)
        return
    for axis, dim in enumerate(dims):
        if dim not in group and dim not in group.file:  # collisions have no coordinates
            scale = group.create_dataset(dim, values.shape[axis : axis + 1], ">f4")
            scale.make_scale(NO_COORDINATES)
        dataset.dims[axis].attach_scale(group[dim] if dim in group else group.file[dim])


def _filters(dims: tuple[str, ...], values: np.ndarray) -> dict[str, object]:
    """Return h5py's options for a compressed variable. A chunk is as much of a run as fits, then
    more runs.
    """
    sizes = dict(zip(dims, values.shape, strict=True))
    chunks = dict.fromkeys(dims, 1)
    items = CHUNK_BYTES // values.itemsize  # that still fit
    inner_first = dims[::-1]
    for dim in sorted(inner_first, key=lambda dim: dim == "seed"):
        chunks[dim] = max(1, min(sizes[dim], items))
        items //= chunks[dim]
    return {
        "chunks": tuple(chunks.values()),
        "compression": "gzip",
        "compression_opts": 4,
        "shuffle": True,
    }


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
    places = ["/"] if outline else [place for place in PLACES if place in file]
    groups: Groups = {place: {} for place in places}
    for place, variables in groups.items():
        for name, item in file[place].items():
            if "units" not in item.attrs:  # a group, or a dimension without coordinates
                continue
            if h5py.check_string_dtype(item.dtype):
                variables[name] = item.asstr()[()]
            else:
                variables[name] = item if outline and not item.is_scale else item[()]
    return _trajectories_from(dict(file.attrs), groups)


def open_runs(path: str | Path) -> Ensemble:
    """Return the runs of a file whose seal has been verified, without whole runs and collisions, to
    select slices of.

    Only what is selected is read. The file is open as long as the ensemble is there.
    """
    return trajectories_in(opened(path), outline=True).ensemble


def _trajectories_from(attributes: Mapping, groups: Groups) -> Trajectories:
    """Return the runs that the attributes of the root and the variables of each group tell.

    Raises RequestError for a scene or an engine that this version refuses.
    """
    keys = json.loads(attributes["scene"])
    scene = parse_scene(keys, f"{attributes['scene_name']}.yaml")
    settings = json.loads(attributes["settings"])
    own = OwnEngine(*json.loads(attributes["own_engine"])) if "own_engine" in attributes else None
    engine = engine_of_record(attributes["engine"], settings, own)
    average = str(attributes["average"])
    ensemble = ensemble_of(groups, average, own_arrays(attributes))
    return Trajectories(scene, engine, ensemble, attributes["source_digest"], attributes)


def chosen_seed(
    runs: Trajectories, path: str, seed: int | None, tracks: Mapping[int, Track]
) -> int:
    """Return the seed of a run in the file at `path`, by default the smallest of `tracks`.

    Raises RequestError if there are no tracks, none of this seed, or no disks.
    """
    if not runs.scene.particles:
        raise RequestError(f"{path}: holds no disks")
    if tracks and seed in {None, *tracks}:
        return min(tracks) if seed is None else seed
    lacking = "whole runs" if seed is None else f"run of seed {seed}"
    remarks = ["brownpipe simulate SCENE --record all makes some"]
    if tracks:
        remarks = [f"must be of {seed_text(sorted(tracks))}"]
    if runs.ensemble.stopped:
        remarks.append(stopped_in_words(runs.ensemble.stopped))
    raise RequestError(f"{path}: holds no {lacking}; {'; '.join(remarks)}")


# -- as xarray.DataTree ----------------------------------------------------------------------------


def to_tree(trajectories: Trajectories) -> "DataTree":
    """Return runs as a tree, which shares with them the arrays that `variables_by_group` does
    not copy.

    Unwrapped positions are added, with the size of the box and `failed` as coordinates, which
    arrays calculated from them keep.
    """
    import xarray

    scene = trajectories.scene
    ensemble = trajectories.ensemble
    own = ensemble.own
    size = np.array([scene.box.width, scene.box.height])
    nodes = {}
    for place, group in variables_by_group(scene, ensemble).items():
        if "position" in group:
            group["box_size"] = size
            group["failed"] = ensemble.observables["failed"]
            group["unwrapped"] = group["position"]
        if "image" in group:
            group["unwrapped"] = group["position"] + group["image"] * size
        variables = {}
        for name, values in group.items():
            variables[name] = (dims_of(place, name, own), values, described(name, own))
        coordinates = {"box_size", "failed"} & variables.keys()
        nodes[place] = xarray.Dataset(variables).set_coords(coordinates)
    nodes["/"].attrs = trajectories.attributes
    return xarray.DataTree.from_dict(nodes, name=scene.name)


def from_tree(tree: "DataTree", strict: bool = False) -> Trajectories:
    """Return the runs of a tree that `to_tree` made, or of a selection of its seeds.

    Variables that others have added are left out or, if `strict`, refused. Raises RequestError for
    any other tree.
    """
    groups: Groups = {}
    try:
        own = own_arrays(tree.attrs)
        measured = json.loads(tree.attrs["variables"])
        for node in tree.subtree:
            names = {*PLACES.get(node.path, ()), *measured}
            if node.path == "/":
                names |= own_coordinates(own).keys()
            added = sorted(map(str, node.data_vars.keys() - {*names, "unwrapped"}))
            if strict and added:
                raise ValueError(
                    f"a file has no place for {added[0]}; remove this variable, or save it apart"
                )
            groups[node.path] = {}
            for name in sorted(names & node.variables.keys()):
                dims = dims_of(node.path, name, own)
                groups[node.path][name] = node[name].transpose(*dims).values
        runs = _trajectories_from(tree.attrs, groups)
        _refuse_incomplete(runs.scene, groups, own)
    except MALFORMED as error:
        wrong = (
            "runs: must be what simulate or open returns, or a selection of its seeds, as in "
            "sel(seed=[3])"
        )
        raise RequestError(f"{wrong} ({error})") from error
    return runs


def _refuse_selection(dim: str, number: int) -> NoReturn:
    raise ValueError(
        f"of {dim} it must hold all {number} in order; select from the analysis instead"
    )


def _refuse_incomplete(scene: Scene, groups: Groups, own: OwnArrays) -> None:
    """Raise ValueError for a selection of other things than seeds, for a part of the collisions,
    and for positions without the images they need.
    """
    for group in groups.values():
        for dim in (name for name in group if name in AXES):
            complete = AXES[dim].coordinates(scene)
            if not np.array_equal(group[dim], complete):
                _refuse_selection(dim, len(complete))
    root = groups["/"]
    for dim, array in own_coordinates(own).items():
        if root[dim].shape != array.shape or np.any(np.diff(root[dim]) <= 0):
            _refuse_selection(dim, *array.shape)
    seeds = root["seed"]
    if seeds.dtype != np.int64 or not 0 < len(seeds) == len(np.unique(seeds)):
        raise ValueError("its seeds must be one or several different integers")
    if "position" in root and scene.box.has_images and "image" not in root:
        raise ValueError("lacks image, which a periodic box needs")
    if "/events" in groups:
        collisions = root["pair_collisions"] + root["wall_collisions"]
        logged = (~np.isnan(groups["/events"]["a"])).sum(axis=1)
        if not np.array_equal(logged, collisions):
            raise ValueError("of event it must hold all collisions of each run")
