"""The events of the exact engine: predict, collide, bounce, change cell; and the loop over them.

Every disk has its own time TIME: its position and velocity are those after its last collision, and it moves straight
from there. It stores one next event. For every pair of neighbours at least one of the two has a next pair event not
later than their collision, so that the earliest event of all is always correct (B. D. Lubachevsky, J. Comput. Phys. 94,
255 (1991)). A pair event whose partner has changed course since it was predicted is stale: the disk only predicts anew.

Simulated time is divided into blocks (those of `analysis` are blocks of seeds), at whose ends all disks are brought to
the same time. TIME and event times are counted from the beginning of the block, so that their round-off does not grow
with the duration of a run.
"""

import math

import numpy as np

from brownpipe.engines.collisions import delay, encounter, exchange, meets, wall_time
from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.audit import audit_place
from brownpipe.engines.exact.disks import (
    apply_impulse,
    four_contact_distances,
    four_disks,
    four_shifted,
    mass_of,
    move,
    position,
    radius_of,
    relative_motion,
)
from brownpipe.engines.exact.prefetch import prefetch_entry, prefetch_upcoming
from brownpipe.engines.exact.sampling import take_sample
from brownpipe.engines.fours import any_of, four, four_entries, four_from, least, where
from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import local_copy

# -- predict --------------------------------------------------------------------------------------------------------


@kernel
def earliest(
    w: ws.Workspace, i: int, now: float, candidates: np.ndarray, first: int, m: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a four of the times of the earliest collisions of disk i, and a four of the indices of the partners.

    The candidates are candidates[first : first + m]. Four at a time are considered, in place of the last ones perhaps
    disk i itself, which it never meets. Each of the `best` is the earliest of every fourth candidate, `chosen` its
    index; where none is earlier than the pair event that disk i has, `best` is the time of that event and `chosen` is
    `first`, which is always readable. Skip a partner whose own next collision is earlier: it will be re-predicted then
    and will find disk i. No time is earlier than `latest` for a pair that does not meet, not even -inf.
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
        b, c, d = encounter(x, y, vx_k - vx_i, vy_k - vy_i, sigma)
        time = now + delay(b, c, d)
        latest = where(meets(b, d), pair_time_k, four(math.nan))
        sooner = (time < best) & (time <= latest)
        best, chosen = where(sooner, time, best), where(sooner, index, chosen)
        index = index + 4.0
        closer = (c < nearest * (sigma * sigma)) & (k != i)
        if any_of(closer):
            nearest = least(where(closer, c / (sigma * sigma), four(nearest)))
            w.tally[ws.NEAREST] = nearest
    return best, chosen


@kernel
def set_partner(
    w: ws.Workspace, i: int, time: float, candidates: np.ndarray, best: np.ndarray, chosen: np.ndarray
) -> None:
    """Store a collision at `time`, the least of `best`, as the pair event of disk i, if earlier than the one it has.

    There is no branch, as nobody can predict whether a disk that has entered a cell finds an earlier collision there.
    """
    disk, link, a = w.disk, w.link, ws.ROW * i
    sooner = time < disk[a + ws.PAIR_TIME]
    disk[a + ws.PAIR_TIME] = time
    partner, changes = np.int64(link[a + ws.PARTNER]), np.int64(link[a + ws.PARTNER_CHANGES])
    other = np.int64(candidates[int(least(where(best <= time, chosen, four(math.inf))))])  # of several, the first
    other_changes = np.int64(disk[ws.ROW * (other & ws.DISK_MASK) + ws.CHANGES])
    link[a + ws.PARTNER] = either(sooner, other, partner)
    link[a + ws.PARTNER_CHANGES] = either(sooner, other_changes, changes)


@kernel
def either(condition: bool, one: int, other: int) -> int:
    """Return one of two integers, without a branch."""
    return other + condition * (one - other)


@kernel
def leave_time(
    shift: np.ndarray | None,
    position: float,
    velocity: float,
    since: float,
    edge: float,
    low: float,
    side: float,
    radius: float,
) -> tuple[float, bool]:
    """Return when a disk, moving so at the time `since`, reaches the edge or wall ahead in x or y, and whether a wall.

    Consider only the wall the disk moves towards, eq. (4): if round-off has left it slightly beyond the opposite wall,
    that contact also lies ahead and must be ignored. If it overlaps the wall ahead by round-off, the time is before
    `since`.
    """
    if shift is not None:
        return since + wall_time(edge - position, velocity), False
    end = min(max(edge, low + radius), low + side - radius)
    return since + wall_time(end - position, velocity), (edge - end) * velocity > 0.0


@kernel
def edges_ahead(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, vx: float, vy: float) -> tuple[float, float]:
    """Return the edges (x, y) of the cell of disk i, or of the square of its list, to which it moves."""
    if lists is not None:
        return neighbour_lists.edges_ahead(lists, i, vx, vy)
    box, a = w.grid, ws.ROW * i
    x = box.x + (w.link[a + ws.CELL_COLUMN] + (vx > 0.0)) * box.cell_width
    return x, box.y + (w.link[a + ws.CELL_ROW] + (vy > 0.0)) * box.cell_height


@kernel
def schedule(w: ws.Workspace, i: int, now: float, pair_time: float) -> None:
    """Push the next event of disk i: its pair collision, a cell crossing or a wall collision, whichever is first."""
    disk, a = w.disk, ws.ROW * i
    box = w.grid
    radius = radius_of(w.mass, w, i)
    since = disk[a + ws.TIME]
    vx, vy = disk[a + ws.VX], disk[a + ws.VY]
    x_edge, y_edge = edges_ahead(w.lists, w, i, vx, vy)
    x_time, x_wall = leave_time(w.shift, disk[a + ws.X], vx, since, x_edge, box.x, box.width, radius)
    y_time, y_wall = leave_time(w.shift, disk[a + ws.Y], vy, since, y_edge, box.y, box.height, radius)
    x_event = ws.LEFT + (vx > 0.0) + ws.WALL * x_wall
    y_event = ws.DOWN + (vy > 0.0) + ws.WALL * y_wall
    sideways = x_time < y_time
    leaves = min(x_time, y_time) < pair_time
    event = leaves * (sideways * x_event + (1 - sideways) * y_event)  # a branch would be mispredicted half the time
    time = max(min(min(x_time, y_time), pair_time), now)
    w.event_time[ws.EVENT_ROW * i] = time
    w.link[a + ws.EVENT] = event
    calendar.push(w, i, time)


@kernel
def candidates_after(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int
) -> tuple[np.ndarray, int, int]:
    """Return the array with the candidates of disk i after an event, the index of the first, and their number.

    After a crossing only the new neighbours are candidates; otherwise all are, and the pair event is reset.
    """
    if lists is not None:
        w.disk[ws.ROW * i + ws.PAIR_TIME] = math.inf
        return neighbour_lists.neighbours(lists, i)
    if cells.is_crossing(event):
        return w.candidate, 0, cells.gather_new(w.big, w, i, event)
    w.disk[ws.ROW * i + ws.PAIR_TIME] = math.inf
    return w.candidate, 0, cells.gather(w.big, w, i)


@kernel
def predict(w: ws.Workspace, i: int, now: float, event: int) -> None:
    """Predict the pair collision of disk i after an event, and push the event that is its next one.

    The partner is stored last: the next event of the disk does not depend on it.
    """
    candidates, first, m = candidates_after(w.lists, w, i, event)
    best, chosen = earliest(w, i, now, candidates, first, m)
    pair_time = least(best)
    schedule(w, i, now, pair_time)
    set_partner(w, i, pair_time, candidates, best, chosen)


# -- what an event does ---------------------------------------------------------------------------------------------


@kernel
def wrap(image: np.ndarray | None, w: ws.Workspace, i: int, column: int, row: int) -> bool:
    """Move disk i, about to enter a cell outside a periodic box, to the opposite side; return whether it was moved.

    Other disks then see it as another image, so all predictions with disk i are outdated.
    """
    if image is None:
        return False
    across, up = cells.boxes_away(w.shift, w, column, row)
    if across == 0 and up == 0:
        return False
    w.disk[ws.ROW * i + ws.X] -= across * w.grid.width
    w.disk[ws.ROW * i + ws.Y] -= up * w.grid.height
    image[2 * i] += across
    image[2 * i + 1] += up
    w.disk[ws.ROW * i + ws.CHANGES] += 1.0
    return True


@kernel
def enter_cell(w: ws.Workspace, i: int, column: int, row: int) -> bool:
    """List disk i in a cell, after wrapping it if the cell is outside a periodic box; return whether it was wrapped."""
    is_wrapped = wrap(w.image, w, i, column, row)
    if is_wrapped:
        column, row = column % w.grid.columns, row % w.grid.rows
    cells.enter(w.big, w, i, column, row)
    return is_wrapped


@kernel
def cross(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, now: float, event: int) -> bool:
    """Move disk i to the next cell, or renew its square and list; return whether all must be predicted anew."""
    if lists is not None:
        neighbour_lists.clear(lists, i)
        column, row = cells.place(w, i, now)
        cells.leave(w.big, w, i)
        enter_cell(w, i, column, row)
        neighbour_lists.centre(lists, w, i, now)
        neighbour_lists.meet(lists, w, i, 0)
        return True
    column, row = cells.place_of(w, i)
    cells.leave(w.big, w, i)
    return enter_cell(
        w, i, column + (event == ws.RIGHT) - (event == ws.LEFT), row + (event == ws.UP) - (event == ws.DOWN)
    )


@kernel
def collide(w: ws.Workspace, i: int, candidate: int, now: float) -> tuple[float, float]:
    """Exchange momentum between disk i and its partner, eqs. (5)-(8); return the impulse given to disk i."""
    k = candidate & ws.DISK_MASK
    move(w, i, now)
    move(w, k, now)
    x, y, u, v = relative_motion(w, i, candidate, now)
    fx, fy = exchange(x, y, u, v)
    mass = apply_impulse(w.mass, w, i, k, fx, fy)
    w.disk[ws.ROW * i + ws.CHANGES] += 1.0
    w.disk[ws.ROW * k + ws.CHANGES] += 1.0
    w.tally[ws.VIRIAL] -= mass * (x * fx + y * fy)
    return mass * fx, mass * fy


@kernel
def bounce(w: ws.Workspace, i: int, event: int, now: float) -> tuple[float, float]:
    """Reflect disk i at a wall, eqs. (9)-(10), its edge exactly at the wall; return the impulse given to the disk."""
    disk, a = w.disk, ws.ROW * i
    box = w.grid
    radius = radius_of(w.mass, w, i)
    mass = mass_of(w.mass, i)
    move(w, i, now)
    disk[a + ws.CHANGES] += 1.0
    side = event - ws.WALL
    if side <= ws.RIGHT:
        disk[a + ws.X] = box.x + radius if side == ws.LEFT else box.x + box.width - radius
        disk[a + ws.VX] = -disk[a + ws.VX]
        fx, fy = 2.0 * mass * disk[a + ws.VX], 0.0
    else:
        disk[a + ws.Y] = box.y + radius if side == ws.DOWN else box.y + box.height - radius
        disk[a + ws.VY] = -disk[a + ws.VY]
        fx, fy = 0.0, 2.0 * mass * disk[a + ws.VY]
    w.tally[ws.WALL_IMPULSE + side - 1] += abs(fx + fy)
    return fx, fy


@kernel
def log(w: ws.Workspace, r: ws.Recorder, i: int, partner: int, fx: float, fy: float, now: float) -> None:
    """Write a collision to the log, if there is one. `partner` is a disk, or -side for a wall."""
    n = w.progress[ws.LOGGED]
    if n < len(r.log_time):
        r.log_block[n], r.log_time[n] = w.progress[ws.BLOCK], now
        r.log_pair[n, 0], r.log_pair[n, 1] = i, partner
        r.log_impulse[n, 0], r.log_impulse[n, 1] = fx, fy
        w.progress[ws.LOGGED] = n + 1


@kernel
def happen(w: ws.Workspace, r: ws.Recorder, i: int, now: float) -> None:
    """Execute the next event of disk i, and predict the next events of the disks that changed course."""
    link, count = w.link, w.count
    event = int(link[ws.ROW * i + ws.EVENT])
    k = i  # the other disk that changes course, if there is one
    if event == ws.PAIR:
        partner = link[ws.ROW * i + ws.PARTNER]
        if w.disk[ws.ROW * (partner & ws.DISK_MASK) + ws.CHANGES] == link[ws.ROW * i + ws.PARTNER_CHANGES]:
            k = partner & ws.DISK_MASK
            fx, fy = collide(w, i, partner, now)
            log(w, r, i, k, fx, fy, now)
            count[ws.PAIRS] += 1
            count[ws.TRACER_PAIRS] += (i == r.tracer) | (k == r.tracer)
            w.disk[ws.ROW * k + ws.PAIR_TIME] = math.inf
        else:
            count[ws.STALE] += 1
    elif event > ws.WALL:
        fx, fy = bounce(w, i, event, now)
        log(w, r, i, ws.WALL - event, fx, fy, now)
        count[ws.WALLS] += 1
    else:
        count[ws.CROSSINGS] += 1
        if cross(w.lists, w, i, now, event):
            event = ws.PAIR
    while True:
        predict(w, i, now, event)
        if k == i:
            return
        i = k


# -- the loop -------------------------------------------------------------------------------------------------------


@kernel
def run_until(w: ws.Workspace, r: ws.Recorder, until: float, most: int) -> tuple[int, int]:
    """Execute up to `most` events until a time within the block; return why it stopped and how many events are left."""
    progress = w.progress
    for left in range(most, 0, -1):
        while not calendar.has_next_event(w):
            if (progress[ws.CURRENT_BUCKET] + 1) * w.calendar.width > until:
                return ws.DONE, left
            calendar.open_next_bucket(w)
            prefetch_upcoming(w.deferred, w)
        last = progress[ws.CURRENT_EVENTS] - 1
        now, i = w.current_time[last], np.int64(w.current_disk[last])
        if now > until:
            return ws.DONE, left
        if len(r.log_time) > 0 and progress[ws.LOGGED] == len(r.log_time):
            return ws.LOG_FULL, left
        progress[ws.CURRENT_EVENTS] = last
        prefetch_entry(w.deferred, w, last)
        if w.event_time[ws.EVENT_ROW * i] == now:
            happen(w, r, i, now)
            w.tally[ws.NOW] = now
            if progress[ws.OVERFLOW]:
                return ws.CELL_FULL, left
    return ws.PAUSED, 0


@kernel
def begin_block(w: ws.Workspace) -> None:
    """List all disks in cells, and let each begin with a stale pair event at local time 0, so that it predicts anew.

    A block depends on nothing but the positions and velocities at its beginning. A disk with a neighbour list may have
    left a periodic box by half a square; its neighbours are found only from its cell inside.
    """
    w.cell[:: w.grid.slots] = 0
    calendar.clear(w)
    for i in range(len(w.disk) // ws.ROW - 1, -1, -1):
        a = ws.ROW * i
        column, row = cells.place(w, i, 0.0)
        enter_cell(w, i, column, row)
        w.disk[a + ws.PAIR_TIME] = w.disk[a + ws.CHANGES] = w.event_time[ws.EVENT_ROW * i] = 0.0
        w.link[a + ws.EVENT], w.link[a + ws.PARTNER], w.link[a + ws.PARTNER_CHANGES] = ws.PAIR, i, 1
        calendar.insert(w, i, 0.0)
    neighbour_lists.make_all(w.lists, w)


@kernel
def end_block(w: ws.Workspace) -> None:
    """Advance all disks to the end of the block, which is the beginning of the next."""
    for i in range(len(w.disk) // ws.ROW):
        move(w, i, w.calendar.block)
        w.disk[ws.ROW * i + ws.TIME] = 0.0
        audit_place(w.lists, w, i, 0.0)
    w.progress[ws.BLOCK] += 1
    w.tally[ws.NOW] = 0.0


@entry_point
def advance(w: ws.Workspace, r: ws.Recorder, most: int) -> int:
    """Run until all samples are taken, for at most `most` events; return why it stopped (DONE, PAUSED, ...).

    Call it again to continue, except after CELL_FULL: then the run must restart with twice the capacity.
    """
    w, r = local_copy(w), local_copy(r)
    progress = w.progress
    while progress[ws.SAMPLE] < len(r.block):
        if not progress[ws.BLOCK_BEGUN]:
            begin_block(w)
            progress[ws.BLOCK_BEGUN] = 1
        if progress[ws.OVERFLOW]:
            return ws.CELL_FULL
        in_this_block = r.block[progress[ws.SAMPLE]] == progress[ws.BLOCK]
        until = r.time[progress[ws.SAMPLE]] if in_this_block else w.calendar.block
        outcome, most = run_until(w, r, until, most)
        if outcome != ws.DONE:
            return outcome
        if in_this_block:
            take_sample(w, r, until)
        else:
            end_block(w)
            progress[ws.BLOCK_BEGUN] = 0
            if progress[ws.STOP]:
                return ws.BLOCK_OVER
    return ws.DONE
