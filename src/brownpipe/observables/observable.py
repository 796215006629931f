"""The record of an observable: how it is measured, its arrays, the scenes that it fits, the CPU time that it takes."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from brownpipe.observables.tracks import Run
from brownpipe.scene import Scene


class Axis(NamedTuple):
    """Description of a dimension of arrays."""

    units: str
    long_name: str
    coordinates: Callable[[Scene], np.ndarray | list[str]]  # along it in a scene: numbers, or names of species


class RunArray(NamedTuple):
    """Description of an array that is measured in every run."""

    dims: tuple[str, ...]  # names in AXES, or one's own; in files the dimension of the runs, `seed`, comes first
    units: str
    long_name: str
    averaged: bool = False  # whether its average over runs is of interest as it is, and a variable of datasets
    # Of an array that a user's own function measures (`own`); a file has it as JSON
    shape: tuple[int, ...] = ()
    observable: str = ""  # my_module:my_function
    source: str = ""  # SHA-256 of its module


class Observable(NamedTuple):
    """An observable; forecasts (`engines.forecast`) add up its CPU seconds, good to a factor of 2."""

    measure: Callable[[Scene, Run, str], Mapping[str, np.ndarray | int]]  # (scene, run, average) -> values by array
    arrays: dict[str, RunArray]  # by name; the first is measured in every scene
    seconds_per_disk_sample: float  # CPU seconds for each disk in each sample, or each pair of samples of an average
    # Whose tracks it is made from: those of the tracer alone, to which all AVERAGES apply, of the bath, which may be
    # averaged over origins, or of all disks
    of: Literal["tracer", "bath", "all"] = "all"
    axes: Mapping[str, Axis] = MappingProxyType({})  # the dimensions that are its own, by name
    is_over_samples: bool = False  # counted or averaged over the samples of a stationary scene, otherwise the last one
    unfit: Callable[[Scene], str | None] = lambda scene: None  # why the scene cannot have it, None if it can
