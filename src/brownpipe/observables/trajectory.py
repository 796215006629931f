"""The trajectory of a run, as engines return it: the tracks of its disks and its collisions.

T sample times, N disks, of which the tracer is the first.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.scene import Scene


class Track(NamedTuple):
    """The trajectories of M disks of a run, sampled at T times, which engines return."""

    position: np.ndarray  # (T, M, 2) centres, inside the box [length]
    velocity: np.ndarray | None = None  # (T, M, 2) [length/time]
    # (T, M, 2) int32, periodic sides: unwrapped = position + image * (width, height)
    image: np.ndarray | None = None

    def select(self, disks: np.ndarray | slice | int) -> "Track":
        """Return the tracks of some of the disks: indices or a mask (M,), a slice, or one index."""
        return self.transformed(lambda values: values[:, disks])

    def transformed(self, change: Callable[[np.ndarray], np.ndarray]) -> "Track":
        """Return the tracks with this change of each of their arrays."""
        velocity = None if self.velocity is None else change(self.velocity)
        image = None if self.image is None else change(self.image)
        return Track(change(self.position), velocity, image)

    @property
    def disks(self) -> int:
        """Their number M."""
        return self.position.shape[1]

    @property
    def known_velocity(self) -> np.ndarray:
        """(T, M, 2) [length/time], of a track that must have them, as those of engines do. Raises
        ValueError if it has none.
        """
        if self.velocity is None:
            raise ValueError("track: has no velocities")
        return self.velocity

    def first_samples(self, count: int) -> "Track":
        """Return the tracks at the first samples, T = count."""
        return self.transformed(lambda values: values[:count])

    def last_sample(self) -> "Track":
        """Return the tracks at the last sample, T = 1."""
        return self.transformed(lambda values: values[-1:])


def displacement(
    position: np.ndarray,
    image: np.ndarray | None,
    size: tuple[float, float],
    earlier: slice | np.ndarray = slice(0, 1),
    later: slice | np.ndarray = slice(None),
) -> np.ndarray:
    """Return displacements (T, M, 2) between samples, by default from the first, of tracks (T, M,
    2).

    `size` is (width, height) of the box; `image` counts the periodic images crossed, None between
    walls. Differences of positions and of images are taken before they are added, so that a disk
    far from its first image loses no digits.
    """
    difference = position[later] - position[earlier]
    if image is None:
        return difference
    crossings = image[later] - image[earlier]
    return difference + crossings * np.asarray(size, float)


def unwrapped(track: Track, size: tuple[float, float]) -> np.ndarray:
    """Return positions (T, M, 2) as if the disks were not brought back into a periodic box of this
    size.
    """
    if track.image is None:
        return track.position
    return track.position + track.image * np.asarray(size, float)


class Events(NamedTuple):
    """The E collisions of one run, in order of time."""

    time: np.ndarray  # (E,) [time]
    a: np.ndarray  # (E,) int32, the disk
    b: np.ndarray  # (E,) int32, the other disk, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2) given to disk a [mass length/time]


class DiskPath(NamedTuple):
    """The exact path of one disk, which moves straight between its P points: its place at t = 0,
    those of its collisions, and that at the last sample time.
    """

    time: np.ndarray  # (P,) [time]
    # (P, 2) of its centre, as if not brought back into a periodic box [length]
    position: np.ndarray
    velocity: np.ndarray  # (P, 2) just after [length/time]


class Run(NamedTuple):
    """One run. Arrays of the tracer's track may be overwritten by the next run."""

    tracer: Track  # disk 0, M = 1
    whole: Track | None  # all disks, M = N; None if not recorded, see `needs_every_disk`
    events: Events | None = None  # if recorded
    # what the engine itself reports, like numbers of collisions
    observables: Mapping[str, ArrayLike] = MappingProxyType({})

    @property
    def every_disk(self) -> Track:
        """The tracks of all disks, of a run that must have them. Raises ValueError if it has none;
        those of `observables.needs_every_disk` have.
        """
        if self.whole is None:
            raise ValueError("run: has no tracks of all disks")
        return self.whole

    def path(self, scene: Scene, disk: int = 0) -> DiskPath:
        """Return the exact path of a disk, from its state at t = 0 and the impulses that it gets.

        Raises ValueError for a number that no disk has, for a run without collisions, and if that
        state is not recorded: in the tracks of all disks, or for disk 0 in that of the tracer.
        """
        if not 0 <= disk < scene.particles:
            raise ValueError(f"disk: must be from 0 to {scene.particles - 1}, not {disk}")
        if self.events is None:
            raise ValueError("run: has no collisions, which record: events keeps")
        if disk and self.whole is None:
            raise ValueError("run: has no tracks of all disks")
        tracks = self.tracer if self.whole is None else self.whole
        track = tracks.select(slice(disk, disk + 1))
        velocity_at_start = track.known_velocity[0]
        is_a = self.events.a == disk
        is_of_disk = is_a | (self.events.b == disk)
        impulse = np.where(is_a[:, None], self.events.impulse, -self.events.impulse)
        changes = impulse[is_of_disk] / scene.mass[disk]
        velocities = np.cumsum(np.concatenate([velocity_at_start, changes]), axis=0)
        time = np.concatenate([[0.0], self.events.time[is_of_disk], scene.times[-1:]])
        straight_pieces = velocities * np.diff(time)[:, None]
        start = unwrapped(track, (scene.box.width, scene.box.height))[0]
        position = np.cumsum(np.concatenate([start, straight_pieces]), axis=0)
        return DiskPath(time, position, np.concatenate([velocities, velocities[-1:]]))
