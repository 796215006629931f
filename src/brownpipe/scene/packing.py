"""Overlaps of disks in a rectangle. Arrays and numbers only."""

import numpy as np

ROUND_OFF = 1e-12  # in contact distances: disks that overlap by no more than this are in contact
Sides = tuple[tuple[float, float], tuple[float, float]]  # (x_low, x_high), (y_low, y_high) [length]


def overlap(position: np.ndarray, radius: np.ndarray, box: Sides | None = None) -> tuple[int, int, float] | None:
    """Return the two disks that overlap most and the (negative) gap between their edges, None if no two overlap.

    position: (N, 2), radius: (N,) [length]. box: its sides if it is periodic, at least twice the largest diameter, else
    None. Overlaps within round-off do not count.

    A disk of radius R that overlaps another one, no larger, is nearer to it than 2 R: a k-d tree finds both.
    """
    if len(radius) < 2:
        return None
    from scipy.spatial import KDTree  # takes 0.2 s

    sides, inside = None, position
    if box is not None:
        low, high = np.array(box, float).T
        sides, inside = high - low, (position - low) % (high - low)
    tree = KDTree(inside, boxsize=sides)
    near = tree.query_ball_point(tree.data, 2 * radius)
    a, b = np.repeat(np.arange(len(radius)), [len(disks) for disks in near]), np.concatenate(near).astype(int)
    apart = position[a] - position[b]
    if sides is not None:
        apart -= sides * np.rint(apart / sides)
    sigma, spacing = radius[a] + radius[b], 2 * np.spacing(np.abs(position).max())  # round-off of the positions
    gap = np.hypot(*apart.T) - sigma
    gap[(a == b) | (gap >= -(ROUND_OFF * sigma + spacing))] = 0.0
    k = int(np.argmin(gap))
    return (int(min(a[k], b[k])), int(max(a[k], b[k])), float(gap[k])) if gap[k] < 0 else None
