"""A plain event-driven code, as in a textbook: Sedgewick and Wayne, Algorithms, 4th ed. (2011),
section 6.1.

A binary heap of predicted collisions with absolute times in double precision. All disks move to
each event. A prediction is skipped when it comes up if one of its disks has collided since. Each
disk is predicted with all others.
"""

import math

import numpy as np

from brownpipe.engines.compiled.kernels import entry_point, kernel
from validation.stability.outcome import Outcome, measured
from validation.stability.start import Start

MOST_EVENTS = 1_000_000_000  # a run that is stuck ends here


def plain(start: Start, duration: float, most_events: int = MOST_EVENTS) -> Outcome:
    """Run by the plain event-driven code."""
    n = len(start.state.radius)
    room = 16 * (n + 4) * (n + 4)
    disks = np.column_stack(
        (start.state.position, start.state.velocity, start.state.radius, start.state.mass)
    )
    times, events, collided = np.empty(room), np.empty((room, 4), np.int64), np.zeros(n, np.int64)
    counts, impulse, walls = np.zeros(2, np.int64), np.zeros(4), np.array((*start.x, *start.y))
    depth = _run(disks, collided, times, events, walls, duration, most_events, counts, impulse)
    return measured(start, disks[:, :2].copy(), disks[:, 2:4].copy(), counts, impulse, depth)


@kernel
def _delay(disks: np.ndarray, i: int, j: int) -> float:
    """Return the time until disks i and j touch, negative if they overlap by round-off; inf if
    never.
    """
    rx, ry = disks[j, 0] - disks[i, 0], disks[j, 1] - disks[i, 1]
    vx, vy = disks[j, 2] - disks[i, 2], disks[j, 3] - disks[i, 3]
    rv, vv, sigma = rx * vx + ry * vy, vx * vx + vy * vy, disks[i, 4] + disks[j, 4]
    if rv >= 0.0 or vv == 0.0:
        return math.inf
    root = rv * rv - vv * (rx * rx + ry * ry - sigma * sigma)
    return -(rv + math.sqrt(root)) / vv if root >= 0.0 else math.inf


@kernel
def _wall_delay(disks: np.ndarray, i: int, axis: int, walls: np.ndarray) -> float:
    """Return the time until disk i touches the wall that it moves to."""
    v = disks[i, 2 + axis]
    if v == 0.0:
        return math.inf
    edge = walls[2 * axis + 1] - disks[i, 4] if v > 0.0 else walls[2 * axis] + disks[i, 4]
    return (edge - disks[i, axis]) / v


@kernel
def _copy(times: np.ndarray, events: np.ndarray, source: int, target: int) -> None:
    """Copy an event to another place of the heap."""
    times[target] = times[source]
    for k in range(4):
        events[target, k] = events[source, k]


@kernel
def _push(
    times: np.ndarray, events: np.ndarray, size: int, t: float, i: int, j: int, n_i: int, n_j: int
) -> int:
    """Put an event on the heap; return its new size."""
    child = size
    while child > 0 and times[(child - 1) // 2] > t:
        parent = (child - 1) // 2
        _copy(times, events, parent, child)
        child = parent
    times[child] = t
    events[child, 0], events[child, 1], events[child, 2], events[child, 3] = i, j, n_i, n_j
    return size + 1


@kernel
def _drop_first(times: np.ndarray, events: np.ndarray, size: int) -> int:
    """Take the earliest event off the heap; return its new size."""
    size -= 1
    hole = 0
    while 2 * hole + 1 < size:
        child = 2 * hole + 1
        if child + 1 < size and times[child + 1] < times[child]:
            child += 1
        if times[size] <= times[child]:
            break
        _copy(times, events, child, hole)
        hole = child
    _copy(times, events, size, hole)
    return size


@entry_point
def _run(
    disks: np.ndarray,
    collided: np.ndarray,
    times: np.ndarray,
    events: np.ndarray,
    walls: np.ndarray,
    duration: float,
    most_events: int,
    counts: np.ndarray,
    impulse: np.ndarray,
) -> float:
    """Advance the disks (N, 6), rows x, y, vx, vy, radius, mass; return the deepest overlap at a
    prediction.

    collided (N,): how often each disk has collided. events: i, j and their numbers of collisions
    when it was predicted; j < 0 is a wall: -1 left, -2 right, -3 bottom, -4 top.
    """
    n, now, size, depth = len(disks), 0.0, 0, 0.0
    a, b, predict_all = 0, -1, True
    while counts[0] + counts[1] < most_events:
        if size > len(times) - 2 * (n + 4):
            size, predict_all = 0, True
        for i in range(n):
            if predict_all or i in (a, b):
                for j in range(n):
                    if i != j:
                        rx, ry, sigma = (
                            disks[i, 0] - disks[j, 0],
                            disks[i, 1] - disks[j, 1],
                            disks[i, 4] + disks[j, 4],
                        )
                        if rx * rx + ry * ry < sigma * sigma:
                            depth = max(depth, 1.0 - math.sqrt(rx * rx + ry * ry) / sigma)
                        t = now + _delay(disks, i, j)
                        if t <= duration:
                            size = _push(times, events, size, t, i, j, collided[i], collided[j])
                for axis in range(2):
                    t = now + _wall_delay(disks, i, axis, walls)
                    if t <= duration:
                        wall = -2 * axis - (2 if disks[i, 2 + axis] > 0.0 else 1)
                        size = _push(times, events, size, t, i, wall, collided[i], 0)
        predict_all = False
        while size > 0 and (
            events[0, 2] != collided[events[0, 0]]
            or (events[0, 1] >= 0 and events[0, 3] != collided[events[0, 1]])
        ):
            size = _drop_first(times, events, size)
        t = times[0] if size > 0 else duration
        for i in range(n):
            disks[i, 0] += disks[i, 2] * (t - now)
            disks[i, 1] += disks[i, 3] * (t - now)
        now = t
        if size == 0:
            break
        a, b = events[0, 0], events[0, 1]
        size = _drop_first(times, events, size)
        collided[a] += 1
        if b < 0:
            axis = (-b - 1) // 2
            counts[1] += 1
            impulse[-b - 1] += 2.0 * disks[a, 5] * abs(disks[a, 2 + axis])
            disks[a, 2 + axis] = -disks[a, 2 + axis]
            continue
        counts[0] += 1
        collided[b] += 1
        rx, ry = disks[b, 0] - disks[a, 0], disks[b, 1] - disks[a, 1]
        sigma = disks[a, 4] + disks[b, 4]
        rv = rx * (disks[b, 2] - disks[a, 2]) + ry * (disks[b, 3] - disks[a, 3])
        given = 2.0 * disks[a, 5] * disks[b, 5] * rv / ((disks[a, 5] + disks[b, 5]) * sigma)
        disks[a, 2] += given * rx / sigma / disks[a, 5]
        disks[a, 3] += given * ry / sigma / disks[a, 5]
        disks[b, 2] -= given * rx / sigma / disks[b, 5]
        disks[b, 3] -= given * ry / sigma / disks[b, 5]
    return depth
