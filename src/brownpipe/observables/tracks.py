"""What observables use of a run: the tracks of its disks at T sample times, as engines return them."""

from typing import Protocol

import numpy as np


class Track(Protocol):
    """The trajectories of M disks, as in `engines.state.Track`."""

    @property
    def position(self) -> np.ndarray: ...  # (T, M, 2) centres, inside the box [length]

    @property
    def velocity(self) -> np.ndarray: ...  # (T, M, 2) [length/time]

    @property
    def image(self) -> np.ndarray | None: ...  # (T, M, 2) int32 periodic images, None between walls


class Run(Protocol):
    """One run, as in `engines.batch.RunResult`."""

    @property
    def tracer(self) -> Track: ...  # disk 0, M = 1

    @property
    def whole(self) -> Track | None: ...  # all disks, M = N; None if not recorded, see `needs_every_disk`
