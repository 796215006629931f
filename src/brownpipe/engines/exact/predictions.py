"""Prediction: the earliest pair collision of a disk, and its one next event, which enters the event
queue.

For every pair of neighbours at least one of the two has a next pair event not later than their
collision, so that the earliest event of all is always correct (B. D. Lubachevsky, J. Comput. Phys.
94, 255 (1991)).
"""

import math

import numpy as np

from brownpipe.engines.collisions import delay, encounter, meets, wall_time
from brownpipe.engines.compiled.fours import (
    any_of,
    four,
    four_entries,
    four_from,
    least_of_four,
    where,
)
from brownpipe.engines.compiled.kernels import kernel
from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.workspace import (
    four_contact_distances,
    four_disks,
    four_shifted,
    position,
    radius_of,
)


@kernel
def earliest(
    w: ws.Workspace, i: int, now: float, candidates: np.ndarray, first: int, m: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a four of the times of the earliest collisions of disk i, and a four of the indices of
    the partners.

    The candidates are candidates[first : first + m]. They are considered four at a time; the last
    four are completed by disk i itself, which it never meets. Each of the `best` is the earliest of
    every fourth candidate, `chosen` its index; where none is earlier than the pair event that disk
    i has, `best` is the time of that event and `chosen` is `first`, which is always readable. Skip
    a partner whose own next collision is earlier: it will be re-predicted then and will find disk
    i. For a pair that does not meet `latest` is NaN, so that no time, not even -inf, counts as
    earlier.
    """
    disk, a = w.disk, ws.ROW * i
    x_i, y_i = position(w, i, now)
    vx_i, vy_i = disk[a + ws.VX], disk[a + ws.VY]
    best, chosen, index = four(disk[a + ws.PAIR_TIME]), four(first), four_from(first)
    nearest = w.tally[ws.NEAREST]
    for j in range(first, first + m, 4):
        candidate = four_entries(candidates, j, first + m, i)
        k = candidate & ws.DISK_MASK
        x_k, y_k, vx_k, vy_k, pair_time_k, radius_k = four_disks(w, k, now)
        x, y = four_shifted(w.shift, candidate, x_k - x_i, y_k - y_i)
        sigma = four_contact_distances(w.mass, w, i, radius_k)
        sigma2 = sigma * sigma
        b, c, d = encounter(x, y, vx_k - vx_i, vy_k - vy_i, sigma2)
        time = now + delay(b, c, d)
        latest = where(meets(b, d), pair_time_k, four(math.nan))
        sooner = (time < best) & (time <= latest)
        best, chosen = where(sooner, time, best), where(sooner, index, chosen)
        index = index + 4.0
        closer = (c < nearest * sigma2) & (k != i)
        if any_of(closer):
            nearest = least_of_four(where(closer, c / sigma2, four(nearest)))
            w.tally[ws.NEAREST] = nearest
    return best, chosen


@kernel
def earliest_candidate(
    candidates: np.ndarray, best: np.ndarray, chosen: np.ndarray, time: float
) -> np.int64:
    """Return the candidate whose collision is the earliest, at `time`, the least of `best`; the
    first of equal ones.
    """
    index = least_of_four(where(best <= time, chosen, four(math.inf)))
    return np.int64(candidates[int(index)])


@kernel
def set_partner(
    w: ws.Workspace,
    i: int,
    time: float,
    candidates: np.ndarray,
    best: np.ndarray,
    chosen: np.ndarray,
) -> None:
    """Store a collision at `time`, the least of `best`, as the pair event of disk i, if earlier
    than the one it has.

    There is no branch, as nobody can predict whether a disk that has entered a cell finds an
    earlier collision there.
    """
    disk, link, a = w.disk, w.link, ws.ROW * i
    sooner = time < disk[a + ws.PAIR_TIME]
    disk[a + ws.PAIR_TIME] = time
    partner, changes = np.int64(link[a + ws.PARTNER]), np.int64(link[a + ws.PARTNER_CHANGES])
    other = earliest_candidate(candidates, best, chosen, time)
    other_changes = np.int64(disk[ws.ROW * (other & ws.DISK_MASK) + ws.CHANGES])
    link[a + ws.PARTNER] = partner + sooner * (other - partner)
    link[a + ws.PARTNER_CHANGES] = changes + sooner * (other_changes - changes)


@kernel
def leave_time(
    wraps: ws.Periodic | None,
    position: float,
    velocity: float,
    since: float,
    edge: float,
    low: float,
    side: float,
    radius: float,
) -> tuple[float, bool]:
    """Return when a disk, moving so at the time `since`, reaches the edge or wall ahead in x or y,
    and whether a wall.

    Consider only the wall the disk moves towards, eq. (4): if round-off has left it slightly beyond
    the opposite wall, that contact also lies ahead and must be ignored. If it overlaps the wall
    ahead by round-off, the time is before `since`.
    """
    if wraps is not None:
        return since + wall_time(edge - position, velocity), False
    end = min(max(edge, low + radius), low + side - radius)
    return since + wall_time(end - position, velocity), (edge - end) * velocity > 0.0


@kernel
def edges_ahead(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, vx: float, vy: float
) -> tuple[float, float]:
    """Return the edges (x, y) of the cell of disk i, or of the square of its list, to which it
    moves.
    """
    if lists is not None:
        x, y = lists.centre[2 * i], lists.centre[2 * i + 1]
        return x + math.copysign(lists.half, vx), y + math.copysign(lists.half, vy)
    box, a = w.grid, ws.ROW * i
    x = box.x + (w.link[a + ws.CELL_COLUMN] + (vx > 0.0)) * box.cell_width
    return x, box.y + (w.link[a + ws.CELL_ROW] + (vy > 0.0)) * box.cell_height


@kernel
def schedule(w: ws.Workspace, i: int, now: float, pair_time: float) -> None:
    """Push the next event of disk i: its pair collision, a cell crossing or a wall collision,
    whichever is first.
    """
    disk, a = w.disk, ws.ROW * i
    box = w.grid
    radius = radius_of(w.mass, w, i)
    since = disk[a + ws.TIME]
    vx, vy = disk[a + ws.VX], disk[a + ws.VY]
    x_edge, y_edge = edges_ahead(w.lists, w, i, vx, vy)
    x_time, x_wall = leave_time(
        w.wraps_x, disk[a + ws.X], vx, since, x_edge, box.x, box.width, radius
    )
    y_time, y_wall = leave_time(
        w.wraps_y, disk[a + ws.Y], vy, since, y_edge, box.y, box.height, radius
    )
    x_event = ws.LEFT + (vx > 0.0) + ws.WALL * x_wall
    y_event = ws.DOWN + (vy > 0.0) + ws.WALL * y_wall
    sideways = x_time < y_time
    leaves = min(x_time, y_time) < pair_time
    # a branch would be mispredicted half the time
    event = leaves * (sideways * x_event + (1 - sideways) * y_event)
    time = max(min(min(x_time, y_time), pair_time), now)
    w.event_time[ws.EVENT_ROW * i] = time
    w.link[a + ws.EVENT] = event
    calendar.push(w, i, time)


@kernel
def candidates_after(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int
) -> tuple[np.ndarray, int, int]:
    """Return the array with the candidates of disk i after an event, the index of the first, and
    their number.

    After a crossing only the new neighbours are candidates; otherwise all are, and the pair event
    is reset.
    """
    if lists is not None:
        w.disk[ws.ROW * i + ws.PAIR_TIME] = math.inf
        first = neighbour_lists.words_of_list(lists.wide) * i
        return lists.neighbour, first + 1, lists.neighbour[first]
    if cells.is_crossing(event):
        return w.candidate, 0, cells.gather(w.big, w, i, event)
    w.disk[ws.ROW * i + ws.PAIR_TIME] = math.inf
    return w.candidate, 0, cells.gather(w.big, w, i, ws.PAIR)


@kernel
def predict(w: ws.Workspace, i: int, now: float, event: int) -> None:
    """Predict the pair collision of disk i after an event, and push the event that is its next one.

    The partner is stored last: the next event of the disk does not depend on it.
    """
    candidates, first, m = candidates_after(w.lists, w, i, event)
    best, chosen = earliest(w, i, now, candidates, first, m)
    pair_time = least_of_four(best)
    schedule(w, i, now, pair_time)
    set_partner(w, i, pair_time, candidates, best, chosen)


@kernel
def predict_both(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, k: int, now: float
) -> bool:
    """Predict the next events of two disks that have collided, phase by phase. Return False if they
    must be predicted one after the other; then nothing has been scheduled.

    Predicted second, disk k would wait for the pair time of its neighbour, disk i, which is what
    the first prediction ends with; here the processor computes the collisions of both at the same
    time. Only if an image of disk i is the earliest partner of disk k is that time needed, as disk
    k may have to skip it (see `earliest`).
    """
    if lists is None:
        return False  # with the cell list alone some boxes would lose
    neighbour, first_i, m_i = candidates_after(lists, w, i, ws.PAIR)
    _, first_k, m_k = candidates_after(lists, w, k, ws.PAIR)
    best_i, chosen_i = earliest(w, i, now, neighbour, first_i, m_i)
    best_k, chosen_k = earliest(w, k, now, neighbour, first_k, m_k)
    time_i, time_k = least_of_four(best_i), least_of_four(best_k)
    partner_of_k = earliest_candidate(neighbour, best_k, chosen_k, time_k) & ws.DISK_MASK
    if (time_k < math.inf) & (partner_of_k == i):
        return False
    schedule(w, i, now, time_i)
    schedule(w, k, now, time_k)
    set_partner(w, i, time_i, neighbour, best_i, chosen_i)
    set_partner(w, k, time_k, neighbour, best_k, chosen_k)
    return True
