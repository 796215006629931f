"""pymunk, a rigid-body library for games, which moves in fixed time steps; None where it is not
installed.
"""

import importlib.util
import math
from typing import Any

import numpy as np

from brownpipe.engines.units import State
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


def pymunk(
    start: Start, duration: float, step: float | None = None, most_steps: int = MOST_STEPS
) -> Outcome | None:
    """Run by pymunk; None where it is not installed, or the run needs more steps than `most_steps`.

    Elasticity 1, no friction, no rotation, no allowed overlap (`collision_slop` 0, its default is
    0.1), else defaults: 10 iterations of its solver. Collisions are counted when a contact begins;
    overlaps are looked at after each step. The impulses of the walls are not recorded.
    """
    step = step or time_step(start)
    if not IS_INSTALLED or not duration <= step * most_steps:
        return None
    space, bodies = space_of(start.state, start.x, start.y)
    space.collision_slop = 0.0
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
    return measured(start, position, velocity, counts, np.zeros(4), depth)._replace(
        momentum_residual=math.nan
    )


def space_of(state: State, x: tuple[float, float], y: tuple[float, float]) -> tuple[Any, list[Any]]:
    """Return a space of pymunk with these disks, which do not rotate, between four walls; and their
    bodies.

    Elasticity 1, no friction. Collision types: 1 of disks, 2 of walls. Each wall is as thick as the
    box, with its surface at the edge of the box.
    """
    import pymunk as library

    space, bodies = library.Space(), []
    shapes: list[library.Shape] = []
    for position, velocity, radius, mass in zip(
        *(values.tolist() for values in state), strict=True
    ):
        bodies.append(library.Body(mass, math.inf))
        bodies[-1].position, bodies[-1].velocity = tuple(position), tuple(velocity)
        shapes.append(library.Circle(bodies[-1], radius))
        shapes[-1].collision_type = 1
    thick = max(x[1] - x[0], y[1] - y[0])
    low, high = (x[0] - thick, y[0] - thick), (x[1] + thick, y[1] + thick)
    corners = (low, (low[0], high[1]), high, (high[0], low[1]))
    for k in range(4):
        shapes.append(library.Segment(space.static_body, corners[k - 1], corners[k], thick))
        shapes[-1].collision_type = 2
    for shape in shapes:
        shape.elasticity, shape.friction = 1.0, 0.0
    space.add(*bodies, *shapes)
    return space, bodies


def _count(counts: np.ndarray, index: int) -> None:
    counts[index] += 1
