"""Density profile: how the density of the disks of one run changes with the distance from the
walls.

N disks, K species, B bins of distance.
"""

import numpy as np

from brownpipe.observables.observable import Axis, Observable, RunArray, centres, counted_bins
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene
from brownpipe.scene.species import species_table

BINS_PER_DIAMETER = 40  # bins per smallest diameter
FARTHEST = 5.0  # end of the profile, in units of the largest diameter
SAMPLES_AT_ONCE = 64


def bins(scene: Scene) -> tuple[int, float]:
    """Return the number B of bins of distance and their width [length]; B = 0 if there is no room
    for one.

    The smallest diameter is 40 bins wide. The last bin ends at five times the largest diameter, but
    not beyond half the shorter side of the rectangle accessible to the largest disks; in a channel
    not beyond its middle.
    """
    radius = scene.radius
    if not len(radius):
        return 0, 0.0
    width = 2 * radius.min() / BINS_PER_DIAMETER
    _, accessible = scene.box.accessible(radius.max())
    end = min(accessible[profile_axes(scene)].min() / 2, FARTHEST * 2 * radius.max())
    return counted_bins(end, width)


def profile_axes(scene: Scene) -> np.ndarray:
    """Return along which of x and y (2,) distances are taken: in a channel across it, in other
    boxes along both.
    """
    return ~scene.box.periodic_axes if scene.box.is_channel else np.ones(2, bool)


def density_profile(scene: Scene, track: Track, _: str) -> dict[str, np.ndarray]:
    """Return the number density (K, B) [1/length^2] of centres of each species by distance from the
    walls.

    The distance is that of the disk's edge from a wall; in a periodic box that of its centre from a
    side, on which nothing depends. Mean over the four walls, all along them, and over all samples
    of a stationary run, otherwise the last sample. Each disk counts twice: at the nearer of the
    walls left and right, and of those below and above. The corners are part of both walls, as they
    are of the momentum that walls take up. In a channel each disk counts once, at the nearer of its
    two walls.
    """
    position = track.position
    species = species_table(scene)
    number, width = bins(scene)
    axes = profile_axes(scene)
    profile = np.zeros((len(species.name), number))
    for k, radius in enumerate(species.radius):
        disks = np.flatnonzero(species.species_index == k)
        corner, size = scene.box.accessible(scene.radius[disks, None])
        mean_size = scene.box.accessible(radius)[1]
        sides = 2 * mean_size[::-1][axes].sum()  # their length: a side is as long as the other axis
        counts = np.zeros(number, np.int64)
        for first in range(0, len(position), SAMPLES_AT_ONCE):
            from_low = position[first : first + SAMPLES_AT_ONCE, disks] - corner
            # from the nearer of two opposite walls
            distance = np.minimum(from_low, size - from_low)[..., axes].ravel()
            column = (np.maximum(distance, 0.0) / width).astype(np.int64)  # by round-off below 0
            counts += np.bincount(column[column < number], minlength=number)
        profile[k] = counts / (len(position) * width * sides)
    return {"density_profile": profile}


DENSITY_PROFILE = Observable(
    density_profile,
    {
        "density_profile": RunArray(
            ("species", "wall_distance"), "1/length^2", "number density of the centres", True
        )
    },
    axes={
        "wall_distance": Axis(
            "length", "distance of the disk's edge from a wall", lambda scene: centres(*bins(scene))
        )
    },
    seconds_per_disk_sample=8e-8,
    is_over_samples=True,
    why_unfit=lambda scene: (
        None
        if bins(scene)[0] > 3
        else "needs walls farther apart by a fifth of the smallest diameter"
    ),
)
