"""Trajectory files: one batch of seeds of one scene, by one engine."""

import json
import re
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from brownpipe.engines import Engine, recorded
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.observables import ARRAYS, AXES
from brownpipe.provenance import simulation_of, source_digest, versions
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage import arrays
from brownpipe.storage.files import BLANK_SEAL, read_sealed, seal, write_file
from brownpipe.storage.hdf5 import Link, Node, digest, from_bytes, some_from_bytes, to_bytes

FORMAT = 1
OUTLINE = (  # what an outline is made of
    "parameters",
    "parameters/scene",
    "parameters/settings",
    "observables/run/seed",
    "particles/tracer",
    "particles/tracer/position/time",
    "observables/run/time",
)
TIME_FIRST = (2, 0, 1)  # a chunk of (T, S, 2) spans all times of a few runs

MEANING = {
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
    "a": ("1", "disk that collides"),
    "b": ("1", "its partner: a disk, or wall -1 left, -2 right, -3 bottom, -4 top"),
    "impulse": ("mass*length/time", "momentum given to a"),
    "pair_collisions": ("1", "collisions between disks"),
    "wall_collisions": ("1", "collisions of disks with walls"),
    "tracer_collisions": ("1", "collisions of the tracer with disks"),
    "energy_drift": ("1", "relative change of the kinetic energy over the run"),
    "worst_overlap": ("1", "deepest overlap seen, in contact distances"),
    "momentum_residual": ("1", "relative error of momentum change plus impulse given to the walls"),
    "kinetic_energy": ("energy", "kinetic energy at t = 0, conserved; NaN if no floating-point number in these units"),
    "virial": ("energy*time", "sum of abs(momentum transfer) * contact distance over the pair collisions of the run"),
    "wall_impulse": ("mass*length/time", "sum of abs(momentum transfer) over the wall collisions of the run"),
    "missed_collisions": ("1", "collisions missed because the pair met and separated within one time step"),
    "friction_rate": ("1/time", "friction rate gamma of the tracer, dv/dt = -gamma v + noise"),
    "initial_square_speed": ("length^2/time^2", "squared speed of the tracer at t = 0"),
    "failed": ("1", "1 if overlap or energy drift passed its bound, or a number is not finite: not to be averaged in"),
    "scene": ("1", "the scene as canonical JSON"),
    "settings": ("1", "settings of the engine as JSON"),
}


class Trajectories(NamedTuple):
    """What a trajectory file holds."""

    scene: Scene
    engine: Engine
    ensemble: Ensemble
    source: str = ""  # digest of the source that made the runs


class Outline(NamedTuple):
    """What a trajectory file is about: all but the runs themselves."""

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,)
    times: np.ndarray  # (T,)
    tracer: bool  # whether it has the tracks of the tracer
    source: str
    average: str = "runs"  # as in Ensemble


def write_trajectories(path: str | Path, scene: Scene, engine: Engine, ensemble: Ensemble) -> None:
    """Write one batch of runs; layout in `brownpipe.storage`.

    Raises StorageError if the file cannot be written or does not read back as what was given.
    """
    nodes = _layout(Trajectories(scene, engine, ensemble))
    expected = digest(nodes)
    nodes["parameters"].attributes.update(contents_digest=expected, seal=BLANK_SEAL)
    image = seal(to_bytes(nodes))
    if digest(from_bytes(image)) != expected:
        raise StorageError(f"{path}: not written: HDF5 gives back other numbers; check memory and the HDF5 library")
    write_file(path, image)


def read_trajectories(path: str | Path) -> Trajectories:
    """The Trajectories in the file at `path`, after every byte is verified.

    Raises StorageError naming the file, the seeds concerned and how to make the file again.
    """
    with _naming(path):
        return _trajectories(_contents(path))


def read_outline(path: str | Path) -> Outline:
    """The Outline of the file at `path`. Every byte is verified, but no track unpacked.

    Raises StorageError like `read_trajectories`.
    """
    with _naming(path):
        nodes = some_from_bytes(read_sealed(path), OUTLINE)
        parameters = _parameters_of(nodes)
        scene, engine = _scene_and_engine(nodes)
        times = nodes.get("particles/tracer/position/time", nodes.get("observables/run/time"))
        return Outline(
            scene,
            engine,
            nodes["observables/run/seed"].value,
            scene.times if times is None else times.value,
            "particles/tracer" in nodes,
            parameters["source_digest"],
            parameters.get("average", "runs"),
        )


def read_header(path: str | Path) -> dict:
    """The attributes of /parameters: names, versions and digests. Verified, with errors, like `read_trajectories`."""
    with _naming(path):
        return _contents(path)["parameters"].attributes


# Layout: what goes where


def _layout(trajectories):
    scene, ensemble = trajectories.scene, trajectories.ensemble
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
    return nodes | _parameters(trajectories)


def _header():
    return {
        "h5md": Node(None, {"version": np.array([1, 1])}),
        "h5md/author": Node(None, {"name": "brownpipe"}),
        "h5md/creator": Node(None, {"name": "brownpipe", "version": versions()["brownpipe_version"]}),
        "particles": Node(None, {}),
    }


def _dataset(name, value, dims=(), chunk_axes=None):
    units, long_name = MEANING.get(name, ("1", name.replace("_", " ")))
    return Node(value, {"units": units, "long_name": long_name}, dims, chunk_axes)


def _particles(group, scene, times, track, dim, ids):
    """One H5MD particles group; the elements share their steps and scales."""
    nodes = {group: Node(None, {})} | _box(f"{group}/box", scene.box)
    nodes[f"{group}/id"] = _dataset(dim, ids, ("id",))
    first = {"time": _dataset("time", times, ("time",)), dim: _dataset(dim, ids, (dim,))}
    first |= {"component": Link(f"{group}/box/component"), "step": _dataset("step", np.arange(len(times)), ("time",))}
    again = {name: Link(f"{group}/position/{name}") for name in first}
    axes = TIME_FIRST if dim == "seed" else None
    for element, value in track._asdict().items():
        if value is None:
            continue
        nodes[f"{group}/{element}"] = Node(None, {})
        for name, node in (first if element == "position" else again).items():
            nodes[f"{group}/{element}/{name}"] = node
        nodes[f"{group}/{element}/value"] = _dataset(element, value, ("time", dim, "component"), axes)
    return nodes


def _box(group, box):
    boundary = "periodic" if box.periodic else "none"
    return {
        group: Node(None, {"dimension": 2, "boundary": [boundary, boundary]}),
        f"{group}/component": _components(),
        f"{group}/edges": _dataset("edges", np.array([box.width, box.height]), ("component",)),
        f"{group}/origin": _dataset("origin", np.array(box.origin), ("component",)),
    }


def _components():
    return _dataset("component", np.array(["x", "y"], h5py.string_dtype()), ("component",))


def _observables(scene, ensemble):
    group = "observables/run"
    nodes = {
        "observables": Node(None, {}),
        group: Node(None, {}),
        f"{group}/seed": _dataset("seed", ensemble.seeds, ("seed",)),
    }
    for name, value in ensemble.observables.items():
        if name not in ARRAYS:
            nodes[f"{group}/{name}"] = _dataset(name, value, ("seed",))
    nodes |= arrays.layout(group, scene, ensemble)
    if ensemble.events:
        nodes["observables/events"] = Node(None, {})
    return nodes


def _events(group, events):
    nodes = {group: Node(None, {}), f"{group}/component": _components()}
    for name, value in events._asdict().items():
        nodes[f"{group}/{name}"] = _dataset(name, value, ("time", "component")[: value.ndim])
    return nodes


def _parameters(trajectories):
    scene, engine, ensemble = trajectories[:3]
    names = {
        "format": FORMAT,
        "scene_name": scene.name,
        "particles": scene.particles,
        "engine": engine.name,
        "seeds": seed_text(ensemble.seeds),
        "average": ensemble.average,
        "rerun": _command(scene, engine, ensemble),
        "source_digest": source_digest(simulation_of(engine.name)),
    }
    return {
        "parameters": Node(None, names | versions()),
        "parameters/scene": _dataset("scene", scene.text),
        "parameters/settings": _dataset("settings", json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False)),
    }


def _command(scene, engine, ensemble):
    """What makes these runs again; found in the raw bytes of a broken file by its backquotes."""
    particles = f" --particles {scene.particles}" if scene.species else ""
    words = ["all"] * bool(ensemble.whole) + ["events"] * bool(ensemble.events)
    nothing = ["none"] * (ensemble.tracer is None and scene.particles > 0)
    record = f" --record {','.join(words or nothing)}" if words or nothing else ""
    seeds = f" --seeds {seed_text(ensemble.seeds)}"
    observables = arrays.command_options(ensemble)
    return f"`brownpipe simulate {scene.name}.yaml{particles}{seeds} --engine {engine.options}{record}{observables}`"


# Reading


def _contents(path):
    """The verified nodes of a trajectory file."""
    nodes = from_bytes(read_sealed(path))
    if _parameters_of(nodes)["contents_digest"] != digest(nodes):
        raise StorageError("HDF5 gives back other numbers than were written; check memory and the HDF5 library")
    return nodes


def _parameters_of(nodes):
    """The attributes of /parameters, if the nodes are of a trajectory file that this brownpipe reads."""
    if "parameters" not in nodes:
        raise WrongFileError("is a file of brownpipe, but not a trajectory file (of `brownpipe simulate`)")
    attributes = nodes["parameters"].attributes
    if attributes["format"] > FORMAT:
        raise StorageError(f"has format {attributes['format']}; this brownpipe reads up to {FORMAT}: upgrade it")
    return attributes


def _scene_and_engine(nodes):
    parameters = nodes["parameters"].attributes
    settings = json.loads(nodes["parameters/settings"].value)
    try:
        scene = parse_scene(json.loads(nodes["parameters/scene"].value), f"{parameters['scene_name']}.yaml")
        return scene, recorded({"name": parameters["engine"], **settings})
    except RequestError as error:
        raise StorageError(f"is of brownpipe {parameters['brownpipe_version']}, not of this one: {error}") from error


def _trajectories(nodes):
    parameters = nodes["parameters"].attributes
    scene, engine = _scene_and_engine(nodes)
    ensemble = _ensemble(nodes, scene)._replace(average=parameters.get("average", "runs"))
    return Trajectories(scene, engine, ensemble, parameters["source_digest"])


def _ensemble(nodes, scene):
    run = {name: value for name, value in _children(nodes, "observables/run").items() if name not in AXES}
    seeds = run.pop("seed")
    whole = {_seed(name): _track(nodes, f"particles/{name}") for name in _runs(nodes, "particles")}
    events = _runs(nodes, "observables/events")
    events = {_seed(name): _read_events(nodes, f"observables/events/{name}") for name in events}
    tracer = _track(nodes, "particles/tracer") if "particles/tracer" in nodes else None
    places = ("/position/time", "observables/run/time")
    times = next((node.value for path, node in nodes.items() if path.endswith(places)), scene.times)
    return Ensemble(seeds=seeds, times=times, tracer=tracer, observables=run, whole=whole, events=events)


def _children(nodes, group):
    return {path.rpartition("/")[2]: node.value for path, node in nodes.items() if path.rpartition("/")[0] == group}


def _runs(nodes, group):
    return sorted((name for name in _children(nodes, group) if name.startswith("seed_")), key=_seed)


def _seed(name):
    return int(name.removeprefix("seed_"))


def _track(nodes, group):
    values = (nodes.get(f"{group}/{name}/value") for name in Track._fields)
    return Track(*(node and node.value for node in values))


def _read_events(nodes, group):
    return Events(*(nodes[f"{group}/{name}"].value for name in Events._fields))


@contextmanager
def _naming(path):
    """Give an error the name of the file and, if it is broken, the cure."""
    try:
        yield
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except StorageError as error:
        raise StorageError(f"{path}: {error}; {_cure(path)}") from error


def _cure(path):
    """How to make a broken file again, as far as it can tell: HDF5 is not trusted with it."""
    try:
        found = re.search(rb"`(brownpipe simulate [^`]* --seeds ([0-9,-]+)[^`]*)`", Path(path).read_bytes())
    except OSError:
        return "check that it is there and can be read"
    if found is None:
        return "if brownpipe wrote it, delete it and rerun snakemake or brownpipe simulate"
    command, seeds = (text.decode(errors="replace") for text in found.groups())
    return f"seeds {seeds} are lost: delete it and rerun snakemake, or rerun {command} --output {path}"
