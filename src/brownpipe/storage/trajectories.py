"""Trajectory files: a batch of runs of one scene by one engine; their layout is drawn in `brownpipe.storage`."""

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.ensemble import Ensemble
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import observables_making
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.layout import NO_OBSERVABLES, SCALES, Groups, described, dims_of, ensemble_of, groups_of

GROUPS = ("/", "/disks", "/events")
CHUNK_BYTES = 2**18
SMALL = 4096  # bytes of a variable that is not compressed: it would grow
NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable."  # as netCDF4 marks such a scale
WITHOUT_RESULTS = {"failed"}  # all that is known of runs that could not go on
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
    def outline(self) -> "Outline":
        """The same without tracks and observables."""
        ensemble = self.ensemble
        record = _record(ensemble.tracer is not None, ensemble.whole, ensemble.events)
        setting = (self.scene, self.engine, ensemble.seeds, ensemble.times)
        return Outline(*setting, record, self.source, _measured(ensemble.observables), ensemble.average)

    @property
    def attributes(self) -> dict:
        """Those of the root: scene, engine, versions, the command that makes the runs again."""
        outline, scene, engine = self.outline, self.scene, self.engine
        record = ",".join(sorted(outline.record - {"tracer"})) or ("tracer" if outline.tracer else "none")
        made = {
            "title": f"{scene.name}: {len(outline.seeds)} runs",
            "scene": scene.text,
            "scene_name": scene.name,
            "particles": scene.particles,
            "engine": engine.name,
            "settings": json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False),
            "average": outline.average,
            "variables": json.dumps(sorted(self.ensemble.observables)),
            "command": simulate_command(outline, outline.seeds, record),
            "source_digest": self.source,
            "runs_digest": "",
        }
        return {**made, **versions(), **self.header}


class Outline(NamedTuple):
    """Contents of a trajectory file without its tracks and observables."""

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) [time]
    record: frozenset[str]  # of tracer, all, events: whose tracks, and whether collisions, are stored
    source: str  # digest of the source code that made the runs
    observables: tuple[str, ...] | None = ()  # measured in the runs; None if none of them came to its end
    average: str = "runs"  # as in Ensemble
    digest: str = ""  # of all that determines the runs (`store.runs_digest`); empty for runs that were only saved

    @property
    def tracer(self) -> bool:
        """Whether the tracks of the tracer are stored."""
        return "tracer" in self.record


def simulate_command(outline: Outline, seeds: Sequence[int] | np.ndarray, record: str) -> str:
    """Return the command that makes runs of these seeds (S,) again; `record` as --record takes it."""
    options = {"record": record, "observables": ",".join(outline.observables or ()), "average": outline.average}
    words = [f"--particles {outline.scene.particles}"] if outline.scene.species else []
    words += [f"--seeds {seed_text(seeds)}", f"--engine {outline.engine.options}"]
    words += [f"--{key} {value}" for key, value in options.items() if value not in DEFAULTS]
    return f"brownpipe simulate {outline.scene.name}.yaml {' '.join(words)}"


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
    write_file(path, sealed(_to_bytes(groups_of(scene, ensemble), attributes)))


def _to_bytes(groups: Groups, attributes: dict) -> bytes:
    """Return the bytes of an HDF5 file of these groups, which are emptied. The same groups give the same bytes."""
    with h5py.File.in_memory(block_size=2**20) as file:
        file.attrs.update(attributes)
        for path, variables in groups.items():
            group = file.require_group(path)
            for name in sorted(variables, key=lambda name: (name not in SCALES, name)):
                _write_variable(group, name, variables.pop(name))  # whole runs are copies: one variable at a time
        file.flush()
        return file.id.get_file_image()


def _write_variable(group: h5py.Group, name: str, values: np.ndarray) -> None:
    """Write a variable with units, meaning and the scales of its dimensions, which are in the group or in the root."""
    kind = h5py.string_dtype() if values.dtype.kind == "U" else values.dtype
    dims = dims_of(group.name, name)
    filters = _filters(dims, values) if values.nbytes > SMALL and values.dtype.kind in "iuf" else {}
    dataset = group.create_dataset(name, data=values.astype(kind, copy=False), **filters)
    dataset.attrs.update(described(name))
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
        groups = {
            path: {name: values_of(item) for name, item in _variables(file[path])} for path in GROUPS if path in file
        }
    ensemble = ensemble_of(scene, groups, header["average"])
    return Trajectories(scene, engine, ensemble, header["source_digest"], header)


def read_outline(path: str | Path) -> Outline:
    """Return the outline of a trajectory file after verifying its seal; no track is decompressed.

    Raises StorageError and WrongFileError like `read_trajectories`.
    """
    with naming(path, "simulate"), h5py.File.in_memory(read_sealed(path)) as file:
        scene, engine, header = _setting(file)
        return Outline(
            scene=scene,
            engine=engine,
            seeds=values_of(file["seed"]),
            times=values_of(file["time"]),
            record=_record("position" in file, "disks" in file, "events" in file),
            source=header["source_digest"],
            observables=_measured([name for name, _ in _variables(file) if name not in NO_OBSERVABLES]),
            average=header["average"],
            digest=header["runs_digest"],
        )


def _measured(names: Collection[str]) -> tuple[str, ...] | None:
    """Return the observables that were measured, given the names of all numbers and arrays of the runs."""
    return None if WITHOUT_RESULTS.issuperset(names) else observables_making(names)


def _record(tracer: object, whole: object, events: object) -> frozenset[str]:
    """Return what is recorded, in the words of `--record`; an argument is true, or not empty, if it is recorded."""
    parts = {"tracer": tracer, "all": whole, "events": events}
    return frozenset(name for name, is_recorded in parts.items() if is_recorded)


def whole_seed(trajectories: Trajectories, path: str, seed: int | None) -> int:
    """Return the seed of a whole run, by default the smallest, of the trajectories in the file at `path`.

    Raises RequestError if the file holds no whole runs, none of this seed, or no disks.
    """
    whole = trajectories.ensemble.whole
    refuse_stopped(trajectories, path, seed)
    refuse_empty(trajectories, path)
    if not whole:
        raise RequestError(f"{path}: holds no whole runs; make it again: brownpipe simulate SCENE --record all")
    if seed is not None and seed not in whole:
        seeds = seed_text(sorted(whole))
        raise RequestError(f"{path}: seed {seed} is not in it; its whole runs have the seeds {seeds}")
    return min(whole) if seed is None else seed


def refuse_empty(trajectories: Trajectories, path: str) -> None:
    """Raise RequestError for runs of a scene without disks."""
    if not trajectories.scene.particles:
        raise RequestError(f"{path}: its scene has no disks")


def refuse_stopped(trajectories: Trajectories, path: str, seed: int | None) -> None:
    """Raise RequestError for the seed of a run that could not go on: there are no trajectories of it."""
    if seed in trajectories.ensemble.stopped:
        raise RequestError(f"{path}: seed {seed}: its run could not go on: {trajectories.ensemble.stopped[seed]}")


# -- reading --------------------------------------------------------------------------------------------------------


def values_of(dataset: h5py.Dataset) -> Any:
    """Return the values of a dataset of HDF5: an array or a scalar, with texts as `str`."""
    return dataset.asstr()[()] if h5py.check_string_dtype(dataset.dtype) else dataset[()]


def _variables(group: h5py.Group) -> list[tuple[str, h5py.Dataset]]:
    """Return the names and datasets of a group, without dimensions that have no coordinates."""
    return [(name, item) for name, item in group.items() if "units" in item.attrs]


def _setting(file: h5py.File) -> tuple[Scene, Engine, dict[str, str]]:
    """Return scene, engine and the texts in the attributes of a trajectory file.

    Raises WrongFileError for another file of brownpipe, StorageError if this version refuses the scene or the engine.
    """
    if "runs_digest" not in file.attrs:
        raise WrongFileError(NO_TRAJECTORIES)
    header = {name: value for name, value in file.attrs.items() if isinstance(value, str) and name[0] != "_"}
    try:
        scene, engine = setting_of(header)
        return scene, engine, header
    except RequestError as error:
        raise StorageError(f"is of brownpipe {header['brownpipe_version']}, not of this one: {error}") from error


def setting_of(attributes: Mapping) -> tuple[Scene, Engine]:
    """Return the scene and the engine that the attributes of runs name. Raises RequestError if they are none."""
    scene = parse_scene(json.loads(attributes["scene"]), f"{attributes['scene_name']}.yaml")
    return scene, recorded({"name": attributes["engine"], **json.loads(attributes["settings"])})
