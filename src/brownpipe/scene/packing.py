"""Packing of disks in a rectangle: overlaps, and an upper bound on their number. Arrays and numbers only."""

import math

import numpy as np

ROUND_OFF = 1e-12  # in contact distances: disks that overlap by no more than this are in contact
LARGEST_BOUND = 10**18  # disks; returned for every larger bound, as no scene has so many

Sides = tuple[tuple[float, float], tuple[float, float]]  # (x_low, x_high), (y_low, y_high) [length]


def overlap(position: np.ndarray, radius: np.ndarray, box: Sides | None = None) -> tuple[int, int, float] | None:
    """Return two overlapping disks and the (negative) gap between their edges, None if no two overlap.

    position: (N, 2), radius: (N,) [length]. box: its sides if periodic, else None. Overlaps
    within round-off do not count.

    Sweep and prune along the longer side: with the disks sorted by their left edges, the disks whose left edge lies
    left of the right edge of disk i follow it directly, and these are its only candidates. Step k compares every such
    i with i + k and drops those that end before i + k begins. The cost is the number of pairs that overlap in
    projection, for any mixture of radii.
    """
    if len(radius) < 2:
        return None
    spacing = 2 * np.spacing(np.abs(position).max())  # round-off of the positions
    disk = np.arange(len(radius))
    if box is not None:
        position, radius, disk = _with_images(position, radius, box)
    axis = int(np.ptp(position[:, 1]) > np.ptp(position[:, 0]))
    order = np.argsort(position[:, axis] - radius, kind="stable")
    position, radius, disk = position[order], radius[order], disk[order]
    left, right = position[:, axis] - radius, position[:, axis] + radius
    k, i = 0, np.arange(len(radius))
    while len(i):
        k += 1
        i = i[: np.searchsorted(i, len(radius) - k)]
        i = i[left[i + k] < right[i]]
        sigma = radius[i] + radius[i + k]
        gap = np.hypot(*(position[i] - position[i + k]).T) - sigma
        overlapping = np.flatnonzero(gap < -(ROUND_OFF * sigma + spacing))
        if len(overlapping):
            deepest = overlapping[np.argmin(gap[overlapping])]
            a, b = sorted((int(disk[i[deepest]]), int(disk[i[deepest] + k])))
            return a, b, float(gap[deepest])
    return None


def _with_images(position: np.ndarray, radius: np.ndarray, box: Sides) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (M, 2), radii and indices (M,) of all disks and of those images that reach into the box."""
    low, high = np.array(box, dtype=float).T
    shifts = [np.array([i, j]) * (high - low) for i in (0, -1, 1) for j in (0, -1, 1)]
    images = np.concatenate([position + shift for shift in shifts])
    radius, disk = np.tile(radius, 9), np.tile(np.arange(len(radius)), 9)
    inside = np.all((images + radius[:, None] >= low) & (images - radius[:, None] <= high), axis=1)
    return images[inside], radius[inside], disk[inside]


def most_disks(width: float, height: float, diameter: float, periodic: bool) -> int:
    """Return an upper bound on the number of equal disks in a rectangle, 0 if not even one fits.

    Periodic: no packing is denser than the hexagonal one, phi = pi/sqrt(12). Between walls: N. Oler, Acta Math. 105,
    19 (1961), N <= 2 A/(sqrt(3) d^2) + P/(2 d) + 1 with the area A and perimeter P of the rectangle accessible to the
    centres, d the diameter.
    """
    walls = 0.0 if periodic else 1.0
    x, y = width / diameter - walls, height / diameter - walls  # sides of that rectangle in diameters
    if min(x, y) < 0:
        return 0
    if x * y > LARGEST_BOUND:
        return LARGEST_BOUND
    return math.floor((2 / math.sqrt(3) * x * y + walls * (x + y + 1)) * (1 + 1e-9))
