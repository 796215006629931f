"""The records of an observable: the tracks that it is measured from, the arrays that it yields, its
cost.

T sample times, N disks, of which the tracer is the first.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from brownpipe.scene import Scene


class Track(NamedTuple):
    """The trajectories of M disks of a run, sampled at T times, which engines return."""

    position: np.ndarray  # (T, M, 2) centres, inside the box [length]
    velocity: np.ndarray | None = None  # (T, M, 2) [length/time]
    # (T, M, 2) int32, periodic boxes: unwrapped = position + image * (width, height)
    image: np.ndarray | None = None

    def of(self, disks: np.ndarray | slice | int) -> "Track":
        """Return the tracks of some of the disks: indices or a mask (M,), a slice, or one index."""
        return Track(*(None if values is None else values[:, disks] for values in self))

    def at_end(self) -> "Track":
        """Return the tracks at the last sample, T = 1."""
        return Track(*(None if values is None else values[-1:] for values in self))


class Events(NamedTuple):
    """The E collisions of one run, in order of time."""

    time: np.ndarray  # (E,) [time]
    a: np.ndarray  # (E,) int32, the disk
    b: np.ndarray  # (E,) int32, the other disk, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2) given to disk a [mass length/time]


class Run(NamedTuple):
    """One run. Arrays of the tracer's track may be overwritten by the next run."""

    tracer: Track  # disk 0, M = 1
    whole: Track | None  # all disks, M = N; None if not recorded, see `needs_every_disk`
    events: Events | None = None  # if recorded
    # what the engine itself reports, like numbers of collisions
    observables: Mapping[str, Any] = MappingProxyType({})


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


class Observable(NamedTuple):
    """An observable; forecasts (`engines.forecast`) add up its CPU seconds, good to a factor of
    2.
    """

    # (scene, track, average): values by array
    measure: Callable[[Scene, Track, str], Mapping[str, np.ndarray]]
    arrays: dict[str, RunArray]  # by name; the first is measured in every scene
    # CPU seconds for each disk in each sample, or each pair of samples of an average
    seconds_per_disk_sample: float
    # Whose tracks it needs: the tracer's alone (all AVERAGES apply), the bath's (which may be
    # averaged over origins) or those of all disks; for the last two the track has all disks
    of: Literal["tracer", "bath", "all"] = "all"
    axes: Mapping[str, Axis] = MappingProxyType({})  # the dimensions that are its own, by name
    # its track has all samples of a stationary scene, otherwise the last one alone
    is_over_samples: bool = False
    # in this scene, as those CPU seconds
    times_as_long: Callable[[Scene], float] = lambda scene: 1.0
    # bytes that it takes while it is measured, besides its tracks and arrays
    working_memory: Callable[[Scene], float] = lambda scene: 0.0
    # why the scene cannot have it, None if it can
    unfit: Callable[[Scene], str | None] = lambda scene: None


def counted_bins(end: float, width: float) -> tuple[int, float]:
    """Return the number of whole bins of a width from 0 to an end, despite round-off, and the
    width; 0 if none fits.
    """
    return max(0, int(end / width * (1 + 1e-12))), width


def centres(number: int, width: float) -> np.ndarray:
    """Return the centres (number,) of bins from 0 on."""
    return (np.arange(number) + 0.5) * width
