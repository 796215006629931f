"""Which pairs may touch: Verlet lists, made from cells whenever a disk may have come too far from where it was.

A list holds every pair closer than contact plus a skin, and is complete until a disk has moved by half the skin
(L. Verlet, Phys. Rev. 159, 98 (1967)). To make it, places are copied in the order of the cells, line by line, so that
neighbouring cells are stretches of the copies.
"""

import math

import numpy as np

from brownpipe.engines.kernels import kernel
from brownpipe.engines.timestep.workspace import (
    ACROSS,
    BUDGET,
    FAR,
    FASTEST,
    LISTS_MADE,
    OVERFULL,
    SKIN,
    SLACK,
    TRACER,
    WITHIN,
)

SAFE = 0.98  # of the skin is used: round-off of single precision moves disks, too
KEEP_ORDER = 16  # times that lists are made before the disks are moved in memory again, for neighbours to lie together
WORTH = 0.25  # of the skin still free: then the lists go on being used


@kernel
def survey(w):
    """Return how far a disk is at most from where it was when the lists were made, and the highest speed."""
    furthest, fastest = 0.0, 0.0
    for i in range(len(w.x)):
        x, y = w.x[i] - w.made_x[i], w.y[i] - w.made_y[i]
        furthest = max(furthest, np.float64(x * x + y * y))
        fastest = max(fastest, np.float64(w.vx[i] * w.vx[i] + w.vy[i] * w.vy[i]))
    return math.sqrt(furthest), math.sqrt(fastest)


@kernel
def slack(path):
    """Return by how much the squared distance of a pair may exceed that of contact, two steps of this path after it."""
    return 16.0 * path * path


@kernel
def renew(w):
    """Make sure that the lists hold for another step; return False if there is no room for them."""
    furthest, fastest = survey(w)
    w.tally[FASTEST] = fastest
    limit = 2.0 * fastest * w.step  # by how much a pair may come nearer in a step
    w.real[SLACK] = slack(fastest * w.step)
    free = 0.5 * SAFE * w.tally[SKIN] - furthest
    if free < max(0.5 * WORTH * w.tally[SKIN], limit) or w.clock[OVERFULL]:
        w.tally[SKIN] = w.real[FAR] = max(w.skin, 1.5 * limit)
        free = 0.5 * SAFE * w.tally[SKIN]
        make(w)
    w.tally[BUDGET] = -1.0 if w.clock[OVERFULL] else free
    return w.clock[OVERFULL] == 0


@kernel
def make(w):
    """Make the lists."""
    columns, lines = cells_across(w, w.box.width), cells_across(w, w.box.height)
    wrap(w)
    sort(w, columns, lines)
    w.clock[WITHIN] = w.clock[ACROSS] = w.clock[OVERFULL] = 0
    for line in range(lines):
        pairs_of_line(w, columns, lines, line)
        for column in range(columns if w.box.periodic else 0):
            if column == 0 or column == columns - 1 or line == lines - 1:
                pairs_round_the_box(w, columns, lines, column, line)
    for i in range(w.big):
        pairs_of_big(w, i)
    note_contacts(w, w.within, w.clock[WITHIN])
    note_contacts(w, w.across, w.clock[ACROSS])
    for i in range(len(w.x)):
        w.made_x[i], w.made_y[i] = w.x[i], w.y[i]
    w.clock[LISTS_MADE] += 1


@kernel
def note_contacts(w, pairs, number):
    """Note at which squared distance the pairs of a list touch, and where in memory their disks are."""
    for j in range(number):
        a, b = pairs.a[j], pairs.b[j]
        sigma = w.near_radius[a] + w.near_radius[b]
        pairs.contact[j] = sigma * sigma
        pairs.a[j], pairs.b[j] = w.order[a], w.order[b]


@kernel
def reach(w):
    """Return the largest distance of two disks, none of them big, on a list."""
    return 2.0 * w.largest + w.tally[SKIN]


@kernel
def cells_across(w, side):
    """Return how many cells fit into a side, none narrower than the reach.

    Altogether they are at most len(first) - 1, in a box so narrow that there is one row of them, too.
    """
    most = len(w.first) - 1
    least = math.sqrt(w.box.width * w.box.height / most)
    return min(max(int(side / max(reach(w), least)), 1), most)


@kernel
def wrap(w):
    """Take disks that left a periodic box to its other side."""
    if not w.box.periodic:
        return
    for i in range(len(w.x)):
        across, up = boxes_away(w.x[i], w.box.x, w.box.width), boxes_away(w.y[i], w.box.y, w.box.height)
        if across != 0 or up != 0:
            w.x[i] = np.float64(w.x[i]) - across * w.box.width
            w.y[i] = np.float64(w.y[i]) - up * w.box.height
            w.image_x[i] += across
            w.image_y[i] += up


@kernel
def boxes_away(place, low, side):
    """Return how many boxes from the first one a coordinate lies."""
    return math.floor((np.float64(place) - low) / side)


@kernel
def cell_along(place, low, side, cells):
    """Return which of the cells along a side a coordinate is in; what is outside belongs to the nearest."""
    return min(max(int((np.float64(place) - low) / side * cells), 0), cells - 1)


@kernel
def sort(w, columns, lines):
    """Find the order of the disks by their cells, within a cell that which they have (counting sort); copy by it."""
    n, first, order = len(w.x), w.first, w.order
    for cell in range(columns * lines + 1):
        first[cell] = 0
    for i in range(w.big, n):
        column = cell_along(w.x[i], w.box.x, w.box.width, columns)
        line = cell_along(w.y[i], w.box.y, w.box.height, lines)
        w.cell[i] = line * columns + column
        first[w.cell[i] + 1] += 1
    first[0] = w.big
    for cell in range(columns * lines):
        first[cell + 1] += first[cell]
    for i in range(w.big):
        order[i] = i
    for i in range(w.big, n):
        order[first[w.cell[i]]] = i
        first[w.cell[i]] += 1
    for cell in range(columns * lines, 0, -1):
        first[cell] = first[cell - 1]
    first[0] = w.big
    if w.clock[LISTS_MADE] % KEEP_ORDER == 0:
        move_in_memory(w)
    for i in range(n):
        w.near_x[i], w.near_y[i], w.near_radius[i] = w.x[order[i]], w.y[order[i]], w.radius[order[i]]


@kernel
def move_in_memory(w):
    """Put the disks themselves in the order of their cells."""
    for values in (w.x, w.y, w.vx, w.vy, w.radius):
        permute(values, w.order, w.near_x)
    for numbers in (w.disk, w.image_x, w.image_y, w.cell):
        permute(numbers, w.order, w.spare)
    for i in range(len(w.x)):
        w.order[i] = i
        if w.disk[i] == w.tracer:
            w.clock[TRACER] = i


@kernel
def permute(values, order, spare):
    """Bring values into an order."""
    for i in range(len(values)):
        spare[i] = values[i]
    for i in range(len(values)):
        values[i] = spare[order[i]]


@kernel
def pairs_of_line(w, columns, lines, line):
    """List the pairs of the disks in a line of cells: in the same cell, the one to the right and the three above."""
    pairs, first, m = w.within, w.first, w.clock[WITHIN]
    begin, end = line * columns, (line + 1) * columns
    x, y, radius, skin = w.near_x, w.near_y, w.near_radius, w.real[FAR]
    for i in range(first[begin], first[end]):
        cell = w.cell[w.order[i]]
        beside = first[min(cell + 2, end)] - (i + 1)
        above = first[max(cell + columns - 1, end)] if line + 1 < lines else 0
        number = first[min(cell + columns + 2, end + columns)] - above if line + 1 < lines else 0
        if m + beside + number > len(pairs.a):
            w.clock[OVERFULL] = 1
            return
        xi, yi, far = x[i], y[i], radius[i] + skin
        for j in range(beside + number):  # one loop over two stretches: its end has to be guessed once
            k = i + 1 + j if j < beside else above + j - beside
            dx, dy, most = x[k] - xi, y[k] - yi, radius[k] + far
            pairs.a[m], pairs.b[m] = i, k
            m += dx * dx + dy * dy < most * most
    w.clock[WITHIN] = m


@kernel
def pairs_round_the_box(w, columns, lines, column, line):
    """List the pairs of the disks of a cell with images in the same directions, for cells at a side of the box."""
    first, cell = w.first, line * columns + column
    wide, high = images_within_reach(reach(w), columns, w.box.width), images_within_reach(reach(w), lines, w.box.height)
    for above in range(high + 1):
        for aside in range(-wide if above > 0 else 1, wide + 1):
            across, up = (column + aside) // columns, (line + above) // lines
            if across != 0 or up != 0:
                other = (line + above - up * lines) * columns + column + aside - across * columns
                for i in range(first[cell], first[cell + 1]):
                    meet(w, w.across, ACROSS, i, first[other], first[other + 1], across, up)


@kernel
def images_within_reach(distance, cells, side):
    """Return how many cells to a side a distance reaches."""
    return max(1, math.ceil(distance * cells / side))


@kernel
def pairs_of_big(w, i):
    """List the pairs of big disk i with all small ones and the big ones after it."""
    meet(w, w.within, WITHIN, i, i + 1, len(w.x), 0, 0)
    if not w.box.periodic:
        return
    largest = w.largest
    for k in range(w.big):
        largest = max(largest, np.float64(w.radius[k]))
    far = np.float64(w.radius[i]) + largest + w.tally[SKIN]
    x, y = np.float64(w.x[i]) - w.box.x, np.float64(w.y[i]) - w.box.y
    for across in range(math.floor((x - far) / w.box.width), math.floor((x + far) / w.box.width) + 1):
        for up in range(math.floor((y - far) / w.box.height), math.floor((y + far) / w.box.height) + 1):
            if across != 0 or up != 0:
                meet(w, w.across, ACROSS, i, i + 1, len(w.x), across, up)


@kernel
def meet(w, pairs, counter, i, begin, end, across, up):
    """List the pairs of disk i with a stretch of the arrays, all seen as one image; say if there is no room."""
    m = begun = w.clock[counter]
    if m + end - begin > len(pairs.a):
        w.clock[OVERFULL] = 1
        return
    shift_x, shift_y = across * w.box.width, up * w.box.height
    x, y, far = w.near_x[i] - shift_x, w.near_y[i] - shift_y, w.near_radius[i] + w.tally[SKIN]
    for k in range(begin, end):
        dx, dy, most = w.near_x[k] - x, w.near_y[k] - y, w.near_radius[k] + far
        pairs.a[m], pairs.b[m] = i, k
        m += dx * dx + dy * dy < most * most
    w.clock[counter] = m
    if across != 0 or up != 0:
        pairs.shift_x[begun:m], pairs.shift_y[begun:m] = shift_x, shift_y
