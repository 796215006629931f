"""Pairs of disks that overlap."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial import KDTree

ROUND_OFF = 1e-12  # in contact distances: disks that overlap by no more than this are in contact
BLOCK = 20_000  # disks whose neighbours are looked up at a time, which bounds the memory
# per disk, closer than its diameter: on average 20 at most, and 16 more for each size of disks that
# are much larger, unless disks overlap
MOST_NEIGHBOURS = 100


class Crowd(NamedTuple):
    """A disk with far more neighbours than disks without overlaps can have."""

    disk: int
    neighbours: int  # disks whose centres are closer to its own than its diameter


class Overlaps(NamedTuple):
    """How many pairs of disks overlap, and the pair that does most, in contact distances."""

    number: int
    first: int  # of the two disks, first < second
    second: int
    gap: float  # between their edges, negative [length]
    depth: float  # -gap over their contact distance


PeriodicSides = tuple[tuple[float, float] | None, tuple[float, float] | None]
WALLS: PeriodicSides = (None, None)


def crowd(position: np.ndarray, radius: np.ndarray, sides: PeriodicSides = WALLS) -> Crowd | None:
    """Return the disk with most neighbours if disks are so crowded that their pairs cannot be
    listed; None if they are not. Arguments are those of `overlaps`.

    Positions and radii in different units are crowded, and positions that are all zero.
    """
    tree, _ = _tree(position, radius, sides)
    number = np.zeros(len(radius), np.int64)
    for start in range(0, len(radius), BLOCK):
        block = slice(start, start + BLOCK)
        reach = 2 * radius[block]
        number[block] = tree.query_ball_point(tree.data[block], reach, return_length=True)
        if number.sum() > MOST_NEIGHBOURS * len(radius):
            disk = int(np.argmax(number))
            return Crowd(disk, int(number[disk]) - 1)
    return None


def _tree(
    position: np.ndarray, radius: np.ndarray, sides: PeriodicSides
) -> tuple["KDTree", np.ndarray]:
    """Return a k-d tree of the centres, and the size (2,) of its periodic box: between walls so
    large that no disk is near an image of another.
    """
    from scipy.spatial import KDTree  # takes 0.2 s

    margin = 2 * radius.max()
    low = position.min(axis=0) - margin
    high = position.max(axis=0) + margin
    for axis, periodic in enumerate(sides):
        if periodic is not None:
            low[axis], high[axis] = periodic
    size = high - low
    return KDTree((position - low) % size, boxsize=size), size


def overlaps(
    position: np.ndarray, radius: np.ndarray, sides: PeriodicSides = WALLS
) -> Overlaps | None:
    """Return the pairs that overlap, None if no two do.

    position: (N, 2), radius: (N,) [length]. sides: (low, high) of x and of y where they are
    periodic, at least twice the largest diameter apart, None where they are walls. Overlaps within
    round-off do not count.

    Two overlapping disks, the larger one of radius R, are closer than 2 R: a k-d tree finds them.
    """
    if len(radius) < 2:
        return None
    tree, size = _tree(position, radius, sides)
    spacing = 2 * np.spacing(np.abs(position).max())
    blocks = []
    for start in range(0, len(radius), BLOCK):
        block = slice(start, start + BLOCK)
        near = tree.query_ball_point(tree.data[block], 2 * radius[block])
        a = start + np.repeat(np.arange(len(near)), [len(neighbours) for neighbours in near])
        b = np.concatenate(near).astype(int)
        apart = position[a] - position[b]
        apart -= size * np.rint(apart / size)
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
