"""The records that all engines share: the state of all disks, trajectories, collisions, and the ensemble of a batch.

All are in the scene's units and in the scene's order of the disks; the tracer is disk 0.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from brownpipe.observables.tracks import Track

NONE_STOPPED: Mapping[int, str] = MappingProxyType({})
HEALTH_BOUND = 1e-9  # a run with a larger energy drift, overlap or momentum residual has failed; round-off is far below


class State(NamedTuple):
    """All disks at one time."""

    position: np.ndarray  # (N, 2) centres [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    radius: np.ndarray  # (N,) [length]
    mass: np.ndarray  # (N,) [mass]


class Events(NamedTuple):
    """The E collisions of one run, in order of time."""

    time: np.ndarray  # (E,) [time]
    a: np.ndarray  # (E,) int32, the disk
    b: np.ndarray  # (E,) int32, the other disk, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2) given to disk a [mass length/time]


class Ensemble(NamedTuple):
    """What an engine returns for a batch of S seeds."""

    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) sample times [time]
    tracer: Track | None  # disk 0 of every run, M = S, if recorded
    observables: dict[str, np.ndarray]  # name -> (S, ...): one number or array per run
    whole: dict[int, Track]  # seed -> trajectories of all disks, M = N, if recorded
    events: dict[int, Events]  # seed -> collisions, if recorded
    average: str = "runs"  # what displacements and autocorrelations are averaged over, of observables.AVERAGES
    stopped: Mapping[int, str] = NONE_STOPPED  # seed -> why its run could not go on: failed, and without data

    @property
    def failed_seeds(self) -> np.ndarray:
        """The seeds (F,) of the runs that failed: stopped, or beyond the bounds of the health check."""
        return self.seeds[self.observables["failed"] > 0]


def blank(shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
    """Return an array for values that are not there: NaN, or 0 where the type has no NaN."""
    return np.full(shape, np.nan if np.dtype(dtype).kind == "f" else 0, dtype)


def together(arrays: Sequence[np.typing.ArrayLike]) -> np.ndarray:
    """Return arrays of one shape as one array with a first dimension for them; of a single array, a view."""
    return np.asarray(arrays[0])[None] if len(arrays) == 1 else np.array(arrays)
