"""Random sequential insertion of disks into a box, with a cell list.

`placement` draws the random numbers and calls `insert` until all disks are placed. Arguments of the kernels: `position`
(N, 2) and `radius` (N,), with coordinates from 0 to `size` (2,); `grid` (columns, rows) int64, the last disk inserted
into each cell or -1; `following` (N,) int64, the disk inserted into the same cell before each disk, or -1.
"""

import numpy as np

from brownpipe.engines.kernels import entry_point, kernel

# How `insert` ends: all disks are placed; it needs more random numbers; a disk found no place in TRIES tries.
PLACED, OUT_OF_NUMBERS, STUCK = range(3)
TRIES = 1_000_000


@kernel
def cell_of(value: float, size: float, cells: int) -> int:
    """Return the column or row of a coordinate: which of `cells` equal parts of [0, size] holds it."""
    return min(max(int(value / size * cells), 0), cells - 1)


@kernel
def register(grid: np.ndarray, following: np.ndarray, position: np.ndarray, size: np.ndarray, i: int) -> None:
    """Add disk i to its cell, as the first of the cell's linked list."""
    column, row = cell_of(position[i, 0], size[0], grid.shape[0]), cell_of(position[i, 1], size[1], grid.shape[1])
    following[i] = grid[column, row]
    grid[column, row] = i


@kernel
def overlaps(position: np.ndarray, radius: np.ndarray, size: np.ndarray, periodic: bool, i: int, k: int) -> bool:
    """Whether disks i and k overlap."""
    x, y = abs(position[i, 0] - position[k, 0]), abs(position[i, 1] - position[k, 1])
    if periodic:
        x, y = min(x, size[0] - x), min(y, size[1] - y)
    sigma = radius[i] + radius[k]
    return x * x + y * y < sigma * sigma


@kernel
def fits(
    position: np.ndarray,
    radius: np.ndarray,
    common: float,
    big: np.ndarray,
    size: np.ndarray,
    periodic: bool,
    grid: np.ndarray,
    following: np.ndarray,
    i: int,
) -> bool:
    """Whether disk i overlaps no disk placed before: no disk of `big`, and no disk of the cells within its reach.

    `common` is the largest radius of the disks not in `big`, which are ascending numbers.
    """
    for k in big:
        if k >= i:
            break
        if overlaps(position, radius, size, periodic, i, k):
            return False
    columns, rows = grid.shape
    reach_x = min(int((radius[i] + common) / size[0] * columns) + 1, columns)
    reach_y = min(int((radius[i] + common) / size[1] * rows) + 1, rows)
    column, row = cell_of(position[i, 0], size[0], columns), cell_of(position[i, 1], size[1], rows)
    for c in range(column - reach_x, column + reach_x + 1):
        for r in range(row - reach_y, row + reach_y + 1):
            if not periodic and (c < 0 or c >= columns or r < 0 or r >= rows):
                continue
            k = grid[c % columns, r % rows]
            while k >= 0:
                if overlaps(position, radius, size, periodic, i, k):
                    return False
                k = following[k]
    return True


@entry_point
def insert(
    position: np.ndarray,
    radius: np.ndarray,
    common: float,
    big: np.ndarray,
    size: np.ndarray,
    periodic: bool,
    numbers: np.ndarray,
    grid: np.ndarray,
    following: np.ndarray,
    progress: np.ndarray,
) -> int:
    """Insert disks one after another; return PLACED, OUT_OF_NUMBERS or STUCK.

    `numbers` (n, 2) are uniform in [0, 1): one row for every try. `progress` (2,) int64 holds the number of disks
    placed and of tries for the next one, which a further call continues.
    """
    i, tries = progress
    for j in range(len(numbers)):
        if i == len(radius):
            break
        margin = 0.0 if periodic else radius[i]
        position[i, 0] = margin + numbers[j, 0] * (size[0] - 2.0 * margin)
        position[i, 1] = margin + numbers[j, 1] * (size[1] - 2.0 * margin)
        tries += 1
        if fits(position, radius, common, big, size, periodic, grid, following, i):
            register(grid, following, position, size, i)
            i, tries = i + 1, 0
        elif tries == TRIES:
            return STUCK
    progress[0], progress[1] = i, tries
    return PLACED if i == len(radius) else OUT_OF_NUMBERS


def insert_nothing() -> None:
    """Insert no disk, so that the kernel is compiled."""
    no_disks, none = np.zeros((0, 2)), np.zeros(0, np.int64)
    cells = np.zeros((1, 1), np.int64)
    insert(no_disks, no_disks[:, 0], 1.0, none, np.ones(2), False, no_disks, cells, none, np.zeros(2, np.int64))
