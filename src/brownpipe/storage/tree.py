"""Runs in memory as `xarray.DataTree`: what a trajectory file holds, with named dimensions, units and meanings.

/                        position (time, seed, component) of the tracer, and image in a periodic box;
                         worst_overlap (seed), ... and arrays of observables (seed, ...);
                         attributes scene (JSON), scene_name, particles, engine, settings (JSON), average,
                         source_digest, variables (JSON: the names of these)
disks/                   if recorded: position, velocity, image (time, seed, disk, component) of all disks;
                         radius, mass (disk)
events/seed_00017        if recorded: event_time, a, b (event), impulse (event, component) of this run
"""

import json
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.engines import recorded
from brownpipe.engines.state import Ensemble, Events, Track, blank
from brownpipe.errors import RequestError, StorageError
from brownpipe.observables import ARRAYS, AXES, axes
from brownpipe.scene import Scene, parse_scene
from brownpipe.storage.layout import MEANING
from brownpipe.storage.trajectories import Trajectories, refuse_sizes

if TYPE_CHECKING:
    from xarray import Dataset, DataTree, Variable

TRACER_DIMS = ("time", "seed", "component")
DISK_DIMS = ("time", "seed", "disk", "component")
BIN = {"velocity": "velocity_bin", "speed": "speed_bin"}  # dimensions of histograms; groups have variables `velocity`
LOG = {"event_time": "time", "a": "a", "b": "b", "impulse": "impulse"}  # variable: field of Events

PARTS = {*Track._fields, "stopped"}  # variables of the runs that are no observables

Columns = dict[str, tuple[tuple[str, ...], np.ndarray]]  # name: (dimensions, values)


def to_tree(trajectories: Trajectories) -> "DataTree":
    """Return runs as a tree. Arrays of the tracer and of observables are shared with it, tracks of all disks copied."""
    import xarray

    scene, engine, ensemble, source, _ = trajectories
    attributes = {
        "title": f"{scene.name}: {len(ensemble.seeds)} runs",
        "scene": scene.text,
        "scene_name": scene.name,
        "particles": scene.particles,
        "engine": engine.name,
        "settings": json.dumps(dict(engine.settings), sort_keys=True, allow_nan=False),
        "average": ensemble.average,
        "source_digest": source,
    }
    columns: Columns = {name: (("seed", *_dims(name)), values) for name, values in ensemble.observables.items()}
    if ensemble.stopped:
        reasons = [ensemble.stopped.get(seed, "") for seed in ensemble.seeds.tolist()]
        columns["stopped"] = (("seed",), np.array(reasons, object))
    arrays = [name for name in columns if name in ARRAYS]
    along = {BIN.get(dim, dim): values for name in arrays for dim, values in axes(scene, name).items()}
    along |= {"time": ensemble.times, "seed": ensemble.seeds, "component": ["x", "y"]}
    columns = _motion(TRACER_DIMS, ensemble.tracer) | columns
    root, attributes["variables"] = _scales(along) | _described(columns), json.dumps(sorted(columns))
    nodes = {"/": xarray.Dataset(root, attrs=attributes)}
    if ensemble.whole:
        absent = _without_values(next(iter(ensemble.whole.values())))
        tracks = zip(*(ensemble.whole.get(seed, absent) for seed in ensemble.seeds.tolist()), strict=True)
        track = Track(*(None if values[0] is None else np.stack(values, axis=1) for values in tracks))
        sizes = {"radius": (("disk",), scene.radius), "mass": (("disk",), scene.mass)}
        disks = _scales({"disk": np.arange(scene.particles)}) | _described(_motion(DISK_DIMS, track) | sizes)
        nodes["/disks"] = xarray.Dataset(disks)
    if ensemble.events:
        nodes["/events"] = xarray.Dataset(_described(_log(ensemble.events)))
    return xarray.DataTree.from_dict(nodes, name=scene.name)


def from_tree(tree: "DataTree", with_events: bool = True) -> Trajectories:
    """Return the runs of a tree that `to_tree` made, or of a selection of its seeds; without events if so asked.

    Variables that others have added are left out. Raises RequestError for any other tree.
    """
    import xarray

    if not isinstance(tree, xarray.DataTree):
        raise RequestError(f"runs: must be what simulate or open returns, not a {type(tree).__name__}")
    try:
        attributes, root = tree.attrs, tree.to_dataset()
        scene = parse_scene(json.loads(attributes["scene"]), f"{attributes['scene_name']}.yaml")
        engine = recorded({"name": attributes["engine"], **json.loads(attributes["settings"])})
        _refuse_part(scene, root)
        seeds = root.seed.values.tolist()
        own = [str(name) for name in root.data_vars if name in json.loads(attributes["variables"])]
        names = [name for name in own if name not in PARTS]
        observables = {name: root[name].transpose("seed", *_dims(name)).values for name in names}
        observables["failed"]  # every batch has it
        reasons = root["stopped"].values.tolist() if "stopped" in root else []
        stopped = {seed: reason for seed, reason in zip(seeds, reasons, strict=False) if reason}
        complete = [seed for seed in seeds if seed not in stopped]
        has_events = with_events and "events" in tree.children
        ensemble = Ensemble(
            seeds=root.seed.values,
            times=root.time.values,
            tracer=_track(root[own], TRACER_DIMS) if "position" in own else None,
            observables=observables,
            whole=_whole(scene, tree["disks"].to_dataset(), seeds, complete) if "disks" in tree.children else {},
            events=_events(tree["events"].to_dataset(), complete) if has_events else {},
            average=attributes["average"],
            stopped=stopped,
        )
        refuse_sizes(ensemble, scene)
        return Trajectories(scene, engine, ensemble, attributes["source_digest"])
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, RequestError, StorageError) as error:
        raise RequestError(
            f"runs: must be what simulate or open returns, or a selection of its seeds ({error})"
        ) from error


def refuse_foreign(tree: "DataTree") -> None:
    """Raise RequestError for a variable that a trajectory file has no place for."""
    own = {
        "/": {*json.loads(tree.attrs["variables"])},
        "/disks": {*Track._fields, "radius", "mass"},
        "/events": {"event_seed", *LOG},
    }
    foreign = [
        f"{node.path}/{name}".lstrip("/")
        for node in tree.subtree
        for name in ([*node.data_vars] if node.path in own else [""])
        if name not in own.get(node.path, ())
    ]
    if foreign:
        raise RequestError(
            f"data: a trajectory file has no place for {foreign[0]}; remove this variable, or save it apart"
        )


def _refuse_part(scene: Scene, root: "Dataset") -> None:
    """Raise ValueError for a selection of other things than seeds."""
    if "seed" not in root.dims:
        raise ValueError("without the dimension seed; select seeds by a list, as in sel(seed=[3])")
    if not root.sizes["seed"]:
        raise ValueError("no seed is selected")
    seeds = root.seed.values
    if seeds.dtype != np.int64 or seeds.min() < 0 or len(np.unique(seeds)) < len(seeds):
        raise ValueError("holds seeds that are negative or repeated, or not integers")
    if (
        "position" in root
        and not np.isfinite(root.position.transpose("seed", ...).values[root.failed.values == 0]).all()
    ):
        raise ValueError("holds positions that are not finite in a run that did not fail")
    if root.sizes["time"] != len(scene.times):
        samples = f"{root.sizes['time']} of its {len(scene.times)} samples"
        raise ValueError(f"{samples}; select times from the analysis instead")
    if (components := root.component.values.tolist()) != ["x", "y"]:
        raise ValueError(f"its components are {components}; must be x and y in this order")
    if scene.box.periodic and "position" in root and "image" not in root:
        raise ValueError("lacks image, which a periodic box needs")


def _dims(name: str) -> tuple[str, ...]:
    """Return the dimensions of an observable of one run."""
    return tuple(BIN.get(dim, dim) for dim in ARRAYS[name].dims) if name in ARRAYS else ()


def _scales(scales: dict) -> "dict[str, Variable]":
    """Return coordinates along dimensions of their names."""
    return _described({dim: ((dim,), np.asarray(values)) for dim, values in scales.items()})


def _described(values: Columns) -> "dict[str, Variable]":
    """Return variables with the units and the meaning that belong to their names."""
    import xarray

    arrays = {BIN.get(name, name): (each.units, each.long_name) for name, each in (AXES | ARRAYS).items()}
    known = arrays | MEANING | {f"event_{name}": MEANING[name] for name in ("time", "seed")}
    meanings = {name: dict(zip(("units", "long_name"), known.get(name, ("1", name)), strict=True)) for name in values}
    return {name: xarray.Variable(dims, array, meanings[name]) for name, (dims, array) in values.items()}


def _motion(dims: tuple[str, ...], track: Track | None) -> Columns:
    """Return position, velocity and image with their dimensions, as far as they are recorded."""
    recorded_arrays = {} if track is None else track._asdict()
    return {name: (dims, values) for name, values in recorded_arrays.items() if values is not None}


def _track(dataset: "Dataset", dims: tuple[str, ...]) -> Track:
    return Track(*(dataset[name].transpose(*dims).values if name in dataset else None for name in Track._fields))


def _log(events: dict[int, Events]) -> Columns:
    """Return the collisions of all runs, one after the other."""
    joined = {"event_seed": np.repeat(list(events), [len(log.time) for log in events.values()])}
    joined |= {name: np.concatenate([getattr(log, field) for log in events.values()]) for name, field in LOG.items()}
    return {name: (("event", "component")[: values.ndim], values) for name, values in joined.items()}


def _without_values(track: Track) -> Track:
    """Return a track of the same shape for a run that could not go on."""
    return Track(*(None if values is None else blank(values.shape, values.dtype) for values in track))


def _whole(scene: Scene, dataset: "Dataset", seeds: list[int], complete: list[int]) -> dict[int, Track]:
    if dataset.disk.values.tolist() != list(range(scene.particles)):
        raise ValueError("lacks disks, or has them in another order")
    track, columns = _track(dataset, DISK_DIMS), {seed: column for column, seed in enumerate(seeds)}
    return {seed: track.of(columns[seed]) for seed in complete}


def _events(dataset: "Dataset", seeds: list[int]) -> dict[int, Events]:
    """Return the collisions of each run, in the order in which they are listed."""
    order = np.argsort(dataset.event_seed.values, kind="stable")
    listed = dataset.event_seed.values[order]
    first, end = (np.searchsorted(listed, seeds, side).tolist() for side in ("left", "right"))
    columns = [dataset[name].transpose("event", ...).values[order] for name in LOG]
    return {
        seed: Events(*(column[begin:stop].copy() for column in columns))
        for seed, begin, stop in zip(seeds, first, end, strict=True)
    }
