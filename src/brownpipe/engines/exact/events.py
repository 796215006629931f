"""The events of the exact engine: predict, collide, bounce, change cell; and the loop over them.

Every disk has its own time: its position and velocity are those after its last collision, and it moves straight from
there. It knows one next event. For every pair of neighbours at least one of the two knows a next pair event that is not
later than their collision, so that the earliest event of all is always right (B. D. Lubachevsky, J. Comput. Phys. 94,
255 (1991)). A pair event whose partner has collided in the meantime is stale and only makes the disk predict afresh.
"""

import math

import numpy as np

from brownpipe.engines.collisions import delay, encounter, exchange, meets
from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact.audit import audit_place, sample
from brownpipe.engines.exact.disks import contact_distance, displacement, mass_of, move, push_apart, radius_of
from brownpipe.engines.exact.prefetch import ask_ahead
from brownpipe.engines.exact.workspace import (
    BLOCK,
    BLOCK_OVER,
    BUCKET_NOW,
    CELL_FULL,
    COLUMN,
    COUNT,
    CROSSINGS,
    DISK_MASK,
    DONE,
    DOWN,
    EVENT,
    EVENT_ROW,
    LEFT,
    LINE,
    LOG_FULL,
    LOGGED,
    NEAREST,
    NOW,
    OPEN,
    OVERFULL,
    PAIR,
    PAIR_TIME,
    PAIRS,
    PARTNER,
    PARTNER_COUNT,
    PAUSED,
    RIGHT,
    ROW,
    SAMPLE,
    SOON,
    STALE,
    STOP,
    TIME,
    TRACER_PAIRS,
    UP,
    VIRIAL,
    VX,
    VY,
    WALL,
    WALL_IMPULSE,
    WALLS,
    X,
    Y,
)
from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import local_copy


@kernel
def earliest(w, i, now, candidates, first, m):
    """Make the earliest collision with one of m candidates the pair event of disk i, if it is earlier than that.

    The candidates begin at `first` of an array, which may be `w.candidate`: that is overwritten.

    Two passes: the first, free of branches, keeps those that are on a course to touch; the second takes their square
    roots. A partner that will predict afresh before that (its own pair event comes first) is left to find disk i then.
    """
    disk, approach = w.disk, w.quadratic
    n = 0
    for j in range(m):
        candidate = candidates[first + j]
        k = candidate & DISK_MASK
        x, y, u, v = displacement(w, i, candidate, now)
        sigma = contact_distance(w.mass, w, i, k)
        b, c, d = encounter(x, y, u, v, sigma)
        w.candidate[n] = candidate
        approach[3 * n], approach[3 * n + 1], approach[3 * n + 2] = b, c, d
        n += meets(b, d)
        if (c < w.tally[NEAREST] * (sigma * sigma)) & (k != i):
            w.tally[NEAREST] = c / (sigma * sigma)
    best, partner = disk[ROW * i + PAIR_TIME], w.candidate[0]
    for j in range(n):
        time = now + delay(approach[3 * j], approach[3 * j + 1], approach[3 * j + 2])
        sooner = (time < best) & (time <= disk[ROW * (w.candidate[j] & DISK_MASK) + PAIR_TIME])
        best = time if sooner else best
        partner = w.candidate[j] if sooner else partner
    if best < disk[ROW * i + PAIR_TIME]:
        disk[ROW * i + PAIR_TIME] = best
        w.link[ROW * i + PARTNER] = partner
        w.link[ROW * i + PARTNER_COUNT] = disk[ROW * (partner & DISK_MASK) + COUNT]


@kernel
def within_walls(shift, edge, low, side, radius):
    """Return how far a disk can move towards the edge of its cell: with walls no further than contact, eq. (4)."""
    if shift is not None:
        return edge
    return min(max(edge, low + radius), low + side - radius)


@kernel
def leave_time(shift, position, velocity, since, edge, low, side, radius):
    """Return when a disk is at an edge ahead in one direction, and whether a wall ends its way before.

    Only the wall ahead can: a disk that round-off put behind the other one may have that one's contact ahead, too.
    """
    end = within_walls(shift, edge, low, side, radius)
    time = since + (end - position) / velocity
    return time if velocity != 0.0 else math.inf, (edge - end) * velocity > 0.0


@kernel
def edges_ahead(lists, w, i, vx, vy):
    """Return where the cell of disk i, or the square of its list, ends in both directions of its motion."""
    if lists is not None:
        return neighbour_lists.edges_ahead(lists, i, vx, vy)
    box, a = w.grid, ROW * i
    x = box.x + (w.link[a + COLUMN] + (vx > 0.0)) * box.cell_width
    return x, box.y + (w.link[a + LINE] + (vy > 0.0)) * box.cell_height


@kernel
def schedule(w, i, now):
    """Enter the next event of disk i: its collision, its next cell or a wall, whichever comes first."""
    disk, link, box, a = w.disk, w.link, w.grid, ROW * i
    radius, since = radius_of(w.mass, w, i), disk[a + TIME]
    vx, vy = disk[a + VX], disk[a + VY]
    x_edge, y_edge = edges_ahead(w.lists, w, i, vx, vy)
    x, x_wall = leave_time(w.shift, disk[a + X], vx, since, x_edge, box.x, box.width, radius)
    y, y_wall = leave_time(w.shift, disk[a + Y], vy, since, y_edge, box.y, box.height, radius)
    x_event, y_event = LEFT + (vx > 0.0) + WALL * x_wall, DOWN + (vy > 0.0) + WALL * y_wall
    sideways, pair_time = x < y, disk[a + PAIR_TIME]
    leaves = min(x, y) < pair_time
    event = leaves * (sideways * x_event + (1 - sideways) * y_event)  # a branch would be guessed wrong half the time
    time = max(min(min(x, y), pair_time), now)
    w.event_time[EVENT_ROW * i] = time
    link[a + EVENT] = event
    calendar.push(w, i, time)


@kernel
def wrapped(image, w, i, column, line):
    """Take disk i, about to enter a cell, to the other side of a periodic box if that cell is outside; return if so.

    Disks see each other as other images then, so that all that was predicted with disk i is out of date.
    """
    if image is None:
        return False
    across, up = column // w.grid.columns, line // w.grid.rows
    if across == 0 and up == 0:
        return False
    w.disk[ROW * i + X] -= across * w.grid.width
    w.disk[ROW * i + Y] -= up * w.grid.height
    image[2 * i] += across
    image[2 * i + 1] += up
    w.disk[ROW * i + COUNT] += 1.0
    return True


@kernel
def change_cell(w, i, column, line):
    """Move disk i from its cell to another; return whether it went round a periodic box."""
    cells.leave(w.big, w, i, np.int64(w.link[ROW * i + COLUMN]), np.int64(w.link[ROW * i + LINE]))
    round_the_box = wrapped(w.image, w, i, column, line)
    if round_the_box:
        column, line = column % w.grid.columns, line % w.grid.rows
    cells.enter(w.big, w, i, column, line)
    return round_the_box


@kernel
def cross(lists, w, i, now, event):
    """Let disk i go into the next cell, or make a new list; return whether all must be predicted afresh."""
    if lists is not None:
        neighbour_lists.forget(lists, i)
        column, line = cells.place(w, i, now)
        change_cell(w, i, column, line)
        neighbour_lists.centre(lists, w, i, now)
        neighbour_lists.meet(lists, w, i, 0)
        return True
    column = np.int64(w.link[ROW * i + COLUMN]) + (event == RIGHT) - (event == LEFT)
    line = np.int64(w.link[ROW * i + LINE]) + (event == UP) - (event == DOWN)
    return change_cell(w, i, column, line)


@kernel
def collide(w, i, candidate, now):
    """Exchange momentum between disk i and its partner, eqs. (5)-(8); return the impulse given to disk i."""
    k = candidate & DISK_MASK
    a, b = ROW * i, ROW * k
    move(w, i, now)
    move(w, k, now)
    x, y, u, v = displacement(w, i, candidate, now)
    fx, fy = exchange(x, y, u, v)
    mass = push_apart(w.mass, w, i, k, fx, fy)
    w.disk[a + COUNT] += 1.0
    w.disk[b + COUNT] += 1.0
    w.tally[VIRIAL] -= mass * (x * fx + y * fy)
    return mass * fx, mass * fy


@kernel
def bounce(w, i, event, now):
    """Reflect disk i at a wall, eqs. (9)-(10), its edge exactly at it; return the impulse given to the disk."""
    disk, box, a = w.disk, w.grid, ROW * i
    radius = radius_of(w.mass, w, i)
    mass = mass_of(w.mass, i)
    move(w, i, now)
    disk[a + COUNT] += 1.0
    side = event - WALL
    if side <= RIGHT:
        disk[a + X] = box.x + radius if side == LEFT else box.x + box.width - radius
        disk[a + VX] = -disk[a + VX]
        fx, fy = 2.0 * mass * disk[a + VX], 0.0
    else:
        disk[a + Y] = box.y + radius if side == DOWN else box.y + box.height - radius
        disk[a + VY] = -disk[a + VY]
        fx, fy = 0.0, 2.0 * mass * disk[a + VY]
    w.tally[WALL_IMPULSE + side - 1] += abs(fx + fy)
    return fx, fy


@kernel
def log(w, r, i, partner, fx, fy, now):
    """Note a collision, where a log is asked for."""
    n = w.progress[LOGGED]
    if n < len(r.log_time):
        r.log_block[n], r.log_time[n] = w.progress[BLOCK], now
        r.log_pair[n, 0], r.log_pair[n, 1] = i, partner
        r.log_impulse[n, 0], r.log_impulse[n, 1] = fx, fy
        w.progress[LOGGED] = n + 1


@kernel
def neighbours(lists, w, i, event):
    """Return where the candidates of disk i after an event are: the new ones if it changed cells, else all."""
    if lists is not None:
        w.disk[ROW * i + PAIR_TIME] = math.inf
        return neighbour_lists.neighbours(lists, i)
    column, line = np.int64(w.link[ROW * i + COLUMN]), np.int64(w.link[ROW * i + LINE])
    if cells.crosses(event):
        return w.candidate, 0, cells.gather_new(w.big, w, i, column, line, event)
    w.disk[ROW * i + PAIR_TIME] = math.inf
    return w.candidate, 0, cells.gather(w.big, w, i, column, line)


@kernel
def happen(w, r, i, now):
    """Let the next event of disk i happen, and predict what comes next for those that changed course."""
    link, count = w.link, w.count
    event, k = int(link[ROW * i + EVENT]), i
    if event == PAIR:
        partner = link[ROW * i + PARTNER]
        if w.disk[ROW * (partner & DISK_MASK) + COUNT] == link[ROW * i + PARTNER_COUNT]:
            k = partner & DISK_MASK
            fx, fy = collide(w, i, partner, now)
            log(w, r, i, k, fx, fy, now)
            count[PAIRS] += 1
            count[TRACER_PAIRS] += (i == r.tracer) | (k == r.tracer)
            w.disk[ROW * k + PAIR_TIME] = math.inf
        else:
            count[STALE] += 1
    elif event > WALL:
        fx, fy = bounce(w, i, event, now)
        log(w, r, i, WALL - event, fx, fy, now)
        count[WALLS] += 1
    else:
        count[CROSSINGS] += 1
        if cross(w.lists, w, i, now, event):
            event = PAIR
    while True:
        candidates, first, m = neighbours(w.lists, w, i, event)
        earliest(w, i, now, candidates, first, m)
        schedule(w, i, now)
        if k == i:
            return
        i = k


@kernel
def run(w, r, until, most):
    """Let events happen up to a time within the block, at most so many; return why it stopped and how many are left."""
    clock = w.progress
    for left in range(most, 0, -1):
        while not calendar.next_is_due(w):
            if (clock[BUCKET_NOW] + 1) * w.calendar.width > until:
                return DONE, left
            calendar.open_next_bucket(w)
            ask_ahead(w.deferred, w)
        soon = clock[SOON] - 1
        now, i = w.current_time[soon], np.int64(w.current_disk[soon])
        if now > until:
            return DONE, left
        if len(r.log_time) > 0 and clock[LOGGED] == len(r.log_time):
            return LOG_FULL, left
        clock[SOON] = soon
        if w.event_time[EVENT_ROW * i] == now:
            happen(w, r, i, now)
            w.tally[NOW] = now
            if clock[OVERFULL]:
                return CELL_FULL, left
    return PAUSED, 0


@kernel
def begin_block(w):
    """Put the disks into cells and let each begin with a stale event, so that it predicts afresh.

    All that follows depends on nothing but the positions and velocities at local time 0. A disk that keeps a list may
    have left a periodic box by half a square; its neighbours are found only from its cell inside.
    """
    w.cell[:: w.grid.slots] = 0
    calendar.clear(w)
    for i in range(len(w.disk) // ROW - 1, -1, -1):
        a = ROW * i
        column, line = cells.place(w, i, 0.0)
        if wrapped(w.image, w, i, column, line):
            column, line = column % w.grid.columns, line % w.grid.rows
        cells.enter(w.big, w, i, column, line)
        w.disk[a + PAIR_TIME] = w.disk[a + COUNT] = w.event_time[EVENT_ROW * i] = 0.0
        w.link[a + EVENT], w.link[a + PARTNER], w.link[a + PARTNER_COUNT] = PAIR, i, 1
        calendar.insert(w, i, 0.0)
    make_lists(w.lists, w)


@kernel
def make_lists(lists, w):
    """Make the lists of all disks anew, if there are any."""
    if lists is not None:
        lists.neighbour[:: neighbour_lists.room(lists.wide)] = 0
        n = len(w.disk) // ROW
        for i in range(n):
            neighbour_lists.centre(lists, w, i, 0.0)
        for i in range(n):
            neighbour_lists.meet(lists, w, i, i)


@kernel
def end_block(w):
    """Bring all disks to the end of the block, which is the beginning of the next."""
    for i in range(len(w.disk) // ROW):
        move(w, i, w.calendar.block)
        w.disk[ROW * i + TIME] = 0.0
        audit_place(w.lists, w, i, 0.0)
    w.progress[BLOCK] += 1
    w.tally[NOW] = 0.0


@entry_point
def advance(w, r, most):
    """Run until all samples are taken; return why it stopped. To go on, call it again, unless a cell was full."""
    w, r = local_copy(w), local_copy(r)
    clock = w.progress
    while clock[SAMPLE] < len(r.block):
        if not clock[OPEN]:
            begin_block(w)
            clock[OPEN] = 1
        if clock[OVERFULL]:
            return CELL_FULL
        here = r.block[clock[SAMPLE]] == clock[BLOCK]
        until = r.time[clock[SAMPLE]] if here else w.calendar.block
        outcome, most = run(w, r, until, most)
        if outcome != DONE:
            return outcome
        if here:
            sample(w, r, until)
        else:
            end_block(w)
            clock[OPEN] = 0
            if clock[STOP]:
                return BLOCK_OVER
    return DONE
