"""The cell list: cells at least one contact distance wide, so that 3 x 3 of them hold every partner
of a disk.

A cell is a short array in `w.cell`: the number of candidates in it, and the candidates. Cells are
numbered row by row, with a rim of ghost cells around the box. Beyond walls the ghost cells stay
empty; beyond periodic sides they list the images of the disks at the opposite side, so that no
search ever wraps round.

A disk much bigger than a cell is listed in a sparse pattern of cells around its own, such that
every small disk within its reach finds it among its own 3 x 3 cells. Small disks need no code for
this.

`enter` lists a disk, `update_...` lists or removes one. `gather` collects the disks of cells in
`w.candidate`; the functions that prefetch the same cells or disks stand next to it.
"""

import math

import numpy as np

from brownpipe.engines.compiled.fours import copy_four, replace_in_four
from brownpipe.engines.compiled.kernels import kernel, prefetch
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.workspace import position

# -- which cell ------------------------------------------------------------------------------------
# A "place" is the column and row of a cell.


@kernel
def cell_at(w: ws.Workspace, column: int, row: int) -> int:
    """Return the number of a cell; columns and rows count from 0, and the ghost rim is at -1 and at
    their number.
    """
    return (row + 1) * (w.grid.columns + 2) + column + 1


@kernel
def place_of(w: ws.Workspace, i: int) -> tuple[np.int64, np.int64]:
    """Return column and row of the cell in which disk i is listed."""
    return np.int64(w.link[ws.ROW * i + ws.CELL_COLUMN]), np.int64(w.link[ws.ROW * i + ws.CELL_ROW])


@kernel
def cell_of(w: ws.Workspace, i: int) -> int:
    """Return the number of the cell in which disk i is listed."""
    column, row = place_of(w, i)
    return cell_at(w, column, row)


@kernel
def interval_at(wraps: ws.Periodic | None, distance: float, width: float, cells: int) -> int:
    """Return which of the `cells` intervals of a width holds a coordinate, its `distance` from the
    lower side of the box; their numbering continues beyond periodic sides.
    """
    number = math.floor(distance / width)
    if wraps is not None:
        return number
    return min(max(number, 0), cells - 1)


@kernel
def place_at_time(w: ws.Workspace, i: int, now: float) -> tuple[int, int]:
    """Return column and row of the cell at the position of disk i."""
    x, y = position(w, i, now)
    column = interval_at(w.wraps_x, x - w.grid.x, w.grid.cell_width, w.grid.columns)
    return column, interval_at(w.wraps_y, y - w.grid.y, w.grid.cell_height, w.grid.rows)


@kernel
def boxes_along(wraps: ws.Periodic | None, place: int, cells: int) -> int:
    """Return how many boxes away a column or row is, 0 between walls."""
    if wraps is None:
        return 0
    return place // cells


@kernel
def boxes_away(shift: np.ndarray | None, w: ws.Workspace, column: int, row: int) -> tuple[int, int]:
    """Return how many boxes to the right and above a place is."""
    if shift is None:
        return 0, 0
    columns, rows = w.grid.columns, w.grid.rows
    if 0 <= column < columns and 0 <= row < rows:
        return 0, 0  # without two divisions
    return boxes_along(w.wraps_x, column, columns), boxes_along(w.wraps_y, row, rows)


@kernel
def ghosts_of(wraps: ws.Periodic | None, place: int, cells: int) -> tuple[int, int]:
    """Return the first and last number of boxes by which a column or row is repeated in the rim:
    (0, 0) between walls.
    """
    if wraps is None:
        return 0, 0
    return -1 if place == cells - 1 else 0, 1 if place == 0 else 0


@kernel
def is_beyond_walls(wraps: ws.Periodic | None, place: int, cells: int, rim: int) -> bool:
    """Whether a column or row is beyond walls, and beyond `rim` ghost cells there."""
    if wraps is not None:
        return False
    return not -rim <= place < cells + rim


@kernel
def images_each_way(wraps: ws.Periodic | None) -> int:
    """Return how many boxes away images are considered in each direction."""
    return 0 if wraps is None else 1


@kernel
def image_of(i: int, across: int, up: int) -> int:
    """Return the candidate that is disk i seen `across` boxes to the right and `up` boxes above,
    each -1, 0 or 1.
    """
    return i + (((across + 3) % 3 + 3 * ((up + 3) % 3)) << ws.DISK_BITS)


# -- which disks are in it -------------------------------------------------------------------------


@kernel
def update_cell(w: ws.Workspace, cell: int, candidate: int, adding: bool) -> None:
    """Add a candidate to a cell, or remove it.

    If the cell is full, set the OVERFLOW flag. The cell's last candidate takes the place of one
    that is removed; four entries are looked at once, the first of them the number of candidates,
    which is written last.
    """
    first = cell * w.grid.slots
    if adding:
        n = w.cell[first] + 1
        if n < w.grid.slots:
            w.cell[first + n] = candidate
            w.cell[first] = n
        else:
            w.progress[ws.OVERFLOW] = 1
    else:
        n = w.cell[first]
        last = w.cell[first + n]
        for j in range(first, first + n, 4):
            replace_in_four(w.cell, j, candidate, last)
        w.cell[first] = n - 1


@kernel
def update_images(
    shift: np.ndarray | None,
    w: ws.Workspace,
    i: int,
    column: int,
    row: int,
    across: int,
    up: int,
    adding: bool,
) -> None:
    """Add disk i, as the image (across, up), to a cell and to the ghost cells that repeat this
    cell, or remove it.
    """
    columns, rows = w.grid.columns, w.grid.rows
    update_cell(w, cell_at(w, column, row), image_of(i, across, up), adding)
    if shift is None:
        return
    if 0 < column < columns - 1 and 0 < row < rows - 1:
        return  # no ghost cell repeats it
    left, right = ghosts_of(w.wraps_x, column, columns)
    bottom, top = ghosts_of(w.wraps_y, row, rows)
    for a in range(left, right + 1):
        for u in range(bottom, top + 1):
            if a != 0 or u != 0:
                cell = cell_at(w, column + a * columns, row + u * rows)
                update_cell(w, cell, image_of(i, across + a, up + u), adding)


@kernel
def update_pattern(
    shift: np.ndarray | None,
    big: ws.BigDisks,
    w: ws.Workspace,
    i: int,
    column: int,
    row: int,
    adding: bool,
) -> None:
    """Add big disk i to the cells of its pattern, which may lie in an image of the box, or remove
    it.
    """
    columns, rows = w.grid.columns, w.grid.rows
    for j in range(big.listed_first[i], big.listed_first[i + 1]):
        c, r = column + big.listed[j, 0], row + big.listed[j, 1]
        if is_beyond_walls(w.wraps_x, c, columns, 1) or is_beyond_walls(w.wraps_y, r, rows, 1):
            continue
        a, u = boxes_along(w.wraps_x, c, columns), boxes_along(w.wraps_y, r, rows)
        update_images(shift, w, i, c - a * columns, r - u * rows, -a, -u, adding)


@kernel
def update_disk(
    big: ws.BigDisks | None, w: ws.Workspace, i: int, column: int, row: int, adding: bool
) -> None:
    """Add disk i to its cell, or if it is big to the cells of its pattern, or remove it from
    them.
    """
    if big is not None:
        if i < big.number:
            update_pattern(w.shift, big, w, i, column, row, adding)
            return
    update_images(w.shift, w, i, column, row, 0, 0, adding)


@kernel
def enter(w: ws.Workspace, i: int, column: int, row: int) -> None:
    """List disk i in the cell at a place."""
    w.link[ws.ROW * i + ws.CELL_COLUMN] = column
    w.link[ws.ROW * i + ws.CELL_ROW] = row
    update_disk(w.big, w, i, column, row, True)


# -- which cells an event needs --------------------------------------------------------------------


@kernel
def three_cells(middle: int, step: int) -> tuple[int, int, int]:
    """Return a cell between the cells one step before and one step after it."""
    return middle - step, middle, middle + step


@kernel
def rows_around(w: ws.Workspace, cell: int) -> tuple[int, int, int]:
    """Return the middle cells of the three rows around a cell."""
    return three_cells(cell, w.grid.columns + 2)


@kernel
def is_crossing(event: int) -> bool:
    """Whether in an event a disk leaves its cell, or the square of its list."""
    return ws.LEFT <= event <= ws.UP


@kernel
def steps(w: ws.Workspace, event: int) -> tuple[int, int]:
    """Return the change of the cell number from the cell left to the cell entered, and along the
    edge between them.
    """
    above = w.grid.columns + 2
    sideways = event <= ws.RIGHT
    across, up = (event == ws.RIGHT) - (event == ws.LEFT), (event == ws.UP) - (event == ws.DOWN)
    return across + above * up, above if sideways else 1


@kernel
def gather_three(w: ws.Workspace, middle: int, step: int, m: int) -> int:
    """Append the disks of three cells to the m candidates; return their new number.

    Four entries of a cell are copied at once, whether valid or not: few cells have more disks.
    """
    for first in three_cells(w.grid.slots * middle, w.grid.slots * step):
        n = w.cell[first]
        copy_four(w.candidate, m, w.cell, first + 1)
        for j in range(4, n, 4):
            copy_four(w.candidate, m + j, w.cell, first + 1 + j)
        m += n
    return m


@kernel
def gather_within_reach(shift: np.ndarray | None, big: ws.BigDisks, w: ws.Workspace, i: int) -> int:
    """Collect all disks, other big ones included, that big disk i can touch while it stays in its
    cell.
    """
    m, columns, rows = 0, w.grid.columns, w.grid.rows
    column, row = place_of(w, i)
    for j in range(big.reach_first[i], big.reach_first[i + 1]):
        c, r = column + big.reach[j, 0], row + big.reach[j, 1]
        if is_beyond_walls(w.wraps_x, c, columns, 0) or is_beyond_walls(w.wraps_y, r, rows, 0):
            continue
        across, up = boxes_away(shift, w, c, r)
        first = cell_at(w, c - across * columns, r - up * rows) * w.grid.slots
        for entry in range(first + 1, first + 1 + w.cell[first]):
            k = np.int64(w.cell[entry])
            if k & ws.DISK_MASK >= big.number:
                w.candidate[m] = image_of(k, across, up)
                m += 1
    far_x, far_y = images_each_way(w.wraps_x), images_each_way(w.wraps_y)
    for other in range(big.number):
        for a in range(-far_x, far_x + 1):
            for u in range(-far_y, far_y + 1):
                w.candidate[m] = image_of(other, a, u)
                m += 1
    return m


@kernel
def gather(big: ws.BigDisks | None, w: ws.Workspace, i: int, event: int) -> int:
    """Collect the disks that disk i can touch while it stays in its cell, and return their number.

    After a crossing into its cell at least those that became neighbours: the disks of the three
    cells ahead.
    """
    if big is not None:
        if i < big.number:
            return gather_within_reach(w.shift, big, w, i)
    cell = cell_of(w, i)
    if is_crossing(event):
        ahead, along = steps(w, event)
        return gather_three(w, cell + ahead, along, 0)
    m = 0
    for middle in rows_around(w, cell):
        m = gather_three(w, middle, 1, m)
    return m


@kernel
def prefetch_cells(w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the cells that an event of disk i reads: all around it, or those that a crossing
    changes and gathers.
    """
    cell, slots = cell_of(w, i), w.grid.slots
    if is_crossing(event):
        ahead, along = steps(w, event)
        prefetch(w.cell, slots * cell)
        prefetch(w.cell, slots * (cell + ahead))
        for one in three_cells(cell + 2 * ahead, along):
            prefetch(w.cell, slots * one)
    else:
        for middle in rows_around(w, cell):
            for one in three_cells(middle, 1):
                prefetch(w.cell, slots * one)


@kernel
def prefetch_disks_of_three(w: ws.Workspace, middle: int, step: int) -> None:
    """Prefetch the first two disks of each cell that `gather_three` reads; few cells hold more."""
    cells, slots = len(w.cell) // w.grid.slots, w.grid.slots
    for first in three_cells(slots * min(max(middle, step), cells - 1 - step), slots * step):
        prefetch(w.disk, ws.ROW * (w.cell[first + 1] & ws.DISK_MASK))
        prefetch(w.disk, ws.ROW * (w.cell[first + 2] & ws.DISK_MASK))


@kernel
def prefetch_gathered(w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the disks that an event of disk i gathers, from the cells of `prefetch_cells`."""
    cell = cell_of(w, i)
    if is_crossing(event):
        ahead, along = steps(w, event)
        prefetch_disks_of_three(w, cell + 2 * ahead, along)
    else:
        for middle in rows_around(w, cell):
            prefetch_disks_of_three(w, middle, 1)
