"""Whether the arrays of a trajectory file fit its scene, seeds and sample times; their sizes before any is decoded."""

import math

import h5py
import numpy as np

from brownpipe.engines.state import Ensemble, Events
from brownpipe.errors import StorageError
from brownpipe.observables import ARRAYS, AVERAGES, AXES, axes
from brownpipe.observables.pairs import MOST_SPECIES
from brownpipe.observables.tracks import Track
from brownpipe.scene import Scene
from brownpipe.storage.admission import Items

MOST_UNKNOWN = 2**26  # bytes of all datasets that this version does not know
MOST_EXPANSION_OF_TIMES = 30  # times of collisions are hardly compressed; their number is not known otherwise
SAME_TIME = 1e-9  # relative; round-off of the sample times in files of earlier versions
SCALES = {"time": "time", "step": "time", "seed": "seed", "disk": "disk", "component": "component"}
OF_BOX = {"edges", "origin", "component"}
OF_DISKS = {"id", "radius", "mass"}


def refuse_sizes(items: Items, scene: Scene, runs: int) -> None:
    """Raise StorageError for a dataset whose shape is not that of its place in a file of so many runs of the scene."""
    sizes = {"time": len(scene.times), "seed": runs, "disk": scene.particles, "component": 2}
    unknown = 0
    for path, item in items.items():
        if not isinstance(item, h5py.Dataset):
            continue
        shape = _shape(path, scene, sizes)
        if shape is None:
            unknown += math.prod(item.shape) * item.dtype.itemsize
        elif item.shape != shape:
            raise StorageError(f"holds {_named(path)} of shape {item.shape}; its scene and seeds make it {shape}")
    logs = {path.rpartition("/")[0] for path in items if path.startswith("observables/events/seed_")}
    unknown -= sum(_size_of_log(items, group) for group in logs - {"observables/events"})
    if unknown > MOST_UNKNOWN:
        raise StorageError("declares more data than its runs have")


def _named(path: str) -> str:
    return path if len(path) <= 80 else f"{path[:77]}..."


def _size_of_log(items: Items, group: str) -> int:
    """Return the bytes of the collisions of a run; raise StorageError if its arrays differ in length."""
    arrays = [items.get(f"{group}/{name}") for name in Events._fields]
    if not all(isinstance(array, h5py.Dataset) and array.shape for array in arrays):
        raise StorageError(f"lacks arrays of the collisions ({_named(group)})")
    time, *others = arrays
    shapes = [array.shape for array in others]
    if shapes != [time.shape, time.shape, (*time.shape, 2)] or time.ndim != 1:
        raise StorageError(f"holds arrays of different length for the collisions ({_named(group)})")
    if time.nbytes > MOST_EXPANSION_OF_TIMES * time.id.get_storage_size() + MOST_UNKNOWN // 64:
        raise StorageError(f"declares more collisions than it stores ({_named(group)})")
    return sum(array.nbytes for array in arrays)


def _shape(path: str, scene: Scene, sizes: dict[str, int]) -> tuple[int, ...] | None:
    """Return the shape of the dataset at a path, None if it is not known."""
    match path.split("/"):
        case ["particles", _, "box", name] if name in OF_BOX:
            return (2,)
        case ["particles", group, name] if name in OF_DISKS:
            return (sizes["seed" if group == "tracer" else "disk"],)
        case ["particles", group, element, "value"] if element in Track._fields:
            return sizes["time"], sizes["seed" if group == "tracer" else "disk"], 2
        case ["particles", _, element, scale] if element in Track._fields and scale in SCALES:
            return (sizes[SCALES[scale]],)
        case ["observables", "run", name] if name in AXES and name != "time":
            return None  # short, and shown by nobody
        case ["observables", "run", name] if name in ARRAYS:
            if ARRAYS[name].dims[:1] == ("species_pair",) and len(scene.disks or scene.species) > MOST_SPECIES:
                raise StorageError(f"holds {name} of more species than can have it")
            return sizes["seed"], *(len(values) for values in axes(scene, name).values())
        case ["observables", "run", name]:
            return (sizes["time" if name == "time" else "seed"],)
        case ["parameters", "scene" | "settings"]:
            return ()
    return None


def refuse_axes(seeds: np.ndarray, times: np.ndarray, average: str, scene: Scene) -> None:
    """Raise StorageError for seeds, sample times [time] or an average that no runs of the scene have."""
    _refuse_type("seeds", seeds, "i", 8)
    if seeds.ndim != 1 or not seeds.size or seeds.min() < 0 or len(np.unique(seeds)) < len(seeds):
        raise StorageError("holds seeds that are negative or repeated, or none")
    _refuse_type("sample times", times, "f", 8)
    if times.shape != scene.times.shape or not np.allclose(times, scene.times, rtol=SAME_TIME, atol=0.0):
        raise StorageError("holds other sample times than those of its scene")
    if average not in AVERAGES:
        raise StorageError("says of its observables that they are averages over something unknown")


def refuse_values(ensemble: Ensemble, scene: Scene) -> None:
    """Raise StorageError for arrays of other types than the engines make, and for numbers that cannot be there.

    Those are what `refuse_axes` refuses, tracks and collisions of other runs, numbers that are not finite in tracks of
    runs that did not fail, and collisions of disks that the scene does not have.
    """
    refuse_axes(ensemble.seeds, ensemble.times, ensemble.average, scene)
    seeds, observables = ensemble.seeds, ensemble.observables
    for name, values in observables.items():
        _refuse_type(name, values, "iuf")
        if np.isinf(values).any():  # engines store NaN in place of what overflows
            raise StorageError(f"holds infinite numbers ({name})")
    failed = observables.get("failed")
    if failed is None or not np.isin(failed, (0, 1)).all():
        raise StorageError("does not say which runs failed")
    finite = failed == 0
    if ensemble.tracer is not None:
        _refuse_track("tracer", ensemble.tracer if finite.all() else ensemble.tracer.of(finite))
    kept = set(seeds[finite].tolist())
    if not (ensemble.whole.keys() | ensemble.events.keys()) <= set(seeds.tolist()):
        raise StorageError("holds tracks or collisions of a seed that is not among its runs")
    for seed, track in ensemble.whole.items():
        _refuse_track(f"disks of seed {seed}", track if seed in kept else track.of(slice(0)))
    for seed, events in ensemble.events.items():
        _refuse_events(seed, events, scene)


def _refuse_type(name: str, values: object, kinds: str, size: int | None = None) -> None:
    """Raise StorageError unless the values are an array of numbers of these kinds and, if given, so many bytes each."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds or size not in (None, values.itemsize):
        raise StorageError(f"holds values of another type than brownpipe writes ({name})")


def _refuse_track(name: str, track: Track) -> None:
    _refuse_type(f"position of the {name}", track.position, "f", 8)
    if track.velocity is not None:
        _refuse_type(f"velocity of the {name}", track.velocity, "f", 8)
    if track.image is not None:
        _refuse_type(f"image of the {name}", track.image, "i", 4)
    if not all(np.isfinite(values).all() for values in (track.position, track.velocity) if values is not None):
        raise StorageError(f"holds numbers that are not finite in a run that did not fail ({name})")


def _refuse_events(seed: int, events: Events, scene: Scene) -> None:
    name, most = f"collisions of seed {seed}", max(scene.particles, 1)
    for values in (events.time, events.impulse):
        _refuse_type(name, values, "f", 8)
    for disks in (events.a, events.b):
        _refuse_type(name, disks, "i", 4)
        if disks.size and (disks.min() < -4 or disks.max() >= most):
            raise StorageError(f"holds numbers of disks that its scene does not have ({name})")
