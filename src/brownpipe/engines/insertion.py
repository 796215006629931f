"""Random sequential insertion of disks into a box, with a cell list.

`placement` draws the random numbers and calls `insert` until all disks are placed.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import by_reference, local_copy

# How `insert` ends: all disks are placed; it needs more random numbers; a disk found no place in TRIES tries.
PLACED, OUT_OF_NUMBERS, STUCK = range(3)
TRIES = 1_000_000


@by_reference
class Places(NamedTuple):
    """Disks that are being placed in a box, in the order of their insertion, and the cells that list them."""

    position: np.ndarray  # (N, 2) relative to the lower left corner of the box
    radius: np.ndarray  # (N,)
    common: float  # the largest radius of the disks not in `big`
    big: np.ndarray  # int64, a few big disks, ascending numbers
    size: np.ndarray  # (2,) of the box
    periodic: bool
    grid: np.ndarray  # (columns, rows) int64, the last disk inserted into each cell or -1
    following: np.ndarray  # (N,) int64, the disk inserted into the same cell before each disk, or -1


@kernel
def cell_of(value: float, size: float, cells: int) -> int:
    """Return the column or row of a coordinate: which of `cells` equal parts of [0, size] holds it."""
    return min(max(int(value / size * cells), 0), cells - 1)


@kernel
def register(p: Places, i: int) -> None:
    """Add disk i to its cell, as the first of the cell's linked list."""
    column = cell_of(p.position[i, 0], p.size[0], p.grid.shape[0])
    row = cell_of(p.position[i, 1], p.size[1], p.grid.shape[1])
    p.following[i] = p.grid[column, row]
    p.grid[column, row] = i


@kernel
def overlaps(p: Places, i: int, k: int) -> bool:
    """Whether disks i and k overlap."""
    x, y = abs(p.position[i, 0] - p.position[k, 0]), abs(p.position[i, 1] - p.position[k, 1])
    if p.periodic:
        x, y = min(x, p.size[0] - x), min(y, p.size[1] - y)
    sigma = p.radius[i] + p.radius[k]
    return x * x + y * y < sigma * sigma


@kernel
def block_around(p: Places, i: int, reach: float) -> tuple[int, int, int, int]:
    """Return the first and last column and row of the cells within reach of disk i; beyond the box between walls, too.

    A cell of a small periodic box may be among them twice.
    """
    columns, rows = p.grid.shape
    reach_x = min(int(reach / p.size[0] * columns) + 1, columns)
    reach_y = min(int(reach / p.size[1] * rows) + 1, rows)
    column, row = cell_of(p.position[i, 0], p.size[0], columns), cell_of(p.position[i, 1], p.size[1], rows)
    return column - reach_x, column + reach_x, row - reach_y, row + reach_y


@kernel
def first_in_cell(p: Places, column: int, row: int) -> int:
    """Return the disk that was listed last in a cell or, of a periodic box, its image; -1 for none."""
    columns, rows = p.grid.shape
    if not p.periodic and (column < 0 or column >= columns or row < 0 or row >= rows):
        return -1
    return p.grid[column % columns, row % rows]


@kernel
def fits(p: Places, i: int) -> bool:
    """Whether disk i overlaps no disk placed before: no big one, and no disk of the cells within its reach."""
    for k in p.big:
        if k >= i:
            break
        if overlaps(p, i, k):
            return False
    left, right, bottom, top = block_around(p, i, p.radius[i] + p.common)
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            k = first_in_cell(p, column, row)
            while k >= 0:
                if overlaps(p, i, k):
                    return False
                k = p.following[k]
    return True


@entry_point
def insert(p: Places, numbers: np.ndarray, progress: np.ndarray) -> int:
    """Insert disks one after another; return PLACED, OUT_OF_NUMBERS or STUCK.

    `numbers` (n, 2) are uniform in [0, 1): one row for every try. `progress` (2,) int64 holds the number of disks
    placed and of tries for the next one, which a further call continues.
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


def insert_nothing() -> None:
    """Insert no disk, so that the kernel is compiled."""
    no_disks, none = np.zeros((0, 2)), np.zeros(0, np.int64)
    no_places = Places(no_disks, np.zeros(0), 1.0, none, np.ones(2), False, np.zeros((1, 1), np.int64), none)
    insert(no_places, no_disks, np.zeros(2, np.int64))
