"""Random sequential insertion of disks into a box, with a cell list."""

import numpy as np

from brownpipe.engines.kernels import entry_point, kernel

PLACED, HUNGRY, STUCK = range(3)  # all done; out of random numbers; out of tries

TRIES = 1_000_000  # in a row, before a disk counts as one that cannot be placed


@kernel
def cell_of(value, size, cells):
    """Return which of `cells` equal parts of [0, size] holds a coordinate."""
    return min(max(int(value / size * cells), 0), cells - 1)


@kernel
def register(grid, following, position, size, i):
    """Put disk i at the head of the list of its cell."""
    column, row = cell_of(position[i, 0], size[0], grid.shape[0]), cell_of(position[i, 1], size[1], grid.shape[1])
    following[i] = grid[column, row]
    grid[column, row] = i


@kernel
def overlaps(position, radius, size, periodic, i, k):
    """Whether disks i and k overlap."""
    x, y = abs(position[i, 0] - position[k, 0]), abs(position[i, 1] - position[k, 1])
    if periodic:
        x, y = min(x, size[0] - x), min(y, size[1] - y)
    sigma = radius[i] + radius[k]
    return x * x + y * y < sigma * sigma


@kernel
def fits(position, radius, common, big, size, periodic, grid, following, i):
    """Whether disk i, of common size or big, overlaps none of those placed before."""
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
def insert(position, radius, common, big, size, periodic, numbers, grid, following, progress):
    """Insert disks one after another until all are placed, the random numbers are used up, or one finds no place."""
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
    return PLACED if i == len(radius) else HUNGRY


def warm_up() -> None:
    """Compile the kernels, or load them from the cache, without placing anything."""
    no_disks, none = np.zeros((0, 2)), np.zeros(0, np.int64)
    cells = np.zeros((1, 1), np.int64)
    insert(no_disks, no_disks[:, 0], 1.0, none, np.ones(2), False, no_disks, cells, none, np.zeros(2, np.int64))
