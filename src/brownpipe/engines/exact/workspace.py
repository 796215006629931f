"""The arrays on which the kernels of the exact engine work, the names of their columns, and a
disk's motion in them.

How to read a kernel
--------------------
`w` is the `Workspace` of a run and `r` its `Recorder`; `i` and `k` are disks, `j` counts. A disk is
one row of `w.disk` (64 bytes, a cache line) and one row of `w.link` (32 bytes). Both arrays are
flat, and the rows of disk i begin at `ROW * i`:

    w.disk        ROW * i + ...   8 float64: X | Y | VX | VY | TIME | PAIR_TIME | CHANGES | RADIUS
    w.link        ROW * i + ...   8 uint32:  (time of the event) | PARTNER | PARTNER_CHANGES |
                                             CELL_COLUMN | CELL_ROW | BUCKET | EVENT
    w.event_time  EVENT_ROW * i   the first two words of the row of `link`, as one float64

`w.disk[ROW * i + VX]` is the x velocity of disk i. (Two-dimensional arrays cost 10 to 28 % of the
speed.) No index is negative (see `engines.compiled.compiler`). A `four` of numbers belongs to four
disks (see `engines.compiled.fours`).

An optional field is an argument of its own beside `w`, as in `gather(w.big, w, i)`: where the
argument is None, Numba removes the branch behind `if big is not None` when it compiles; a branch on
`w.big` would remain. Every kind of scene thus has kernels of its own, without code for what it
lacks. Records declared with `by_reference` are passed as one pointer (see
`engines.compiled.records`). Without Numba's compiler every kernel is a Python function with the
same results.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.collisions import shares
from brownpipe.engines.compiled.fours import all_bits, four, four_columns
from brownpipe.engines.compiled.kernels import kernel
from brownpipe.engines.compiled.records import SampleArrays, by_reference

# A row of `disk`: position and velocity at the disk's own time TIME; the time of its next pair
# collision; how often its velocity or its image has changed, which tells whether a prediction made
# with it still holds; the radius.
ROW = 8
X, Y, VX, VY, TIME, PAIR_TIME, CHANGES, RADIUS = range(ROW)
MOTION = slice(X, TIME)  # what is handed from one block of time to the next
# A row of `link`: the time of the next event, which takes the first two words (see EVENT_ROW); the
# partner of the next pair collision (a candidate, see DISK_BITS) and its CHANGES when the collision
# was predicted; the cell; the bucket and the kind of the next event.
PARTNER, PARTNER_CHANGES, CELL_COLUMN, CELL_ROW, BUCKET, EVENT = range(2, ROW)
EVENT_ROW = ROW // 2
# The kind of an event: with the partner, into a neighbouring cell (LEFT to UP), or with a wall:
# WALL + its side, from LEFT to UP, so that it exceeds UP.
PAIR, LEFT, RIGHT, DOWN, UP = range(5)
WALL = UP
# A candidate for a collision is a disk or a periodic image of it: disk + (image << DISK_BITS);
# image 0 is the disk.
DISK_BITS = 28
DISK_MASK = (1 << DISK_BITS) - 1
SHIFT_ROW = 4  # the displacement of image n begins at shift[SHIFT_ROW * n]
# Marks a periodic axis. It takes no room in the compiled record: with a byte in its place the
# kernels that prefetch had 2.6 % more instructions.
Periodic = tuple[()]
PERIODIC: Periodic = ()
# Words of a neighbour list, the first of which is the number of neighbours: one or two cache lines.
LIST_WORDS, WIDE_LIST_WORDS = 16, 32
# `tally`: time within the block, smallest (r^2 - sigma^2)/sigma^2 of any pair, largest distance of
# a disk outside its cell or square (in cells), sum of the virial, impulse given by each wall
# (WALL_IMPULSE + side - 1).
NOW, NEAREST, STRAY, VIRIAL, WALL_IMPULSE = range(5)
TALLY = WALL_IMPULSE + 4
# `count`: events of each kind. STALE pair events have a partner that has changed course since they
# were predicted.
PAIRS, WALLS, TRACER_PAIRS, STALE, CROSSINGS = range(5)
COUNTS = 5
# `progress`: current bucket and the number of its events; current block, next sample, collisions in
# the log; whether a cell or list overflowed, whether the block has begun, whether to stop at its
# end.
CURRENT_BUCKET, CURRENT_EVENTS, BLOCK, SAMPLE, LOGGED, OVERFLOW, BLOCK_BEGUN, STOP = range(8)
PROGRESS = 8
# How a call of `events.advance` ends.
DONE, PAUSED, LOG_FULL, CELL_FULL, BLOCK_OVER = range(5)


@by_reference
class BigDisks(NamedTuple):
    """The disks much bigger than a cell, which are numbered first, and the patterns of cells around
    their own.
    """

    number: int
    # (number + 1,) int64, index in `listed` where the pattern of each big disk begins
    listed_first: np.ndarray
    listed: np.ndarray  # (n, 2) int64, offsets (columns, rows) of the cells that list it
    reach_first: np.ndarray  # (number + 1,) int64, the same for `reach`
    reach: np.ndarray  # (n, 2) int64, offsets of the cells in which it can touch a disk


@by_reference
class Grid(NamedTuple):
    """The box in the engine's coordinates and units, divided into cells; a rim of ghost cells
    surrounds it.
    """

    columns: int
    rows: int
    x: float  # lower left corner of the box
    y: float
    width: float  # of the box
    height: float
    cell_width: float
    cell_height: float
    slots: int  # words of a cell: the number of candidates in it, and the candidates
    sigma: float  # contact distance, where all disks are equal


@by_reference
class Calendar(NamedTuple):
    """The scale of the calendar queue: blocks of time, and the ring of buckets into which a block
    is divided.
    """

    block: float  # duration of a block, a power of two
    width: float  # duration of a bucket, a power of two
    per_time: float  # 1/width
    ring: int  # number of buckets in the ring - 1, a bit mask; the number is a power of two


@by_reference
class NeighbourLists(NamedTuple):
    """The neighbours of each disk, and the squares for which they are complete."""

    half: float  # half the side of a square
    wide: bool | None  # True: a list has WIDE_LIST_WORDS; None: LIST_WORDS
    centre: np.ndarray  # (2 N,) float64, of each disk's square
    # (words of a list * N + 4,) uint32: the number of neighbours, and these (candidates)
    neighbour: np.ndarray


@by_reference
class Deferred(NamedTuple):
    """Events that are not in their bucket yet, as it is being prefetched. Only systems that
    prefetch have this record.

    There a bucket is not in the cache, and to write to it at once would be to wait for it. There
    are two lists, one of the insertions deferred during buckets of even number and one of those
    during buckets of odd number. A list is carried out before the next bucket but one is opened, or
    when it is full.
    """

    number: np.ndarray  # (2,) int64, of the deferred insertions in each list
    # (2 MOST_DEFERRED,) int64, number of the bucket, not reduced to the ring; one list, the other
    bucket: np.ndarray
    disk: np.ndarray  # (2 MOST_DEFERRED,) uint32
    # whether the candidates for upcoming collisions are prefetched, too (`prefetch`)
    with_candidates: bool


@by_reference
class Workspace(NamedTuple):
    """All that the kernels read and write in a run, except the samples. None: the scene does not
    need it.
    """

    grid: Grid
    calendar: Calendar
    disk: np.ndarray  # (8 N,) float64
    link: np.ndarray  # (8 N,) uint32
    event_time: np.ndarray  # (4 N,) float64, a view of `link`
    mass: np.ndarray | None  # (N,) float64; None: all disks have mass 1 and the same radius
    cell: np.ndarray  # (cells * slots + 4,) uint32
    # PERIODIC if the box is periodic along x, and along y; None: walls there
    wraps_x: Periodic | None
    wraps_y: Periodic | None
    # (2 N,) int32, how often each disk has left a periodic box to the right and upwards; None:
    # walls on all sides
    image: np.ndarray | None
    # (36,) float64, displacement (x, y, 0, 0) of each periodic image; None: walls on all sides
    shift: np.ndarray | None
    big: BigDisks | None
    lists: NeighbourLists | None
    bucket: np.ndarray  # (16 * buckets,) uint32
    current_time: np.ndarray  # (n,) float64, events of the current bucket, the next one last
    current_disk: np.ndarray  # (n,) uint32
    deferred: Deferred | None  # None: few disks, whose buckets are in the cache
    candidate: np.ndarray  # (m,) uint32, scratch: disks that disk i may touch
    progress: np.ndarray  # (PROGRESS,) int64
    count: np.ndarray  # type: ignore[assignment]  # (COUNTS,) int64; hides tuple.count
    tally: np.ndarray  # (TALLY,) float64


@by_reference
class Recorder(NamedTuple):
    """When to sample, and the arrays to write to; those of all disks, or of collisions, are empty
    if not recorded.
    """

    tracer: int  # its number in the engine
    block: np.ndarray  # (T,) int64, block of each sample
    time: np.ndarray  # (T,) float64, time of each sample within its block
    track: SampleArrays  # of the tracer, M = 1
    whole: SampleArrays  # of all disks, M = N, or M = 0
    # (5,) int64, samples between which the quarters of the run lie; (0,): not counted in quarters
    quarter: np.ndarray
    species: np.ndarray  # (N,) int64, of each disk; (0,): not counted in quarters
    # (5, 2 + K) float64: pair collisions and virial until then, energy of the K species; or (0, 2)
    totals: np.ndarray
    log_block: np.ndarray  # (L,) int64, of each collision
    log_time: np.ndarray  # (L,) float64, within the block
    log_pair: np.ndarray  # (L, 2) int32, the disks; the second is -side for a wall
    log_impulse: np.ndarray  # (L, 2) float64, given to the first disk


# -- a disk, and a pair of disks as seen from one of them ------------------------------------------
# A disk's position is that at its own time TIME, from which it moves straight. `mass` and `shift`
# may be None.


@kernel
def contact_distance(mass: np.ndarray | None, w: Workspace, i: int, k: int) -> float:
    """Return sigma of disks i and k; without masses all disks are equal."""
    if mass is None:
        return w.grid.sigma
    return w.disk[ROW * i + RADIUS] + w.disk[ROW * k + RADIUS]


@kernel
def radius_of(mass: np.ndarray | None, w: Workspace, i: int) -> float:
    """Return the radius of disk i."""
    if mass is None:
        return 0.5 * w.grid.sigma
    return w.disk[ROW * i + RADIUS]


@kernel
def mass_of(mass: np.ndarray | None, i: int) -> float:
    """Return the mass of disk i."""
    if mass is None:
        return 1.0
    return mass[i]


@kernel
def apply_impulse(
    mass: np.ndarray | None, w: Workspace, i: int, k: int, fx: float, fy: float
) -> float:
    """Apply eqs. (5)-(6) to the velocities of disks i and k; return m, where m f is the impulse
    given to disk i.
    """
    disk, a, b = w.disk, ROW * i, ROW * k
    if mass is None:
        disk[a + VX] += fx
        disk[a + VY] += fy
        disk[b + VX] -= fx
        disk[b + VY] -= fy
        return 1.0
    whole_a, part_a, whole_b, part_b, impulse_mass = shares(mass[i], mass[k])
    disk[a + VX] = disk[a + VX] + whole_a * fx + part_a * fx
    disk[a + VY] = disk[a + VY] + whole_a * fy + part_a * fy
    disk[b + VX] = disk[b + VX] - whole_b * fx - part_b * fx
    disk[b + VY] = disk[b + VY] - whole_b * fy - part_b * fy
    return impulse_mass


@kernel
def shifted(shift: np.ndarray | None, candidate: int, x: float, y: float) -> tuple[float, float]:
    """Return the position of the candidate whose disk is at (x, y): periodic images are displaced
    by a box.
    """
    if shift is None:
        return x, y
    a = SHIFT_ROW * (candidate >> DISK_BITS)
    return x + shift[a], y + shift[a + 1]


@kernel
def position(w: Workspace, i: int, now: float) -> tuple[float, float]:
    """Return the position of disk i at the time now."""
    a = ROW * i
    dt = now - w.disk[a + TIME]
    return w.disk[a + X] + w.disk[a + VX] * dt, w.disk[a + Y] + w.disk[a + VY] * dt


@kernel
def relative_motion(
    w: Workspace, i: int, candidate: int, now: float
) -> tuple[float, float, float, float]:
    """Return position and velocity of a candidate relative to disk i, (x, y, u, v) of
    `collisions.encounter`.
    """
    k = candidate & DISK_MASK
    x_i, y_i = position(w, i, now)
    x_k, y_k = position(w, k, now)
    x, y = shifted(w.shift, candidate, x_k - x_i, y_k - y_i)
    disk, a, b = w.disk, ROW * i, ROW * k
    return x, y, disk[b + VX] - disk[a + VX], disk[b + VY] - disk[a + VY]


@kernel
def move(w: Workspace, i: int, now: float) -> None:
    """Advance disk i to the time now."""
    a = ROW * i
    w.disk[a + X], w.disk[a + Y] = position(w, i, now)
    w.disk[a + TIME] = now


# -- four disks at a time, see `engines.compiled.fours` --------------------------------------------


@kernel
def four_disks(w: Workspace, k: np.ndarray, now: float) -> tuple[np.ndarray, ...]:
    """Return position at the time now, velocity, time of the next pair collision and radius of four
    disks.
    """
    x, y, vx, vy = four_columns(w.disk, ROW * k)
    time, pair_time, _, radius = four_columns(w.disk, ROW * k + TIME)
    dt = now - time
    return x + vx * dt, y + vy * dt, vx, vy, pair_time, radius


@kernel
def four_contact_distances(
    mass: np.ndarray | None, w: Workspace, i: int, radius: np.ndarray
) -> np.ndarray:
    """Return sigma of disk i and each of four others, like `contact_distance`."""
    if mass is None:
        return four(w.grid.sigma)
    return w.disk[ROW * i + RADIUS] + radius


@kernel
def four_shifted(
    shift: np.ndarray | None, candidate: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of four candidates, like `shifted`; seldom is one of them an image."""
    if shift is None:
        return x, y
    if all_bits(candidate) <= DISK_MASK:
        return x, y
    across, up, _, _ = four_columns(shift, (candidate >> DISK_BITS) * SHIFT_ROW)
    return x + across, y + up
