"""Disks placed in a box, with a cell list: by random sequential insertion, or pushed apart until
none overlap.

`initial_state` draws the random numbers, and calls `insert` or `push_apart` until all disks are
placed.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import by_reference, local_copy

# How `insert` ends: all disks are placed; it needs more random numbers; a disk found no place in
# TRIES tries.
PLACED, OUT_OF_NUMBERS, STUCK = range(3)
TRIES = 1_000_000


@by_reference
class Places(NamedTuple):
    """Disks that are being placed in a box, in the order of their insertion, and the cells that
    list them.
    """

    position: np.ndarray  # (N, 2) relative to the lower left corner of the box
    radius: np.ndarray  # (N,)
    common: float  # the largest radius of the disks not in `big`
    big: np.ndarray  # int64, a few big disks, ascending numbers
    size: np.ndarray  # (2,) of the box
    periodic: bool
    grid: np.ndarray  # (columns, rows) int64, the last disk inserted into each cell or -1
    following: (
        np.ndarray
    )  # (N,) int64, the disk inserted into the same cell before each disk, or -1


@kernel
def cell_of(value: float, size: float, cells: int) -> int:
    """Return the column or row of a coordinate: which of `cells` equal parts of [0, size] holds it,
    or is nearest.
    """
    return min(max(int(value / size * cells), 0), cells - 1)


@kernel
def register(p: Places, i: int) -> None:
    """Add disk i to its cell, as the first of the cell's linked list."""
    column = cell_of(p.position[i, 0], p.size[0], p.grid.shape[0])
    row = cell_of(p.position[i, 1], p.size[1], p.grid.shape[1])
    p.following[i] = p.grid[column, row]
    p.grid[column, row] = i


@kernel
def block_around(p: Places, i: int, reach: float) -> tuple[int, int, int, int]:
    """Return the first and last column and row of the cells within reach of disk i; beyond the box
    between walls, too.

    A cell of a small periodic box may be among them twice.
    """
    columns, rows = p.grid.shape
    reach_x = min(int(reach / p.size[0] * columns) + 1, columns)
    reach_y = min(int(reach / p.size[1] * rows) + 1, rows)
    column, row = (
        cell_of(p.position[i, 0], p.size[0], columns),
        cell_of(p.position[i, 1], p.size[1], rows),
    )
    return column - reach_x, column + reach_x, row - reach_y, row + reach_y


@kernel
def first_in_cell(p: Places, column: int, row: int) -> int:
    """Return the disk that was listed last in a cell or, of a periodic box, its image; -1 for
    none.
    """
    columns, rows = p.grid.shape
    if not p.periodic and (column < 0 or column >= columns or row < 0 or row >= rows):
        return -1
    return p.grid[column % columns, row % rows]


@kernel
def fits(p: Places, i: int) -> bool:
    """Whether disk i overlaps no disk placed before: no big one, and no disk of the cells within
    its reach.
    """
    for k in p.big:
        if k >= i:
            break
        if part(p, -1, 0.0, i, k):
            return False
    left, right, bottom, top = block_around(p, i, p.radius[i] + p.common)
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            k = first_in_cell(p, column, row)
            while k >= 0:
                if part(p, -1, 0.0, i, k):
                    return False
                k = p.following[k]
    return True


@entry_point
def insert(p: Places, numbers: np.ndarray, progress: np.ndarray) -> int:
    """Insert disks one after another; return PLACED, OUT_OF_NUMBERS or STUCK.

    `numbers` (n, 2) are uniform in [0, 1): one row for every try. `progress` (2,) int64 holds the
    number of disks placed and of tries for the next one, which a further call continues.
    """
    p = local_copy(p)
    i, tries = progress
    for j in range(len(numbers)):
        if i == len(p.radius):
            break
        margin = 0.0 if p.periodic else p.radius[i]
        p.position[i, 0] = margin + numbers[j, 0] * (p.size[0] - 2.0 * margin)
        p.position[i, 1] = margin + numbers[j, 1] * (p.size[1] - 2.0 * margin)
        tries += 1
        if fits(p, i):
            register(p, i)
            i, tries = i + 1, 0
        elif tries == TRIES:
            return STUCK
    progress[0], progress[1] = i, tries
    return PLACED if i == len(p.radius) else OUT_OF_NUMBERS


@kernel
def share(radius: np.ndarray, held: int, i: int, k: int) -> float:
    """Return disk i's part of the path by which disks i and k separate: the other's share of their
    areas.
    """
    if held in (i, k):
        return 0.0 if held == i else 1.0
    return radius[k] * radius[k] / (radius[i] * radius[i] + radius[k] * radius[k])


@kernel
def moved(value: float, step: float, radius: float, size: float, periodic: bool) -> float:
    """Return a coordinate after a step, inside the box: wrapped, or at least its radius from the
    walls.
    """
    value += step
    if periodic:
        value -= size * math.floor(value / size)
        return value if value < size else 0.0
    return min(max(value, radius), size - radius)


@kernel
def part(p: Places, held: int, stretch: float, i: int, k: int) -> bool:
    """Return whether disks i and k overlap; move them apart, to `stretch` contact distances (not if
    that is 0).
    """
    position, radius, size = p.position, p.radius, p.size
    x, y = position[k, 0] - position[i, 0], position[k, 1] - position[i, 1]
    if p.periodic:
        x -= size[0] * math.floor(x / size[0] + 0.5)
        y -= size[1] * math.floor(y / size[1] + 0.5)
    sigma, square = radius[i] + radius[k], x * x + y * y
    wanted = stretch * sigma
    if square < wanted * wanted:
        distance = math.sqrt(square)
        if distance == 0.0:
            x, distance = sigma, sigma
        away = (wanted - math.sqrt(square)) / distance
        of_i = share(radius, held, i, k)
        position[i, 0] = moved(position[i, 0], -of_i * away * x, radius[i], size[0], p.periodic)
        position[i, 1] = moved(position[i, 1], -of_i * away * y, radius[i], size[1], p.periodic)
        position[k, 0] = moved(
            position[k, 0], (1.0 - of_i) * away * x, radius[k], size[0], p.periodic
        )
        position[k, 1] = moved(
            position[k, 1], (1.0 - of_i) * away * y, radius[k], size[1], p.periodic
        )
    return square < sigma * sigma


@entry_point
def push_apart(p: Places, held: int, stretch: float) -> int:
    """Go once over all disks, push overlapping ones apart to `stretch` contact distances, and count
    the overlaps.

    With a stretch of 0 nothing is moved. Disk `held` stays where it is (-1: none).
    """
    p = local_copy(p)
    for column in range(p.grid.shape[0]):
        for row in range(p.grid.shape[1]):
            p.grid[column, row] = -1
    for i in range(len(p.radius)):
        register(p, i)
    overlapping = 0
    for i in range(len(p.radius)):
        for k in p.big:
            if k > i:
                overlapping += part(p, held, stretch, i, k)
        left, right, bottom, top = block_around(p, i, (p.radius[i] + p.common) * max(stretch, 1.0))
        for column in range(left, right + 1):
            for row in range(bottom, top + 1):
                k = first_in_cell(p, column, row)
                while k >= 0:
                    if k != i:
                        overlapping += part(p, held, stretch, i, k)
                    k = p.following[k]
    return overlapping


def insert_nothing() -> None:
    """Insert no disk, so that the kernel is compiled."""
    no_disks, none = np.zeros((0, 2)), np.zeros(0, np.int64)
    no_places = Places(
        no_disks, np.zeros(0), 1.0, none, np.ones(2), False, np.zeros((1, 1), np.int64), none
    )
    insert(no_places, no_disks, np.zeros(2, np.int64))
