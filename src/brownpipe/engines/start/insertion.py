"""Disks placed in a box, with a cell list: by random sequential insertion, or pushed apart until
none overlap.

`initial_state` draws the random numbers, and calls `insert_disks` or `push_apart` until all disks
are placed.

Where hardly any room is left, a disk fails hundreds of thousands of tries. A raster then tells most
failures by one look-up: its fields cover the rectangle accessible to the disk's centre, and a field
is closed if no centre in it is possible. If all are closed, the disk has no place, whatever tries
are made.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.engines.compiled.kernels import entry_point, kernel
from brownpipe.engines.compiled.records import by_reference, local_copy

# How `insert_disks` ends: all disks are placed; it needs more random numbers; a disk found no place
# in TRIES tries.
PLACED, OUT_OF_NUMBERS, STUCK = range(3)
TRIES = 1_000_000

# Entries of the array `progress`: the number of the disk that is inserted next; how many tries it
# has failed; rows of random numbers used so far; failures of all disks since the raster was
# examined; the disk it was last examined for, or -1; and tries that were compared with other disks.
NEXT, FAILED, ROWS, UNEXAMINED, EXAMINED_FOR, COMPARED = range(6)
NOTHING_PLACED = (0, 0, 0, 0, -1, 0)

FIELDS_PER_CELL = 4  # of the raster, along each side of a cell
# failures after which the raster is examined; that takes as long as some 80 tries per disk
FAILURES_PER_DISK = 100
SMALLEST_SQUARE = 12  # how often a field is halved along both sides before it is taken to be open
COVERED, FREE, UNDECIDED = range(3)  # what is known of a square of possible centres
# relative to contact distances, and to the box: far above rounding errors
SLACK, ROUND_OFF = 1e-9, 1e-14


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
    periodic_x: bool
    periodic_y: bool
    grid: np.ndarray  # (columns, rows) int64, the last disk inserted into each cell or -1
    # (N,) int64, the disk inserted into the same cell before each disk, or -1
    following: np.ndarray
    # (columns, rows) bool, fields of the raster in which a centre may be possible
    is_open: np.ndarray


@kernel
def interval_of(value: float, size: float, cells: int) -> int:
    """Return the column or row of a coordinate: which of `cells` equal parts of [0, size] holds it,
    or is nearest.
    """
    return min(max(int(value / size * cells), 0), cells - 1)


@kernel
def register(p: Places, i: int) -> None:
    """Add disk i to its cell, as the first of the cell's linked list."""
    column = interval_of(p.position[i, 0], p.size[0], p.grid.shape[0])
    row = interval_of(p.position[i, 1], p.size[1], p.grid.shape[1])
    p.following[i] = p.grid[column, row]
    p.grid[column, row] = i


@kernel
def block_around(p: Places, i: int, reach: float) -> tuple[int, int, int, int]:
    """Return the first and last column and row of the cells within reach of disk i; beyond walls,
    too.

    A cell of a small periodic box may be among them twice.
    """
    columns, rows = p.grid.shape
    reach_x = min(int(reach / p.size[0] * columns) + 1, columns)
    reach_y = min(int(reach / p.size[1] * rows) + 1, rows)
    column = interval_of(p.position[i, 0], p.size[0], columns)
    row = interval_of(p.position[i, 1], p.size[1], rows)
    return column - reach_x, column + reach_x, row - reach_y, row + reach_y


@kernel
def first_in_cell(p: Places, column: int, row: int) -> int:
    """Return the disk that was listed last in a cell or, beyond a periodic side, its image; -1
    for none.
    """
    columns, rows = p.grid.shape
    if not p.periodic_x and (column < 0 or column >= columns):
        return -1
    if not p.periodic_y and (row < 0 or row >= rows):
        return -1
    return p.grid[column % columns, row % rows]


@kernel
def is_free(p: Places, i: int) -> bool:
    """Whether disk i overlaps no disk placed before: no big one, and no disk of the cells within
    its reach.
    """
    for k in p.big:
        if k >= i:
            break
        if separate(p, -1, 0.0, i, k):
            return False
    left, right, bottom, top = block_around(p, i, p.radius[i] + p.common)
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            k = first_in_cell(p, column, row)
            while k >= 0:
                if separate(p, -1, 0.0, i, k):
                    return False
                k = p.following[k]
    return True


@kernel
def margins(p: Places, i: int) -> tuple[float, float]:
    """Return how far the centre of disk i must be from the sides in x and in y: its radius from
    walls.
    """
    return 0.0 if p.periodic_x else p.radius[i], 0.0 if p.periodic_y else p.radius[i]


@kernel
def apart(p: Places, i: int, k: int) -> tuple[float, float]:
    """Return the vector from disk i to disk k, or to its nearest periodic image."""
    x, y = p.position[k, 0] - p.position[i, 0], p.position[k, 1] - p.position[i, 1]
    if p.periodic_x:
        x -= p.size[0] * math.floor(x / p.size[0] + 0.5)
    if p.periodic_y:
        y -= p.size[1] * math.floor(y / p.size[1] + 0.5)
    return x, y


@kernel
def try_place(p: Places, i: int, u: float, v: float) -> None:
    """Set the centre of disk i to the point (u, v), each in [0, 1), of the rectangle accessible to
    it.
    """
    margin_x, margin_y = margins(p, i)
    p.position[i, 0] = margin_x + u * (p.size[0] - 2.0 * margin_x)
    p.position[i, 1] = margin_y + v * (p.size[1] - 2.0 * margin_y)


@kernel
def coverage_by_disk(p: Places, i: int, k: int, half: float) -> int:
    """Return what disk k says of the square of half diagonal `half` around the centre of disk i.

    COVERED: at every centre in it disk i overlaps disk k. UNDECIDED: at that in its middle. FREE:
    not at that.
    """
    x, y = apart(p, i, k)
    sigma, square = p.radius[i] + p.radius[k], x * x + y * y
    inside = (1.0 - SLACK) * sigma - half - ROUND_OFF * (p.size[0] + p.size[1])
    if inside > 0.0 and square < inside * inside:
        return COVERED
    return UNDECIDED if square < sigma * sigma else FREE


@kernel
def coverage(p: Places, i: int, half: float) -> int:
    """Return what all disks placed before say of the square of half diagonal `half` around disk
    i's centre.
    """
    verdict = FREE
    for k in p.big:
        if k >= i:
            break
        cover = coverage_by_disk(p, i, k, half)
        if cover == COVERED:
            return COVERED
        if cover == UNDECIDED:
            verdict = UNDECIDED
    left, right, bottom, top = block_around(p, i, p.radius[i] + p.common)
    for column in range(left, right + 1):
        for row in range(bottom, top + 1):
            k = first_in_cell(p, column, row)
            while k >= 0:
                cover = coverage_by_disk(p, i, k, half)
                if cover == COVERED:
                    return COVERED
                if cover == UNDECIDED:
                    verdict = UNDECIDED
                k = p.following[k]
    return verdict


@kernel
def has_room(p: Places, i: int, column: int, row: int) -> bool:
    """Return False if no centre of disk i is possible in a field of the raster.

    A square that is undecided is divided in four, each examined in turn; the
    smallest ones are taken to have room.
    """
    columns, rows = p.is_open.shape
    margin_x, margin_y = margins(p, i)
    width, height = (p.size[0] - 2.0 * margin_x) / columns, (p.size[1] - 2.0 * margin_y) / rows
    half = 0.5 * math.sqrt(width * width + height * height)
    # of the square: its column and row among parts x parts of the field
    x, y, level, parts = 0, 0, 0, 1
    while True:
        try_place(p, i, (column + (x + 0.5) / parts) / columns, (row + (y + 0.5) / parts) / rows)
        verdict = coverage(p, i, half / parts)
        if verdict == FREE or (verdict == UNDECIDED and level == SMALLEST_SQUARE):
            return True
        if verdict == UNDECIDED:
            x, y, level, parts = 2 * x, 2 * y, level + 1, 2 * parts
            continue
        while level > 0 and x % 2 == 1 and y % 2 == 1:  # the last of four
            x, y, level, parts = x // 2, y // 2, level - 1, parts // 2
        if level == 0:
            return False
        if x % 2 == 0:
            x += 1
        else:
            x, y = x - 1, y + 1


@kernel
def examine(p: Places, i: int, again: bool) -> bool:
    """Close the fields of the raster in which disk i has no room; return whether any stays open.

    `again`: fields closed before stay closed, as disks were only added since. Otherwise all are
    examined.
    """
    some_room = False
    for column in range(p.is_open.shape[0]):
        for row in range(p.is_open.shape[1]):
            is_open = (not again or p.is_open[column, row]) and has_room(p, i, column, row)
            p.is_open[column, row] = is_open
            some_room = some_room or is_open
    return some_room


@entry_point
def insert_disks(p: Places, numbers: np.ndarray, progress: np.ndarray) -> int:
    """Insert disks one after another; return PLACED, OUT_OF_NUMBERS or STUCK.

    `numbers` (n, 2) are uniform in [0, 1): one row for every try. `progress` (6,) int64, at first
    NOTHING_PLACED, is what a further call continues. A disk for which no room is left counts as one
    that has failed all of its tries, and used a row for each.
    """
    p = local_copy(p)
    n, columns, rows = len(p.radius), p.is_open.shape[0], p.is_open.shape[1]
    i, failed, unexamined = progress[NEXT], progress[FAILED], progress[UNEXAMINED]
    examined_for, compared = progress[EXAMINED_FOR], progress[COMPARED]
    used, outcome = 0, OUT_OF_NUMBERS
    while used < len(numbers) and i < n and outcome == OUT_OF_NUMBERS:
        u, v = numbers[used, 0], numbers[used, 1]
        used += 1
        known = examined_for >= 0 and p.radius[examined_for] == p.radius[i]
        if not known or p.is_open[int(u * columns), int(v * rows)]:
            try_place(p, i, u, v)
            compared += 1
            if is_free(p, i):
                register(p, i)
                i, failed = i + 1, 0
                continue
        failed, unexamined = failed + 1, unexamined + 1
        if failed == TRIES:
            outcome = STUCK
        elif unexamined >= FAILURES_PER_DISK * n and examined_for != i:
            unexamined = 0
            if not examine(p, i, known):
                progress[ROWS] += TRIES - failed
                outcome = STUCK
            examined_for = i
    progress[NEXT], progress[FAILED], progress[UNEXAMINED] = i, failed, unexamined
    progress[EXAMINED_FOR], progress[COMPARED] = examined_for, compared
    progress[ROWS] += used
    return PLACED if i == n else outcome


@kernel
def share_of_path(radius: np.ndarray, held: int, i: int, k: int) -> float:
    """Return disk i's part of the path by which disks i and k separate: the other's share of their
    areas.
    """
    if held in (i, k):
        return 0.0 if held == i else 1.0
    return radius[k] * radius[k] / (radius[i] * radius[i] + radius[k] * radius[k])


@kernel
def next_coordinate(value: float, step: float, radius: float, size: float, periodic: bool) -> float:
    """Return a coordinate after a step, inside the box: wrapped, or at least its radius from the
    walls.
    """
    value += step
    if periodic:
        value -= size * math.floor(value / size)
        return value if value < size else 0.0
    return min(max(value, radius), size - radius)


@kernel
def separate(p: Places, held: int, stretch: float, i: int, k: int) -> bool:
    """Return whether disks i and k overlap; move them apart, to `stretch` contact distances (not if
    that is 0).
    """
    position, radius, size = p.position, p.radius, p.size
    x, y = apart(p, i, k)
    sigma, square = radius[i] + radius[k], x * x + y * y
    wanted = stretch * sigma
    if square < wanted * wanted:
        distance = math.sqrt(square)
        if distance == 0.0:
            x, distance = sigma, sigma
        away = (wanted - math.sqrt(square)) / distance
        share = share_of_path(radius, held, i, k)
        step_of_i, step_of_k = -share * away, (1.0 - share) * away
        position[i, 0] = next_coordinate(
            position[i, 0], step_of_i * x, radius[i], size[0], p.periodic_x
        )
        position[i, 1] = next_coordinate(
            position[i, 1], step_of_i * y, radius[i], size[1], p.periodic_y
        )
        position[k, 0] = next_coordinate(
            position[k, 0], step_of_k * x, radius[k], size[0], p.periodic_x
        )
        position[k, 1] = next_coordinate(
            position[k, 1], step_of_k * y, radius[k], size[1], p.periodic_y
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
                overlapping += separate(p, held, stretch, i, k)
        left, right, bottom, top = block_around(p, i, (p.radius[i] + p.common) * max(stretch, 1.0))
        for column in range(left, right + 1):
            for row in range(bottom, top + 1):
                k = first_in_cell(p, column, row)
                while k >= 0:
                    if k != i:
                        overlapping += separate(p, held, stretch, i, k)
                    k = p.following[k]
    return overlapping


def insert_nothing() -> None:
    """Insert no disk, so that the kernel is compiled."""
    no_disks, none = np.zeros((0, 2)), np.zeros(0, np.int64)
    grid, is_open = np.zeros((1, 1), np.int64), np.zeros((1, 1), np.bool_)
    no_places = Places(
        no_disks, np.zeros(0), 1.0, none, np.ones(2), False, False, grid, none, is_open
    )
    insert_disks(no_places, no_disks, np.array(NOTHING_PLACED))
