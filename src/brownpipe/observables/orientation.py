"""Bond-orientational order of all disks in one run: psi_6 with Voronoi neighbours. N disks, Q pairs
of neighbours.

See docs/theory.md, section 3.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.observables.equilibrium import claims_equilibrium, ends_of_quarters, is_stationary
from brownpipe.observables.observable import Observable, RunArray
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene

if TYPE_CHECKING:
    from scipy.spatial import Delaunay

# width of the strip around the box whose images are triangulated at first, in mean distances
# sqrt(A/N)
MARGIN = 4.0
# in the same unit: a shorter edge of a Voronoi cell is a corner, to round-off
SHORTEST_EDGE = 1e-9


def orientational_order(scene: Scene, track: Track, _: str) -> dict[str, np.ndarray]:
    """Return abs(psi_6) and abs(psi_6)^2 of one run, means over the samples; if it is not
    stationary, of the last one.

    For a stationary run also the mean of abs(psi_6) in each quarter (4,), over its samples except
    the first.

    psi_6 is the mean over all disks j of the mean over the Voronoi neighbours k of j of exp(6 i
    theta_jk), theta_jk the angle of the bond from j to k (D. R. Nelson and B. I. Halperin, Phys.
    Rev. B 19, 2457 (1979)).
    """
    squared = np.array([square_order(scene, sample) for sample in track.position])
    values = {
        "orientational_order": np.sqrt(squared).mean(),
        "orientational_order_squared": squared.mean(),
    }
    ends = ends_of_quarters(scene.times)
    if is_stationary(scene) and claims_equilibrium(scene) and len(ends):
        quarters = np.split(np.sqrt(squared), ends[:-1] + 1)[1:]
        values["quarter_order"] = np.array([samples.mean() for samples in quarters])
    return values


def square_order(scene: Scene, position: np.ndarray) -> float:
    """Return abs(psi_6)^2 of one sample, position (N, 2); a disk without neighbours contributes 0
    to psi_6.
    """
    disk, bond = bonds(scene, position)
    dx, dy = bond.T
    square = dx * dx + dy * dy
    c = (dx * dx - dy * dy) / square  # cosine of 2 theta
    s = 2 * dx * dy / square  # sine of 2 theta
    number = np.maximum(np.bincount(disk, minlength=len(position)), 1)  # of neighbours
    real = _mean_over_disks(disk, c * (4 * c * c - 3), number)
    imaginary = _mean_over_disks(disk, s * (3 - 4 * s * s), number)
    return real * real + imaginary * imaginary


def _mean_over_disks(disk: np.ndarray, value: np.ndarray, number: np.ndarray) -> float:
    """Return the mean over disks of the mean over the bonds of each: value (Q,) of the bonds of
    disk (Q,), number (N,) of bonds.
    """
    means = np.bincount(disk, value, len(number)) / number
    return means.sum() / len(number)


def bonds(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a disk (Q,) and the vector (Q, 2) to one of its Voronoi neighbours, for each neighbour
    of each disk.

    The lengths are in units of sqrt(A/N). Two disks are neighbours if their Voronoi cells share an
    edge, which is if the Delaunay triangulation joins them, but for disks on one empty circle, as
    across the squares of a square lattice: their cells share a corner. The triangulation is that of
    the disks and their images: periodic ones, which are neighbours, along periodic axes, and mirror
    images of all these at walls, which cut the cells off there and are no neighbours.
    """
    from scipy.spatial import Delaunay

    number = len(position)
    sides = np.array([scene.box.width, scene.box.height])
    unit = math.sqrt(sides[0] / number * sides[1])
    size = sides / unit
    inside = (position - scene.box.origin) / unit
    margin = MARGIN
    while True:
        points, disks = disks_and_images(inside, size, scene.box.periodic_axes, margin)
        triangulation = Delaunay(points)
        if margin > size.sum() or _reach(points, triangulation.simplices, number, size) < margin:
            break
        margin *= 2
    starts, neighbours = triangulation.vertex_neighbor_vertices
    disk = np.repeat(np.arange(number), np.diff(starts[: number + 1]))
    other = neighbours[: starts[number]]
    if scene.box.has_walls:
        is_disk = other < disks
        disk = disk[is_disk]
        other = other[is_disk]
    corners = _pairs_at_corners(points, triangulation, number)
    if len(corners):
        numbered = [len(points), 1]  # a pair (a, b) as the number a * len(points) + b
        share_edge = ~np.isin(disk * len(points) + other, corners @ numbered)
        disk = disk[share_edge]
        other = other[share_edge]
    return disk, points[other] - points[disk]


def _pairs_at_corners(points: np.ndarray, triangulation: Delaunay, number: int) -> np.ndarray:
    """Return the pairs (Q, 2), each in both orders, that a triangulation joins though their Voronoi
    cells share a corner only.

    The edge between the cells of a pair joins the centres of the circles around both triangles at
    it.
    """
    near = np.flatnonzero((triangulation.simplices < number).any(axis=1))
    centre = np.full((len(triangulation.simplices), 2), np.nan)
    centre[near], _ = _circles(points, triangulation.simplices[near])
    edge = centre[near][:, None] - centre[triangulation.neighbors[near]]
    is_corner = np.hypot(edge[..., 0], edge[..., 1]) < SHORTEST_EDGE
    triangle, opposite = np.nonzero(is_corner)
    first = triangulation.simplices[near[triangle], opposite - 2]
    second = triangulation.simplices[near[triangle], opposite - 1]
    pairs = np.stack([first, second], axis=1).astype(np.int64)
    return np.concatenate([pairs, pairs[:, ::-1]])


def disks_and_images(
    inside: np.ndarray, size: np.ndarray, periodic_axes: np.ndarray, margin: float
) -> tuple[np.ndarray, int]:
    """Return the disks (N, 2), relative to the corner of the box, then their periodic images, then
    mirror images, all up to `margin` from the box; and how many of these are no mirror images.
    """
    columns, rows = np.ceil(margin / size).astype(int).tolist()  # of tiles at each side of the box
    disks = [inside]
    mirror_images: list[np.ndarray] = []
    for tile in product(range(-columns, columns + 1), range(-rows, rows + 1)):
        if tile == (0, 0):
            continue
        walls = np.where(periodic_axes, 0, tile)  # between the box and the tile
        image = np.where(walls % 2 == 1, size - inside, inside) + tile * size
        is_near = (image > -margin) & (image < size + margin)
        images = mirror_images if walls.any() else disks
        images.append(image[is_near.all(axis=1)])
    points = np.concatenate([*disks, *mirror_images])
    return points, sum(len(group) for group in disks)


def _reach(points: np.ndarray, triangles: np.ndarray, number: int, size: np.ndarray) -> float:
    """Return how far the circumcircles of all triangles at a disk reach beyond the box.

    No disk lies inside such a circle: as long as they do not reach images that were left out, the
    triangles are right.
    """
    centre, radius = _circles(points, triangles[(triangles < number).any(axis=1)])
    return float(np.maximum(radius - centre, centre + radius - size).max())


def _circles(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres (T, 2) and radii (T, 1) of the circles around triangles (T, 3)."""
    a, b, c = (points[corner] for corner in triangles.T)
    bx, by = (b - a).T
    cx, cy = (c - a).T
    b2 = bx * bx + by * by
    c2 = cx * cx + cy * cy
    twice = 2 * (bx * cy - by * cx)  # four times the area
    x = (cy * b2 - by * c2) / twice
    y = (bx * c2 - cx * b2) / twice
    offset = np.stack([x, y], axis=1)
    radius = np.sqrt((offset * offset).sum(axis=1))
    return a + offset, radius[:, None]


ORDER = Observable(
    orientational_order,
    {
        "orientational_order": RunArray(
            (), "1", "bond-orientational order abs(psi_6), mean over samples", True
        ),
        "orientational_order_squared": RunArray((), "1", "abs(psi_6)^2, mean over samples", True),
        "quarter_order": RunArray(
            ("quarter",), "1", "abs(psi_6), mean over the samples of each quarter of the run"
        ),
    },
    seconds_per_disk_sample=6e-6,
    is_over_samples=True,
    # few disks have many images near them
    relative_cost=lambda scene: 1 + 150 / max(scene.particles, 1),
)
