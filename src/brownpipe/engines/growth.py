"""Disks grown where they are too dense for random insertion: pushed apart until none overlap, with a cell list."""

import math

import numpy as np

from brownpipe.engines.insertion import Places, block_around, first_in_cell, register
from brownpipe.engines.kernels import entry_point, kernel
from brownpipe.engines.records import local_copy


@kernel
def share(radius: np.ndarray, held: int, i: int, k: int) -> float:
    """Return the share of disk i in the path by which it and disk k part: that of the area of the other."""
    if held in (i, k):
        return 0.0 if held == i else 1.0
    return radius[k] * radius[k] / (radius[i] * radius[i] + radius[k] * radius[k])


@kernel
def moved(value: float, step: float, radius: float, size: float, periodic: bool) -> float:
    """Return a coordinate after a step, inside the box: wrapped, or at least its radius from the walls."""
    value += step
    if periodic:
        value -= size * math.floor(value / size)
        return value if value < size else 0.0
    return min(max(value, radius), size - radius)


@kernel
def part(p: Places, held: int, stretch: float, i: int, k: int) -> bool:
    """Return whether disks i and k overlap; move them apart, to `stretch` contact distances (not if that is 0)."""
    position, radius, size = p.position, p.radius, p.size
    x, y = position[k, 0] - position[i, 0], position[k, 1] - position[i, 1]
    if p.periodic:
        x -= size[0] * math.floor(x / size[0] + 0.5)
        y -= size[1] * math.floor(y / size[1] + 0.5)
    sigma, square = radius[i] + radius[k], x * x + y * y
    wanted = stretch * sigma
    if square < wanted * wanted:
        distance = math.sqrt(square)
        if distance == 0.0:
            x, distance = sigma, sigma
        away = (wanted - math.sqrt(square)) / distance
        of_i = share(radius, held, i, k)
        position[i, 0] = moved(position[i, 0], -of_i * away * x, radius[i], size[0], p.periodic)
        position[i, 1] = moved(position[i, 1], -of_i * away * y, radius[i], size[1], p.periodic)
        position[k, 0] = moved(position[k, 0], (1.0 - of_i) * away * x, radius[k], size[0], p.periodic)
        position[k, 1] = moved(position[k, 1], (1.0 - of_i) * away * y, radius[k], size[1], p.periodic)
    return square < sigma * sigma


@entry_point
def push_apart(p: Places, held: int, stretch: float) -> int:
    """Go once over all disks and push those that overlap apart, to `stretch` contact distances; return how many did.

    With a stretch of 0 nothing is moved. Disk `held` stays where it is (-1: none).
    """
    p = local_copy(p)
    for column in range(p.grid.shape[0]):
        for row in range(p.grid.shape[1]):
            p.grid[column, row] = -1
    for i in range(len(p.radius)):
        register(p, i)
    overlapping = 0
    for i in range(len(p.radius)):
        for k in p.big:
            if k > i:
                overlapping += part(p, held, stretch, i, k)
        left, right, bottom, top = block_around(p, i, (p.radius[i] + p.common) * max(stretch, 1.0))
        for column in range(left, right + 1):
            for row in range(bottom, top + 1):
                k = first_in_cell(p, column, row)
                while k >= 0:
                    if k != i:
                        overlapping += part(p, held, stretch, i, k)
                    k = p.following[k]
    return overlapping
