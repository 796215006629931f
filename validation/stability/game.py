"""pymunk, a rigid-body library for games, which moves in fixed time steps; None where it is not installed."""

import importlib.util
import math

import numpy as np

from validation.stability.outcome import Outcome, measured
from validation.stability.start import Start

IS_INSTALLED = importlib.util.find_spec("pymunk") is not None
PATH = 0.01  # path of a disk of rms speed in a time step, in radii of the smallest disk
MOST_STEPS = 50_000


def time_step(start: Start) -> float:
    """Return the time step for these disks; squares of their speeds may over- or underflow."""
    largest = float(np.abs(start.state.velocity).max())
    speed = largest * math.sqrt(np.mean(np.sum((start.state.velocity / largest) ** 2, axis=1)))
    return PATH * float(start.state.radius.min()) / speed


def pymunk(start: Start, duration: float, step: float | None = None, most_steps: int = MOST_STEPS) -> Outcome | None:
    """Run by pymunk; None where it is not installed, or the run needs more steps than `most_steps`.

    Elasticity 1, no friction, no rotation, no allowed overlap (`collision_slop` 0, its default is 0.1), else defaults:
    10 iterations of its solver. Collisions are counted when a contact begins; overlaps are looked at after each step.
    The impulses of the walls are not recorded.
    """
    step = step or time_step(start)
    if not IS_INSTALLED or not duration <= step * most_steps:
        return None
    import pymunk as library

    space = library.Space()
    space.collision_slop = 0.0
    bodies = [_disk(library, space, *row) for row in zip(*start.state, strict=True)]
    _walls(library, space, start)
    counts = np.zeros(2, np.int64)
    space.on_collision(1, 1, begin=lambda *_: _count(counts, 0))
    space.on_collision(1, 2, begin=lambda *_: _count(counts, 1))
    first, second = np.triu_indices(len(bodies), 1)
    sigma, depth = start.state.radius[first] + start.state.radius[second], 0.0
    steps = math.ceil(duration / step)
    for _ in range(steps):
        space.step(duration / steps)
        position = np.array([body.position for body in bodies])
        if len(first):
            apart = position[first] - position[second]
            depth = max(depth, float((1.0 - np.hypot(apart[:, 0], apart[:, 1]) / sigma).max()))
    velocity = np.array([body.velocity for body in bodies])
    return measured(start, position, velocity, counts, np.zeros(4), depth)._replace(momentum_residual=math.nan)


def _disk(library, space, position, velocity, radius, mass):  # type: ignore[no-untyped-def]
    """Add a disk that does not rotate; return its body."""
    body = library.Body(float(mass), math.inf)
    body.position, body.velocity = tuple(position.tolist()), tuple(velocity.tolist())
    shape = library.Circle(body, float(radius))
    shape.elasticity, shape.friction, shape.collision_type = 1.0, 0.0, 1
    space.add(body, shape)
    return body


def _walls(library, space, start: Start) -> None:  # type: ignore[no-untyped-def]
    """Add the four walls, each as thick as the box and with its surface at the edge of the box."""
    (left, right), (bottom, top) = start.x, start.y
    thick = max(right - left, top - bottom)
    low, high = (left - thick, bottom - thick), (right + thick, top + thick)
    corners = (low, (low[0], high[1]), high, (high[0], low[1]))
    for k in range(4):
        wall = library.Segment(space.static_body, corners[k - 1], corners[k], thick)
        wall.elasticity, wall.friction, wall.collision_type = 1.0, 0.0, 2
        space.add(wall)


def _count(counts: np.ndarray, index: int) -> None:
    counts[index] += 1
