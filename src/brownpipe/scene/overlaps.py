"""Pairs of disks that overlap."""

from typing import NamedTuple

import numpy as np

ROUND_OFF = 1e-12  # in contact distances: disks that overlap by no more than this are in contact
BLOCK = 20_000  # disks whose neighbours are looked up at a time, which bounds the memory


class Overlaps(NamedTuple):
    """How many pairs of disks overlap, and the pair that does most, in contact distances."""

    number: int
    first: int  # of the two disks, first < second
    second: int
    gap: float  # between their edges, negative [length]
    depth: float  # -gap over their contact distance


def overlaps(position: np.ndarray, radius: np.ndarray, box: tuple | None = None) -> Overlaps | None:
    """Return the pairs that overlap, None if no two do.

    position: (N, 2), radius: (N,) [length]. box: (low, high) of x and of y if it is periodic, at
    least twice the largest diameter, else None. Overlaps within round-off do not count.

    Two overlapping disks, the larger one of radius R, are closer than 2 R: a k-d tree finds them.
    """
    from scipy.spatial import KDTree  # takes 0.2 s

    if len(radius) < 2:
        return None
    margin = 2 * radius.max()  # of a box around all disks: in it none is near an image of another
    if box is None:
        low = position.min(axis=0) - margin
        high = position.max(axis=0) + margin
    else:
        low, high = np.array(box, float).T
    sides = high - low
    tree = KDTree((position - low) % sides, boxsize=sides)
    spacing = 2 * np.spacing(np.abs(position).max())
    blocks = []
    for start in range(0, len(radius), BLOCK):
        block = slice(start, start + BLOCK)
        near = tree.query_ball_point(tree.data[block], 2 * radius[block])
        a = start + np.repeat(np.arange(len(near)), [len(neighbours) for neighbours in near])
        b = np.concatenate(near).astype(int)
        apart = position[a] - position[b]
        apart -= sides * np.rint(apart / sides)
        sigma = radius[a] + radius[b]
        gap = np.hypot(*apart.T) - sigma
        is_overlap = (a != b) & (gap < -(ROUND_OFF * sigma + spacing))
        blocks.append(np.stack([a, b, gap, -gap / sigma])[:, is_overlap])
    a, b, gap, depth = np.concatenate(blocks, axis=1)
    if not len(depth):
        return None
    # A pair is found from its larger disk, and from both if the smaller one is not much smaller.
    pairs = np.unique(np.sort(np.stack([a, b]), axis=0), axis=1)
    deepest = int(np.argmax(depth))
    first, second = sorted((int(a[deepest]), int(b[deepest])))
    return Overlaps(pairs.shape[1], first, second, float(gap[deepest]), float(depth[deepest]))
