"""The note's loop: eqs. (1)-(10) as printed, in double precision.

The smallest time t >= 0 of all pairs and of the walls ahead is the next event; all disks move
there. Times are relative to the last event; the sum of them is compared with the duration.
"""

import math

import numpy as np

from brownpipe.engines.compiled.kernels import entry_point
from validation.stability.outcome import Outcome, measured
from validation.stability.start import Start

MOST_EVENTS = 1_000_000_000  # a run that is stuck ends here


def note_loop(start: Start, duration: float, most_events: int = MOST_EVENTS) -> Outcome:
    """Run by the note's loop, which is compiled once, for arrays of one type."""
    position, velocity, radius, mass = (np.array(column, order="C") for column in start.state)
    walls, counts, impulse = np.array((*start.x, *start.y)), np.zeros(2, np.int64), np.zeros(4)
    with np.errstate(all="ignore"):
        depth = _loop(
            position, velocity, radius, mass, walls, float(duration), most_events, counts, impulse
        )
    return measured(start, position, velocity, counts, impulse, depth)


@entry_point
def _loop(
    x: np.ndarray,
    v: np.ndarray,
    radius: np.ndarray,
    mass: np.ndarray,
    walls: np.ndarray,
    duration: float,
    most_events: int,
    counts: np.ndarray,
    impulse: np.ndarray,
) -> float:
    """Advance x, v (N, 2) to the duration; return the deepest overlap. walls: left, right, bottom,
    top.
    """
    n, now, depth = len(x), 0.0, 0.0
    while counts[0] + counts[1] < most_events:
        first, a, b, wall = math.inf, 0, 0, -1
        for i in range(n):
            for axis in range(2):
                ahead = 2 * axis + (1 if v[i, axis] > 0.0 else 0)
                edge = walls[ahead] - (radius[i] if v[i, axis] > 0.0 else -radius[i])
                t = (edge - x[i, axis]) / v[i, axis] if v[i, axis] != 0.0 else math.inf  # eq. (4)
                if 0.0 <= t < first:
                    first, a, wall = t, i, ahead
            for j in range(i):
                rx, ry, vx, vy = (
                    x[i, 0] - x[j, 0],
                    x[i, 1] - x[j, 1],
                    v[i, 0] - v[j, 0],
                    v[i, 1] - v[j, 1],
                )
                rv, vv, rr, sigma = (
                    rx * vx + ry * vy,
                    vx * vx + vy * vy,
                    rx * rx + ry * ry,
                    radius[i] + radius[j],
                )
                if rr < sigma * sigma:
                    depth = max(depth, 1.0 - math.sqrt(rr) / sigma)
                root = rv * rv - vv * (rr - sigma * sigma)
                if root >= 0.0 and vv > 0.0:
                    t = (-rv - math.sqrt(root)) / vv  # eq. (1)
                    if 0.0 <= t < first:
                        first, a, b, wall = t, i, j, -1
        t = min(first, duration - now)
        for i in range(n):
            x[i, 0] += v[i, 0] * t
            x[i, 1] += v[i, 1] * t
        if now + first > duration:
            break
        now += first
        if wall >= 0:
            counts[1] += 1
            impulse[wall] += 2.0 * mass[a] * abs(v[a, wall // 2])
            v[a, wall // 2] = -v[a, wall // 2]  # eqs. (9)-(10)
        else:
            counts[0] += 1
            rx, ry = x[a, 0] - x[b, 0], x[a, 1] - x[b, 1]
            r = math.sqrt(rx * rx + ry * ry)
            nx, ny = rx / r, ry / r  # eq. (8)
            f = nx * (v[a, 0] - v[b, 0]) + ny * (v[a, 1] - v[b, 1])  # eq. (7)
            share_a, share_b = (
                2.0 * mass[b] / (mass[a] + mass[b]),
                2.0 * mass[a] / (mass[a] + mass[b]),
            )
            v[a, 0] -= share_a * f * nx  # eqs. (5)-(6)
            v[a, 1] -= share_a * f * ny
            v[b, 0] += share_b * f * nx
            v[b, 1] += share_b * f * ny
    return depth
