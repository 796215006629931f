"""How far the tracer comes: squared displacements of one run, and how fast they grow.

T sample times, M disks.
"""

import numpy as np

from brownpipe.observables.species import tracer_tracks
from brownpipe.observables.time_origins import averaged
from brownpipe.scene import Scene


def square_displacement(scene: Scene, run, average: str) -> dict[str, np.ndarray]:
    """Squared displacement and half of its rate of change, (T,) each, of one run (`batch.Run`).

    The run's share of <r^2(t)>, eq. (12), and of <v(t).(r(t) - r(0))>, which is d<r^2>/dt / 2 at that very time.
    Of the tracer from its start (`runs`), of the tracer from every sample as far back (`origins`, Frenkel and Smit,
    Understanding Molecular Simulation, section 4.4.2), or of all disks that are equal to it (`disks`).
    """
    track, size = tracer_tracks(scene, run, average), (scene.box.width, scene.box.height)

    def products(earlier: slice, later: slice) -> tuple[np.ndarray, np.ndarray]:
        moved = displacement(track.position, track.image, size, earlier, later)
        return (moved**2).sum(axis=-1), dot(moved, track.velocity[later])

    squared, growth = averaged(scene, average, products)
    return {"square_displacement": squared, "displacement_velocity": growth}


def velocity_displacement(scene: Scene, run, average: str) -> np.ndarray:
    """v(0).(r(t) - r(0)) (T,) of one run: exactly the integral of v(0).v(s) from 0 to t, averaged likewise."""
    track, size = tracer_tracks(scene, run, average), (scene.box.width, scene.box.height)

    def product(earlier: slice, later: slice) -> tuple[np.ndarray]:
        moved = displacement(track.position, track.image, size, earlier, later)
        return (dot(moved, track.velocity[earlier]),)

    return averaged(scene, average, product)[0]


def displacement(
    position: np.ndarray,
    image: np.ndarray | None,
    size: tuple[float, float],
    earlier: slice = slice(0, 1),
    later: slice = slice(None),
) -> np.ndarray:
    """Displacement (T, M, 2) between samples, by default from the start, of tracks (T, M, 2) in a box of `size`.

    In a periodic box positions are unwrapped by the images crossed. The difference of positions and of images is taken
    first, so that far images cost no digits.
    """
    moved = position[later] - position[earlier]
    return moved if image is None else moved + (image[later] - image[earlier]) * np.asarray(size, float)


def dot(moved: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Scalar products (T, M) of displacements (T, M, 2) and velocities (T, M, 2) or (1, M, 2)."""
    return np.einsum("tmc,tmc->tm", moved, velocity)


def from_start(position: np.ndarray, image: np.ndarray | None, size: tuple[float, float]) -> np.ndarray:
    """Squared distance (T, M) from the start, as in `displacement`; `size` is (width, height)."""
    return (displacement(position, image, size) ** 2).sum(axis=-1)
