"""Read-only kernels: sampling, and consistency checks (overlaps, disks outside their cell)."""

import math

from brownpipe.engines.collisions import encounter
from brownpipe.engines.exact import cells
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.disks import contact_distance, position, relative_motion
from brownpipe.engines.kernels import kernel


@kernel
def surroundings(lists, w, i):
    """Return centre and half sides (x, y, half width, half height) of the cell of disk i, or of its list's square."""
    if lists is not None:
        return lists.centre[2 * i], lists.centre[2 * i + 1], lists.half, lists.half
    box, a = w.grid, ws.ROW * i
    x, y = 0.5 * box.cell_width, 0.5 * box.cell_height
    return box.x + (2.0 * w.link[a + ws.CELL_COLUMN] + 1.0) * x, box.y + (2.0 * w.link[a + ws.CELL_ROW] + 1.0) * y, x, y


@kernel
def audit_place(lists, w, i, now):
    """Record in STRAY how far disk i is outside its cell or square, in cells.

    A disk that crossed an edge unnoticed could pass through another between two predictions without a visible overlap.
    """
    centre_x, centre_y, half_width, half_height = surroundings(lists, w, i)
    x, y = position(w, i, now)
    beyond_x = (abs(x - centre_x) - half_width) / w.grid.cell_width
    beyond_y = (abs(y - centre_y) - half_height) / w.grid.cell_height
    w.tally[ws.STRAY] = max(w.tally[ws.STRAY], max(beyond_x, beyond_y))


@kernel
def audit(w, i, now):
    """Check disk i for overlaps with its neighbours (NEAREST), and its position against its cell (STRAY)."""
    audit_place(w.lists, w, i, now)
    for j in range(cells.gather(w.big, w, i)):
        k = w.candidate[j] & ws.DISK_MASK
        if k != i:
            x, y, u, v = relative_motion(w, i, w.candidate[j], now)
            sigma = contact_distance(w.mass, w, i, k)
            c = encounter(x, y, u, v, sigma)[1]
            w.tally[ws.NEAREST] = min(w.tally[ws.NEAREST], c / (sigma * sigma))


@kernel
def boxes_beyond(image, w, x, y):
    """Return how many boxes to the right and above a position is.

    It can be outside a periodic box, as with neighbour lists a disk is wrapped only when it leaves its square.
    """
    if image is None:
        return 0, 0
    return math.floor((x - w.grid.x) / w.grid.width), math.floor((y - w.grid.y) / w.grid.height)


@kernel
def write_image(image, i, images, sample, column, across, up):
    """Write the image of disk i, how often it has left a periodic box, to (sample, column) of a record."""
    if image is not None:
        images[sample, column, 0] = image[2 * i] + across
        images[sample, column, 1] = image[2 * i + 1] + up


@kernel
def write_motion(w, i, now, positions, velocities, images, sample, column):
    """Write position, velocity and image of disk i at the time now to (sample, column) of a record."""
    x, y = position(w, i, now)
    across, up = boxes_beyond(w.image, w, x, y)
    positions[sample, column, 0] = x - across * w.grid.width
    positions[sample, column, 1] = y - up * w.grid.height
    velocities[sample, column, 0] = w.disk[ws.ROW * i + ws.VX]
    velocities[sample, column, 1] = w.disk[ws.ROW * i + ws.VY]
    write_image(w.image, i, images, sample, column, across, up)


@kernel
def take_sample(w, r, now):
    """Record the next sample, and audit the disks recorded; at the last sample audit all disks."""
    sample = w.progress[ws.SAMPLE]
    w.progress[ws.SAMPLE] = sample + 1
    if len(w.disk) == 0:
        return
    write_motion(w, r.tracer, now, r.position, r.velocity, r.image, sample, 0)
    whole = r.whole_position.shape[1] > 0
    is_last = sample == len(r.block) - 1
    first, end = (0, len(w.disk) // ws.ROW) if whole or is_last else (r.tracer, r.tracer + 1)
    for i in range(first, end):
        audit(w, i, now)
        if whole:
            write_motion(w, i, now, r.whole_position, r.whole_velocity, r.whole_image, sample, i)
