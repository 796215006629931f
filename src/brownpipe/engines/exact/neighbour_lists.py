"""Where the neighbours are when it is crowded: every disk keeps a list of them.

Each disk has a small square of its own around the place where its list was made. While two disks stay in their squares,
they can touch only if the squares are less than a contact distance apart; those that are know each other. A disk that
leaves its square gets a new one around the place where it is, and a new list. The cells then hold the disks by the
centres of their squares, and are needed only to make lists.
"""

import math

import numpy as np

from brownpipe.engines.exact import cells
from brownpipe.engines.exact.disks import contact_distance, shifted
from brownpipe.engines.exact.workspace import (
    COLUMN,
    DISK_BITS,
    DISK_MASK,
    LINE,
    LIST_LINE,
    OVERFULL,
    ROW,
    TIME,
    VX,
    VY,
    WIDE_LINE,
    X,
    Y,
)
from brownpipe.engines.kernels import kernel


@kernel
def reversed_image(candidate, i):
    """Return disk i as it is seen by a candidate that disk i sees."""
    image = candidate >> DISK_BITS
    across, up = image % 3, image // 3
    return i + ((((3 - across) % 3) + 3 * ((3 - up) % 3)) << DISK_BITS)


@kernel
def room(wide):
    """Return how many numbers the list of a disk takes, as a constant: one in the workspace costs 4 %."""
    if wide is None:
        return LIST_LINE
    return WIDE_LINE


@kernel
def append(lists, w, i, candidate):
    """Put a candidate on the list of disk i; if there is no room, say so in the clock."""
    first = room(lists.wide) * i
    n = lists.neighbour[first]
    if n + 1 == room(lists.wide):
        w.progress[OVERFULL] = 1
        return
    lists.neighbour[first + 1 + n] = candidate
    lists.neighbour[first] = n + 1


@kernel
def strike(lists, i, candidate):
    """Take a candidate off the list of disk i, the last one taking its place."""
    first = room(lists.wide) * i
    n = lists.neighbour[first]
    last = lists.neighbour[first + n]
    for j in range(first + 1, first + n):
        if lists.neighbour[j] == candidate:
            lists.neighbour[j] = last
    lists.neighbour[first] = n - 1


@kernel
def near(lists, w, i, candidate):
    """Whether the squares of disk i and of a candidate are less than a contact distance apart."""
    k = candidate & DISK_MASK
    x, y = lists.centre[2 * k] - lists.centre[2 * i], lists.centre[2 * k + 1] - lists.centre[2 * i + 1]
    x, y = shifted(w.shift, candidate, x, y)
    x, y = max(abs(x) - 2.0 * lists.half, 0.0), max(abs(y) - 2.0 * lists.half, 0.0)
    sigma = contact_distance(w.mass, w, i, k)
    return x * x + y * y < sigma * sigma


@kernel
def forget(lists, i):
    """Empty the list of disk i, and take it off the lists of its neighbours."""
    first = room(lists.wide) * i
    for j in range(first + 1, first + 1 + lists.neighbour[first]):
        strike(lists, lists.neighbour[j] & DISK_MASK, reversed_image(lists.neighbour[j], i))
    lists.neighbour[first] = 0


@kernel
def centre(lists, w, i, now):
    """Give disk i a square around the place where it is."""
    a = ROW * i
    since = now - w.disk[a + TIME]
    lists.centre[2 * i] = w.disk[a + X] + w.disk[a + VX] * since
    lists.centre[2 * i + 1] = w.disk[a + Y] + w.disk[a + VY] * since


@kernel
def meet(lists, w, i, least):
    """Put disk i and its neighbours, of those numbered `least` or more, on each other's lists."""
    for j in range(cells.gather_around(w, np.int64(w.link[ROW * i + COLUMN]), np.int64(w.link[ROW * i + LINE]))):
        candidate = w.candidate[j]
        k = candidate & DISK_MASK
        if k >= least and k != i and near(lists, w, i, candidate):
            append(lists, w, i, candidate)
            append(lists, w, k, reversed_image(candidate, i))


@kernel
def edges_ahead(lists, i, vx, vy):
    """Return where the square of disk i ends in both directions of its motion."""
    return lists.centre[2 * i] + math.copysign(lists.half, vx), lists.centre[2 * i + 1] + math.copysign(lists.half, vy)


@kernel
def neighbours(lists, i):
    """Return the array that the list of disk i is in, where it begins, and how many it holds."""
    first = room(lists.wide) * i
    return lists.neighbour, first + 1, lists.neighbour[first]
