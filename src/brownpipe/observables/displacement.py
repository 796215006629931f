"""How far the tracer comes: squared displacements of one run.

T sample times, M disks.
"""

import numpy as np

from brownpipe.observables.kinds import equal_disks
from brownpipe.observables.origins import lags
from brownpipe.scene import Scene


def square_displacement(scene: Scene, run, average: str) -> dict[str, np.ndarray]:
    """Squared displacement (T,) of one run (`batch.Run`): its share of <r^2(t)>, eq. (12).

    Of the tracer from its start (`runs`), of the tracer from every sample as far back (`origins`, Frenkel and Smit,
    Understanding Molecular Simulation, section 4.4.2), or of all disks that are equal to it (`disks`).
    """
    size = (scene.box.width, scene.box.height)
    if average == "origins":
        return {"square_displacement": over_origins(scene, run.tracer.position, run.tracer.image, size)}
    if average == "disks":
        disks = equal_disks(scene)
        image = None if run.whole.image is None else run.whole.image[:, disks]
        return {"square_displacement": from_start(run.whole.position[:, disks], image, size).mean(axis=1)}
    return {"square_displacement": from_start(run.tracer.position, run.tracer.image, size)[:, 0]}


def from_start(position: np.ndarray, image: np.ndarray | None, size: tuple[float, float]) -> np.ndarray:
    """Squared distance (T, M) from the start, of tracks (T, M, 2) in a box of `size` (width, height).

    In a periodic box positions are unwrapped by the images crossed. The difference of positions and of images is taken
    first, so that far images cost no digits.
    """
    return _square(position, image, slice(0, 1), slice(None), size)


def over_origins(scene: Scene, position: np.ndarray, image: np.ndarray | None, size: tuple[float, float]) -> np.ndarray:
    """Mean over disks and time origins (T,) of the squared distance between samples, as `from_start`."""
    return np.array([_square(position, image, *pair, size).mean() for pair in lags(scene)])


def _square(position, image, earlier: slice, later: slice, size) -> np.ndarray:
    moved = position[later] - position[earlier]
    if image is not None:
        moved = moved + (image[later] - image[earlier]) * np.asarray(size, float)
    return (moved**2).sum(axis=-1)
