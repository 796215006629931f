"""Where the disks are: the initial state of a run, and the records that engines hand back."""

from typing import NamedTuple

import numpy as np

HEALTH_BOUND = 1e-9  # energy drift, overlap and momentum residual beyond which a run has failed; round-off is far below


class State(NamedTuple):
    """All disks at one time."""

    position: np.ndarray  # (N, 2) centres [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    radius: np.ndarray  # (N,) [length]
    mass: np.ndarray  # (N,)


class Track(NamedTuple):
    """Where M disks were at T sample times."""

    position: np.ndarray  # (T, M, 2) centres, inside the box [length]
    velocity: np.ndarray | None = None  # (T, M, 2)
    image: np.ndarray | None = None  # (T, M, 2) int32, periodic boxes: unwrapped = position + image * (width, height)


class Events(NamedTuple):
    """Every collision of one run, in order."""

    time: np.ndarray  # (E,)
    a: np.ndarray  # (E,) int32, the disk
    b: np.ndarray  # (E,) int32, the other disk, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2), given to a [mass length/time]


class Ensemble(NamedTuple):
    """What an engine returns for a batch of S seeds."""

    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) sample times
    tracer: Track | None  # disk 0 of every run, M = S
    observables: dict[str, np.ndarray]  # name -> (S, ...): one number or array per run
    whole: dict[int, Track]  # seed -> all disks of that run, M = N, where asked for
    events: dict[int, Events]  # seed -> its collisions, where asked for
    average: str = "runs"  # what displacements and autocorrelations among the observables are averages over
