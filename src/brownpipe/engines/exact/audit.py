"""Consistency checks of a run: overlaps, and disks outside their cell. Positions and velocities are only read."""

import math

from brownpipe.engines.collisions import encounter
from brownpipe.engines.exact import cells
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.disks import four_contact_distances, four_disks, four_shifted, position
from brownpipe.engines.fours import four, four_entries, least, where
from brownpipe.engines.kernels import kernel


@kernel
def surroundings(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int) -> tuple[float, float, float, float]:
    """Return centre and half sides (x, y, half width, half height) of the cell of disk i, or of its list's square."""
    if lists is not None:
        return lists.centre[2 * i], lists.centre[2 * i + 1], lists.half, lists.half
    box, a = w.grid, ws.ROW * i
    x, y = 0.5 * box.cell_width, 0.5 * box.cell_height
    return box.x + (2.0 * w.link[a + ws.CELL_COLUMN] + 1.0) * x, box.y + (2.0 * w.link[a + ws.CELL_ROW] + 1.0) * y, x, y


@kernel
def audit_place(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, now: float) -> None:
    """Record in STRAY how far disk i is outside its cell or square, in cells.

    A disk that crossed an edge unnoticed could pass through another between two predictions without a visible overlap.
    """
    centre_x, centre_y, half_width, half_height = surroundings(lists, w, i)
    x, y = position(w, i, now)
    beyond_x = (abs(x - centre_x) - half_width) / w.grid.cell_width
    beyond_y = (abs(y - centre_y) - half_height) / w.grid.cell_height
    w.tally[ws.STRAY] = max(w.tally[ws.STRAY], max(beyond_x, beyond_y))


@kernel
def audit(w: ws.Workspace, i: int, now: float) -> None:
    """Check disk i for overlaps with its neighbours (NEAREST), and its position against its cell (STRAY)."""
    audit_place(w.lists, w, i, now)
    x_i, y_i = position(w, i, now)
    m = cells.gather(w.big, w, i)
    for j in range(0, m, 4):
        candidate = four_entries(w.candidate, j, m, i)
        k = candidate & ws.DISK_MASK
        x_k, y_k, u, v, _, radius = four_disks(w, k, now)
        x, y = four_shifted(w.shift, candidate, x_k - x_i, y_k - y_i)
        sigma = four_contact_distances(w.mass, w, i, radius)
        c = encounter(x, y, u, v, sigma)[1]  # whatever the velocities
        w.tally[ws.NEAREST] = min(w.tally[ws.NEAREST], least(where(k != i, c / (sigma * sigma), four(math.inf))))
