"""Lay out the workspace of a scene: cells, neighbour lists, calendar queue; and set it to the
beginning of a run.
"""

import math
from functools import partial

import numpy as np

from brownpipe import theory
from brownpipe.engines.compiled import fours
from brownpipe.engines.compiled.kernels import compile_all
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.calendar import BUCKET_WORDS, MOST_DEFERRED, push_all
from brownpipe.engines.units import (
    PATH_PER_BLOCK,
    Frame,
    cell_width,
    common_radius,
    power_of_two,
    rms_speed,
)
from brownpipe.scene import Scene
from brownpipe.scene.sections import Box

EVENTS_PER_BUCKET = 8.0  # at most, by estimate; the duration of a bucket is a power of two
PREFETCHED_PER_BUCKET = 13.0  # the same where candidates of upcoming events are prefetched
# counted in a run (bucket: 15 places); a pair collision enters an event for each disk
MOST_PER_BUCKET = 6.0
# factor at most by which buckets become shorter: disks that began close together may spread out
SHORTER_AT_ONCE = 64.0
MOST_BUCKETS = 2.0**30  # in a block; to open so many empty ones takes some 8 s of CPU
# per disk; many, as all events are predicted anew at the beginning of a block
COLLISIONS_PER_BLOCK = 128.0
LISTS_FROM = 0.6  # packing fraction from which neighbour lists are faster than the cell list alone
FITS_CACHE = 10_000  # disks; from this number on, prefetching upcoming events is faster
# disks; from this number on, prefetching candidates in cells and a shorter ring are, too
CANDIDATES_FIT_CACHE = 20_000
LEAST_SLOTS, MOST_SLOTS = 8, 64  # words of a cell at the first try; four disks are copied at once
CACHE_LINE, HUGE_PAGE = 64, 2 << 20  # bytes


def new_workspace(
    scene: Scene, frame: Frame, pinned: bool = False, slots: int | None = None
) -> ws.Workspace:
    """Return a workspace for runs of a scene.

    A `pinned` tracer has infinite mass. `slots` is the size of a cell where the usual one proved
    too small; such a workspace has no neighbour lists.
    """
    n = scene.particles
    radius = scene.radius[frame.order] / frame.length
    mass = scene.mass[frame.order] / frame.mass
    if pinned:
        mass[frame.back[0]] = np.inf
    are_equal = n < 2 or bool(np.all((radius == radius[0]) & (mass == mass[0])))
    box = scene.box
    common = common_radius(radius) if n else 0.5
    without_lists = _cell_grid(scene, frame, common, half=0.0)
    big = _big_disks(without_lists, radius, common, box)
    half = 0.0
    wide = None
    if big is None:
        common = radius.max(initial=common)
        if slots is None:
            half, wide = _squares(scene, radius)
    grid = _cell_grid(scene, frame, common, half)
    grid = grid._replace(slots=slots or _slots(scene, radius, common, grid))
    speed = rms_speed(scene) * frame.time / frame.length
    calendar = _calendar(scene, speed, common, grid, half)
    cells = (grid.columns + 2) * (grid.rows + 2)
    cell_words = cells * grid.slots + fours.SIZE
    bucket_words = BUCKET_WORDS * (calendar.ring + 1)
    # one event of every disk, and some outdated ones before they must be removed
    current = n + n // 8 + 16
    list_words = 0
    if half:
        list_words = ws.WIDE_LIST_WORDS if wide else ws.LIST_WORDS
    disk, link, cell, bucket, current_time, current_disk, centre, neighbour = zeros_together(
        (ws.ROW * n, np.float64),
        (ws.ROW * n, np.uint32),
        (cell_words, np.uint32),
        (bucket_words, np.uint32),
        (current, np.float64),
        (current, np.uint32),
        (2 * n, np.float64),
        (list_words * n + fours.SIZE, np.uint32),
    )
    disk[ws.RADIUS :: ws.ROW] = radius
    image = np.zeros(2 * n, np.int32) if box.has_images else None
    lists = ws.NeighbourLists(half, wide, centre, neighbour) if half else None
    candidate = np.zeros(_most_candidates(grid, big), np.uint32)
    return ws.Workspace(
        grid=grid,
        calendar=calendar,
        disk=disk,
        link=link,
        event_time=link.view(np.float64),
        mass=None if are_equal else mass,
        cell=cell,
        wraps_x=ws.PERIODIC if box.periodic_x else None,
        wraps_y=ws.PERIODIC if box.periodic_y else None,
        image=image,
        shift=_shifts(grid) if box.has_images else None,
        big=big,
        lists=lists,
        bucket=bucket,
        current_time=current_time,
        current_disk=current_disk,
        deferred=_deferred(n, half),
        candidate=candidate,
        progress=np.zeros(ws.PROGRESS, np.int64),
        count=np.zeros(ws.COUNTS, np.int64),
        tally=np.zeros(ws.TALLY),
    )


def _shifts(grid: ws.Grid) -> np.ndarray:
    """Return the displacements (9 SHIFT_ROW,) of the periodic images of a disk, first its own."""
    displacements = []
    for up in (0, 1, -1):
        for right in (0, 1, -1):
            displacements += [right * grid.width, up * grid.height, 0.0, 0.0]
    return np.array(displacements)


def _deferred(n: int, half: float) -> ws.Deferred | None:
    """Return memory for deferred insertions; None for so few disks that they fit the cache."""
    if n < FITS_CACHE:
        return None
    number = np.zeros(2, np.int64)
    bucket = np.zeros(2 * MOST_DEFERRED, np.int64)
    disk = np.zeros(2 * MOST_DEFERRED, np.uint32)
    return ws.Deferred(number, bucket, disk, _prefetches_candidates(n, half))


def _most_candidates(grid: ws.Grid, big: ws.BigDisks | None) -> int:
    """Return how many candidates an event has at most: the disks of 3 x 3 cells or, of a big disk,
    those of the cells within its reach, too.
    """
    if big is None:
        return 9 * grid.slots + 8
    return grid.slots * (len(big.reach) + 9) + 9 * big.number + 8


def zeros_together(*sizes: tuple[int, type]) -> list[np.ndarray]:
    """Return arrays of zeros of the given lengths and types, in one piece of memory, of huge pages
    unless it is small.

    Each begins at a cache line, so that no row of a disk lies across two. NumPy requests huge pages
    for 4 MiB or more; pages that are never written to take no memory.
    """
    lines = [-(-size * np.dtype(dtype).itemsize // CACHE_LINE) for size, dtype in sizes]
    starts = CACHE_LINE * np.cumsum([0, *lines])
    unit = HUGE_PAGE if 2 * starts[-1] > HUGE_PAGE else CACHE_LINE
    memory = np.zeros((-(-int(starts[-1]) // unit) + 1) * unit, np.uint8)
    memory = memory[-memory.ctypes.data % unit :]
    return [
        memory[start:].view(dtype)[:size]
        for start, (size, dtype) in zip(starts[:-1], sizes, strict=True)
    ]


def _prefetches_candidates(n: int, half: float) -> bool:
    """Whether candidates for upcoming events of n disks are prefetched; `half`: of `_cell_grid`, 0
    without lists.
    """
    return n >= (FITS_CACHE if half > 0.0 else CANDIDATES_FIT_CACHE)


def begin_run(w: ws.Workspace, motion: np.ndarray) -> None:
    """Set a workspace to the beginning of a run from positions and velocities (N, 4) of
    `units.motion_of`.
    """
    disk = w.disk.reshape(-1, ws.ROW)
    disk[:, ws.MOTION] = motion
    disk[:, ws.TIME] = 0.0
    w.progress[:] = 0
    w.count[:] = 0
    w.tally[:] = 0.0
    w.tally[ws.NEAREST] = np.inf
    if w.image is not None:
        w.image[:] = 0


def _slots(scene: Scene, radius: np.ndarray, common: float, grid: ws.Grid) -> int:
    """Return the words of a cell, its counter included: a multiple of 4."""
    smallest = radius.min(initial=common)
    most = 1.5 * (1.6 * common / smallest) ** 2
    reached = (grid.cell_width + 2 * smallest) * (grid.cell_height + 2 * smallest)
    most = max(most, _smallest_disks_on(scene, smallest, reached)) + 2.0
    return int(min(max(LEAST_SLOTS, 4 * math.ceil(most / 4)), MOST_SLOTS))


def _smallest_disks_on(scene: Scene, smallest: float, area: float) -> float:
    """Return how many disks of the smallest radius cover an area at the scene's packing
    fraction.
    """
    return scene.packing_fraction * area / (math.pi * smallest**2)


def _squares(scene: Scene, radius: np.ndarray) -> tuple[float, bool | None]:
    """Return half the side of the neighbour lists' squares, and whether lists are wide (True or
    None).

    The side is 0 (no lists) where the cell list alone is faster, or where a list could overflow.
    """
    phi = scene.packing_fraction
    if phi < LISTS_FROM or len(radius) == 0:
        return 0.0, None
    smallest = radius.min()
    # mean gap between the edges of neighbours, in contact distances
    gap = math.sqrt(theory.HEXAGONAL_PACKING / phi) - 1
    half = 2 * radius.mean() * min(max(2 * gap, 0.02), 0.35)
    # contact distance of a small disk and its radius: to its far edge
    reach = radius.max() + 2 * smallest
    area = (4 * half) ** 2 + 16 * half * reach + math.pi * reach**2
    most = _smallest_disks_on(scene, smallest, area)
    if most < ws.LIST_WORDS:
        return half, None
    return (half if most < ws.WIDE_LIST_WORDS else 0.0), True


def _cell_grid(scene: Scene, frame: Frame, common: float, half: float) -> ws.Grid:
    """Return cells, `slots` not yet set, 1.1 (dense) to 2 (dilute) contact distances wide, and at
    most about 4 N.

    With neighbour lists the cells hold the centres of squares of half the side `half`. Along an
    axis, the centres for two disks that can touch are up to 2 (common + half) apart: the width of a
    cell.
    """
    box = scene.box
    width = box.width / frame.length
    height = box.height / frame.length
    narrowest = 2 * (common + half) if half else cell_width(common, scene.packing_fraction)
    side = max(narrowest, math.sqrt(width * height / (4 * scene.particles + 4)))
    columns = max(int(width / side), 1)
    rows = max(int(height / side), 1)
    x = (box.x[0] - frame.origin[0]) / frame.length
    y = (box.y[0] - frame.origin[1]) / frame.length
    return ws.Grid(
        columns,
        rows,
        x,
        y,
        width,
        height,
        width / columns,
        height / rows,
        slots=0,
        sigma=2 * common,
    )


def _calendar(scene: Scene, speed: float, common: float, grid: ws.Grid, half: float) -> ws.Calendar:
    """Choose the durations of a block and a bucket from the expected rates of collisions and cell
    crossings.
    """
    n = scene.particles
    sigma = 2 * common
    if speed == 0.0:
        return ws.Calendar(2.0**1000, 2.0**999, 2.0**-999, 15)
    chi = theory.contact_value_henderson(min(scene.packing_fraction, 0.9))
    rate = theory.collision_rate(n / (grid.width * grid.height), sigma, chi, 0.5, 0.5 * speed**2)
    if half == 0.0:
        crossing = speed * (1 / grid.cell_width + 1 / grid.cell_height)
    else:
        crossing = 0.5 * speed / half
    path = max(PATH_PER_BLOCK * sigma, min(grid.cell_width, grid.cell_height))
    block = power_of_two(min(COLLISIONS_PER_BLOCK / rate, path / speed))
    events = PREFETCHED_PER_BUCKET if _prefetches_candidates(n, half) else EVENTS_PER_BUCKET
    # next to close packing collisions are far more frequent than by Henderson's value
    in_crystal = rate * float(theory.contact_value_crystal(scene.packing_fraction) / chi)
    events_per_time = n * (max(rate, in_crystal) + crossing)
    width = power_of_two(min(events / events_per_time, block))
    buckets_per_disk = 1.25 if n < CANDIDATES_FIT_CACHE else 0.5
    ring = max(16, 2 ** math.ceil(math.log2(buckets_per_disk * n)))
    return ws.Calendar(block, width, 1 / width, ring - 1)


def with_fitting_buckets(
    w: ws.Workspace, events: int, elapsed: float, estimated: float
) -> ws.Workspace:
    """Return a workspace with buckets of a duration that fits so many events in the `elapsed` time
    [engine's unit].

    Close to the densest packing collisions are far more frequent than estimated: buckets become
    shorter where they have more than MOST_PER_BUCKET events. Where they have less than a quarter of
    that, as disks have spread out since, they become longer again, up to their `estimated`
    duration. The arrays stay the same, and so does every bit of a run: events happen in the order
    of their times, however they are stored.
    """
    scale = w.calendar
    # events per bucket as found and at most, both times the elapsed time
    per_bucket = events * scale.width
    most = MOST_PER_BUCKET * elapsed
    if most / 4 <= per_bucket <= most:
        return w
    shortest = max(scale.width / SHORTER_AT_ONCE, scale.block / MOST_BUCKETS)
    width = min(power_of_two(max(most / max(events, 1), shortest)), estimated)
    if width != scale.width:
        w = w._replace(calendar=scale._replace(width=width, per_time=1 / width))
        # one kernel for all scenes
        queue_alone = w._replace(
            mass=None, wraps_x=None, wraps_y=None, image=None, shift=None, big=None, lists=None
        )
        compile_all(partial(push_all, queue_alone))
    return w


def _big_disks(grid: ws.Grid, radius: np.ndarray, common: float, box: Box) -> ws.BigDisks | None:
    """Return the cell patterns of the disks larger than the common radius; None if there are none.

    None, too, in a box so short along a periodic axis that a pattern would overlap its own image.
    """
    number = int(np.count_nonzero(radius > common))
    if number == 0:
        return None
    listed = []
    reach = []
    for big_radius in radius[:number]:
        listing_cells, cells_in_reach = _pattern(grid, big_radius, common, radius.min())
        listed.append(listing_cells)
        reach.append(cells_in_reach)
    widest = max(2 * np.abs(cells).max() + 1 for cells in reach)
    cells_along = np.array((grid.columns, grid.rows))
    if np.any(widest > cells_along[box.periodic_axes]):
        return None
    return ws.BigDisks(
        number=number,
        listed_first=_beginnings(listed),
        listed=np.concatenate(listed),
        reach_first=_beginnings(reach),
        reach=np.concatenate(reach),
    )


def _beginnings(patterns: list[np.ndarray]) -> np.ndarray:
    """Return where each of the n patterns begins in all of them, one after the other, and where the
    last ends (n + 1,).

    >>> _beginnings([np.zeros((2, 2)), np.zeros((3, 2))])
    array([0, 2, 5])
    """
    return np.cumsum([0] + [len(pattern) for pattern in patterns])


def _pattern(
    grid: ws.Grid, radius: float, common: float, smallest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells that list a big disk and the cells within its reach, offsets from its own
    cell, (k, 2) each.

    Every cell in which a small disk can touch the big one, wherever this is in its own cell, must
    have one of the listing cells among its 3 x 3. Listing cells are therefore at most three cells
    apart. All cells that see a listing cell count as within reach, so that the big disk and a small
    disk always find each other at the same time.
    """
    sides = np.array((grid.cell_width, grid.cell_height))
    furthest = np.ceil((radius + common) / sides).astype(np.int64)  # cells from its own
    places = [_listing_places(cells) for cells in furthest]
    centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    block = np.stack(np.meshgrid((-1, 0, 1), (-1, 0, 1), indexing="ij"), axis=-1).reshape(1, 9, 2)
    seen_from = np.abs(centres + block)
    nearest = np.hypot(*np.moveaxis(np.maximum(seen_from - 1, 0) * sides, -1, 0))
    opposite = np.hypot(*np.moveaxis((seen_from + 1) * sides, -1, 0))
    touches = (nearest < radius + common) & (opposite >= radius + smallest)
    needed = touches.any(axis=1)
    seen = (centres + block)[needed].reshape(-1, 2)
    return centres[needed, 0], np.unique(seen, axis=0)


def _listing_places(furthest: int) -> np.ndarray:
    """Return places for listing cells along an axis, at most three cells apart, from which all up
    to `furthest` cells away are seen.

    >>> _listing_places(4)
    array([-3,  0,  3])
    """
    count = -(-(2 * furthest + 1) // 3)
    return np.round(np.linspace(1 - furthest, furthest - 1, count)).astype(np.int64)
