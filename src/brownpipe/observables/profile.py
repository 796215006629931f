"""Density profile: how the density of the disks of one run changes with the distance from the walls.

N disks, K species, B bins of distance.
"""

import numpy as np

from brownpipe.observables.species import species_table
from brownpipe.observables.time_origins import is_stationary
from brownpipe.observables.tracks import Run
from brownpipe.scene import Scene

BINS_PER_DIAMETER = 40  # bins per smallest diameter
FARTHEST = 5.0  # end of the profile, in units of the largest diameter
SECONDS_PER_SPECIES = 3.5e-5  # CPU seconds for a species in a sample


def bins(scene: Scene) -> tuple[int, float]:
    """Return the number B of bins of distance and their width [length]; B = 0 if there is no room for one.

    The smallest diameter is 40 bins wide. The last bin ends at five times the largest diameter, but not beyond a
    quarter of the shorter side of the rectangle accessible to any species.
    """
    radius = species_table(scene).radius
    if not len(radius):
        return 0, 0.0
    width = 2 * radius.min() / BINS_PER_DIAMETER
    side = scene.box.accessible(radius.max())[1].min()
    return max(0, int(min(side / 4, FARTHEST * 2 * radius.max()) / width * (1 + 1e-12))), width


def bin_centres(scene: Scene) -> np.ndarray:
    """Return the centres (B,) of the bins [length]."""
    number, width = bins(scene)
    return (np.arange(number) + 0.5) * width


def unfit(scene: Scene) -> str | None:
    """Return why the scene has no such profile, None if it has one."""
    return None if bins(scene)[0] else "needs a box of more than four bins, a tenth of the smallest diameter"


def seconds_per_sample(scene: Scene) -> float:
    """Return the CPU seconds for one sample, apart from those for each of its disks."""
    return SECONDS_PER_SPECIES * len(species_table(scene).name)


def density_profile(scene: Scene, run: Run, _: str) -> dict[str, np.ndarray]:
    """Return the number density (K, B) [1/length^2] of centres of each species by distance from the walls.

    The distance is that of the disk's edge from a wall; in a periodic box that of its centre from a side, on which
    nothing depends. Mean over all samples of a stationary run, otherwise of the last one. Each wall counts the disks in
    front of it that are at least as far as the last bin from the two walls that adjoin it: the corners, where two walls
    act, are left out.
    """
    species, (number, width) = species_table(scene), bins(scene)
    position = run.whole.position[slice(None) if is_stationary(scene) else slice(-1, None)]
    profile, reach = np.zeros((len(species.name), number)), number * width
    for k, radius in enumerate(species.radius):
        (corner, size), disks = scene.box.accessible(radius), np.flatnonzero(species.label == k)
        counts = np.zeros(number, np.int64)
        for sample in position:
            from_low = sample[disks] - corner
            distance = np.minimum(from_low, size - from_low)  # (M, 2) from the nearer of two opposite walls
            for near, beside in (distance.T, distance.T[::-1]):
                column = (np.maximum(near[beside >= reach], 0.0) / width).astype(np.int64)  # by round-off below 0
                counts += np.bincount(column[column < number], minlength=number)
        profile[k] = counts / (len(position) * 2 * width * (size.sum() - 4 * reach))
    return {"density_profile": profile}
