"""The tracks of the disks of a run at T sample times, which engines return and observables use."""

from typing import NamedTuple

import numpy as np


class Track(NamedTuple):
    """The trajectories of M disks, sampled at T times."""

    position: np.ndarray  # (T, M, 2) centres, inside the box [length]
    velocity: np.ndarray | None = None  # (T, M, 2) [length/time]
    image: np.ndarray | None = None  # (T, M, 2) int32, periodic boxes: unwrapped = position + image * (width, height)

    def of(self, disks: np.ndarray | slice | int) -> "Track":
        """Return the tracks of some of the disks: indices or a mask (M,), a slice, or one index."""
        return Track(*(None if values is None else values[:, disks] for values in self))


class Run(NamedTuple):
    """The tracks of one run."""

    tracer: Track  # disk 0, M = 1
    whole: Track | None  # all disks, M = N; None if not recorded, see `needs_every_disk`
