"""From a state to a workspace: units, the order of the disks, cells, the clock."""

import math

import numpy as np

from brownpipe import theory
from brownpipe.engines.exact.calendar import LINE as BUCKET_LINE
from brownpipe.engines.exact.workspace import (
    CLOCK,
    COUNTS,
    LIST_LINE,
    MOTION,
    NEAREST,
    RADIUS,
    ROW,
    TALLY,
    TIME,
    WIDE_LINE,
    Ahead,
    BigDisks,
    Calendar,
    Grid,
    Lists,
    Workspace,
)
from brownpipe.engines.state import State
from brownpipe.engines.units import Frame, common_radius, motion_of, power_of_two, thermal_speed
from brownpipe.scene import Scene

EVENTS_PER_BUCKET = 8.0  # in the mean
COLLISIONS_PER_BLOCK = 128.0  # of one disk: a block begins with predicting everything afresh, which should cost little
LISTS_FROM = 0.6  # packing fraction from which neighbour lists are faster than cells alone
DENSEST = math.pi / math.sqrt(12)  # packing fraction of a triangular lattice
FITS_CACHE = 20_000  # disks; with more, prefetching upcoming events and a shorter ring of buckets are faster
WAIT = 64  # disks that wait for their bucket: more than a bucket's events schedule
CACHE_LINE = 64  # bytes
PATH_PER_BLOCK = 1024.0  # in contact distances: round-off of the time within a block stays below 1e-13 of them


def prepare(scene: Scene, frame: Frame, pinned: bool = False, slots: int | None = None) -> Workspace:
    """Lay out a workspace for the runs of a scene.

    A `pinned` tracer has infinite mass. `slots` is the room of a cell where the usual proved too small.
    """
    n, radius, mass = scene.particles, scene.radius[frame.order] / frame.length, scene.mass[frame.order] / frame.mass
    if pinned:
        mass[frame.back[0]] = np.inf
    equal = n < 2 or (np.all(radius == radius[0]) and np.all(mass == mass[0]))
    common = common_radius(radius) if n else 0.5
    big = _big_disks(_grid(scene, frame, common, 0.0), radius, common, scene.box.periodic)
    if big is None:
        common = radius.max(initial=common)
    half, wide = _squares(scene, radius) if big is None and slots is None else (0.0, None)
    cells = _grid(scene, frame, common, half)
    cells = cells._replace(slots=slots or _slots(scene, radius, common, cells))
    calendar = _calendar(scene, thermal_speed(scene) * frame.time / frame.length, common, cells, half)
    room = 9 * cells.slots + 8 if big is None else cells.slots * (len(big.reach) + 9) + 9 * big.number + 8
    shift = np.array([(a, u) for u in (0, 1, -1) for a in (0, 1, -1)]) * (cells.width, cells.height)
    soon = n + n // 8 + 16  # all disks at once, and room before what no longer counts must be looked for
    disk, link = aligned(ROW * n, np.float64), aligned(ROW * n, np.uint32)
    disk[RADIUS::ROW] = radius
    return Workspace(
        grid=cells,
        calendar=calendar,
        disk=disk,
        link=link,
        event_time=link.view(np.float64),
        mass=None if equal else mass,
        cell=aligned((cells.columns + 2) * (cells.rows + 2) * cells.slots, np.uint32),
        image=np.zeros(2 * n, np.int32) if scene.box.periodic else None,
        shift=shift if scene.box.periodic else None,
        big=big,
        lists=_lists(half, wide, n) if half else None,
        bucket=aligned(BUCKET_LINE * (calendar.ring + 1), np.uint32),
        current_time=np.empty(soon),
        current_disk=np.empty(soon, np.uint32),
        deferred=Ahead(np.zeros(WAIT, np.int64), np.zeros(WAIT, np.uint32)) if n >= FITS_CACHE else None,
        candidate=np.zeros(room, np.uint32),
        quadratic=np.zeros(3 * room),
        progress=np.zeros(CLOCK, np.int64),
        count=np.zeros(COUNTS, np.int64),
        tally=np.zeros(TALLY),
    )


def aligned(size: int, dtype: type) -> np.ndarray:
    """Return (size,) zeros that begin where a cache line does, so that no row lies across two."""
    length = size * np.dtype(dtype).itemsize
    room = np.zeros(length + CACHE_LINE, np.uint8)
    first = -room.ctypes.data % CACHE_LINE
    return room[first : first + length].view(dtype)


def fill(w: Workspace, state: State, frame: Frame) -> None:
    """Set a workspace to the beginning of a run from a state."""
    begin(w, motion_of(state, frame))


def begin(w: Workspace, motion: np.ndarray) -> None:
    """Set a workspace to the beginning of a run from positions and velocities (N, 4), as of `motion_of`."""
    disk = w.disk.reshape(-1, ROW)
    disk[:, MOTION], disk[:, TIME] = motion, 0.0
    w.progress[:], w.count[:], w.tally[:] = 0, 0, 0.0
    w.tally[NEAREST] = np.inf
    if w.image is not None:
        w.image[:] = 0


def _slots(scene: Scene, radius: np.ndarray, common: float, cells: Grid) -> int:
    """Return the room of a cell: a multiple of 4, of which one is the counter."""
    smallest = radius.min(initial=common)
    most = 1.5 * (1.6 * common / smallest) ** 2
    reached = (cells.cell_width + 2 * smallest) * (cells.cell_height + 2 * smallest)
    most = max(most, _crowd(scene, smallest, reached)) + 2.0
    return int(min(max(8, 4 * math.ceil(most / 4)), 64))


def _crowd(scene: Scene, smallest: float, area: float) -> float:
    """Return how many of the smallest disks cover an area as densely as the scene's disks cover the box."""
    return scene.packing_fraction * area / (math.pi * smallest**2)


def _squares(scene: Scene, radius: np.ndarray) -> tuple[float, bool | None]:
    """Return half the side of the squares for which neighbour lists hold, and whether lists are wide (True or None).

    A side of 0 where cells alone are faster, or where the neighbours of the largest disk may be too many for a list.
    """
    phi = scene.packing_fraction
    if phi < LISTS_FROM or len(radius) == 0:
        return 0.0, None
    smallest, largest = radius.min(), radius.max()
    gap = math.sqrt(DENSEST / phi) - 1  # mean, between the edges of neighbours, in contact distances
    half = 2 * radius.mean() * min(max(2 * gap, 0.02), 0.35)
    reach = largest + 2 * smallest  # beyond two squares next to each other, of the edge of a small disk
    most = _crowd(scene, smallest, (4 * half) ** 2 + 16 * half * reach + math.pi * reach**2)
    return half if most < WIDE_LINE else 0.0, None if most < LIST_LINE else True


def _grid(scene: Scene, frame: Frame, common: float, half: float) -> Grid:
    """Cells, of no room yet, 1.1 (dense) to 2 (dilute) contact distances wide, but not many more than there are disks.

    With neighbour lists, cells hold centres of squares of half the side `half`, which may lie nearer than the disks.
    """
    box, n = scene.box, scene.particles
    width, height = box.width / frame.length, box.height / frame.length
    wide = 2 * (common + half) if half else 2 * common * (2.0 - 1.8 * min(scene.packing_fraction, 0.5))
    side = max(wide, math.sqrt(width * height / (4 * n + 4)))
    columns, lines = max(int(width / side), 1), max(int(height / side), 1)
    x, y = (box.x[0] - frame.origin[0]) / frame.length, (box.y[0] - frame.origin[1]) / frame.length
    return Grid(columns, lines, x, y, width, height, width / columns, height / lines, 0, 2 * common)


def _calendar(scene: Scene, speed: float, common: float, cells: Grid, half: float) -> Calendar:
    """Choose block and bucket: see the constants at the head of this file."""
    n, sigma = scene.particles, 2 * common
    if speed == 0.0:
        return Calendar(2.0**1000, 2.0**999, 2.0**-999, 15)
    chi = theory.contact_value_henderson(min(scene.packing_fraction, 0.9))
    rate = theory.collision_rate(n / (cells.width * cells.height), sigma, chi, 0.5, 0.5 * speed**2)
    crossing = speed * (1 / cells.cell_width + 1 / cells.cell_height) if half == 0.0 else 0.5 * speed / half
    block = power_of_two(min(COLLISIONS_PER_BLOCK / rate, PATH_PER_BLOCK * sigma / speed))
    width = power_of_two(min(EVENTS_PER_BUCKET / (n * (rate + crossing)), block))
    ring = max(16, 2 ** math.ceil(math.log2((0.75 if n < FITS_CACHE else 0.5) * n)))
    return Calendar(block, width, 1 / width, ring - 1)


def _lists(half: float, wide: bool | None, n: int) -> Lists:
    """Return empty lists for n disks."""
    line = WIDE_LINE if wide else LIST_LINE
    return Lists(half, wide, np.zeros(2 * n), aligned(line * n, np.uint32))


def _big_disks(cells: Grid, radius: np.ndarray, common: float, periodic: bool) -> BigDisks | None:
    """Return the patterns of the disks larger than the common radius; None without such disks.

    None, too, in a periodic box in which a pattern would reach itself.
    """
    number = int(np.count_nonzero(radius > common))
    if number == 0:
        return None
    patterns = [_pattern(cells, r, common, radius.min()) for r in radius[:number]]
    if periodic and max(2 * np.abs(reach).max() + 1 for _, reach in patterns) > min(cells.columns, cells.rows):
        return None
    listed, reach = zip(*patterns, strict=True)
    first = [np.cumsum([0] + [len(each) for each in offsets]) for offsets in (listed, reach)]
    return BigDisks(number, first[0], np.concatenate(listed), first[1], np.concatenate(reach))


def _pattern(cells: Grid, radius: float, common: float, smallest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where a big disk is listed, and the cells that see it there, as offsets from its own cell, (k, 2) each.

    It must be seen from every cell in which a small disk can touch it while it is somewhere in its own cell. It is
    listed at most three cells apart, as one of the 3 x 3 cells of each of these; and whatever sees it counts as within
    reach, so that a disk that comes to see it and the big disk itself always know of each other.
    """
    sides = np.array((cells.cell_width, cells.cell_height))
    furthest = np.ceil((radius + common) / sides).astype(np.int64)  # cells from its own
    places = [np.round(np.linspace(1 - m, m - 1, -(-(2 * m + 1) // 3))).astype(np.int64) for m in furthest]
    centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    block = np.stack(np.meshgrid((-1, 0, 1), (-1, 0, 1), indexing="ij"), axis=-1).reshape(1, 9, 2)
    seen_from = np.abs(centres + block)
    nearest = np.hypot(*np.moveaxis(np.maximum(seen_from - 1, 0) * sides, -1, 0))
    opposite = np.hypot(*np.moveaxis((seen_from + 1) * sides, -1, 0))
    needed = ((nearest < radius + common) & (opposite >= radius + smallest)).any(axis=1)
    return centres[needed, 0], np.unique((centres + block)[needed].reshape(-1, 2), axis=0)
