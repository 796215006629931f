"""A triangular lattice that fills the box of a scene: its sites, and the gaps between disks on them."""

from typing import Any

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import Scene


def lattice_sites(scene: Scene) -> np.ndarray:
    """Return the sites (at least as many as disks without a position, 2) of a lattice in the box of a scene.

    Around a fixed disk sites are lost: the lattice is refined until enough are left. Raises RequestError if there is no
    such lattice with places as large as the largest disk.
    """
    fixed, radius = scene.species[0].position, scene.radius
    free = radius if fixed is None else radius[1:]
    if len(free) == 0:
        return np.zeros((0, 2))
    low, size = scene.box.accessible(free.max())
    wanted, sites = len(free), np.zeros((0, 2))
    while len(sites) < len(free):
        lattice, nearest = _lattice(size, scene.box.periodic, wanted)
        sites = low + lattice
        if nearest < 2 * free.max() * (1 - 1e-14):
            raise RequestError(
                f"disks: no triangular lattice in this box has {len(free)} places for disks of radius "
                f"{float(free.max())!r}, the largest (packing fraction {scene.packing_fraction:.4g}); must be fewer or "
                "smaller disks"
            )
        if fixed is not None:
            separation = np.abs(sites - fixed)
            if scene.box.periodic:
                separation = np.minimum(separation, size - separation)
            sites = sites[np.hypot(*separation.T) >= radius[0] + free.max()]
        wanted += len(free) - min(len(sites), len(free))
    return sites


def _lattice(size: np.ndarray, periodic: bool, n: int) -> tuple[np.ndarray, float]:
    """Return the sites (at least n, 2) of a triangular lattice in a rectangle, and the distance of nearest neighbours.

    It has the number of rows for which this distance is greatest; in a periodic box this number is even, as every other
    row is shifted. It is stretched along x or y to fill the rectangle: its triangles need not be equilateral.
    """
    rows, columns, across, up = _rows_and_columns(size, periodic, n)
    row, column = np.divmod(np.arange(rows * columns), columns)
    sites = np.stack([(column + 0.5 * (row % 2)) * across, row * up], axis=1)
    return sites, float(min(_spacings(across, up)))


def _rows_and_columns(size: np.ndarray, periodic: bool, n: int) -> tuple[int, int, float, float]:
    """Return the numbers of rows and columns of a lattice, and the distances between columns and between rows."""
    rows = np.arange(1 + periodic, n + 2 + periodic, 1 + periodic)  # each possible number, of which one is chosen
    columns = -(-n // rows)
    across = size[0] / (columns if periodic else np.maximum(columns - 0.5, 0.5))
    up = size[1] / (rows if periodic else np.maximum(rows - 1, 0.5))
    best = np.argmax(np.minimum.reduce(_spacings(across, up)))
    return int(rows[best]), int(columns[best]), float(across[best]), float(up[best])


def _spacings(across: Any, up: Any) -> tuple[Any, Any, Any]:
    """Return the distances of neighbours: in a row, in the next row but one, and in the next row."""
    return across, 2 * up, np.hypot(across / 2, up)


def lattice_gaps(scene: Scene) -> tuple[float, float]:
    """Return the gaps [length] between edges of disks on the lattice of a scene without a fixed disk.

    In a row (two neighbours) and to the next row (four); the disks are those of the largest radius.
    """
    radius = float(scene.radius.max())
    _, _, across, up = _rows_and_columns(scene.box.accessible(radius)[1], scene.box.periodic, scene.particles)
    in_row, _, to_next = _spacings(across, up)
    return in_row - 2 * radius, float(to_next) - 2 * radius
