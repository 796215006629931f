"""Trajectory files: a batch of runs of one scene by one engine; their layout is drawn in `brownpipe.storage`."""

import json
import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from brownpipe.engines import DEFINITIONS, RECORDS, Engine, option, recorded, requested
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import ARRAYS, AVERAGES, AXES, OBSERVABLES, RENAMED, observables_making
from brownpipe.provenance import modules_of, source_digest, versions
from brownpipe.quoting import shell_path
from brownpipe.scene import Box, Scene, parse_scene, reading
from brownpipe.scene.reading import NAME, Entry
from brownpipe.scene.scene_file import MOST_DISKS
from brownpipe.scene.seeds import parse_seeds, seed_text
from brownpipe.storage import arrays
from brownpipe.storage.admission import opened, understood
from brownpipe.storage.consistency import refuse_axes, refuse_sizes, refuse_values
from brownpipe.storage.files import BLANK_SEAL, read_sealed, seal, write_file
from brownpipe.storage.hdf5 import (
    Link,
    Node,
    Tree,
    digest,
    from_bytes,
    names_from_bytes,
    nodes_of,
    some_from_bytes,
    to_bytes,
)

FORMAT = 1
OUTLINE = (  # paths from which an Outline is made
    "parameters",
    "parameters/scene",
    "parameters/settings",
    "observables/run/seed",
    "particles/tracer/position/time",
    "observables/run/time",
)
COMMAND = re.compile(  # as `_command` writes it; none of its characters means anything to a shell
    rb"`brownpipe simulate ([A-Za-z0-9][A-Za-z0-9._-]{0,63})\.yaml((?: --[a-z-]+ [A-Za-z0-9.,_+-]+)+)`"
)
WORDS_OF = {"--record": RECORDS, "--observables": (*OBSERVABLES, *RENAMED), "--average": AVERAGES}  # in the command
WITHOUT_RESULTS = {"seed", "failed", "stopped"}  # all that is known of runs that could not go on
LISTED = ("particles", "observables/run", "observables/events")  # groups whose names an Outline needs
TEXTS = ("scene_name", "engine", "average", "source_digest", "contents_digest")  # attributes of /parameters
TIME_FIRST = (2, 0, 1)  # a chunk of (T, S, 2) spans all times of a few runs

MEANING = {  # dataset: units, long_name
    "time": ("time", "time since the start of the run"),
    "step": ("1", "index of the sample"),
    "seed": ("1", "seed of the run"),
    "disk": ("1", "index of the disk; 0 is the tracer"),
    "component": ("1", "Cartesian component"),
    "position": ("length", "position of the disk's centre"),
    "velocity": ("length/time", "velocity"),
    "image": ("1", "periodic images crossed; unwrapped position = position + image * edges"),
    "radius": ("length", "radius"),
    "mass": ("mass", "mass"),
    "edges": ("length", "width and height of the box"),
    "origin": ("length", "lower left corner of the box"),
    "a": ("1", "colliding disk"),
    "b": ("1", "its partner: a disk, or a wall: -1 left, -2 right, -3 bottom, -4 top"),
    "impulse": ("mass*length/time", "momentum transferred to disk a"),
    "pair_collisions": ("1", "collisions between disks"),
    "wall_collisions": ("1", "collisions of disks with walls"),
    "tracer_collisions": ("1", "collisions of the tracer with disks"),
    "energy_drift": ("1", "relative change of the kinetic energy over the run"),
    "worst_overlap": ("1", "deepest overlap of two disks, in contact distances"),
    "momentum_residual": ("1", "relative residual of the momentum balance of disks and walls"),
    "kinetic_energy": ("energy", "total kinetic energy at t = 0, conserved; NaN if not representable in these units"),
    "virial": ("energy*time", "sum of abs(momentum transfer) * contact distance over the pair collisions of the run"),
    "wall_impulse": ("mass*length/time", "sum of abs(momentum transfer) over the wall collisions of the run"),
    "missed_collisions": ("1", "collisions missed because the pair met and separated within one time step"),
    "friction_rate": ("1/time", "friction rate gamma of the tracer, dv/dt = -gamma v + noise"),
    "initial_square_speed": ("length^2/time^2", "squared speed of the tracer at t = 0"),
    "failed": (
        "1",
        "1 if overlap, energy drift or momentum residual exceeds its bound, a number is not finite or the run could "
        "not go on: exclude from averages",
    ),
    "stopped": ("1", "why the run could not go on; empty for a run that came to its end"),
    "scene": ("1", "the scene as canonical JSON"),
    "settings": ("1", "settings of the engine as JSON"),
}


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
    parameters = _parameters(scene, engine, ensemble, source)
    nodes = _layout(scene, ensemble) | parameters
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
    with _naming(path), understood():
        return _trajectories(*_contents(path))


def read_outline(path: str | Path) -> Outline:
    """Return the outline of a trajectory file after verifying its seal; no track is decompressed.

    Raises StorageError and WrongFileError like `read_trajectories`.
    """
    with _naming(path), understood():
        image = read_sealed(path)
        nodes, names = some_from_bytes(image, OUTLINE), names_from_bytes(image, LISTED)
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
    """Return what is recorded, in the words of `--record`, given what is true of it or not empty."""
    parts = {"tracer": tracer, "all": whole, "events": events}
    return frozenset(name for name, is_recorded in parts.items() if is_recorded)


def read_header(path: str | Path) -> dict:
    """Return the attributes of /parameters (names, versions, digests); checks and errors as of `read_outline`."""
    with _naming(path), understood():
        return _parameters_of(some_from_bytes(read_sealed(path), OUTLINE))


def whole_seed(trajectories: Trajectories, path: str, seed: int | None = None) -> int:
    """Return the seed of a whole run, by default the smallest, of the trajectories in the file at `path`.

    Raises RequestError if the file holds no whole runs, none of this seed, or no disks.
    """
    whole = trajectories.ensemble.whole
    refuse_stopped(trajectories, path, seed)
    if not whole:
        raise RequestError(f"{path}: holds no whole runs; make it again: brownpipe simulate SCENE --record all")
    if seed is not None and seed not in whole:
        seeds = seed_text(sorted(whole))
        raise RequestError(f"{path}: seed {seed} is not in it; its whole runs have the seeds {seeds}")
    if not trajectories.scene.particles:
        raise RequestError(f"{path}: its scene has no disks")
    return min(whole) if seed is None else seed


def refuse_stopped(trajectories: Trajectories, path: str, seed: int | None) -> None:
    """Raise RequestError for the seed of a run that could not go on: there are no trajectories of it."""
    if seed in trajectories.ensemble.stopped:
        raise RequestError(f"{path}: seed {seed}: its run could not go on: {trajectories.ensemble.stopped[seed]}")


# -- layout ---------------------------------------------------------------------------------------------------------


def _layout(scene: Scene, ensemble: Ensemble) -> Tree:
    """Return all nodes of a trajectory file but its parameters."""
    nodes = _header()
    if ensemble.tracer is not None:
        nodes |= _particles("particles/tracer", scene, ensemble.times, ensemble.tracer, "seed", ensemble.seeds)
    for seed, track in ensemble.whole.items():
        group = f"particles/seed_{seed:05d}"
        nodes |= _particles(group, scene, ensemble.times, track, "disk", np.arange(scene.particles))
        nodes[f"{group}/radius"] = _dataset("radius", scene.radius, ("id",))
        nodes[f"{group}/mass"] = _dataset("mass", scene.mass, ("id",))
    nodes |= _observables(scene, ensemble)
    for seed, events in ensemble.events.items():
        nodes |= _events(f"observables/events/seed_{seed:05d}", events)
    return nodes


def _header() -> Tree:
    """Return what H5MD requires of every file."""
    return {
        "h5md": Node(None, {"version": np.array([1, 1])}),
        "h5md/author": Node(None, {"name": "brownpipe"}),
        "h5md/creator": Node(None, {"name": "brownpipe", "version": versions()["brownpipe_version"]}),
        "particles": Node(None, {}),
    }


def _dataset(name: str, value: Any, dims: tuple[str, ...] = (), chunk_axes: tuple[int, ...] | None = None) -> Node:
    """Return a dataset with the units and the meaning that belong to its name."""
    units, long_name = MEANING.get(name, ("1", name.replace("_", " ")))
    return Node(value, {"units": units, "long_name": long_name}, dims, chunk_axes)


def _particles(group: str, scene: Scene, times: np.ndarray, track: Track, dim: str, ids: np.ndarray) -> Tree:
    """Return a particles group of H5MD; `ids` are the values along `dim`, the dimension of the particles.

    All elements (position, velocity, image) have the same steps and scales: those of the position, linked.
    """
    nodes = {group: Node(None, {})} | _box(f"{group}/box", scene.box)
    nodes[f"{group}/id"] = _dataset(dim, ids, ("id",))
    scales: Tree = {"time": _dataset("time", times, ("time",)), dim: _dataset(dim, ids, (dim,))}
    scales |= {"component": Link(f"{group}/box/component"), "step": _dataset("step", np.arange(len(times)), ("time",))}
    links = {name: Link(f"{group}/position/{name}") for name in scales}
    chunk_axes = TIME_FIRST if dim == "seed" else None
    for element, value in track._asdict().items():
        if value is None:
            continue
        nodes[f"{group}/{element}"] = Node(None, {})
        for name, node in (scales if element == "position" else links).items():
            nodes[f"{group}/{element}/{name}"] = node
        nodes[f"{group}/{element}/value"] = _dataset(element, value, ("time", dim, "component"), chunk_axes)
    return nodes


def _box(group: str, box: Box) -> Tree:
    boundary = "periodic" if box.periodic else "none"
    return {
        group: Node(None, {"dimension": 2, "boundary": [boundary, boundary]}),
        f"{group}/component": _components(),
        f"{group}/edges": _dataset("edges", np.array([box.width, box.height]), ("component",)),
        f"{group}/origin": _dataset("origin", np.array(box.origin), ("component",)),
    }


def _components() -> Node:
    """Return the scale of the Cartesian components."""
    return _dataset("component", np.array(["x", "y"], h5py.string_dtype()), ("component",))


def _observables(scene: Scene, ensemble: Ensemble) -> Tree:
    """Return one number per run, and arrays, of every observable."""
    group = "observables/run"
    nodes: Tree = {
        "observables": Node(None, {}),
        group: Node(None, {}),
        f"{group}/seed": _dataset("seed", ensemble.seeds, ("seed",)),
    }
    for name, value in ensemble.observables.items():
        if name not in ARRAYS:
            nodes[f"{group}/{name}"] = _dataset(name, value, ("seed",))
    if ensemble.stopped:
        reasons = [ensemble.stopped.get(seed, "") for seed in ensemble.seeds.tolist()]
        nodes[f"{group}/stopped"] = _dataset("stopped", np.array(reasons, h5py.string_dtype()), ("seed",))
    nodes |= arrays.layout(group, scene, ensemble)
    if ensemble.events:
        nodes["observables/events"] = Node(None, {})
    return nodes


def _events(group: str, events: Events) -> Tree:
    """Return the collisions of one run."""
    nodes: Tree = {group: Node(None, {}), f"{group}/component": _components()}
    for name, value in events._asdict().items():
        nodes[f"{group}/{name}"] = _dataset(name, value, ("time", "component")[: value.ndim])
    return nodes


def _parameters(scene: Scene, engine: Engine, ensemble: Ensemble, source: str) -> dict[str, Node]:
    """Return the group /parameters: scene, engine, versions, and the commands that make the runs again."""
    attributes = {
        "format": FORMAT,
        "scene_name": scene.name,
        "particles": scene.particles,
        "engine": engine.name,
        "seeds": seed_text(ensemble.seeds),
        "average": ensemble.average,
        "rerun": _rerun(scene, engine, ensemble),
        "source_digest": source,
    }
    return {
        "parameters": Node(None, attributes | versions()),
        "parameters/scene": _dataset("scene", scene.text),
        "parameters/settings": _dataset("settings", json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False)),
    }


def _rerun(scene: Scene, engine: Engine, ensemble: Ensemble) -> str:
    """Return the commands that make these runs again, and where the scene file comes from: no other file is needed."""
    scene_file = f"{scene.name}.yaml is printed by `brownpipe inspect FILE --scene`"
    compare = "`brownpipe inspect FILE --reproduce` runs and compares; FILE is this file"
    return f"{_command(scene, engine, ensemble)}, where {scene_file}; {compare}"


def _command(scene: Scene, engine: Engine, ensemble: Ensemble) -> str:
    """Return the command that makes these runs again, in backquotes, by which `_remedy` finds it in a damaged file."""
    particles = f" --particles {scene.particles}" if scene.species else ""
    tracks = ["all"] * bool(ensemble.whole) + ["events"] * bool(ensemble.events)
    if not tracks and ensemble.tracer is None and scene.particles > 0:
        tracks = ["none"]
    record = f" --record {','.join(tracks)}" if tracks else ""
    seeds = f" --seeds {seed_text(ensemble.seeds)}"
    observables = arrays.command_options(ensemble)
    return f"`brownpipe simulate {scene.name}.yaml{particles}{seeds} --engine {engine.options}{record}{observables}`"


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
        raise StorageError("HDF5 gives back other numbers than were written; check memory and the HDF5 library")
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
    """Return the collisions of one run."""
    return Events(*(nodes[f"{group}/{name}"].value for name in Events._fields))


@contextmanager
def _naming(path: str | Path) -> Iterator[None]:
    """Put the name of the file before errors and, if it is damaged, the remedy behind them."""
    try:
        yield
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except StorageError as error:
        raise StorageError(f"{path}: {error}; {_remedy(path)}") from error


def _remedy(path: str | Path) -> str:
    """Return how to make a damaged file again: by the command found in its raw bytes, without the help of HDF5."""
    try:
        match = COMMAND.search(Path(path).read_bytes())
    except OSError:
        return "check that it is there and can be read"
    try:
        seeds, command = _valid_command(match)
    except (RequestError, ValueError):
        return "if brownpipe wrote it, delete it and run the study or brownpipe simulate again"
    return f"seeds {seeds} are lost: delete it and run the study again, or {command} --output {shell_path(path)}"


def _valid_command(match: re.Match[bytes] | None) -> tuple[str, str]:
    """Return the seeds and the command that `_command` wrote, made anew from its values, as bytes may say anything.

    Raises ValueError or RequestError unless there is a command and every part of it is valid.
    """
    if match is None:
        raise ValueError("no command")
    name, options = (text.decode("ascii") for text in match.groups())
    words = options.split()
    given = dict(zip(words[::2], words[1::2], strict=True))
    known = DEFINITIONS[reading.choice(Entry(given.pop("--engine", ""), ""), tuple(DEFINITIONS))]
    settings = {key: given.pop(option(key)) for key in known.settings if option(key) in given}
    values = {key: float(text) if known.settings[key].is_positive else text for key, text in settings.items()}
    seeds = seed_text(parse_seeds(given.pop("--seeds", "")))
    particles = given.pop("--particles", None)
    parts = [f"brownpipe simulate {name}.yaml"]
    parts += [] if particles is None else [f"--particles {reading.integer(Entry(int(particles), ''), 0, MOST_DISKS)}"]
    parts += [f"--seeds {seeds} --engine {requested(known.name, values).options}"]
    for key, text in given.items():
        names = [reading.choice(Entry(word, ""), WORDS_OF.get(key, ())) for word in text.split(",")]
        parts.append(f"{key} {','.join(names)}")
    return seeds, " ".join(parts)
