"""Verlet lists of the pairs that may touch, built from a cell list.

A list holds every pair closer than contact plus a skin. It is complete until some disk has moved by
half the skin since it was built (L. Verlet, Phys. Rev. 159, 98 (1967)). To build it, positions are
copied in the order of the cells, row by row, so that the disks of neighbouring cells of a row are
contiguous in memory.
"""

import math

import numpy as np

from brownpipe.engines.compiled.kernels import kernel
from brownpipe.engines.start.insertion import interval_of
from brownpipe.engines.timestep import workspace as ws

SAFE = 0.98  # part of the skin that is used; the rest covers round-off
# builds of the lists between two sorts of the disks by cell, which keep neighbours close in memory
KEEP_ORDER = 16
WORTH = 0.25  # the lists are kept while at least this part of the skin is unused


@kernel
def set_fastest(w: ws.Workspace, speed: float) -> None:
    """Set the upper bound on all speeds, and by how much r^2 then exceeds sigma^2 two steps after
    contact.
    """
    path = speed * w.step
    w.tally[ws.FASTEST], w.tally[ws.SLACK] = speed, 16.0 * path * path


@kernel
def renew(w: ws.Workspace) -> bool:
    """Make sure that the lists hold for another step, building them if necessary; return False if
    they are full.

    BUDGET becomes the distance that any disk may still move before the next call.
    """
    furthest, fastest = 0.0, 0.0  # squares of the path since the lists were built, and of the speed
    for i in range(len(w.x)):
        x, y = w.x[i] - w.x_at_build[i], w.y[i] - w.y_at_build[i]
        furthest = max(furthest, x * x + y * y)
        fastest = max(fastest, w.vx[i] * w.vx[i] + w.vy[i] * w.vy[i])
    set_fastest(w, math.sqrt(fastest))
    limit = 2.0 * w.tally[ws.FASTEST] * w.step  # by how much a pair may come nearer in a step
    free = 0.5 * SAFE * w.tally[ws.SKIN] - math.sqrt(furthest)
    if free < max(0.5 * WORTH * w.tally[ws.SKIN], limit) or w.counters[ws.OVERFULL]:
        w.tally[ws.SKIN] = max(w.skin, 1.5 * limit)
        free = 0.5 * SAFE * w.tally[ws.SKIN]
        make(w)
    w.tally[ws.BUDGET] = -1.0 if w.counters[ws.OVERFULL] else free
    return w.counters[ws.OVERFULL] == 0


@kernel
def make(w: ws.Workspace) -> None:
    """Build the lists; OVERFULL is set if the pairs exceed the capacity of a list."""
    columns, rows = cells_along_side(w, w.box.width), cells_along_side(w, w.box.height)
    wrap(w)
    sort(w, columns, rows)
    w.counters[ws.WITHIN] = w.counters[ws.ACROSS] = w.counters[ws.OVERFULL] = 0
    for row in range(rows):
        pairs_of_row(w, columns, rows, row)
        for column in range(columns):
            is_at_side = column == 0 or column == columns - 1
            if (w.box.periodic_x and is_at_side) or (w.box.periodic_y and row == rows - 1):
                pairs_across_sides(w, columns, rows, column, row)
    for i in range(w.big):
        pairs_of_big(w, i)
    finish_list(w, w.within, w.counters[ws.WITHIN])
    finish_list(w, w.across, w.counters[ws.ACROSS])
    for i in range(len(w.x)):
        w.x_at_build[i], w.y_at_build[i] = w.x[i], w.y[i]
    w.counters[ws.LISTS_BUILT] += 1


@kernel
def finish_list(w: ws.Workspace, pairs: ws.PairList, number: int) -> None:
    """Store sigma^2 of the listed pairs, and replace places in the sorted copies by places in
    memory.
    """
    for j in range(number):
        a, b = pairs.a[j], pairs.b[j]
        sigma = w.sorted_radius[a] + w.sorted_radius[b]
        pairs.contact[j] = sigma * sigma
        pairs.a[j], pairs.b[j] = w.order[a], w.order[b]


@kernel
def listing_distance(w: ws.Workspace) -> float:
    """Return the distance up to which a pair without a big disk is listed."""
    return 2.0 * w.common_radius + w.tally[ws.SKIN]


@kernel
def cells_along_side(w: ws.Workspace, side: float) -> int:
    """Return how many cells fit along a side, none narrower than the reach.

    All cells together are at most len(cell_start) - 1, also in a box so narrow that it has one row
    of cells.
    """
    most = len(w.cell_start) - 1
    least = math.sqrt(w.box.width * w.box.height / most)
    return min(max(int(side / max(listing_distance(w), least)), 1), most)


@kernel
def wrap(w: ws.Workspace) -> None:
    """Move disks that left the box at a periodic side to its opposite side."""
    if not (w.box.periodic_x or w.box.periodic_y):
        return
    for i in range(len(w.x)):
        across, up = boxes_away(w, w.x[i], w.y[i])
        if across != 0 or up != 0:
            w.x[i] = w.x[i] - across * w.box.width
            w.y[i] = w.y[i] - up * w.box.height
            w.image_x[i] += across
            w.image_y[i] += up


@kernel
def boxes_away(w: ws.Workspace, x: float, y: float) -> tuple[int, int]:
    """Return how many boxes to the right and above a point is; 0 between walls."""
    across, up = 0, 0
    if w.box.periodic_x:
        across = math.floor((x - w.box.x) / w.box.width)
    if w.box.periodic_y:
        up = math.floor((y - w.box.y) / w.box.height)
    return across, up


@kernel
def is_image(w: ws.Workspace, across: int, up: int) -> bool:
    """Return whether a disk has an image so many boxes to the right and above, other than
    itself.
    """
    if (across != 0 and not w.box.periodic_x) or (up != 0 and not w.box.periodic_y):
        return False
    return across != 0 or up != 0


@kernel
def sort(w: ws.Workspace, columns: int, rows: int) -> None:
    """Sort the disks by cell, big disks first (a stable counting sort), and copy positions and
    radii in this order.
    """
    n, cell_start, order = len(w.x), w.cell_start, w.order
    for cell in range(columns * rows + 1):
        cell_start[cell] = 0
    for i in range(w.big, n):
        column = interval_of(w.x[i] - w.box.x, w.box.width, columns)
        row = interval_of(w.y[i] - w.box.y, w.box.height, rows)
        w.cell[i] = row * columns + column
        cell_start[w.cell[i] + 1] += 1
    cell_start[0] = w.big
    for cell in range(columns * rows):
        cell_start[cell + 1] += cell_start[cell]
    for i in range(w.big):
        order[i] = i
    for i in range(w.big, n):
        order[cell_start[w.cell[i]]] = i
        cell_start[w.cell[i]] += 1
    for cell in range(columns * rows, 0, -1):
        cell_start[cell] = cell_start[cell - 1]
    cell_start[0] = w.big
    if w.counters[ws.LISTS_BUILT] % KEEP_ORDER == 0:
        sort_in_memory(w)
    for i in range(n):
        w.sorted_x[i], w.sorted_y[i], w.sorted_radius[i] = (
            w.x[order[i]],
            w.y[order[i]],
            w.radius[order[i]],
        )


@kernel
def sort_in_memory(w: ws.Workspace) -> None:
    """Sort the disks themselves by cell."""
    for values in (w.x, w.y, w.vx, w.vy, w.radius):
        permute(values, w.order, w.sorted_x)
    for numbers in (w.disk, w.image_x, w.image_y, w.cell):
        permute(numbers, w.order, w.scratch)
    for i in range(len(w.x)):
        w.order[i] = i
        if w.disk[i] == w.tracer:
            w.counters[ws.TRACER] = i


@kernel
def permute(values: np.ndarray, order: np.ndarray, scratch: np.ndarray) -> None:
    """Reorder values in place: entry i becomes the former entry order[i]."""
    for i in range(len(values)):
        scratch[i] = values[i]
    for i in range(len(values)):
        values[i] = scratch[order[i]]


@kernel
def pairs_of_row(w: ws.Workspace, columns: int, rows: int, row: int) -> None:
    """List the pairs of the disks in a row of cells: in the same cell, the next one, and the three
    in the row above.
    """
    pairs, cell_start, m = w.within, w.cell_start, w.counters[ws.WITHIN]
    begin, end = row * columns, (row + 1) * columns
    x, y, radius, skin = w.sorted_x, w.sorted_y, w.sorted_radius, w.tally[ws.SKIN]
    for i in range(cell_start[begin], cell_start[end]):
        cell = w.cell[w.order[i]]
        beside = cell_start[min(cell + 2, end)] - (i + 1)
        above = cell_start[max(cell + columns - 1, end)] if row + 1 < rows else 0
        number = cell_start[min(cell + columns + 2, end + columns)] - above if row + 1 < rows else 0
        if m + beside + number > len(pairs.a):
            w.counters[ws.OVERFULL] = 1
            return
        xi, yi, far = x[i], y[i], radius[i] + skin
        for j in range(
            beside + number
        ):  # one loop over two intervals: one branch misprediction at its end
            k = i + 1 + j if j < beside else above + j - beside
            dx, dy, most = x[k] - xi, y[k] - yi, radius[k] + far
            pairs.a[m], pairs.b[m] = i, k
            m += dx * dx + dy * dy < most * most
    w.counters[ws.WITHIN] = m


@kernel
def pairs_across_sides(w: ws.Workspace, columns: int, rows: int, column: int, row: int) -> None:
    """List the pairs of the disks of a cell at a side with periodic images in the same directions
    as `pairs_of_row`.
    """
    cell_start, cell = w.cell_start, row * columns + column
    wide, high = (
        images_within_reach(listing_distance(w), columns, w.box.width),
        images_within_reach(listing_distance(w), rows, w.box.height),
    )
    for above in range(high + 1):
        for aside in range(-wide if above > 0 else 1, wide + 1):
            across, up = (column + aside) // columns, (row + above) // rows
            if is_image(w, across, up):
                other = (row + above - up * rows) * columns + column + aside - across * columns
                for i in range(cell_start[cell], cell_start[cell + 1]):
                    list_pairs(
                        w,
                        w.across,
                        ws.ACROSS,
                        i,
                        cell_start[other],
                        cell_start[other + 1],
                        across,
                        up,
                    )


@kernel
def images_within_reach(distance: float, cells: int, side: float) -> int:
    """Return how many cells on each side, those of periodic images included, are within a
    distance.
    """
    return max(1, math.ceil(distance * cells / side))


@kernel
def pairs_of_big(w: ws.Workspace, i: int) -> None:
    """List the pairs of big disk i with all disks after it, and with their periodic images."""
    list_pairs(w, w.within, ws.WITHIN, i, i + 1, len(w.x), 0, 0)
    if not (w.box.periodic_x or w.box.periodic_y):
        return
    largest = w.common_radius
    for k in range(w.big):
        largest = max(largest, w.radius[k])
    far = w.radius[i] + largest + w.tally[ws.SKIN]
    x, y = w.x[i] - w.box.x, w.y[i] - w.box.y
    for across in range(
        math.floor((x - far) / w.box.width), math.floor((x + far) / w.box.width) + 1
    ):
        for up in range(
            math.floor((y - far) / w.box.height), math.floor((y + far) / w.box.height) + 1
        ):
            if is_image(w, across, up):
                list_pairs(w, w.across, ws.ACROSS, i, i + 1, len(w.x), across, up)


@kernel
def list_pairs(
    w: ws.Workspace,
    pairs: ws.PairList,
    counter: int,
    i: int,
    begin: int,
    end: int,
    across: int,
    up: int,
) -> None:
    """List the pairs of disk i with the sorted disks from begin to end - 1, shifted by (across, up)
    boxes.
    """
    start = w.counters[counter]
    m = start
    if m + end - begin > len(pairs.a):
        w.counters[ws.OVERFULL] = 1
        return
    shift_x, shift_y = across * w.box.width, up * w.box.height
    x, y, far = (
        w.sorted_x[i] - shift_x,
        w.sorted_y[i] - shift_y,
        w.sorted_radius[i] + w.tally[ws.SKIN],
    )
    for k in range(begin, end):
        dx, dy, most = w.sorted_x[k] - x, w.sorted_y[k] - y, w.sorted_radius[k] + far
        pairs.a[m], pairs.b[m] = i, k
        m += dx * dx + dy * dy < most * most
    w.counters[counter] = m
    if across != 0 or up != 0:
        pairs.shift_x[start:m], pairs.shift_y[start:m] = shift_x, shift_y
