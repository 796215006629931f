"""Trajectory files: a batch of runs of one scene by one engine; their layout is drawn in `brownpipe.storage`."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import ARRAYS, AXES, axes, observables_making
from brownpipe.provenance import modules_of, source_digest
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.hdf5 import Node, from_bytes, some_from_bytes, to_bytes
from brownpipe.storage.layout import parameter_nodes, run_nodes

OUTLINE = (  # paths from which an Outline is made
    "parameters",
    "parameters/scene",
    "parameters/settings",
    "observables/run/seed",
    "particles/tracer/position/time",
    "observables/run/time",
)
WITHOUT_RESULTS = {"seed", "failed", "stopped"}  # all that is known of runs that could not go on
NO_TRAJECTORIES = "is a file of brownpipe, but not a trajectory file (of `brownpipe simulate`)"
LISTED = ("particles", "observables/run", "observables/events")  # groups whose names an Outline needs


class Trajectories(NamedTuple):
    """Contents of a trajectory file."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source code that made the runs
    header: Mapping[str, str] = {}  # of the file: versions, and what else its /parameters says; empty without a file

    @property
    def outline(self) -> "Outline":
        """The same without tracks and observables."""
        ensemble = self.ensemble
        record = _record(ensemble.tracer is not None, ensemble.whole, ensemble.events)
        observables = _measured(ensemble.observables)
        setting = (self.scene, self.engine, ensemble.seeds, ensemble.times)
        return Outline(*setting, record, self.source, observables, ensemble.average)


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


def write_trajectories(
    path: str | Path, scene: Scene, engine: Engine, ensemble: Ensemble, source: str | None = None, digest: str = ""
) -> None:
    """Write a batch of runs to a trajectory file.

    source: digest of the source code that made the runs, by default that of this installation.
    digest: of all that determines the runs (`store.runs_digest`), for those that studies share.

    Raises StorageError if the file cannot be written.
    """
    source = source or source_digest(*modules_of("simulate", engine.name))
    nodes = run_nodes(scene, ensemble) | parameter_nodes(scene, engine, ensemble, source, digest)
    write_file(path, sealed(to_bytes(nodes)))


def read_trajectories(path: str | Path) -> Trajectories:
    """Return the contents of a trajectory file after verifying its seal.

    Raises StorageError, which names the file and says how to make it again; WrongFileError if the file does not exist
    or is no trajectory file.
    """
    with naming(path, "simulate"):
        return trajectories_in(read_sealed(path))


def trajectories_in(image: bytes) -> Trajectories:
    """Return the contents of a trajectory file, given its bytes; errors as of `read_trajectories`."""
    if not is_trajectories(image):
        raise WrongFileError(NO_TRAJECTORIES)
    nodes = from_bytes(image)
    scene, engine, header = _setting(nodes)
    ensemble = _ensemble(nodes, scene)._replace(average=header["average"])
    refuse_sizes(ensemble, scene)
    return Trajectories(scene, engine, ensemble, header["source_digest"], header)


def is_trajectories(image: bytes) -> bool:
    """Whether the bytes of an HDF5 file are those of a trajectory file."""
    return "parameters" in some_from_bytes(image, ["parameters"])


def read_outline(path: str | Path) -> Outline:
    """Return the outline of a trajectory file after verifying its seal; no track is decompressed.

    Raises StorageError and WrongFileError like `read_trajectories`.
    """
    with naming(path, "simulate"):
        nodes = some_from_bytes(read_sealed(path), (*OUTLINE, *LISTED))
        scene, engine, header = _setting(nodes)
        tracks, runs, events = (nodes[group].value if group in nodes else () for group in LISTED)
        times = nodes.get("particles/tracer/position/time", nodes.get("observables/run/time"))
        return Outline(
            scene=scene,
            engine=engine,
            seeds=nodes["observables/run/seed"].value,
            times=scene.times if times is None else times.value,
            record=_record("tracer" in tracks, {*tracks} - {"tracer"}, events),
            source=header["source_digest"],
            observables=_measured(runs),
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


def _setting(nodes: dict[str, Node]) -> tuple[Scene, Engine, dict]:
    """Return scene, engine and the attributes of /parameters.

    Raises WrongFileError for another file of brownpipe, StorageError if this version refuses the scene or the engine.
    """
    if "parameters" not in nodes:
        raise WrongFileError(NO_TRAJECTORIES)
    header = nodes["parameters"].attributes
    mapping, settings = (json.loads(nodes[f"parameters/{name}"].value) for name in ("scene", "settings"))
    try:
        scene = parse_scene(mapping, f"{header['scene_name']}.yaml")
        return scene, recorded({"name": header["engine"], **settings}), header
    except RequestError as error:
        raise StorageError(f"is of brownpipe {header['brownpipe_version']}, not of this one: {error}") from error


def refuse_sizes(ensemble: Ensemble, scene: Scene) -> None:
    """Raise StorageError for arrays whose sizes are not those of the scene, its sample times and the seeds."""
    runs, times = len(ensemble.seeds), len(scene.times)
    shapes = {name: (runs, *map(len, axes(scene, name).values())) for name in ARRAYS.keys() & ensemble.observables}
    arrays = {name: (values, shapes.get(name, (runs,))) for name, values in ensemble.observables.items()}
    tracks = {"tracer": (ensemble.tracer, runs)} if ensemble.tracer is not None else {}
    tracks |= {f"seed {seed}": (track, scene.particles) for seed, track in ensemble.whole.items()}
    for whose, (track, disks) in tracks.items():
        parts = track._asdict().items()
        arrays |= {f"{name} ({whose})": (part, (times, disks, 2)) for name, part in parts if part is not None}
    for name, (values, shape) in arrays.items():
        if values.shape != shape:
            raise StorageError(f"holds {name} of shape {values.shape}; its scene and seeds make it {shape}")


def _ensemble(nodes: dict[str, Node], scene: Scene) -> Ensemble:
    """Return the runs; their times are those of the file, the scene's if it has neither tracks nor arrays."""
    observables = {name: value for name, value in _children(nodes, "observables/run").items() if name not in AXES}
    seeds, reasons = observables.pop("seed"), observables.pop("stopped", ())
    stopped = {seed: reason for seed, reason in zip(seeds.tolist(), reasons, strict=False) if reason}
    whole = {_seed(name): _track(nodes, f"particles/{name}") for name in _runs(nodes, "particles")}
    events = {_seed(name): _log(nodes, f"observables/events/{name}") for name in _runs(nodes, "observables/events")}
    tracer = _track(nodes, "particles/tracer") if "particles/tracer" in nodes else None
    ends = ("/position/time", "observables/run/time")
    times = next((node.value for path, node in nodes.items() if path.endswith(ends)), scene.times)
    return Ensemble(seeds, times, tracer, observables, whole, events, stopped=stopped)


def _children(nodes: dict[str, Node], group: str) -> dict:
    """Return the values of the datasets in a group by name, None for groups in it."""
    return {path.rpartition("/")[2]: node.value for path, node in nodes.items() if path.rpartition("/")[0] == group}


def _runs(nodes: dict[str, Node], group: str) -> list[str]:
    """Return the names of the groups of single runs, seed_00017, ascending."""
    return sorted((name for name in _children(nodes, group) if name.startswith("seed_")), key=_seed)


def _seed(name: str) -> int:
    return int(name.removeprefix("seed_"))


def _track(nodes: dict[str, Node], group: str) -> Track:
    values = (nodes.get(f"{group}/{element}/value") for element in Track._fields)
    return Track(*(node and node.value for node in values))


def _log(nodes: dict[str, Node], group: str) -> Events:
    return Events(*(nodes[f"{group}/{name}"].value for name in Events._fields))
