"""Consistency checks of a run: overlaps, and disks outside their cell. Positions and velocities are only read."""

from brownpipe.engines.collisions import encounter
from brownpipe.engines.exact import cells
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.disks import contact_distance, position, relative_motion
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
    for j in range(cells.gather(w.big, w, i)):
        k = w.candidate[j] & ws.DISK_MASK
        if k != i:
            x, y, u, v = relative_motion(w, i, w.candidate[j], now)
            sigma = contact_distance(w.mass, w, i, k)
            c = encounter(x, y, u, v, sigma)[1]
            w.tally[ws.NEAREST] = min(w.tally[ws.NEAREST], c / (sigma * sigma))
