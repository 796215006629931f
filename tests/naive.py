"""The note's algorithm word for word, as slow and as plain as it gets: the twin that the exact
engine is held to.

All pairs, all walls; the smallest time is the next event. Everything moves there, the event
happens, and again. A pair is looked at with its images along periodic axes, and a disk whose centre
reaches a periodic side goes on at the other.
"""

from itertools import product

import numpy as np

LEFT = -1
RIGHT = -2
BOTTOM = -3
TOP = -4


def dot(u, v):
    """Scalar products of vectors (2, ..., n)."""
    return u[0] * v[0] + u[1] * v[1]


def pair_time(r, v, sigma):
    """Eqs. (1)-(3): when abs(r + v t) = sigma, for r = r_a - r_b, (2, ..., n), and v = v_a - v_b,
    (2, n); inf if never.

    One departure: eq. (1) gives a negative time to an approaching pair that round-off left
    overlapped. It is 0 here.
    """
    rv = dot(r, v)
    vv = dot(v, v)
    rr = dot(r, r)
    root = rv**2 - vv * (rr - sigma**2)
    meets = np.nonzero((rv < 0) & (root > 0))
    first_root = (-rv[meets] - np.sqrt(root[meets])) / vv[meets[-1]]
    t = np.full(root.shape, np.inf)
    t[meets] = np.maximum(first_root, 0)
    return t


def wall_time(position, velocity, margin, low, high):
    """Eq. (4): when a coordinate is a margin from the wall that it moves to; arrays (2, N)."""
    wall = np.where(velocity > 0, high - margin, low + margin)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = (wall - position) / velocity
    return np.where(velocity == 0, np.inf, np.maximum(t, 0))


def collide(r, v_a, v_b, m_a, m_b):
    """Eqs. (5)-(8): the velocities after a collision."""
    n = r / np.sqrt(np.sum(r * r))
    f = n * np.sum((v_a - v_b) * n)
    return v_a - 2 * m_b / (m_a + m_b) * f, v_b + 2 * m_a / (m_a + m_b) * f


def displacements_of_images(box):
    """The displacements (2, 1 to 9, 1) of the images of a disk, its own first."""
    columns = (0, -1, 1) if is_periodic(box, "x") else (0,)
    rows = (0, -1, 1) if is_periodic(box, "y") else (0,)
    size = np.array((box.width, box.height))
    steps = np.array([*product(columns, rows)])
    return (steps * size).T[..., None].copy()


def is_periodic(box, axis):
    """Whether the sides of an axis are periodic, from what the scene says."""
    boundary = box.boundary
    return (boundary if isinstance(boundary, str) else getattr(boundary, axis)) == "periodic"


def run(state, box, duration, most=np.inf):
    """Return (events, position, velocity) at the duration, or after so many events; positions
    inside the box.

    events: a list of (time, a, b, impulse given to a), b a disk or a wall.
    """
    x, v = (np.array(column.T, dtype=float, order="C") for column in state[:2])  # (2, N)
    radius, mass = (np.array(column, dtype=float) for column in state[2:])  # (N,)
    low, high = np.array((box.x, box.y)).T[..., None]  # (2, 1)
    a, b = np.triu_indices(len(radius), 1)
    sigma = radius[a] + radius[b]
    images = displacements_of_images(box)
    periodic = [is_periodic(box, "x"), is_periodic(box, "y")]
    margin = np.where(np.array(periodic)[:, None], 0.0, radius)
    now = 0.0
    events = []
    while len(events) < most:
        r = x.take(a, axis=1) - x.take(b, axis=1)
        u = v.take(a, axis=1) - v.take(b, axis=1)
        pairs = pair_time(r[:, None] + images, u, sigma)
        walls = wall_time(x, v, margin, low, high)
        t_pair = pairs.min(initial=np.inf)
        t_wall = walls.min(initial=np.inf)
        t = min(t_pair, t_wall)
        if now + t > duration:
            x += v * (duration - now)
            break
        x += v * t
        now += t
        if t_pair <= t_wall:
            image, pair = np.unravel_index(np.argmin(pairs), pairs.shape)
            i = a[pair]
            k = b[pair]
            before = v[:, i].copy()
            separation = x[:, i] - x[:, k] + images[:, image, 0]
            v[:, i], v[:, k] = collide(separation, before, v[:, k], mass[i], mass[k])
            events.append((now, i, k, mass[i] * (v[:, i] - before)))
            continue
        axis, i = np.unravel_index(np.argmin(walls), walls.shape)
        upper = v[axis, i] > 0
        if periodic[axis]:
            x[axis, i] = low[axis, 0] if upper else high[axis, 0]
            continue
        before = v[:, i].copy()
        v[axis, i] = -v[axis, i]  # eqs. (9)-(10)
        wall = (LEFT, RIGHT, BOTTOM, TOP)[2 * axis + upper]
        events.append((now, i, wall, mass[i] * (v[:, i] - before)))
    return events, x.T, v.T
