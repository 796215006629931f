"""What is looked at without being touched: samples for the record, and the audit of the engine's own books."""

import math

import numpy as np

from brownpipe.engines.collisions import encounter
from brownpipe.engines.exact import cells
from brownpipe.engines.exact.disks import contact_distance, displacement
from brownpipe.engines.exact.workspace import COLUMN, DISK_MASK, LINE, NEAREST, ROW, SAMPLE, STRAY, TIME, VX, VY, X, Y
from brownpipe.engines.kernels import kernel


@kernel
def surroundings(neighbour_lists, w, i):
    """Return centre and half sides of the cell of disk i, or of the square of its list: it must not be outside."""
    if neighbour_lists is not None:
        half = neighbour_lists.half
        return neighbour_lists.centre[2 * i], neighbour_lists.centre[2 * i + 1], half, half
    box, a = w.grid, ROW * i
    x, y = 0.5 * box.cell_width, 0.5 * box.cell_height
    return box.x + (2.0 * w.link[a + COLUMN] + 1.0) * x, box.y + (2.0 * w.link[a + LINE] + 1.0) * y, x, y


@kernel
def audit_place(neighbour_lists, w, i, now):
    """Look whether disk i is where its neighbours look for it.

    One that crossed an edge unnoticed could pass through another between two predictions, and no overlap would show.
    """
    a = ROW * i
    since = now - w.disk[a + TIME]
    x, y, half_width, half_height = surroundings(neighbour_lists, w, i)
    x, y = w.disk[a + X] + w.disk[a + VX] * since - x, w.disk[a + Y] + w.disk[a + VY] * since - y
    out = max((abs(x) - half_width) / w.grid.cell_width, (abs(y) - half_height) / w.grid.cell_height)
    w.tally[STRAY] = max(w.tally[STRAY], out)


@kernel
def audit(w, i, now):
    """Look for overlaps of disk i with its neighbours, and for itself where they look for it."""
    audit_place(w.lists, w, i, now)
    column, line = np.int64(w.link[ROW * i + COLUMN]), np.int64(w.link[ROW * i + LINE])
    m = cells.gather(w.big, w, i, column, line)
    for j in range(m):
        k = w.candidate[j] & DISK_MASK
        if k != i:
            x, y, u, v = displacement(w, i, w.candidate[j], now)
            sigma = contact_distance(w.mass, w, i, k)
            c = encounter(x, y, u, v, sigma)[1]
            w.tally[NEAREST] = min(w.tally[NEAREST], c / (sigma * sigma))


@kernel
def boxes_beyond(image, w, x, y):
    """Return how many boxes to the right and above a position is: with lists, disks go round the box late."""
    if image is None:
        return 0, 0
    return math.floor((x - w.grid.x) / w.grid.width), math.floor((y - w.grid.y) / w.grid.height)


@kernel
def note_image(image, i, images, row, column, across, up):
    """Write how often disk i went round a periodic box into a row of a record."""
    if image is not None:
        images[row, column, 0] = image[2 * i] + across
        images[row, column, 1] = image[2 * i + 1] + up


@kernel
def note(w, i, now, position, velocity, images, row, column):
    """Write where disk i is now into a row of a record."""
    disk, a = w.disk, ROW * i
    since = now - disk[a + TIME]
    x, y = disk[a + X] + disk[a + VX] * since, disk[a + Y] + disk[a + VY] * since
    across, up = boxes_beyond(w.image, w, x, y)
    position[row, column, 0] = x - across * w.grid.width
    position[row, column, 1] = y - up * w.grid.height
    velocity[row, column, 0] = disk[a + VX]
    velocity[row, column, 1] = disk[a + VY]
    note_image(w.image, i, images, row, column, across, up)


@kernel
def sample(w, r, now):
    """Take a sample, and look for overlaps among what it shows; at the last one among all."""
    row = w.progress[SAMPLE]
    w.progress[SAMPLE] = row + 1
    if len(w.disk) == 0:
        return
    note(w, r.tracer, now, r.position, r.velocity, r.image, row, 0)
    whole = r.whole_position.shape[1] > 0
    first, end = (0, len(w.disk) // ROW) if whole or row == len(r.block) - 1 else (r.tracer, r.tracer + 1)
    for i in range(first, end):
        audit(w, i, now)
        if whole:
            note(w, i, now, r.whole_position, r.whole_velocity, r.whole_image, row, i)
