"""What fits: do disks overlap, and how many can there be in a rectangle? Arrays and numbers only."""

import math

import numpy as np

ROUND_OFF = 1e-12  # in contact distances: disks nearer than contact by no more than this are in contact

MOST = 10**18  # disks, as an upper bound; more are never asked for


def overlap(position: np.ndarray, radius: np.ndarray, box=None) -> tuple[int, int, float] | None:
    """Return two disks that overlap by more than round-off and the (negative) gap between their edges, or None.

    position: (N, 2), radius: (N,) [length]. box: ((x_low, x_high), (y_low, y_high)) if it is periodic, else None.

    A sweep along the longer side: sorted by their left edges, the disks that begin before disk i ends follow it
    directly, and these are its only candidates. Step k compares every i with i + k; disk i is done when i + k begins
    beyond its right edge. The cost is the number of pairs that overlap in projection, whatever the mixture of radii.
    """
    if len(radius) < 2:
        return None
    coordinates = 2 * np.spacing(np.abs(position).max())  # round-off of the positions, that of the radii aside
    disk = np.arange(len(radius))
    if box is not None:
        position, radius, disk = _with_images(position, radius, box)
    along = int(np.ptp(position[:, 1]) > np.ptp(position[:, 0]))
    order = np.argsort(position[:, along] - radius, kind="stable")
    position, radius, disk = position[order], radius[order], disk[order]
    left, right = position[:, along] - radius, position[:, along] + radius
    i, k = np.arange(len(radius)), 0
    while len(i):
        k += 1
        i = i[: np.searchsorted(i, len(radius) - k)]
        i = i[left[i + k] < right[i]]
        sigma = radius[i] + radius[i + k]
        gap = np.hypot(*(position[i] - position[i + k]).T) - sigma
        bad = np.flatnonzero(gap < -(ROUND_OFF * sigma + coordinates))
        if len(bad):
            worst = bad[np.argmin(gap[bad])]
            a, b = sorted((int(disk[i[worst]]), int(disk[i[worst] + k])))
            return a, b, float(gap[worst])
    return None


def _with_images(position, radius, box):
    """Return positions, radii and disk numbers of the disks and of their periodic images that reach into the box."""
    low, high = np.array(box, dtype=float).T
    shifts = [np.array([i, j]) * (high - low) for i in (0, -1, 1) for j in (0, -1, 1)]
    images = np.concatenate([position + shift for shift in shifts])
    radius, disk = np.tile(radius, 9), np.tile(np.arange(len(radius)), 9)
    inside = np.all((images + radius[:, None] >= low) & (images - radius[:, None] <= high), axis=1)
    return images[inside], radius[inside], disk[inside]


def most_disks(width: float, height: float, diameter: float, periodic: bool) -> int:
    """Return an upper bound on the number of equal disks in a rectangle, 0 if one is too large for it.

    Periodic: no packing is denser than the hexagonal one, phi = pi/sqrt(12). Between walls: N. Oler, Acta Math. 105,
    19 (1961), N <= 2 A/(sqrt(3) d^2) + P/(2 d) + 1 with the area A and the perimeter P of the rectangle of the centres.
    """
    rim = 0.0 if periodic else 1.0
    x, y = width / diameter - rim, height / diameter - rim
    if min(x, y) < 0:
        return 0
    if x * y > MOST:
        return MOST
    return math.floor((2 / math.sqrt(3) * x * y + rim * (x + y + 1)) * (1 + 1e-9))
