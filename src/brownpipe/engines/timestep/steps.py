"""A time step: all disks fly straight, then the pairs that met exchange momentum; and the loop over
steps.

Collisions at contact: a pair that met in the step is taken back along its straight paths to the
moment of contact, exchanges momentum there, and flies on with its new velocities to the end of the
step. Late collisions: pairs that overlap and approach at the end of the step exchange momentum
where they are.

The collisions of a step are handled in the order of their times, then of their disks' numbers, so
that results do not depend on how the lists are built. Equations (1)-(10): docs/theory.md, section
1.
"""

import math

import numpy as np

from brownpipe.engines.collisions import encounter, exchange, shares
from brownpipe.engines.compiled.kernels import entry_point, kernel
from brownpipe.engines.compiled.records import SampleArrays, local_copy
from brownpipe.engines.timestep import verlet_lists
from brownpipe.engines.timestep import workspace as ws

# wall hits of a disk in a step; with more, in a very narrow gap, it is put in the middle of the gap
MOST_HITS = 1e6


@kernel
def fly(
    w: ws.Workspace,
    x: np.ndarray,
    y: np.ndarray,
    vx: np.ndarray,
    vy: np.ndarray,
    radius: np.ndarray,
) -> int:
    """Move all disks straight for a time step; return how many of them then reach beyond a wall."""
    dt, box, beyond = w.step, w.box, 0
    for i in range(len(x)):
        x[i] += vx[i] * dt
        y[i] += vy[i] * dt
        beyond += reaches_beyond(x[i], y[i], radius[i], box.left, box.right, box.bottom, box.top)
    return beyond


@kernel
def reaches_beyond(
    x: float, y: float, r: float, left: float, right: float, bottom: float, top: float
) -> bool:
    """Return whether a disk reaches beyond a wall; those of a periodic axis are at infinity."""
    return (x - r < left) | (x + r > right) | (y - r < bottom) | (y + r > top)


@kernel
def candidates(
    images: ws.PairList | None, w: ws.Workspace, pairs: ws.PairList, number: int, first: int, m: int
) -> int:
    """Append the pairs of a list that overlap, or did within the last two steps, to m candidates;
    return their number.

    The pairs are numbered from `first`; `images` are those of a disk and a periodic image. Every
    pair is written, but the number increases only if it is close enough, so that there is no branch
    to predict.
    """
    slack = w.tally[ws.SLACK]
    for j in range(number):
        x, y = w.x[pairs.b[j]] - w.x[pairs.a[j]], w.y[pairs.b[j]] - w.y[pairs.a[j]]
        if images is not None:
            x, y = x + images.shift_x[j], y + images.shift_y[j]
        w.candidate[m] = first + j
        m += x * x + y * y < pairs.contact[j] + slack
    return m


@kernel
def relative(w: ws.Workspace, pair: int) -> tuple[int, int, float, float, float, float, float]:
    """Return disks a and b of a pair, the position and velocity of b relative to a, and sigma^2.

    `pair` below the capacity of a list is an index into `w.within`; the others, less the capacity,
    are indices into `w.across`. Disk a has the lower number in the engine.
    """
    j, capacity = pair, len(w.within.a)
    if j < capacity:
        a, b, sigma2 = int(w.within.a[j]), int(w.within.b[j]), w.within.contact[j]
        x, y = w.x[b] - w.x[a], w.y[b] - w.y[a]
    else:
        j -= capacity
        a, b, sigma2 = int(w.across.a[j]), int(w.across.b[j]), w.across.contact[j]
        x = w.x[b] - w.x[a] + w.across.shift_x[j]
        y = w.y[b] - w.y[a] + w.across.shift_y[j]
    if w.disk[a] > w.disk[b]:
        a, b, x, y = b, a, -x, -y
    return a, b, x, y, w.vx[b] - w.vx[a], w.vy[b] - w.vy[a], sigma2


@kernel
def time_since_contact(x: float, y: float, u: float, v: float, sigma2: float) -> float:
    """Return how long ago two disks came into contact, eqs. (1)-(3); negative if they did not.

    (x, y) and (u, v) are their present relative position and velocity. Of the two roots of the
    quadratic equation this is the one at which they approached, in a form without cancellation.
    """
    b, c, d = encounter(x, y, u, v, sigma2)
    if d <= 0.0:
        return -1.0
    root = math.sqrt(d)
    return (b + root) / (u * u + v * v) if b > 0.0 else -c / (root - b)


@kernel
def gather_contacts(w: ws.Workspace, number: int, now: float) -> int:
    """Write those candidates that met by the time `now`, with the time of contact; return their
    number.

    Late collisions are of pairs that overlap now; pairs that met and separated within the step are
    counted as missed.
    """
    n, m = len(w.x), 0
    for j in range(number):
        pair = int(w.candidate[j])
        one, other, x, y, u, v, sigma2 = relative(w, pair)
        i, k = int(w.disk[one]), int(w.disk[other])
        w.tally[ws.NEAREST] = min(w.tally[ws.NEAREST], (x * x + y * y) / sigma2)
        if w.late:
            b, c, d = encounter(x, y, u, v, sigma2)
            met, since = c < 0.0, 0.0
            w.count[ws.MISSED] += (
                (c >= 0.0) & (b > 0.0) & (b < (u * u + v * v) * w.step) & (d > 0.0)
            )
        else:
            met, since = meeting(w, i, k, now, x, y, u, v, sigma2)
        if met:
            w.contact_time[m], w.contact_key[m], w.contact_pair[m] = -since, i * n + k, pair
            m += 1
    return m


@kernel
def meeting(
    w: ws.Workspace,
    i: int,
    k: int,
    now: float,
    x: float,
    y: float,
    u: float,
    v: float,
    sigma2: float,
) -> tuple[bool, float]:
    """Return whether disks i and k (the engine's numbers) met on their straight paths, and how long
    ago.

    A straight path begins at a disk's last collision. A pair that already overlapped when the later
    of its two paths began, because a third disk pushed it together, meets at that moment if it
    approached. Contacts that ended more than two steps ago are ignored: whether they are found
    would depend on the lists.
    """
    since, straight = (
        time_since_contact(x, y, u, v, sigma2),
        now - max(w.straight_since[i], w.straight_since[k]),
    )
    if since < 0.0 or since > straight:
        since, start_x, start_y = straight, x - u * straight, y - v * straight
        if start_x * start_x + start_y * start_y >= sigma2 or start_x * u + start_y * v >= 0.0:
            return False, since
    return since <= 2.0 * w.step or x * x + y * y < sigma2, since


@kernel
def earlier(w: ws.Workspace, i: int, k: int) -> bool:
    """Return whether contact i comes before contact k: by time, then by the numbers of the
    disks.
    """
    if w.contact_time[i] != w.contact_time[k]:
        return w.contact_time[i] < w.contact_time[k]
    return w.contact_key[i] < w.contact_key[k]


@kernel
def sort_contacts(w: ws.Workspace, m: int) -> None:
    """Sort the first m contacts by time and disks: shell sort, D. L. Shell, Commun. ACM 2 (7), 30
    (1959).
    """
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
def swap(values: np.ndarray, i: int, k: int) -> None:
    """Exchange two entries."""
    value = values[i]
    values[i] = values[k]
    values[k] = value


@kernel
def collide(w: ws.Workspace, pair: int, now: float) -> None:
    """Let a pair that met exchange momentum, eqs. (5)-(8): at contact, flying on from there until
    `now`, or late.

    An earlier collision of the same step may have changed a path; if the pair then no longer meets,
    nothing happens.
    """
    a, b, x, y, u, v, sigma2 = relative(w, pair)
    i, k, back = int(w.disk[a]), int(w.disk[b]), 0.0
    if w.late:
        met = x * u + y * v < 0.0
    else:
        met, back = meeting(w, i, k, now, x, y, u, v, sigma2)
    if not met:
        return
    x, y = x - u * back, y - v * back
    fx, fy = exchange(x, y, u, v)
    whole_a, part_a, whole_b, part_b, impulse = shares(w.mass[i], w.mass[k])
    shift = max(
        deflect(w, a, whole_a * fx, whole_a * fy, part_a * fx, part_a * fy, back),
        deflect(w, b, -whole_b * fx, -whole_b * fy, -part_b * fx, -part_b * fy, back),
    )
    if now - max(w.straight_since[i], w.straight_since[k]) < w.step or back > w.step:
        w.tally[ws.BUDGET] -= shift  # beyond the path of a step, which `step` subtracts
    w.straight_since[i] = w.straight_since[k] = now - back
    w.count[ws.PAIRS] += 1
    w.count[ws.TRACER_PAIRS] += (a == w.counters[ws.TRACER]) | (b == w.counters[ws.TRACER])
    w.tally[ws.VIRIAL] -= impulse * (x * fx + y * fy)


@kernel
def deflect(
    w: ws.Workspace, i: int, fx: float, fy: float, gx: float, gy: float, back: float
) -> float:
    """Change the velocity of disk i by f + g, from a time `back` ago on; return how far this shifts
    it.
    """
    ux, uy = w.vx[i], w.vy[i]
    w.vx[i] = ux + fx + gx
    w.vy[i] = uy + fy + gy
    speed = math.sqrt(w.vx[i] * w.vx[i] + w.vy[i] * w.vy[i])
    if speed > w.tally[ws.FASTEST]:
        verlet_lists.set_fastest(w, speed)
    if back == 0.0:
        return 0.0
    dx, dy = (w.vx[i] - ux) * back, (w.vy[i] - uy) * back
    w.x[i] = w.x[i] + dx
    w.y[i] = w.y[i] + dy
    box = w.box
    w.counters[ws.BEYOND] += reaches_beyond(
        w.x[i], w.y[i], w.radius[i], box.left, box.right, box.bottom, box.top
    )
    return math.sqrt(dx * dx + dy * dy)


@kernel
def bounce(
    w: ws.Workspace,
    place: np.ndarray,
    velocity: np.ndarray,
    i: int,
    before: float,
    after: float,
    gap: float,
    wall: int,
    now: float,
) -> None:
    """Reflect disk i where it reaches beyond the wall that it moves towards: one velocity
    component, eqs. (9)-(10).

    `before` and `after` are the distances of its edge beyond the lower and the upper wall, `gap` is
    the distance that its centre can move between them. Unless collisions are late, its path is
    folded into the gap: it may have met both walls several times.
    """
    v = velocity[i]
    beyond = before if v < 0.0 else after
    if v == 0.0 or not beyond > 0.0:
        return
    hits = 1
    if not w.late:
        inward, rest = math.copysign(1.0, -v), 0.0
        at_wall = place[i] + inward * beyond
        if beyond < MOST_HITS * gap:
            turns = int(beyond / gap)
            hits, rest = turns + 1, beyond - turns * gap
            place[i] = at_wall + inward * (gap - rest if turns % 2 else rest)
        else:  # put it in the middle of the gap
            place[i] = at_wall + inward * 0.5 * gap
        w.straight_since[w.disk[i]] = max(w.straight_since[w.disk[i]], now - rest / abs(v))
        if beyond > abs(v) * w.step:
            w.tally[ws.BUDGET] -= 2.0 * beyond  # another disk pushed it there
    if hits % 2:
        velocity[i] = -velocity[i]
    impulse = 2.0 * w.mass[w.disk[i]] * abs(v)
    w.count[ws.WALLS] += hits
    w.tally[ws.WALL_IMPULSE + wall + (v > 0.0)] += (hits + 1) // 2 * impulse
    w.tally[ws.WALL_IMPULSE + wall + (v < 0.0)] += hits // 2 * impulse


@kernel
def step(w: ws.Workspace) -> None:
    """Take a time step: flight, pair collisions in the order of time, wall collisions."""
    w.counters[ws.BEYOND] = fly(w, w.x, w.y, w.vx, w.vy, w.radius)
    box, now = w.box, (w.counters[ws.STEP] + 1) * w.step
    m = candidates(None, w, w.within, w.counters[ws.WITHIN], 0, 0)
    m = candidates(w.across, w, w.across, w.counters[ws.ACROSS], len(w.within.a), m)
    if m > 0:
        m = gather_contacts(w, m, now)
        sort_contacts(w, m)
        for j in range(m):
            collide(w, int(w.contact_pair[j]), now)
    if w.counters[ws.BEYOND] > 0:
        for i in range(len(w.x)):
            x, y, r = w.x[i], w.y[i], w.radius[i]
            bounce(
                w,
                w.x,
                w.vx,
                i,
                box.left - (x - r),
                x + r - box.right,
                box.right - box.left - 2.0 * r,
                0,
                now,
            )
            bounce(
                w,
                w.y,
                w.vy,
                i,
                box.bottom - (y - r),
                y + r - box.top,
                box.top - box.bottom - 2.0 * r,
                2,
                now,
            )
    w.tally[ws.BUDGET] -= w.tally[ws.FASTEST] * w.step
    w.counters[ws.STEP] += 1


@kernel
def write_sample(
    w: ws.Workspace, i: int, rest: float, track: SampleArrays, row: int, column: int
) -> None:
    """Write position, velocity and image of disk i, a time `rest` after the last step, to [row,
    column] of a track.
    """
    vx, vy = w.vx[i], w.vy[i]
    x, y = w.x[i] + vx * rest, w.y[i] + vy * rest
    track.velocity[row, column, 0], track.velocity[row, column, 1] = vx, vy
    if w.box.periodic_x or w.box.periodic_y:
        across, up = verlet_lists.boxes_away(w, x, y)
        x, y = x - across * w.box.width, y - up * w.box.height
        track.image[row, column, 0] = w.image_x[i] + across
        track.image[row, column, 1] = w.image_y[i] + up
    track.position[row, column, 0], track.position[row, column, 1] = x, y


@kernel
def sample(w: ws.Workspace, r: ws.Recorder, rest: float) -> None:
    """Sample the tracer and, if they are recorded, all disks, a time `rest` after the last step."""
    row = w.counters[ws.SAMPLE]
    w.counters[ws.SAMPLE] = row + 1
    if len(w.x) == 0:
        return
    write_sample(w, w.counters[ws.TRACER], rest, r.track, row, 0)
    if r.whole.position.shape[1] > 0:
        for i in range(len(w.x)):
            write_sample(w, i, rest, r.whole, row, w.disk[i])


@entry_point
def advance(w: ws.Workspace, r: ws.Recorder, most: int) -> int:
    """Run until all samples are taken, `most` steps are done, or the lists are full; return DONE,
    PAUSED or LISTS_FULL.

    Call it again to continue: in the last case with a workspace whose lists have twice the
    capacity.
    """
    w, r = local_copy(w), local_copy(r)
    while w.counters[ws.SAMPLE] < len(r.step):
        while w.counters[ws.STEP] < r.step[w.counters[ws.SAMPLE]]:
            if most == 0:
                return ws.PAUSED
            if w.tally[ws.BUDGET] < w.tally[ws.FASTEST] * w.step and not verlet_lists.renew(w):
                return ws.LISTS_FULL
            step(w)
            most -= 1
        sample(w, r, r.rest[w.counters[ws.SAMPLE]])
    return ws.DONE
