"""Squared displacement of the tracer in one run, its rate of change, and its square. T sample
times, M disks.
"""

from collections.abc import Callable

import numpy as np

from brownpipe.observables.equilibrium import lags
from brownpipe.observables.observable import Observable, RunArray
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene


def square_displacement(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return the squared displacement and half its rate of change, (T,) each, of one run.

    Their means over runs are the MSD <r^2(t)>, for which eq. (12) is a model, and <v(t).(r(t) -
    r(0))>, which is (1/2) d<r^2>/dt without a difference quotient. `average`: of the tracer from t
    = 0 (`runs`), of the tracer from every sample as time origin (`origins`; Frenkel and Smit,
    Understanding Molecular Simulation, section 4.4.2), or of all disks equal to it (`disks`).
    """

    def square_and_growth(r: np.ndarray, _: slice, later: slice) -> tuple[np.ndarray, np.ndarray]:
        return squared(r), dot(r, track.velocity[later])

    square, growth = averaged(scene, track, average, square_and_growth)
    return {"square_displacement": square, "displacement_velocity": growth}


def quartic_displacement(scene: Scene, track: Track, average: str) -> dict[str, np.ndarray]:
    """Return the fourth power of the displacement (T,) of one run, averaged like the squared
    displacement.

    Means over runs of both make up the non-Gaussian parameter <r^4>/(2 <r^2>^2) - 1.
    """
    (quartic,) = averaged(scene, track, average, lambda r, *_: (squared(r) ** 2,))
    return {"quartic_displacement": quartic}


def averaged(scene: Scene, track: Track, average: str, products: Callable) -> np.ndarray:
    """Return K functions of time (K, T), averaged over the M disks of a track and, for `origins`,
    over time origins.

    `products(r, earlier, later)` returns K arrays (T', M) from the displacements r (T', M, 2)
    between two samples, and the slices of the earlier samples and of the later ones, such as for
    velocities.
    """
    size = (scene.box.width, scene.box.height)
    if average != "origins":
        start = slice(0, 1)
        samples = slice(None)
        moved = displacement(track.position, track.image, size, start, samples)
        return np.stack([product.mean(axis=1) for product in products(moved, start, samples)])
    means = []
    for earlier, later in lags(scene):
        moved = displacement(track.position, track.image, size, earlier, later)
        means.append([product.mean() for product in products(moved, earlier, later)])
    return np.array(means).T


def displacement(
    position: np.ndarray,
    image: np.ndarray | None,
    size: tuple[float, float],
    earlier: slice = slice(0, 1),
    later: slice = slice(None),
) -> np.ndarray:
    """Return displacements (T, M, 2) between samples, by default from the first, of tracks (T, M,
    2).

    `size` is (width, height) of the box; `image` counts the periodic images crossed, None between
    walls. Differences of positions and of images are taken before they are added, so that a disk
    far from its first image loses no digits.
    """
    moved = position[later] - position[earlier]
    if image is None:
        return moved
    crossings = image[later] - image[earlier]
    return moved + crossings * np.asarray(size, float)


def dot(moved: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return scalar products (T, M) of displacements (T, M, 2) and velocities (T, M, 2) or (1, M,
    2).
    """
    return np.einsum("tmc,tmc->tm", moved, velocity)


def squared(moved: np.ndarray) -> np.ndarray:
    """Return squared lengths (T, M) of displacements (T, M, 2)."""
    squares = moved**2
    # .sum(axis=-1) takes 20 times as long along an axis of two.
    return squares[..., 0] + squares[..., 1]


SQUARE_DISPLACEMENT = Observable(
    square_displacement,
    {
        "square_displacement": RunArray(
            ("time",), "length^2", "squared displacement of the tracer (see `average`)"
        ),
        "displacement_velocity": RunArray(
            ("time",), "length^2/time", "v(t).(r(t) - r(0)) of the tracer"
        ),
    },
    tracks_needed="tracer",
    seconds_per_disk_sample=3.6e-8,
)
QUARTIC_DISPLACEMENT = Observable(
    quartic_displacement,
    {
        "quartic_displacement": RunArray(
            ("time",), "length^4", "fourth power of the tracer's displacement"
        )
    },
    tracks_needed="tracer",
    seconds_per_disk_sample=3.6e-8,
)
