"""Samples of a run, and consistency checks: overlaps, and disks outside their cell.

Positions, velocities and images of disks are only read: neither changes a disk or an event.
"""

import math

import numpy as np

from brownpipe.engines.collisions import encounter
from brownpipe.engines.compiled.fours import four, four_entries, least_of_four, where
from brownpipe.engines.compiled.kernels import kernel
from brownpipe.engines.compiled.records import SampleArrays
from brownpipe.engines.exact import cells
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.workspace import (
    four_contact_distances,
    four_disks,
    four_shifted,
    position,
)


@kernel
def audit_place(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, now: float) -> None:
    """Record in STRAY how far disk i is outside its cell, or the square of its list, in cells.

    A disk that crossed an edge unnoticed could pass through another between two predictions without
    a visible overlap.
    """
    box, a = w.grid, ws.ROW * i
    if lists is not None:
        half_width = half_height = lists.half
        centre_x, centre_y = lists.centre[2 * i], lists.centre[2 * i + 1]
    else:
        half_width, half_height = 0.5 * box.cell_width, 0.5 * box.cell_height
        centre_x = box.x + (2.0 * w.link[a + ws.CELL_COLUMN] + 1.0) * half_width
        centre_y = box.y + (2.0 * w.link[a + ws.CELL_ROW] + 1.0) * half_height
    x, y = position(w, i, now)
    beyond_x = (abs(x - centre_x) - half_width) / box.cell_width
    beyond_y = (abs(y - centre_y) - half_height) / box.cell_height
    w.tally[ws.STRAY] = max(w.tally[ws.STRAY], max(beyond_x, beyond_y))


@kernel
def audit(w: ws.Workspace, i: int, now: float) -> None:
    """Check disk i for overlaps with its neighbours (NEAREST), and its position against its cell
    (STRAY).
    """
    audit_place(w.lists, w, i, now)
    x_i, y_i = position(w, i, now)
    m = cells.gather(w.big, w, i, ws.PAIR)
    for j in range(0, m, 4):
        candidate = four_entries(w.candidate, j, m, i)
        k = candidate & ws.DISK_MASK
        x_k, y_k, u, v, _, radius = four_disks(w, k, now)
        x, y = four_shifted(w.shift, candidate, x_k - x_i, y_k - y_i)
        sigma = four_contact_distances(w.mass, w, i, radius)
        sigma2 = sigma * sigma
        c = encounter(x, y, u, v, sigma2)[1]  # whatever the velocities
        w.tally[ws.NEAREST] = min(
            w.tally[ws.NEAREST], least_of_four(where(k != i, c / sigma2, four(math.inf)))
        )


@kernel
def boxes_outside(wraps: ws.Periodic | None, distance: float, side: float) -> int:
    """Return how many boxes away a coordinate is, its `distance` from the lower side of the box: 0
    between walls, where round-off may put it beyond one.
    """
    if wraps is None:
        return 0
    return math.floor(distance / side)


@kernel
def write_motion(
    image: np.ndarray | None,
    w: ws.Workspace,
    i: int,
    now: float,
    track: SampleArrays,
    sample: int,
    column: int,
) -> None:
    """Write position, velocity and image of disk i at the time now to (sample, column) of a track.

    A disk can be outside a periodic box, as with neighbour lists it is wrapped only when it leaves
    its square.
    """
    x, y = position(w, i, now)
    if image is not None:
        across = boxes_outside(w.wraps_x, x - w.grid.x, w.grid.width)
        up = boxes_outside(w.wraps_y, y - w.grid.y, w.grid.height)
        x, y = x - across * w.grid.width, y - up * w.grid.height
        track.image[sample, column, 0] = image[2 * i] + across
        track.image[sample, column, 1] = image[2 * i + 1] + up
    track.position[sample, column, 0], track.position[sample, column, 1] = x, y
    track.velocity[sample, column, 0] = w.disk[ws.ROW * i + ws.VX]
    track.velocity[sample, column, 1] = w.disk[ws.ROW * i + ws.VY]


@kernel
def take_sample(w: ws.Workspace, r: ws.Recorder, now: float) -> None:
    """Record the next sample, and audit the disks recorded; at the last one of the recorder audit
    all disks.
    """
    sample = w.progress[ws.SAMPLE]
    w.progress[ws.SAMPLE] = sample + 1
    if len(w.disk) == 0:
        return
    write_motion(w.image, w, r.tracer, now, r.track, sample, 0)
    whole = r.whole.position.shape[1] > 0
    is_last = sample == len(r.block) - 1
    first, end = (0, len(w.disk) // ws.ROW) if whole or is_last else (r.tracer, r.tracer + 1)
    for i in range(first, end):
        audit(w, i, now)
        if whole:
            write_motion(w.image, w, i, now, r.whole, sample, i)
