"""The events of the exact engine: collide, bounce, change cell; and the loop over them.

Every disk has its own time TIME: its position and velocity are those after its last collision, and
it moves straight from there. It stores one next event, which `predictions` chooses. A pair event
whose partner has changed course since it was predicted is stale: the disk only predicts anew.

Simulated time is divided into blocks (those of `analysis` are blocks of seeds), at whose ends all
disks are brought to the same time. TIME and event times are counted from the beginning of the
block, so that their round-off does not grow with the duration of a run.
"""

import math

import numpy as np

from brownpipe.engines.collisions import exchange
from brownpipe.engines.compiled.kernels import entry_point, kernel
from brownpipe.engines.compiled.records import local_copy
from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.predictions import predict, predict_both
from brownpipe.engines.exact.prefetch import prefetch_entry, prefetch_upcoming
from brownpipe.engines.exact.sampling import audit_place, take_sample
from brownpipe.engines.exact.workspace import (
    apply_impulse,
    mass_of,
    move,
    radius_of,
    relative_motion,
)

# -- what an event does ----------------------------------------------------------------------------


@kernel
def enter_cell(image: np.ndarray | None, w: ws.Workspace, i: int, column: int, row: int) -> bool:
    """List disk i in a cell, after moving it to the opposite side if the cell is outside a periodic
    box.

    Return whether it was moved: other disks then see it as another image, so all predictions with
    it are outdated.
    """
    is_moved = False
    if image is not None:
        across, up = cells.boxes_away(w.shift, w, column, row)
        is_moved = across != 0 or up != 0
        if is_moved:
            w.disk[ws.ROW * i + ws.X] -= across * w.grid.width
            w.disk[ws.ROW * i + ws.Y] -= up * w.grid.height
            image[2 * i] += across
            image[2 * i + 1] += up
            w.disk[ws.ROW * i + ws.CHANGES] += 1.0
            column, row = column % w.grid.columns, row % w.grid.rows
    cells.enter(w, i, column, row)
    return is_moved


@kernel
def cross(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, now: float, event: int) -> bool:
    """Move disk i to the next cell, or renew its square and list; return whether all must be
    predicted anew.
    """
    if lists is not None:
        neighbour_lists.clear_list(lists, i)
        cells.update_disk(w.big, w, i, *cells.place_of(w, i), False)
        enter_cell(w.image, w, i, *cells.place_at_time(w, i, now))
        neighbour_lists.centre(lists, w, i, now)
        neighbour_lists.list_neighbours(lists, w, i, 0)
        return True
    column, row = cells.place_of(w, i)
    cells.update_disk(w.big, w, i, column, row, False)
    column += (event == ws.RIGHT) - (event == ws.LEFT)
    return enter_cell(w.image, w, i, column, row + (event == ws.UP) - (event == ws.DOWN))


@kernel
def collide(w: ws.Workspace, i: int, candidate: int, now: float) -> tuple[float, float]:
    """Exchange momentum between disk i and its partner, eqs. (5)-(8); return the impulse given to
    disk i.
    """
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
    """Reflect disk i at a wall, eqs. (9)-(10), its edge exactly at the wall; return the impulse
    given to the disk.
    """
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
def log(
    w: ws.Workspace, r: ws.Recorder, i: int, partner: int, fx: float, fy: float, now: float
) -> None:
    """Write a collision to the log, if there is one. `partner` is a disk, or -side for a wall."""
    n = w.progress[ws.LOGGED]
    if n < len(r.log_time):
        r.log_block[n], r.log_time[n] = w.progress[ws.BLOCK], now
        r.log_pair[n, 0], r.log_pair[n, 1] = i, partner
        r.log_impulse[n, 0], r.log_impulse[n, 1] = fx, fy
        w.progress[ws.LOGGED] = n + 1


@kernel
def execute_event(w: ws.Workspace, r: ws.Recorder, i: int, now: float) -> None:
    """Execute the next event of disk i, and predict the next events of the disks that changed
    course.
    """
    link, count = w.link, w.count
    event = int(link[ws.ROW * i + ws.EVENT])
    k = i  # the other disk that changes course, if there is one
    if event == ws.PAIR:
        partner = link[ws.ROW * i + ws.PARTNER]
        if (
            w.disk[ws.ROW * (partner & ws.DISK_MASK) + ws.CHANGES]
            == link[ws.ROW * i + ws.PARTNER_CHANGES]
        ):
            k = partner & ws.DISK_MASK
            fx, fy = collide(w, i, partner, now)
            log(w, r, i, k, fx, fy, now)
            count[ws.PAIRS] += 1
            count[ws.TRACER_PAIRS] += (i == r.tracer) | (k == r.tracer)
            w.disk[ws.ROW * k + ws.PAIR_TIME] = math.inf
        else:
            count[ws.STALE] += 1
    elif event > ws.UP:  # WALL + its side
        fx, fy = bounce(w, i, event, now)
        log(w, r, i, ws.WALL - event, fx, fy, now)
        count[ws.WALLS] += 1
    else:
        count[ws.CROSSINGS] += 1
        if cross(w.lists, w, i, now, event):
            event = ws.PAIR
    if k != i and predict_both(w.lists, w, i, k, now):
        return
    while True:
        predict(w, i, now, event)
        if k == i:
            return
        i = k


# -- the loop --------------------------------------------------------------------------------------


@kernel
def run_until(w: ws.Workspace, r: ws.Recorder, until: float, most: int) -> tuple[int, int]:
    """Execute up to `most` events until a time within the block; return why it stopped and how many
    events are left.
    """
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
            execute_event(w, r, i, now)
            w.tally[ws.NOW] = now
            if progress[ws.OVERFLOW]:
                return ws.CELL_FULL, left
    return ws.PAUSED, 0


@kernel
def begin_block(w: ws.Workspace) -> None:
    """List all disks in cells, and give each a stale pair event at local time 0, so that it
    predicts anew.

    A block depends on nothing but the positions and velocities at its beginning. A disk with a
    neighbour list may have left a periodic box by half a square; its neighbours are found only from
    its cell inside.
    """
    w.cell[:: w.grid.slots] = 0
    calendar.empty_queue(w.deferred, w)
    for i in range(len(w.disk) // ws.ROW - 1, -1, -1):
        a = ws.ROW * i
        enter_cell(w.image, w, i, *cells.place_at_time(w, i, 0.0))
        w.disk[a + ws.PAIR_TIME] = w.disk[a + ws.CHANGES] = w.event_time[ws.EVENT_ROW * i] = 0.0
        w.link[a + ws.EVENT], w.link[a + ws.PARTNER], w.link[a + ws.PARTNER_CHANGES] = ws.PAIR, i, 1
        calendar.insert_event(w, i, 0.0)
    neighbour_lists.make_lists(w.lists, w)


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
    """Run until all samples are taken, for at most `most` events; return why it stopped (DONE,
    PAUSED, ...).

    Call it again to continue, except after CELL_FULL: then the run must restart with twice the
    capacity.
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
        # before the collisions at t = 0, which are in the log
        is_start = progress[ws.BLOCK] == 0 and until == 0.0
        if not is_start:
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
