"""Disks grown where they are too dense for random insertion: pushed apart until none overlap, with a cell list.

Arguments of the kernels as in `insertion`.
"""

import math

import numpy as np

from brownpipe.engines.insertion import cell_of, register
from brownpipe.engines.kernels import entry_point, kernel


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
def part(
    position: np.ndarray,
    radius: np.ndarray,
    size: np.ndarray,
    periodic: bool,
    held: int,
    stretch: float,
    i: int,
    k: int,
) -> bool:
    """Return whether disks i and k overlap; move them apart, to `stretch` contact distances (not if that is 0)."""
    x, y = position[k, 0] - position[i, 0], position[k, 1] - position[i, 1]
    if periodic:
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
        position[i, 0] = moved(position[i, 0], -of_i * away * x, radius[i], size[0], periodic)
        position[i, 1] = moved(position[i, 1], -of_i * away * y, radius[i], size[1], periodic)
        position[k, 0] = moved(position[k, 0], (1.0 - of_i) * away * x, radius[k], size[0], periodic)
        position[k, 1] = moved(position[k, 1], (1.0 - of_i) * away * y, radius[k], size[1], periodic)
    return square < sigma * sigma


@entry_point
def push_apart(
    position: np.ndarray,
    radius: np.ndarray,
    common: float,
    big: np.ndarray,
    size: np.ndarray,
    periodic: bool,
    grid: np.ndarray,
    following: np.ndarray,
    held: int,
    stretch: float,
) -> int:
    """Go once over all disks and push those that overlap apart, to `stretch` contact distances; return how many did.

    With a stretch of 0 nothing is moved. Disk `held` stays where it is (-1: none).
    """
    columns, rows = grid.shape
    for c in range(columns):
        for r in range(rows):
            grid[c, r] = -1
    for i in range(len(radius)):
        register(grid, following, position, size, i)
    overlapping = 0
    for i in range(len(radius)):
        for k in big:
            if k > i:
                overlapping += part(position, radius, size, periodic, held, stretch, i, k)
        reach = (radius[i] + common) * max(stretch, 1.0)
        reach_x = min(int(reach / size[0] * columns) + 1, columns)
        reach_y = min(int(reach / size[1] * rows) + 1, rows)
        column, row = cell_of(position[i, 0], size[0], columns), cell_of(position[i, 1], size[1], rows)
        for c in range(column - reach_x, column + reach_x + 1):
            for r in range(row - reach_y, row + reach_y + 1):
                if not periodic and (c < 0 or c >= columns or r < 0 or r >= rows):
                    continue
                k = grid[c % columns, r % rows]
                while k >= 0:
                    if k != i:
                        overlapping += part(position, radius, size, periodic, held, stretch, i, k)
                    k = following[k]
    return overlapping
