"""What the kernels of the exact engine work on: flat arrays, and the names of their columns.

One disk is one row of `disk` (64 bytes, a cache line) and one of `link` (32 bytes). The arrays are flat, disk i
beginning at 8 * i: two-dimensional ones cost 10 to 28 % here. Identifiers are uint32, so that the compiler knows that
an index is not negative.
"""

from typing import NamedTuple

from brownpipe.engines.records import by_reference

# The row of a disk, what others need of it: position and velocity at its own time, when its next collision is, how
# often its velocity has changed, its radius.
ROW = 8
X, Y, VX, VY, TIME, PAIR_TIME, COUNT, RADIUS = range(ROW)
MOTION = slice(X, TIME)  # what outlasts a block
# The row of its links, what only the disk itself needs. It begins with the time of its next event, a float64, which is
# read and written as `event_time`: the same memory as rows of EVENT_ROW such numbers. PARTNER_COUNT is the partner's
# COUNT when the collision was predicted.
PARTNER, PARTNER_COUNT, COLUMN, LINE, BUCKET, EVENT = range(2, ROW)
EVENT_ROW = ROW // 2
# The event that is next: with the partner, into the next cell, or with a wall (whose code is WALL + the side).
PAIR, LEFT, RIGHT, DOWN, UP, WALL = 0, 1, 2, 3, 4, 4
# A candidate for a collision is a disk or an image of it: disk + (image << DISK_BITS), image 0 the disk itself.
DISK_BITS = 28
DISK_MASK = (1 << DISK_BITS) - 1
# How many numbers the list of a disk takes, and where lists are wide.
LIST_LINE, WIDE_LINE = 16, 32
# Columns of `tally` and `count`: what a run reports.
# STRAY: how far a disk was outside its cell or square, in cells.
NOW, NEAREST, STRAY, VIRIAL, WALL_IMPULSE = range(5)  # WALL_IMPULSE + side - 1: four of them
TALLY = WALL_IMPULSE + 4
PAIRS, WALLS, TRACER_PAIRS, STALE, CROSSINGS = range(5)
COUNTS = 5
# Columns of `clock`.
BUCKET_NOW, SOON, BLOCK, SAMPLE, LOGGED, OVERFULL, OPEN, STOP, WAITING = range(9)  # STOP: at the end of the block
CLOCK = 9
# How a call of `advance` ends.
DONE, PAUSED, LOG_FULL, CELL_FULL, BLOCK_OVER = range(5)


@by_reference
class BigDisks(NamedTuple):
    """The disks much bigger than the cells, numbered first, and the cells around their own that concern them."""

    number: int
    listed_first: object  # (number + 1,) where the rows of big disk i begin
    listed: object  # (n, 2) offsets (columns, lines) of the cells that list it
    reach_first: object
    reach: object  # (n, 2) offsets of the cells in which it can touch something


@by_reference
class Grid(NamedTuple):
    """The box, in the engine's frame and units, cut into cells with a rim of ghost cells around them."""

    columns: int
    rows: int
    x: float  # lower left corner of the box
    y: float
    width: float  # of the box
    height: float
    cell_width: float
    cell_height: float
    slots: int  # per cell: how many disks are in it, and which
    sigma: float  # contact distance, where all disks are equal


@by_reference
class Calendar(NamedTuple):
    """The bucket queue's scale: buckets of equal width in time, a ring of them, a block of time cut into them."""

    block: float  # length of a block of time, a power of two
    width: float  # of a bucket, a power of two
    per_time: float  # 1/width
    ring: int  # number of buckets in the ring - 1, a mask


@by_reference
class Lists(NamedTuple):
    """Neighbour lists, and the squares for which they hold."""

    half: float  # half the side of a square
    wide: object  # True where a list takes two cache lines, None where it takes one
    centre: object  # (2 N,) float64, of the squares
    neighbour: object  # (line * N,) uint32, how many neighbours and which


@by_reference
class Ahead(NamedTuple):
    """Where memory is much slower than the processor's cache: disks that wait for their bucket to come from there."""

    bucket: object  # (n,) int64, the number of each one's bucket
    disk: object  # (n,) uint32


@by_reference
class Workspace(NamedTuple):
    """All that a run needs. What a scene does not need is None, and the code for it is not compiled."""

    grid: Grid
    calendar: Calendar
    disk: object  # (8 N,) float64
    link: object  # (8 N,) uint32
    event_time: object  # (4 N,) float64, a view of `link`
    mass: object  # (N,) float64, or None where all are equal in mass and radius
    cell: object  # (cells * slots,) uint32
    image: object  # (2 N,) int32, times a disk has gone round a periodic box; None between walls
    shift: object  # (9, 2) float64, of the images; None between walls
    big: object  # BigDisks, or None
    lists: object  # Lists, or None
    bucket: object  # (16 * ring,) uint32
    current_time: object  # events of the current bucket, the next one last
    current_disk: object
    deferred: object  # Ahead; None where memory is near
    candidate: object  # scratch of `predict`
    quadratic: object
    progress: object  # int64
    count: object  # int64
    tally: object  # float64


@by_reference
class Recorder(NamedTuple):
    """When to sample, and where to write it. Records of all disks and of events are empty if not asked for."""

    tracer: int  # its number in the engine
    block: object  # (T,) int64, the block of each sample
    time: object  # (T,) time of each sample within its block
    position: object  # (T, 1, 2) of the tracer
    velocity: object
    image: object
    whole_position: object  # (T, N, 2) of all disks, or (T, 0, 2)
    whole_velocity: object
    whole_image: object
    log_block: object  # (L,) int64, of each collision
    log_time: object  # (L,)
    log_pair: object  # (L, 2) int32
    log_impulse: object  # (L, 2)
