"""A time step: all disks move straight, then those that overlap and approach exchange momentum; and the loop over them.

What is done for every disk and every pair is done in the precision of the run; a collision is worked out in double
precision (np.float64, as float() of Numba keeps a single one) and only its outcome rounded. Pairs that overlap at the
same time are taken in the order of their disks' numbers, so that results do not depend on how neighbours are found.
"""

import math

import numpy as np

from brownpipe.collisions import exchange, shares
from brownpipe.kernels import kernel
from brownpipe.timestep import lists
from brownpipe.timestep.workspace import (
    ACROSS,
    BOTTOM,
    BUDGET,
    DONE,
    FASTEST,
    LEFT,
    LENGTH,
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


@kernel
def fly(w, x, y, vx, vy, radius):
    """Move all disks straight for a time step; return how many then reach beyond a wall."""
    dt, left, right, bottom, top = w.real[LENGTH], w.real[LEFT], w.real[RIGHT], w.real[BOTTOM], w.real[TOP]
    beyond = 0
    for i in range(len(x)):
        x[i] += vx[i] * dt
        y[i] += vy[i] * dt
        r = radius[i]
        beyond += (x[i] - r < left) | (x[i] + r > right) | (y[i] - r < bottom) | (y[i] + r > top)
    return beyond


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
def judge(w, hits):
    """Among the pairs found near, gather those that overlap and count those missed; return how many overlap.

    Missed is a pair that touched and parted, or went through each other, within the step: apart and receding now,
    approaching a step ago, on a course that comes nearer than contact.
    """
    n, m, room = len(w.x), 0, len(w.within.a)
    for h in range(hits):
        pair = int(w.hit[h])
        a, b, x, y, u, v = relative(w, pair)
        contact = np.float64(w.within.contact[pair] if pair < room else w.across.contact[pair - room])
        distance, approach, speed, cross = x * x + y * y, x * u + y * v, u * u + v * v, x * v - y * u
        if distance < contact:
            w.contact_key[m], w.contact_pair[m] = int(w.disk[a]) * n + int(w.disk[b]), pair
            m += 1
            w.tally[NEAREST] = min(w.tally[NEAREST], distance / contact)
        else:
            w.count[MISSED] += (approach > 0.0) & (approach < speed * w.step) & (cross * cross < contact * speed)
    return m


@kernel
def sort_contacts(key, pair, m):
    """Sort the first m overlapping pairs by their keys (D. L. Shell, Commun. ACM 2 (7), 30 (1959))."""
    gap = 1
    while 3 * gap + 1 < m:
        gap = 3 * gap + 1
    while gap > 0:
        for j in range(gap, m):
            k, p, place = key[j], pair[j], j
            while place >= gap and key[place - gap] > k:
                key[place], pair[place] = key[place - gap], pair[place - gap]
                place -= gap
            key[place], pair[place] = k, p
        gap //= 3


@kernel
def collide(w, pair):
    """Let a pair that overlaps exchange momentum if it approaches, eqs. (5)-(8)."""
    a, b, x, y, u, v = relative(w, pair)
    if not x * u + y * v < 0.0:
        return
    fx, fy = exchange(x, y, u, v)
    whole_a, part_a, whole_b, part_b, impulse = shares(w.mass[w.disk[a]], w.mass[w.disk[b]])
    w.vx[a] = np.float64(w.vx[a]) + whole_a * fx + part_a * fx
    w.vy[a] = np.float64(w.vy[a]) + whole_a * fy + part_a * fy
    w.vx[b] = np.float64(w.vx[b]) - whole_b * fx - part_b * fx
    w.vy[b] = np.float64(w.vy[b]) - whole_b * fy - part_b * fy
    w.count[PAIRS] += 1
    w.count[TRACER_PAIRS] += (a == w.clock[TRACER]) | (b == w.clock[TRACER])
    w.tally[VIRIAL] -= impulse * (x * fx + y * fy)
    heed_speed(w, a)
    heed_speed(w, b)


@kernel
def heed_speed(w, i):
    """Let the bound on all speeds hold for disk i, too."""
    speed = math.sqrt(np.float64(w.vx[i]) * np.float64(w.vx[i]) + np.float64(w.vy[i]) * np.float64(w.vy[i]))
    if speed > w.tally[FASTEST]:
        w.tally[FASTEST] = speed
        limit = 2.0 * speed * w.step
        w.real[SLACK] = limit * limit


@kernel
def bounce(w, velocity, i, low, high, wall):
    """Reverse a component of the velocity of disk i if its edge is beyond a wall that it moves to, eqs. (9)-(10)."""
    v = np.float64(velocity[i])
    if (low > 0.0 and v < 0.0) or (high > 0.0 and v > 0.0):
        velocity[i] = -velocity[i]
        w.count[WALLS] += 1
        w.tally[WALL_IMPULSE + wall + (v > 0.0)] += 2.0 * w.mass[w.disk[i]] * abs(v)


@kernel
def bounce_all(w):
    """Reflect the disks that are beyond a wall."""
    for i in range(len(w.x)):
        r = w.radius[i]
        bounce(w, w.vx, i, w.real[LEFT] - (w.x[i] - r), w.x[i] + r - w.real[RIGHT], 0)
        bounce(w, w.vy, i, w.real[BOTTOM] - (w.y[i] - r), w.y[i] + r - w.real[TOP], 2)


@kernel
def step(w):
    """Take a time step."""
    beyond = fly(w, w.x, w.y, w.vx, w.vy, w.radius)
    one, slack = w.within, w.real[SLACK]
    hits = near_within(w.x, w.y, one.a, one.b, one.contact, w.clock[WITHIN], slack, w.hit)
    hits = near_across(w, w.across, w.clock[ACROSS], slack, len(one.a), hits)
    w.tally[BUDGET] -= w.tally[FASTEST] * w.step
    if hits > 0:
        m = judge(w, hits)
        sort_contacts(w.contact_key, w.contact_pair, m)
        for j in range(m):
            collide(w, int(w.contact_pair[j]))
    if beyond > 0 and not w.box.periodic:
        bounce_all(w)
    w.clock[STEP] += 1


@kernel
def note(w, i, rest, position, velocity, images, row, column):
    """Write where disk i is, a time `rest` after the step, into a row of a record."""
    vx, vy = np.float64(w.vx[i]), np.float64(w.vy[i])
    x, y = np.float64(w.x[i]) + vx * rest, np.float64(w.y[i]) + vy * rest
    velocity[row, column, 0], velocity[row, column, 1] = vx, vy
    if w.box.periodic:
        across, up = lists.boxes_away(x, w.box.x, w.box.width), lists.boxes_away(y, w.box.y, w.box.height)
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


@kernel
def advance(w, r, most):
    """Run until all samples are taken or so many steps are; return why it stopped. To go on, call it again."""
    while w.clock[SAMPLE] < len(r.step):
        while w.clock[STEP] < r.step[w.clock[SAMPLE]]:
            if most == 0:
                return PAUSED
            if w.tally[BUDGET] < w.tally[FASTEST] * w.step and not lists.renew(w):
                return NO_ROOM
            step(w)
            most -= 1
        sample(w, r, r.rest[w.clock[SAMPLE]])
    return DONE
