"""The cell list: cells at least one contact distance wide, so that 3 x 3 of them hold every partner of a disk.

A cell is a short array in `w.cell`: the number of candidates in it, and the candidates. Cells are numbered row by row,
with a rim of ghost cells around the box. Between walls the ghost cells stay empty; in a periodic box they list the
images of the disks at the opposite side, so that no search ever wraps round.

A disk much bigger than a cell is listed in a sparse pattern of cells around its own, such that every small disk within
its reach finds it among its own 3 x 3 cells. Small disks need no code for this.

`enter` lists a disk and `leave` removes it; `add` and `remove` change one cell; `update_...` does either. `gather_...`
collects the disks of cells in `w.candidate`; the functions that prefetch the same cells or disks stand next to it.
"""

import math

import numpy as np

from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.disks import position
from brownpipe.engines.fours import copy_four, replace_in_four
from brownpipe.engines.kernels import kernel, prefetch

# -- which cell -----------------------------------------------------------------------------------------------------
# A "place" is the column and row of a cell.


@kernel
def cell_at(w: ws.Workspace, column: int, row: int) -> int:
    """Return the number of a cell; columns and rows count from 0, and the ghost rim is at -1 and at their number."""
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
def inside(shift: np.ndarray | None, w: ws.Workspace, column: int, row: int) -> tuple[int, int]:
    """Return the place of the nearest cell; in a periodic box the place itself, which is a cell or the image of one."""
    if shift is not None:
        return column, row
    return min(max(column, 0), w.grid.columns - 1), min(max(row, 0), w.grid.rows - 1)


@kernel
def place(w: ws.Workspace, i: int, now: float) -> tuple[int, int]:
    """Return column and row of the cell at the position of disk i; their numbering continues outside a periodic box."""
    x, y = position(w, i, now)
    column = math.floor((x - w.grid.x) / w.grid.cell_width)
    row = math.floor((y - w.grid.y) / w.grid.cell_height)
    return inside(w.shift, w, int(column), int(row))


@kernel
def boxes_away(shift: np.ndarray | None, w: ws.Workspace, column: int, row: int) -> tuple[int, int]:
    """Return how many boxes to the right and above a place is."""
    if shift is None:
        return 0, 0
    if 0 <= column < w.grid.columns and 0 <= row < w.grid.rows:
        return 0, 0  # without two divisions
    return column // w.grid.columns, row // w.grid.rows


@kernel
def is_outside(shift: np.ndarray | None, w: ws.Workspace, column: int, row: int) -> bool:
    """Whether there is no cell at a place; in a periodic box every place is a cell or an image of one."""
    if shift is not None:
        return False
    return column < 0 or column >= w.grid.columns or row < 0 or row >= w.grid.rows


@kernel
def image_of(i: int, across: int, up: int) -> int:
    """Return the candidate that is disk i seen `across` boxes to the right and `up` boxes above, each -1, 0 or 1."""
    return i + (((across + 3) % 3 + 3 * ((up + 3) % 3)) << ws.DISK_BITS)


# -- which disks are in it ------------------------------------------------------------------------------------------


@kernel
def add(w: ws.Workspace, cell: int, candidate: int) -> None:
    """Add a candidate to a cell; if the cell is full, set the OVERFLOW flag."""
    first = cell * w.grid.slots
    n = w.cell[first] + 1
    if n < w.grid.slots:
        w.cell[first + n] = candidate
        w.cell[first] = n
    else:
        w.progress[ws.OVERFLOW] = 1


@kernel
def remove(w: ws.Workspace, cell: int, candidate: int) -> None:
    """Remove a candidate from a cell; the cell's last candidate takes its place.

    The first four entries include the number of candidates, which is written last.
    """
    first = cell * w.grid.slots
    n = w.cell[first]
    last = w.cell[first + n]
    for j in range(first, first + n, 4):
        replace_in_four(w.cell, j, candidate, last)
    w.cell[first] = n - 1


@kernel
def update_cell(w: ws.Workspace, cell: int, candidate: int, adding: bool) -> None:
    """Add a candidate to a cell, or remove it."""
    if adding:
        add(w, cell, candidate)
    else:
        remove(w, cell, candidate)


@kernel
def update_images(
    shift: np.ndarray | None, w: ws.Workspace, i: int, column: int, row: int, across: int, up: int, adding: bool
) -> None:
    """Add disk i, as the image (across, up), to a cell and to the ghost cells that repeat this cell, or remove it."""
    columns, rows = w.grid.columns, w.grid.rows
    update_cell(w, cell_at(w, column, row), image_of(i, across, up), adding)
    if shift is None:
        return
    if 0 < column < columns - 1 and 0 < row < rows - 1:
        return
    for a in range(-1 if column == columns - 1 else 0, 2 if column == 0 else 1):
        for u in range(-1 if row == rows - 1 else 0, 2 if row == 0 else 1):
            if a != 0 or u != 0:
                cell = cell_at(w, column + a * columns, row + u * rows)
                update_cell(w, cell, image_of(i, across + a, up + u), adding)


@kernel
def update_pattern_cell(shift: np.ndarray | None, w: ws.Workspace, i: int, column: int, row: int, adding: bool) -> None:
    """Add big disk i to a cell of its pattern, which may lie in an image of the box, or remove it."""
    if shift is not None:
        a, u = column // w.grid.columns, row // w.grid.rows
        update_images(shift, w, i, column - a * w.grid.columns, row - u * w.grid.rows, -a, -u, adding)
    elif -1 <= column <= w.grid.columns and -1 <= row <= w.grid.rows:
        update_images(shift, w, i, column, row, 0, 0, adding)


@kernel
def update_disk(big: ws.BigDisks | None, w: ws.Workspace, i: int, column: int, row: int, adding: bool) -> None:
    """Add disk i to its cell, or if it is big to the cells of its pattern, or remove it from them."""
    if big is not None:
        if i < big.number:
            for j in range(big.listed_first[i], big.listed_first[i + 1]):
                update_pattern_cell(w.shift, w, i, column + big.listed[j, 0], row + big.listed[j, 1], adding)
            return
    update_images(w.shift, w, i, column, row, 0, 0, adding)


@kernel
def enter(big: ws.BigDisks | None, w: ws.Workspace, i: int, column: int, row: int) -> None:
    """List disk i in the cell at a place."""
    w.link[ws.ROW * i + ws.CELL_COLUMN] = column
    w.link[ws.ROW * i + ws.CELL_ROW] = row
    update_disk(big, w, i, column, row, True)


@kernel
def leave(big: ws.BigDisks | None, w: ws.Workspace, i: int) -> None:
    """Remove disk i from the cell in which it is listed."""
    column, row = place_of(w, i)
    update_disk(big, w, i, column, row, False)


# -- which cells an event needs -------------------------------------------------------------------------------------


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
    """Return the change of the cell number from the cell left to the cell entered, and along the edge between them."""
    above = w.grid.columns + 2
    sideways = event <= ws.RIGHT
    across, up = (event == ws.RIGHT) - (event == ws.LEFT), (event == ws.UP) - (event == ws.DOWN)
    return across + above * up, above if sideways else 1


@kernel
def gather_three(w: ws.Workspace, middle: int, step: int, m: int) -> int:
    """Append the disks of three cells to the m candidates; return their new number.

    Four entries are copied at once, valid or not. Few cells have more disks.
    """
    for first in three_cells(w.grid.slots * middle, w.grid.slots * step):
        n = w.cell[first]
        copy_four(w.candidate, m, w.cell, first + 1)
        for j in range(4, n, 4):
            copy_four(w.candidate, m + j, w.cell, first + 1 + j)
        m += n
    return m


@kernel
def prefetch_three_cells(w: ws.Workspace, middle: int, step: int) -> None:
    """Prefetch the three cells that `gather_three` reads."""
    for cell in three_cells(middle, step):
        prefetch(w.cell, w.grid.slots * cell)


@kernel
def prefetch_disks_of_three(w: ws.Workspace, middle: int, step: int) -> None:
    """Prefetch the first two disks of each cell that `gather_three` reads; few cells hold more."""
    cells, slots = len(w.cell) // w.grid.slots, w.grid.slots
    for first in three_cells(slots * min(max(middle, step), cells - 1 - step), slots * step):
        prefetch(w.disk, ws.ROW * (w.cell[first + 1] & ws.DISK_MASK))
        prefetch(w.disk, ws.ROW * (w.cell[first + 2] & ws.DISK_MASK))


@kernel
def gather_around(w: ws.Workspace, column: int, row: int) -> int:
    """Collect the disks of 3 x 3 cells; return their number."""
    m = 0
    for middle in rows_around(w, cell_at(w, column, row)):
        m = gather_three(w, middle, 1, m)
    return m


@kernel
def prefetch_cells_around(w: ws.Workspace, cell: int) -> None:
    """Prefetch the cells that `gather_around` reads."""
    for middle in rows_around(w, cell):
        prefetch_three_cells(w, middle, 1)


@kernel
def gather_entered(w: ws.Workspace, column: int, row: int, event: int) -> int:
    """Collect the disks of the three cells that come within reach by a crossing into a cell; return their number."""
    ahead, along = steps(w, event)
    return gather_three(w, cell_at(w, column, row) + ahead, along, 0)


@kernel
def prefetch_cells(w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the cells that an event of disk i reads: `gather_around`, or `leave`, `enter` and `gather_entered`."""
    cell = cell_of(w, i)
    if is_crossing(event):
        ahead, along = steps(w, event)
        prefetch(w.cell, w.grid.slots * cell)
        prefetch(w.cell, w.grid.slots * (cell + ahead))
        prefetch_three_cells(w, cell + 2 * ahead, along)
    else:
        prefetch_cells_around(w, cell)


@kernel
def prefetch_candidates(w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the disks that an event of disk i gathers, from the cells of `prefetch_cells`."""
    cell = cell_of(w, i)
    if is_crossing(event):
        ahead, along = steps(w, event)
        prefetch_disks_of_three(w, cell + 2 * ahead, along)
    else:
        for middle in rows_around(w, cell):
            prefetch_disks_of_three(w, middle, 1)


@kernel
def images_across(shift: np.ndarray | None) -> int:
    """Return how many boxes away, on either side, images are considered: 1 in a periodic box, else 0."""
    if shift is None:
        return 0
    return 1


@kernel
def gather_within_reach(big: ws.BigDisks, w: ws.Workspace, i: int, column: int, row: int) -> int:
    """Collect all disks, other big ones included, that big disk i can touch while it stays in its cell."""
    m = 0
    for j in range(big.reach_first[i], big.reach_first[i + 1]):
        c, r = column + big.reach[j, 0], row + big.reach[j, 1]
        if is_outside(w.shift, w, c, r):
            continue
        across, up = boxes_away(w.shift, w, c, r)
        first = cell_at(w, c - across * w.grid.columns, r - up * w.grid.rows) * w.grid.slots
        for entry in range(first + 1, first + 1 + w.cell[first]):
            k = np.int64(w.cell[entry])
            if k & ws.DISK_MASK >= big.number:
                w.candidate[m] = image_of(k, across, up)
                m += 1
    far = images_across(w.shift)
    for other in range(big.number):
        for a in range(-far, far + 1):
            for u in range(-far, far + 1):
                w.candidate[m] = image_of(other, a, u)
                m += 1
    return m


@kernel
def gather(big: ws.BigDisks | None, w: ws.Workspace, i: int) -> int:
    """Collect all disks that disk i can touch while it stays in its cell; return their number."""
    column, row = place_of(w, i)
    if big is not None:
        if i < big.number:
            return gather_within_reach(big, w, i, column, row)
    return gather_around(w, column, row)


@kernel
def gather_new(big: ws.BigDisks | None, w: ws.Workspace, i: int, event: int) -> int:
    """Collect at least the disks that became neighbours of disk i in a crossing into its cell; return their number."""
    column, row = place_of(w, i)
    if big is not None:
        if i < big.number:
            return gather_within_reach(big, w, i, column, row)
    return gather_entered(w, column, row, event)
