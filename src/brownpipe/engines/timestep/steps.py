"""A time step: all disks move straight, then those that met exchange momentum; and the loop over steps.

Collisions at contact: a pair that met on the way is taken back along its straight courses to the moment of contact,
exchanges momentum there, and flies on with its new velocities until the end of the step. Late: pairs that overlap at
the end of the step and approach exchange momentum where they are.

What is done for every disk and every pair is done in the precision of the run; a collision is worked out in double
precision (np.float64, as float() of Numba keeps a single one) and only its outcome rounded. Collisions of a step are
taken by their times, then by their disks' numbers, so that results do not depend on how neighbours are found.
"""

import math

import numpy as np

from brownpipe.engines.collisions import exchange, shares
from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import local_copy
from brownpipe.engines.timestep import verlet_lists
from brownpipe.engines.timestep.workspace import (
    ACROSS,
    BEYOND,
    BOTTOM,
    BUDGET,
    DONE,
    DT,
    FASTEST,
    LEFT,
    MISSED,
    NEAREST,
    NO_ROOM,
    PAIRS,
    PAUSED,
    RIGHT,
    SAMPLE,
    SLACK,
    STEP,
    TOP,
    TRACER,
    TRACER_PAIRS,
    VIRIAL,
    WALL_IMPULSE,
    WALLS,
    WITHIN,
)

MOST_HITS = 1e6  # of walls by a disk in a step: with less room it has none


@kernel
def fly(w, x, y, vx, vy, radius):
    """Move all disks straight for a time step; return how many then reach beyond a wall."""
    dt, left, right, bottom, top = w.real[DT], w.real[LEFT], w.real[RIGHT], w.real[BOTTOM], w.real[TOP]
    beyond = 0
    for i in range(len(x)):
        x[i] += vx[i] * dt
        y[i] += vy[i] * dt
        beyond += reaches_beyond(x[i], y[i], radius[i], left, right, bottom, top)
    return beyond


@kernel
def reaches_beyond(x, y, r, left, right, bottom, top):
    """Whether a disk reaches beyond a wall."""
    return (x - r < left) | (x + r > right) | (y - r < bottom) | (y + r > top)


@kernel
def near_within(x, y, a, b, contact, number, slack, hit):
    """Find the pairs of a list that overlap, or passed each other in the last step; return how many."""
    m = 0
    for j in range(number):
        dx, dy = x[b[j]] - x[a[j]], y[b[j]] - y[a[j]]
        hit[m] = j
        m += dx * dx + dy * dy < contact[j] + slack
    return m


@kernel
def near_across(w, pairs, number, slack, offset, m):
    """As `near_within`, for pairs of a disk and an image, which are numbered on from `offset`; return the sum."""
    for j in range(number):
        dx = w.x[pairs.b[j]] - w.x[pairs.a[j]] + pairs.shift_x[j]
        dy = w.y[pairs.b[j]] - w.y[pairs.a[j]] + pairs.shift_y[j]
        w.hit[m] = offset + j
        m += dx * dx + dy * dy < pairs.contact[j] + slack
    return m


@kernel
def relative(w, pair):
    """Return a pair, the disk with the lower number first, and place and velocity of its disk b as seen from a."""
    j, room = pair, len(w.within.a)
    if j < room:
        a, b = int(w.within.a[j]), int(w.within.b[j])
        x, y = np.float64(w.x[b]) - np.float64(w.x[a]), np.float64(w.y[b]) - np.float64(w.y[a])
    else:
        j -= room
        a, b = int(w.across.a[j]), int(w.across.b[j])
        x = np.float64(w.x[b]) - np.float64(w.x[a]) + np.float64(w.across.shift_x[j])
        y = np.float64(w.y[b]) - np.float64(w.y[a]) + np.float64(w.across.shift_y[j])
    if w.disk[a] > w.disk[b]:
        a, b, x, y = b, a, -x, -y
    return a, b, x, y, np.float64(w.vx[b]) - np.float64(w.vx[a]), np.float64(w.vy[b]) - np.float64(w.vy[a])


@kernel
def squared_contact(w, pair):
    """Return sigma^2 of a pair on a list."""
    room = len(w.within.a)
    return np.float64(w.within.contact[pair] if pair < room else w.across.contact[pair - room])


@kernel
def time_since_contact(x, y, u, v, sigma2):
    """Return how long ago two disks that now are at (x, y) and flew straight at (u, v) came into contact, eqs. (1)-(3).

    Negative if they have not. Of the two roots it is the one at which they approached, written without cancellation.
    """
    approach, speed2, cross = x * u + y * v, u * u + v * v, x * v - y * u
    root = speed2 * sigma2 - cross * cross
    if root <= 0.0:
        return -1.0
    root = math.sqrt(root)
    return (approach + root) / speed2 if approach > 0.0 else (sigma2 - (x * x + y * y)) / (root - approach)


@kernel
def met_late(w, x, y, u, v, sigma2):
    """Whether two disks overlap; if not, count them as missed if they met and parted within the step."""
    approach, speed2, cross = x * u + y * v, u * u + v * v, x * v - y * u
    if x * x + y * y < sigma2:
        return True
    w.count[MISSED] += (approach > 0.0) & (approach < speed2 * w.step) & (cross * cross < sigma2 * speed2)
    return False


@kernel
def judge(w, hits, now):
    """Among the pairs found near, gather those that met by the time `now`, and when; return how many they are."""
    n, m = len(w.x), 0
    for h in range(hits):
        pair = int(w.hit[h])
        a, b, x, y, u, v = relative(w, pair)
        sigma2, i, k = squared_contact(w, pair), int(w.disk[a]), int(w.disk[b])
        w.tally[NEAREST] = min(w.tally[NEAREST], (x * x + y * y) / sigma2)
        if w.late:
            met, since = met_late(w, x, y, u, v, sigma2), 0.0
        else:
            met, since = meeting(w, i, k, now, x, y, u, v, sigma2)
        if met:
            w.contact_time[m], w.contact_key[m], w.contact_pair[m] = -since, i * n + k, pair
            m += 1
    return m


@kernel
def meeting(w, i, k, now, x, y, u, v, sigma2):
    """Return whether two disks, numbers i and k of the engine, met on their courses, and how long ago.

    A pair that overlapped when its later course began, pushed together by a third disk, meets then, if it approached.
    What happened more than two steps ago and is over would be seen or not, depending on the neighbour lists.
    """
    since, straight = time_since_contact(x, y, u, v, sigma2), now - max(w.course[i], w.course[k])
    if since < 0.0 or since > straight:
        since, begun_x, begun_y = straight, x - u * straight, y - v * straight
        if begun_x * begun_x + begun_y * begun_y >= sigma2 or begun_x * u + begun_y * v >= 0.0:
            return False, since
    return since <= 2.0 * w.step or x * x + y * y < sigma2, since


@kernel
def earlier(w, i, k):
    """Whether contact i comes before contact k: by time, then by the numbers of the disks."""
    if w.contact_time[i] != w.contact_time[k]:
        return w.contact_time[i] < w.contact_time[k]
    return w.contact_key[i] < w.contact_key[k]


@kernel
def sort_contacts(w, m):
    """Sort the first m contacts (D. L. Shell, Commun. ACM 2 (7), 30 (1959)); few of them exchange places."""
    gap = 1
    while 3 * gap + 1 < m:
        gap = 3 * gap + 1
    while gap > 0:
        for j in range(gap, m):
            place = j
            while place >= gap and earlier(w, place, place - gap):
                swap(w.contact_time, place, place - gap)
                swap(w.contact_key, place, place - gap)
                swap(w.contact_pair, place, place - gap)
                place -= gap
        gap //= 3


@kernel
def swap(values, i, k):
    """Exchange two entries."""
    kept = values[i]
    values[i] = values[k]
    values[k] = kept


@kernel
def collide(w, pair, now):
    """Let a pair that met exchange momentum, eqs. (5)-(8): at contact, from where both fly on until now, or late."""
    a, b, x, y, u, v = relative(w, pair)
    i, k, back = int(w.disk[a]), int(w.disk[b]), 0.0
    if w.late:
        met = x * u + y * v < 0.0
    else:
        met, back = meeting(w, i, k, now, x, y, u, v, squared_contact(w, pair))
    if not met:  # an earlier collision of the step has changed a course
        return
    x, y = x - u * back, y - v * back
    fx, fy = exchange(x, y, u, v)
    whole_a, part_a, whole_b, part_b, impulse = shares(w.mass[i], w.mass[k])
    way = max(
        turn(w, a, whole_a * fx, whole_a * fy, part_a * fx, part_a * fy, back),
        turn(w, b, -whole_b * fx, -whole_b * fy, -part_b * fx, -part_b * fy, back),
    )
    if now - max(w.course[i], w.course[k]) < w.step or back > w.step:
        w.tally[BUDGET] -= way  # it is not part of a path that began with this step
    w.course[i] = w.course[k] = now - back
    w.count[PAIRS] += 1
    w.count[TRACER_PAIRS] += (a == w.clock[TRACER]) | (b == w.clock[TRACER])
    w.tally[VIRIAL] -= impulse * (x * fx + y * fy)


@kernel
def turn(w, i, fx, fy, gx, gy, back):
    """Add f + g to the velocity of disk i as of a time `back` ago; return how far that takes it from where it was."""
    ux, uy = np.float64(w.vx[i]), np.float64(w.vy[i])
    w.vx[i] = ux + fx + gx
    w.vy[i] = uy + fy + gy
    raise_speed_bound(w, i)
    if back == 0.0:
        return 0.0
    dx, dy = (np.float64(w.vx[i]) - ux) * back, (np.float64(w.vy[i]) - uy) * back
    w.x[i] = np.float64(w.x[i]) + dx
    w.y[i] = np.float64(w.y[i]) + dy
    left, right, bottom, top = w.real[LEFT], w.real[RIGHT], w.real[BOTTOM], w.real[TOP]
    w.clock[BEYOND] += reaches_beyond(w.x[i], w.y[i], w.radius[i], left, right, bottom, top)
    return math.sqrt(dx * dx + dy * dy)


@kernel
def raise_speed_bound(w, i):
    """Let the bound on all speeds hold for disk i, too."""
    speed = math.sqrt(np.float64(w.vx[i]) * np.float64(w.vx[i]) + np.float64(w.vy[i]) * np.float64(w.vy[i]))
    if speed > w.tally[FASTEST]:
        w.tally[FASTEST] = speed
        w.real[SLACK] = verlet_lists.slack(speed * w.step)


@kernel
def bounce(w, place, velocity, i, before, after, gap, wall, now):
    """Reverse a component of the velocity of disk i if its edge is beyond a wall that it moves to, eqs. (9)-(10).

    `before` and `after` are how far it reaches beyond the lower and the upper wall, `gap` is the room between them.
    Unless walls are met late, its way is folded into the gap: it may have met both walls, several times.
    """
    v = np.float64(velocity[i])
    beyond = before if v < 0.0 else after
    if v == 0.0 or not beyond > 0.0:
        return
    hits = 1
    if not w.late:
        inward, rest = math.copysign(1.0, -v), 0.0
        at_wall = np.float64(place[i]) + inward * beyond
        if beyond < MOST_HITS * gap:
            turns = int(beyond / gap)
            hits, rest = turns + 1, beyond - turns * gap
            place[i] = at_wall + inward * (gap - rest if turns % 2 else rest)
        else:  # it has no room to move
            place[i] = at_wall + inward * 0.5 * gap
        w.course[w.disk[i]] = max(w.course[w.disk[i]], now - rest / abs(v))
        if beyond > abs(v) * w.step:
            w.tally[BUDGET] -= 2.0 * beyond  # it was pushed there by another disk
    if hits % 2:
        velocity[i] = -velocity[i]
    impulse = 2.0 * w.mass[w.disk[i]] * abs(v)
    w.count[WALLS] += hits
    w.tally[WALL_IMPULSE + wall + (v > 0.0)] += (hits + 1) // 2 * impulse
    w.tally[WALL_IMPULSE + wall + (v < 0.0)] += hits // 2 * impulse


@kernel
def bounce_all(w, now):
    """Reflect the disks that are beyond a wall."""
    left, right = np.float64(w.real[LEFT]), np.float64(w.real[RIGHT])
    bottom, top = np.float64(w.real[BOTTOM]), np.float64(w.real[TOP])
    for i in range(len(w.x)):
        x, y, r = np.float64(w.x[i]), np.float64(w.y[i]), np.float64(w.radius[i])
        bounce(w, w.x, w.vx, i, left - (x - r), x + r - right, right - left - 2.0 * r, 0, now)
        bounce(w, w.y, w.vy, i, bottom - (y - r), y + r - top, top - bottom - 2.0 * r, 2, now)


@kernel
def step(w):
    """Take a time step."""
    w.clock[BEYOND] = fly(w, w.x, w.y, w.vx, w.vy, w.radius)
    one, slack, now = w.within, w.real[SLACK], (w.clock[STEP] + 1) * w.step
    hits = near_within(w.x, w.y, one.a, one.b, one.contact, w.clock[WITHIN], slack, w.hit)
    hits = near_across(w, w.across, w.clock[ACROSS], slack, len(one.a), hits)
    if hits > 0:
        m = judge(w, hits, now)
        sort_contacts(w, m)
        for j in range(m):
            collide(w, int(w.contact_pair[j]), now)
    if w.clock[BEYOND] > 0 and not w.box.periodic:
        bounce_all(w, now)
    w.tally[BUDGET] -= w.tally[FASTEST] * w.step
    w.clock[STEP] += 1


@kernel
def note(w, i, rest, position, velocity, images, row, column):
    """Write where disk i is, a time `rest` after the step, into a row of a record."""
    vx, vy = np.float64(w.vx[i]), np.float64(w.vy[i])
    x, y = np.float64(w.x[i]) + vx * rest, np.float64(w.y[i]) + vy * rest
    velocity[row, column, 0], velocity[row, column, 1] = vx, vy
    if w.box.periodic:
        across, up = verlet_lists.boxes_away(x, w.box.x, w.box.width), verlet_lists.boxes_away(y, w.box.y, w.box.height)
        x, y = x - across * w.box.width, y - up * w.box.height
        images[row, column, 0], images[row, column, 1] = w.image_x[i] + across, w.image_y[i] + up
    position[row, column, 0], position[row, column, 1] = x, y


@kernel
def sample(w, r, rest):
    """Take a sample."""
    row = w.clock[SAMPLE]
    w.clock[SAMPLE] = row + 1
    if len(w.x) == 0:
        return
    note(w, w.clock[TRACER], rest, r.position, r.velocity, r.image, row, 0)
    if r.whole_position.shape[1] > 0:
        for i in range(len(w.x)):
            note(w, i, rest, r.whole_position, r.whole_velocity, r.whole_image, row, w.disk[i])


@entry_point
def advance(w, r, most):
    """Run until all samples are taken or so many steps are; return why it stopped. To go on, call it again."""
    w, r = local_copy(w), local_copy(r)
    while w.clock[SAMPLE] < len(r.step):
        while w.clock[STEP] < r.step[w.clock[SAMPLE]]:
            if most == 0:
                return PAUSED
            if w.tally[BUDGET] < w.tally[FASTEST] * w.step and not verlet_lists.renew(w):
                return NO_ROOM
            step(w)
            most -= 1
        sample(w, r, r.rest[w.clock[SAMPLE]])
    return DONE
