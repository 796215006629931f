"""A batch of runs of one scene by one engine, in a trajectory file and in memory as `xarray.DataTree`.

Both have the same groups, names and attributes, which are drawn in `brownpipe.storage`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.ensemble import Ensemble, Track, stopped_in_words
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import AXES, observables_making
from brownpipe.observables.own import Own, own_arrays
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.layout import LOG, OF_POSITIONS, SCALES, Groups, described, dims_of, ensemble_of, groups_of

if TYPE_CHECKING:
    from xarray import DataTree

GROUPS = ("/", "/disks", "/events")
CHUNK_BYTES = 2**18
SMALL = 4096  # bytes of a variable that is not compressed: it would grow
NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable."  # as netCDF4 marks such a scale
WITHOUT_RESULTS = {"failed"}  # all that is known of runs that could not go on
MOST_SCENE_TEXT = 100_000  # characters; a longer scene, of thousands of listed disks, is in the trajectory files only
NO_TRAJECTORIES = "is a file of brownpipe, but not a trajectory file (of `brownpipe simulate`)"
DEFAULTS = ("", "tracer", "runs")  # of the options --observables, --record and --average of `brownpipe simulate`


class Trajectories(NamedTuple):
    """Contents of a trajectory file."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source code that made the runs
    header: Mapping[str, str] = {}  # texts in the attributes of the file: versions, and more; empty without a file

    @property
    def record(self) -> frozenset[str]:
        """What is recorded, in the words of `--record`: whose tracks, and whether collisions."""
        tracer, whole, events = self.ensemble.tracer, self.ensemble.whole, self.ensemble.events
        velocity = tracer is not None and tracer.velocity is not None
        parts = {"tracer": tracer is not None, "velocity": velocity, "all": whole, "events": events}
        return frozenset(name for name, is_recorded in parts.items() if is_recorded)

    @property
    def measured(self) -> tuple[str, ...] | None:
        """The observables that were measured in the runs; None if none of them came to its end."""
        names = self.ensemble.observables.keys()
        own = dict.fromkeys(array.observable for array in self.ensemble.own.values())
        return None if WITHOUT_RESULTS.issuperset(names) else (*observables_making(names), *own)

    @property
    def digest(self) -> str:
        """That of all that determines the runs (`store.runs_digest`); empty for runs that were only saved."""
        return self.header.get("runs_digest", "")

    @property
    def attributes(self) -> dict:
        """Those of the root: scene, engine, versions, the command that makes the runs again."""
        scene, engine, ensemble = self.scene, self.engine, self.ensemble
        made = {
            "title": f"{scene.name}: {len(ensemble.seeds)} runs",
            "scene": scene.text,
            "scene_name": scene.name,
            "particles": scene.particles,
            "engine": engine.name,
            "settings": json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False),
            "average": ensemble.average,
            "variables": json.dumps(sorted(ensemble.observables)),
            "command": simulate_command(self, ensemble.seeds, ",".join(sorted(self.record - {"tracer"}))),
            "source_digest": self.source,
            "runs_digest": "",
            **({"own_arrays": json.dumps(ensemble.own)} if ensemble.own else {}),
        }
        return {**made, **versions(), **self.header}


def simulate_command(runs: Trajectories, seeds: Sequence[int] | np.ndarray, record: str = "") -> str:
    """Return the command that makes runs of these seeds (S,) again.

    record: as --record takes it; by default what was recorded of the tracer, `none` if nothing was.
    """
    record = record or next((word for word in ("velocity", "tracer") if word in runs.record), "none")
    options = {"record": record, "observables": ",".join(runs.measured or ()), "average": runs.ensemble.average}
    words = [f"--particles {runs.scene.particles}"] if runs.scene.species else []
    words += [f"--seeds {seed_text(seeds)}", f"--engine {runs.engine.options}"]
    words += [f"--{key} {value}" for key, value in options.items() if value not in DEFAULTS]
    return f"brownpipe simulate {runs.scene.name}.yaml {' '.join(words)}"


def runs_record(runs: Trajectories, seeds: Sequence[int] | np.ndarray, record: str = "") -> dict:
    """Return the command that makes runs (S,) of one scene and engine again, their scene and the source that made them.

    record: as of `simulate_command`.
    """
    scene = runs.scene
    return {
        "command": simulate_command(runs, seeds, record),
        "scene_digest": scene.digest,
        "scene": json.loads(scene.text) if len(scene.text) <= MOST_SCENE_TEXT else None,
        "source_digest": runs.source,
    }


def write_trajectories(
    path: str | Path, scene: Scene, engine: Engine, ensemble: Ensemble, source: str | None = None, digest: str = ""
) -> None:
    """Write a batch of runs to a trajectory file.

    source: digest of the source code that made the runs, by default that of this installation.
    digest: of all that determines the runs (`store.runs_digest`), for those that studies share.

    Raises StorageError if the file cannot be written.
    """
    source = source or source_digest(*modules_of("simulate", engine.name))
    attributes = Trajectories(scene, engine, ensemble, source).attributes | {"runs_digest": digest}
    write_file(path, sealed(_to_bytes(groups_of(scene, ensemble), attributes, ensemble.own)))


def _to_bytes(groups: Groups, attributes: dict, own: Own) -> bytes:
    """Return the bytes of an HDF5 file of these groups, which are emptied. The same groups give the same bytes."""
    with h5py.File.in_memory(block_size=2**20) as file:
        file.attrs.update(attributes)
        for path, variables in groups.items():
            group = file.require_group(path)
            for name in sorted(variables, key=lambda name: (name not in SCALES, name)):
                _write_variable(group, name, variables.pop(name), own)  # whole runs are copies: one variable at a time
        file.flush()
        return file.id.get_file_image()


def _write_variable(group: h5py.Group, name: str, values: np.ndarray, own: Own) -> None:
    """Write a variable with units, meaning and the scales of its dimensions, which are in the group or in the root."""
    kind = h5py.string_dtype() if values.dtype.kind == "U" else values.dtype
    dims = dims_of(group.name, name, own)
    filters = _filters(dims, values) if values.nbytes > SMALL and values.dtype.kind in "iuf" else {}
    dataset = group.create_dataset(name, data=values.astype(kind, copy=False), **filters)
    dataset.attrs.update(described(name, own))
    if name in SCALES:
        dataset.make_scale(name)
        return
    for axis, dim in enumerate(dims):
        if dim not in group and dim not in group.file:  # collisions have no coordinates
            group.create_dataset(dim, values.shape[axis : axis + 1], ">f4").make_scale(NO_COORDINATES)
        dataset.dims[axis].attach_scale(group[dim] if dim in group else group.file[dim])


def _filters(dims: tuple[str, ...], values: np.ndarray) -> dict:
    """Return the options of h5py for compression: in a chunk as much of a run as CHUNK_BYTES hold, then more runs."""
    chunks, items = dict.fromkeys(dims, 1), CHUNK_BYTES // values.itemsize
    for dim, size in sorted(zip(dims[::-1], values.shape[::-1], strict=True), key=lambda pair: pair[0] == "seed"):
        chunks[dim] = max(1, min(size, items))
        items //= chunks[dim]
    return {"chunks": tuple(chunks.values()), "compression": "gzip", "compression_opts": 4, "shuffle": True}


def read_trajectories(path: str | Path) -> Trajectories:
    """Return the contents of a trajectory file after verifying its seal.

    Raises StorageError, which names the file and says how to make it again; WrongFileError if the file does not exist
    or is no trajectory file.
    """
    with naming(path, "simulate"):
        return trajectories_in(read_sealed(path))


def trajectories_in(image: bytes) -> Trajectories:
    """Return the contents of a trajectory file, given its bytes; errors as of `read_trajectories`."""
    with h5py.File.in_memory(image) as file:
        scene, engine, header = _setting(file)
        groups = {path: _variables(file[path]) for path in GROUPS if path in file}
    ensemble = ensemble_of(groups, header["average"], own_arrays(header))
    return Trajectories(scene, engine, ensemble, header["source_digest"], header)


def read_outline(path: str | Path) -> Trajectories:
    """Return the contents of a trajectory file after verifying its seal, with empty tracks and observables.

    Nothing of these is decompressed, and whole runs and collisions are left out. Raises StorageError and WrongFileError
    like `read_trajectories`.
    """
    with naming(path, "simulate"), h5py.File.in_memory(read_sealed(path)) as file:
        scene, engine, header = _setting(file)
        times, observables = file["time"][()], dict.fromkeys(json.loads(header["variables"]), np.zeros(0))
        none = np.zeros((len(times), 0, 2))
        tracer = Track(none, none if "velocity" in file else None) if "position" in file else None
        seeds, own, average = file["seed"][()], own_arrays(header), header["average"]
        ensemble = Ensemble(seeds, times, tracer, observables, {}, {}, {}, own, average)
        return Trajectories(scene, engine, ensemble, header["source_digest"], header)


def _variables(group: h5py.Group) -> dict[str, np.ndarray]:
    """Return the variables of a group, without dimensions that have no coordinates."""
    return {name: values_of(item) for name, item in group.items() if "units" in item.attrs}


def values_of(dataset: h5py.Dataset) -> Any:
    """Return the values of a dataset of HDF5: an array or a scalar, with texts as `str`."""
    return dataset.asstr()[()] if h5py.check_string_dtype(dataset.dtype) else dataset[()]


def _setting(file: h5py.File) -> tuple[Scene, Engine, dict[str, str]]:
    """Return scene, engine and the texts in the attributes of a trajectory file.

    Raises WrongFileError for another file of brownpipe, StorageError if this version refuses the scene or the engine.
    """
    if "runs_digest" not in file.attrs:
        raise WrongFileError(NO_TRAJECTORIES)
    header = {name: value for name, value in file.attrs.items() if isinstance(value, str) and name[0] != "_"}
    try:
        return *setting_of(header), header
    except RequestError as error:
        raise StorageError(f"is of brownpipe {header['brownpipe_version']}, not of this one: {error}") from error


def setting_of(attributes: Mapping) -> tuple[Scene, Engine]:
    """Return the scene and the engine that the attributes of runs name. Raises RequestError if they are none."""
    scene = parse_scene(json.loads(attributes["scene"]), f"{attributes['scene_name']}.yaml")
    return scene, recorded({"name": attributes["engine"], **json.loads(attributes["settings"])})


def chosen_seed(
    trajectories: Trajectories, path: str, seed: int | None, tracks: Mapping[int, Track] | None = None
) -> int:
    """Return the seed of a run in the file at `path`, by default the smallest, of `tracks`, by default all whole runs.

    Raises RequestError if there are no tracks, none of this seed, or no disks.
    """
    ensemble = trajectories.ensemble
    tracks = ensemble.whole if tracks is None else tracks
    if seed in ensemble.stopped:
        wrong = f"seed {seed}: its run could not go on: {ensemble.stopped[seed]}"
    elif not trajectories.scene.particles:
        wrong = "its scene has no disks"
    elif len(ensemble.stopped) == len(ensemble.seeds):
        wrong = stopped_in_words(ensemble.stopped)
    elif not tracks:
        wrong = "holds no whole runs; make it again: brownpipe simulate SCENE --record all"
    elif seed is None or seed in tracks:
        return min(tracks) if seed is None else seed
    else:
        wrong = f"seed {seed} is not in it; must be of {seed_text(sorted(tracks))}"
    raise RequestError(f"{path}: {wrong}")


# -- as xarray.DataTree ---------------------------------------------------------------------------------------------


def to_tree(trajectories: Trajectories) -> "DataTree":
    """Return runs as a tree, which shares arrays with them as far as `groups_of` does.

    Besides what a file has, positions are there unwrapped, too, and the size of the box is one of their coordinates. So
    is `failed`: what is calculated from them keeps it.
    """
    import xarray

    scene, _, ensemble, *_ = trajectories
    size = np.array([scene.box.width, scene.box.height])
    nodes = {}
    for path, group in groups_of(scene, ensemble).items():
        if "position" in group:
            group |= {"box_size": size, "failed": ensemble.observables["failed"], "unwrapped": group["position"]}
        if "image" in group:
            group["unwrapped"] = group["position"] + group["image"] * size
        said = {name: (dims_of(path, name, ensemble.own), described(name, ensemble.own)) for name in group}
        variables = {name: (dims, group[name], meaning) for name, (dims, meaning) in said.items()}
        nodes[path] = xarray.Dataset(variables).set_coords(OF_POSITIONS.keys() & variables.keys())
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
        own, arrays = _own_names(tree), own_arrays(tree.attrs)
        _refuse_part(scene, tree)
        groups = {
            node.path: {
                name: node[name].transpose(*dims_of(node.path, name, arrays)).values
                for name in sorted(own[node.path] & node.variables.keys())
            }
            for node in tree.subtree
            if node.path in own
        }
        ensemble = ensemble_of(groups, tree.attrs["average"], arrays)
        return Trajectories(scene, engine, ensemble, tree.attrs["source_digest"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, RequestError) as error:
        wrong = "runs: must be what simulate or open returns, or a selection of its seeds"
        raise RequestError(f"{wrong} ({error})") from error


def refuse_foreign(tree: "DataTree") -> None:
    """Raise RequestError for a variable that a trajectory file has no place for."""
    own = _own_names(tree)
    for node in tree.subtree:
        for name in node.data_vars.keys() - {"unwrapped", *own.get(node.path, ())}:
            wrong = f"a trajectory file has no place for {f'{node.path}/{name}'.lstrip('/')}"
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
    complete = {"component": np.array(["x", "y"]), "disk": np.arange(scene.particles)}
    complete |= {dim: np.asarray(AXES[dim].coordinates(scene)) for dim in AXES if dim in tree.dims}
    for node in tree.subtree:
        for dim, values in complete.items():
            is_other = dim in node.coords and not np.array_equal(node.coords[dim].values, values)
            if is_other or node.sizes.get(dim, len(values)) != len(values):
                raise ValueError(f"of {dim} it must hold all {len(values)} in order; select from the analysis instead")
    if "position" in tree:
        if not np.isfinite(tree.position.transpose("seed", ...).values[tree.failed.values == 0]).all():
            raise ValueError("holds positions that are not finite in a run that did not fail")
        if scene.box.periodic and "image" not in tree:
            raise ValueError("lacks image, which a periodic box needs")
