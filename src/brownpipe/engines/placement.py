"""Where the disks of a scene begin: random sequential insertion, or a lattice for the dense."""

import math

import numpy as np

from brownpipe.engines.insertion import HUNGRY, STUCK, TRIES, insert, register
from brownpipe.engines.units import common_radius
from brownpipe.errors import RequestError
from brownpipe.scene import Scene


def place(scene: Scene, radius: np.ndarray, stream: np.random.Generator) -> np.ndarray:
    """Return the (N, 2) centres of the disks of a scene of species.

    The tracer stands where the scene puts it. `random`: every other centre is uniform over the places where the disk
    lies in the box and overlaps none before it (random sequential insertion, which ends near phi = 0.5). Larger disks
    come first, as they would find no place among the small ones; equal ones in the order of the scene.
    `lattice`: a triangular lattice that fills the box, its sites shared out at random.
    Raises RequestError if the disks do not fit.
    """
    fixed = scene.species[0].position if scene.species else None
    if scene.placement == "lattice":
        return _on_lattice(scene, radius, fixed, stream)
    return _insert(scene, radius, fixed, stream)


def _accessible(scene: Scene, margin) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower corner and the size of the region that centres may be in, a margin away from walls."""
    margin = 0.0 if scene.box.periodic else margin
    low, high = np.array((scene.box.x, scene.box.y)).T
    return low + margin, high - low - 2 * margin


def _insert(scene: Scene, radius: np.ndarray, fixed, stream: np.random.Generator) -> np.ndarray:
    n, turn = len(radius), np.argsort(-radius, kind="stable")
    if fixed is not None:
        turn = np.concatenate([[0], turn[turn > 0]])
    position, radius = np.zeros((n, 2)), radius[turn]
    if n == 0:
        return position
    low, size = np.array((scene.box.x[0], scene.box.y[0])), np.array((scene.box.width, scene.box.height))
    common = common_radius(radius)
    shape = np.clip((size / (2 * common)).astype(np.int64), 1, 1 + math.isqrt(4 * n))
    grid = np.full((shape[0], shape[1]), -1, dtype=np.int64)
    following = np.full(n, -1, dtype=np.int64)
    big = np.flatnonzero(radius > common)
    progress = np.zeros(2, dtype=np.int64)  # disks placed, tries for the next
    if fixed is not None:
        position[0] = np.array(fixed) - low
        register(grid, following, position, size, 0)
        progress[0] = 1
    outcome = HUNGRY
    while outcome == HUNGRY:
        numbers = stream.random((2 * n + 64, 2))
        outcome = insert(position, radius, common, big, size, scene.box.periodic, numbers, grid, following, progress)
    if outcome == STUCK:
        raise RequestError(
            f"disks: only {progress[0]} of {n} disks found a place by random insertion in {TRIES} tries "
            f"(packing fraction {scene.packing_fraction:.3g}); must be fewer or smaller disks, or `placement: lattice`"
        )
    return (position + low)[np.argsort(turn)]


def _on_lattice(scene: Scene, radius: np.ndarray, fixed, stream: np.random.Generator) -> np.ndarray:
    free = radius if fixed is None else radius[1:]
    if len(free) == 0:
        return np.array(fixed or (), dtype=float).reshape(-1, 2)
    low, size = _accessible(scene, free.max())
    wanted, sites = len(free), np.zeros((0, 2))
    while len(sites) < len(free):
        sites = low + _lattice(size, scene.box.periodic, wanted)
        if _nearest(size, scene.box.periodic, wanted) < 2 * free.max() * (1 - 1e-14):
            raise RequestError(
                f"disks: no triangular lattice in this box has places for {len(free)} disks of radius "
                f"{float(free.max())!r} (packing fraction {scene.packing_fraction:.4g}); must be fewer or smaller disks"
            )
        if fixed is not None:
            apart = np.abs(sites - fixed)
            if scene.box.periodic:
                apart = np.minimum(apart, size - apart)
            sites = sites[np.hypot(*apart.T) >= radius[0] + free.max()]
        wanted += len(free) - min(len(sites), len(free))
    position = sites[stream.permutation(len(sites))[: len(free)]]
    return position if fixed is None else np.concatenate([[fixed], position])


def _spacings(size: np.ndarray, periodic: bool, rows: np.ndarray, n: int) -> tuple[np.ndarray, ...]:
    """Return columns, their spacing, that of the rows, and the distance of nearest sites, for numbers of rows."""
    columns = -(-n // rows)
    wide = size[0] / (columns if periodic else np.maximum(columns - 0.5, 0.5))
    high = size[1] / (rows if periodic else np.maximum(rows - 1, 0.5))
    return columns, wide, high, np.minimum(np.minimum(wide, 2 * high), np.hypot(wide / 2, high))


def _best_rows(size: np.ndarray, periodic: bool, n: int) -> np.ndarray:
    """Return the number of rows, even in a periodic box, of the widest triangular lattice with at least n sites."""
    rows = np.arange(1 + periodic, n + 2 + periodic, 1 + periodic)
    return rows[np.argmax(_spacings(size, periodic, rows, n)[3])]


def _nearest(size: np.ndarray, periodic: bool, n: int) -> float:
    """Return the distance of nearest sites of `_lattice`."""
    return float(_spacings(size, periodic, _best_rows(size, periodic, n), n)[3])


def _lattice(size: np.ndarray, periodic: bool, n: int) -> np.ndarray:
    """Return the sites (at least n, 2) of the widest triangular lattice in a rectangle, row by row."""
    rows = _best_rows(size, periodic, n)
    columns, wide, high, _ = _spacings(size, periodic, rows, n)
    row, column = np.divmod(np.arange(rows * columns), columns)
    return np.stack([(column + 0.5 * (row % 2)) * wide, row * high], axis=1)
