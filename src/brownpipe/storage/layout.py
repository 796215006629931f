"""The groups and datasets of a trajectory file, as H5MD names them; they are drawn in `brownpipe.storage`."""

import json
from typing import Any

import h5py
import numpy as np

from brownpipe.engines import Engine
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.observables import ARRAYS, AXES, axes
from brownpipe.provenance import versions
from brownpipe.scene import Box, Scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.hdf5 import Link, Node, Nodes
from brownpipe.storage.rerun import rerun

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


def run_nodes(scene: Scene, ensemble: Ensemble) -> Nodes:
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


def _header() -> Nodes:
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


def _particles(group: str, scene: Scene, times: np.ndarray, track: Track, dim: str, ids: np.ndarray) -> Nodes:
    """Return a particles group of H5MD; `ids` are the values along `dim`, the dimension of the particles.

    All elements (position, velocity, image) have the same steps and scales: those of the position, linked.
    """
    nodes = {group: Node(None, {})} | _box(f"{group}/box", scene.box)
    nodes[f"{group}/id"] = _dataset(dim, ids, ("id",))
    scales: Nodes = {"time": _dataset("time", times, ("time",)), dim: _dataset(dim, ids, (dim,))}
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


def _box(group: str, box: Box) -> Nodes:
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


def _observables(scene: Scene, ensemble: Ensemble) -> Nodes:
    """Return one number per run, and arrays, of every observable."""
    group = "observables/run"
    nodes: Nodes = {
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
    nodes |= _arrays(group, scene, ensemble)
    if ensemble.events:
        nodes["observables/events"] = Node(None, {})
    return nodes


def _arrays(group: str, scene: Scene, ensemble: Ensemble) -> Nodes:
    """Return the arrays of observables (S, ...) and their scales; the times are those of the ensemble."""
    arrays = {name: ARRAYS[name] for name in ensemble.observables if name in ARRAYS}
    scales = {dim: values for name in arrays for dim, values in axes(scene, name).items()}
    nodes: Nodes = {}
    for dim, values in scales.items():
        values = np.array(values, h5py.string_dtype()) if isinstance(values, list) else values
        attributes = {"units": AXES[dim].units, "long_name": AXES[dim].long_name}
        nodes[f"{group}/{dim}"] = Node(ensemble.times if dim == "time" else values, attributes, (dim,))
    for name, array in arrays.items():
        attributes = {"units": array.units, "long_name": array.long_name}
        nodes[f"{group}/{name}"] = Node(ensemble.observables[name], attributes, ("seed", *array.dims))
    return nodes


def _events(group: str, events: Events) -> Nodes:
    nodes: Nodes = {group: Node(None, {}), f"{group}/component": _components()}
    for name, value in events._asdict().items():
        nodes[f"{group}/{name}"] = _dataset(name, value, ("time", "component")[: value.ndim])
    return nodes


def parameter_nodes(scene: Scene, engine: Engine, ensemble: Ensemble, source: str, digest: str) -> dict[str, Node]:
    """Return the group /parameters: scene, engine, versions, and the commands that make the runs again."""
    attributes = {
        "scene_name": scene.name,
        "particles": scene.particles,
        "engine": engine.name,
        "seeds": seed_text(ensemble.seeds),
        "average": ensemble.average,
        "rerun": rerun(scene, engine, ensemble),
        "source_digest": source,
        "runs_digest": digest,
    }
    return {
        "parameters": Node(None, attributes | versions()),
        "parameters/scene": _dataset("scene", scene.text),
        "parameters/settings": _dataset("settings", json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False)),
    }
