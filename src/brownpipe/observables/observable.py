"""The records of an observable: the arrays that it yields from tracks of a run, and its cost."""

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from brownpipe.observables.trajectory import DiskPath, Track
from brownpipe.scene import Scene


class Axis(NamedTuple):
    """Description of a dimension of arrays."""

    units: str
    long_name: str
    # along it in a scene: numbers, or names of species
    coordinates: Callable[[Scene], np.ndarray | list[str]]


class RunArray(NamedTuple):
    """Description of an array that is measured in every run."""

    # names in AXES, or the user's own; in files the dimension of the runs, `seed`, comes first
    dims: tuple[str, ...]
    units: str
    long_name: str
    # whether its average over runs is of interest as it is, and a variable of datasets
    averaged: bool = False
    # Of an array that a user's own function measures (`own`); a file has it as JSON
    shape: tuple[int, ...] = ()
    observable: str = ""  # my_module:my_function
    source: str = ""  # what tells it from others: SHA-256 of its module
    # of a coordinate of the user's own, which is along the dimension of its name
    coordinates: tuple[float, ...] = ()


class Observable(NamedTuple):
    """An observable; forecasts (`engines.forecast`) add up its CPU seconds, good to a factor of
    2.
    """

    # (scene, track, average): values by array
    measure: Callable[[Scene, Track, str], Mapping[str, np.ndarray]]
    arrays: dict[str, RunArray]  # by name; the first is measured in every scene
    # CPU seconds for each disk in each sample, without averages over time origins
    seconds_per_disk_sample: float
    # of the tracer alone (all AVERAGES apply), of the bath (which may be averaged over origins) or
    # of all disks; for the last two the track has all disks; or the exact path of the tracer
    tracks_needed: Literal["tracer", "bath", "all", "path"] = "all"
    # (scene, path of the tracer): values by array, in place of `measure` where a path is needed
    measure_path: Callable[[Scene, DiskPath], Mapping[str, np.ndarray]] | None = None
    axes: Mapping[str, Axis] = MappingProxyType({})  # the dimensions that are its own, by name
    # its track has all samples of a stationary scene, otherwise the last one alone
    is_over_samples: bool = False
    # CPU seconds in this scene over those above
    relative_cost: Callable[[Scene], float] = lambda scene: 1.0
    # bytes that it takes while it is measured, besides its tracks and arrays
    working_memory: Callable[[Scene], float] = lambda scene: 0.0
    # names of arrays over time that are not measured in this scene
    absent: Callable[[Scene], Collection[str]] = lambda scene: ()
    # why the scene cannot have it, None if it can
    why_unfit: Callable[[Scene], str | None] = lambda scene: None


def only_where_axes_differ(*names: str) -> Callable[[Scene], Collection[str]]:
    """Return `Observable.absent` for arrays along x and y that are measured where walls make the
    motion along them differ.
    """
    return lambda scene: () if scene.box.axes_differ else names


def counted_bins(end: float, width: float) -> tuple[int, float]:
    """Return the number of whole bins of a width from 0 to an end, despite round-off, and the
    width; 0 if none fits.
    """
    return max(0, int(end / width * (1 + 1e-12))), width


def centres(number: int, width: float) -> np.ndarray:
    """Return the centres (number,) of bins from 0 on."""
    return (np.arange(number) + 0.5) * width
