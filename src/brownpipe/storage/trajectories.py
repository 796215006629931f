"""Trajectory files: a batch of runs of one scene by one engine; their layout is drawn in `brownpipe.storage`."""

import json
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import AXES, observables_making
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.reading import NAME
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.admission import opened, understood
from brownpipe.storage.consistency import refuse_axes, refuse_sizes, refuse_values
from brownpipe.storage.files import BLANK_SEAL, naming, read_sealed, seal, write_file
from brownpipe.storage.hdf5 import CHANGED, Node, digest, from_bytes, nodes_of, some_from_bytes, to_bytes
from brownpipe.storage.layout import FORMAT, parameter_nodes, run_nodes
from brownpipe.storage.rerun import remedy

OUTLINE = (  # paths from which an Outline is made
    "parameters",
    "parameters/scene",
    "parameters/settings",
    "observables/run/seed",
    "particles/tracer/position/time",
    "observables/run/time",
)
WITHOUT_RESULTS = {"seed", "failed", "stopped"}  # all that is known of runs that could not go on
LISTED = ("particles", "observables/run", "observables/events")  # groups whose names an Outline needs
TEXTS = ("scene_name", "engine", "average", "source_digest", "contents_digest")  # attributes of /parameters


class Trajectories(NamedTuple):
    """Contents of a trajectory file."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source code that made the runs

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

    @property
    def tracer(self) -> bool:
        """Whether the tracks of the tracer are stored."""
        return "tracer" in self.record


def write_trajectories(
    path: str | Path, scene: Scene, engine: Engine, ensemble: Ensemble, source: str | None = None
) -> None:
    """Write a batch of runs to a trajectory file.

    source: digest of the source code that made the runs, by default that of this installation.

    Raises StorageError if the file cannot be written, or if HDF5 decodes other values from its bytes.
    """
    source = source or source_digest(*modules_of("simulate", engine.name))
    parameters = parameter_nodes(scene, engine, ensemble, source)
    nodes = run_nodes(scene, ensemble) | parameters
    expected = digest(nodes)
    parameters["parameters"].attributes.update(contents_digest=expected, seal=BLANK_SEAL)
    image = seal(to_bytes(nodes))
    if digest(from_bytes(image)) != expected:
        raise StorageError(f"{path}: not written: HDF5 gives back other numbers; check memory and the HDF5 library")
    write_file(path, image)


def read_trajectories(path: str | Path) -> Trajectories:
    """Return the contents of a trajectory file after verifying seal and digest.

    Raises StorageError, which names the file, its seeds and the command that makes them again; WrongFileError if the
    file does not exist or is no trajectory file.
    """
    with naming(path, remedy), understood():
        return _trajectories(*_contents(path))


def read_outline(path: str | Path) -> Outline:
    """Return the outline of a trajectory file after verifying its seal; no track is decompressed.

    Raises StorageError and WrongFileError like `read_trajectories`.
    """
    with naming(path, remedy), understood():
        with opened(read_sealed(path)) as contents:
            nodes, groups = nodes_of(contents, contents.some(OUTLINE)), contents.some(LISTED)
            names = {group: tuple(item) for group, item in groups.items() if isinstance(item, h5py.Group)}
        parameters = _parameters_of(nodes)
        scene, engine = _scene_and_engine(nodes)
        tracks, runs, events = (names.get(group, ()) for group in LISTED)
        times = nodes.get("particles/tracer/position/time", nodes.get("observables/run/time"))
        outline = Outline(
            scene=scene,
            engine=engine,
            seeds=nodes["observables/run/seed"].value,
            times=scene.times if times is None else times.value,
            record=_record("tracer" in tracks, {*tracks} - {"tracer"}, events),
            source=parameters["source_digest"],
            observables=_measured(runs),
            average=parameters.get("average", "runs"),
        )
        refuse_axes(outline.seeds, outline.times, outline.average, scene)
        return outline


def _measured(names: Collection[str]) -> tuple[str, ...] | None:
    """Return the observables that were measured, given the names of all numbers and arrays of the runs."""
    return None if WITHOUT_RESULTS.issuperset(names) else observables_making(names)


def _record(tracer: object, whole: object, events: object) -> frozenset[str]:
    """Return what is recorded, in the words of `--record`; an argument is true, or not empty, if it is recorded."""
    parts = {"tracer": tracer, "all": whole, "events": events}
    return frozenset(name for name, is_recorded in parts.items() if is_recorded)


def read_header(path: str | Path) -> dict:
    """Return the attributes of /parameters (names, versions, digests); checks and errors as of `read_outline`."""
    with naming(path, remedy), understood():
        return _parameters_of(some_from_bytes(read_sealed(path), OUTLINE))


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


def _contents(path: str | Path) -> tuple[dict[str, Node], Scene, Engine]:
    """Return all nodes of a trajectory file, its scene and its engine after verifying seal, sizes and digest."""
    with opened(read_sealed(path)) as contents:
        outline = nodes_of(contents, contents.some(OUTLINE))
        _parameters_of(outline)
        scene, engine = _scene_and_engine(outline)
        items = contents.members()
        refuse_sizes(items, scene, len(outline["observables/run/seed"].value))
        nodes = nodes_of(contents, items)
    if nodes["parameters"].attributes["contents_digest"] != digest(nodes):
        raise StorageError(CHANGED)
    return nodes, scene, engine


def _parameters_of(nodes: dict[str, Node]) -> dict:
    """Return the attributes of /parameters; raise an error if the nodes are not those of a file of this format."""
    if "parameters" not in nodes:
        raise WrongFileError("is a file of brownpipe, but not a trajectory file (of `brownpipe simulate`)")
    attributes = nodes["parameters"].attributes
    if attributes["format"] > FORMAT:
        raise StorageError(f"has format {attributes['format']}; this brownpipe reads up to {FORMAT}: upgrade it")
    for name in (*TEXTS, *versions()):
        if not isinstance(attributes.get(name, ""), str):
            raise StorageError(f"has a {name} that is no text")
    return attributes


def _scene_and_engine(nodes: dict[str, Node]) -> tuple[Scene, Engine]:
    """Return scene and engine; raise StorageError if this version of brownpipe refuses one of them."""
    parameters = nodes["parameters"].attributes
    if not NAME.fullmatch(parameters["scene_name"]):
        raise StorageError("names no scene")
    mapping, settings = (json.loads(nodes[f"parameters/{name}"].value) for name in ("scene", "settings"))
    try:
        scene = parse_scene(mapping, f"{parameters['scene_name']}.yaml")
        return scene, recorded({"name": parameters["engine"], **settings})
    except RequestError as error:
        raise StorageError(f"is of brownpipe {parameters['brownpipe_version']}, not of this one: {error}") from error


def _trajectories(nodes: dict[str, Node], scene: Scene, engine: Engine) -> Trajectories:
    parameters = nodes["parameters"].attributes
    ensemble = _ensemble(nodes, scene)._replace(average=parameters.get("average", "runs"))
    refuse_values(ensemble, scene)
    return Trajectories(scene, engine, ensemble, parameters["source_digest"])


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
