"""Where memory is far: what the next events will need is asked for before they happen.

With more disks than the processor's cache holds an event waits for memory again and again, as one thing leads to the
next: a bucket to its disks, a disk to its partner and to its cell or list, and these to the candidates. So whenever a
bucket is opened, the fifth after it is asked for, the disks of the third, the partners and the cells or lists of the
second, the candidates of the next, and those of the current one's partners: what a stage reads was asked for by the
one before. Nothing is computed here, and no result depends on it.
"""

import numpy as np

from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact.workspace import (
    BUCKET,
    BUCKET_NOW,
    COLUMN,
    DISK_MASK,
    EVENT,
    LINE,
    PAIR,
    PARTNER,
    ROW,
    SOON,
)
from brownpipe.engines.kernels import kernel, prefetch


@kernel
def ask_ahead(ahead, w):
    """Ask for what the events of the current bucket and the next ones will need, where memory is far."""
    if ahead is None:
        return
    prefetch(w.bucket, calendar.LINE * bucket_after(w, 5))
    for j in entries(w, bucket_after(w, 3)):
        ask_for_disk(w.mass, w, np.int64(w.bucket[j]))
    bucket = bucket_after(w, 2)
    for j in entries(w, bucket):
        i = np.int64(w.bucket[j])
        if w.link[ROW * i + BUCKET] == bucket:
            ask_for_disk(w.mass, w, partner_of(w, i))
            ask_where(w.lists, w, i, int(w.link[ROW * i + EVENT]))
    bucket = bucket_after(w, 1)
    for j in entries(w, bucket):
        i = np.int64(w.bucket[j])
        if w.link[ROW * i + BUCKET] == bucket:
            event = int(w.link[ROW * i + EVENT])
            ask_for_candidates(w.lists, w, i, event)
            if event == PAIR:
                ask_where(w.lists, w, partner_of(w, i), PAIR)
    for i in w.current_disk[: w.progress[SOON]]:
        if w.link[ROW * i + EVENT] == PAIR:
            ask_for_candidates(w.lists, w, partner_of(w, i), PAIR)


@kernel
def bucket_after(w, number):
    """Return which bucket comes so many after the current one."""
    return (w.progress[BUCKET_NOW] + number) & w.calendar.ring


@kernel
def entries(w, bucket):
    """Return where the disks in a bucket are, those included that do not count."""
    first = calendar.LINE * bucket
    return range(first + 1, first + 1 + w.bucket[first])


@kernel
def partner_of(w, i):
    """Return the disk that disk i will collide with, or would have."""
    return w.link[ROW * i + PARTNER] & DISK_MASK


@kernel
def ask_for_disk(mass, w, i):
    """Ask for all that is known of disk i."""
    prefetch(w.link, ROW * i)
    prefetch(w.disk, ROW * i)
    if mass is not None:
        prefetch(mass, i)


@kernel
def ask_where(lists, w, i, event):
    """Ask for the list of disk i, or for the cells, that say which candidates it will have after an event."""
    if lists is not None:
        prefetch(lists.neighbour, neighbour_lists.room(lists.wide) * i)
        prefetch(lists.centre, 2 * i)
        if cells.crosses(event):
            ask_for_cells_around(w, i)
    elif cells.crosses(event):
        ask_for_cells_entered(w, i, event)
    else:
        ask_for_cells_around(w, i)


@kernel
def ask_for_cells_around(w, i):
    """Ask for the 3 x 3 cells around disk i."""
    middle, above = cell_of(w, i), w.grid.columns + 2
    for cell in (middle - above, middle, middle + above):
        for side in (-1, 0, 1):
            prefetch(w.cell, w.grid.slots * (cell + side))


@kernel
def ask_for_cells_entered(w, i, event):
    """Ask for the cell that disk i leaves, the one it enters, and those three that are new to it then."""
    slots, cell = w.grid.slots, cell_of(w, i)
    ahead, along = cells.steps(w, event)
    prefetch(w.cell, slots * cell)
    prefetch(w.cell, slots * (cell + ahead))
    for side in (-along, 0, along):
        prefetch(w.cell, slots * (cell + 2 * ahead + side))


@kernel
def ask_for_candidates(lists, w, i, event):
    """Ask for the candidates that disk i will have after an event."""
    if lists is not None:
        ask_for_list(lists, w, i, event)
    elif cells.crosses(event):
        ahead, along = cells.steps(w, event)
        ask_for_three(w, cell_of(w, i) + 2 * ahead, along)
    else:
        middle, above = cell_of(w, i), w.grid.columns + 2
        for cell in (middle - above, middle, middle + above):
            ask_for_three(w, cell, 1)


@kernel
def ask_for_list(lists, w, i, event):
    """Ask for the disks on the list of disk i, and if that is to be made anew for their lists, too."""
    first = neighbour_lists.room(lists.wide) * i
    for j in range(first + 1, first + 1 + lists.neighbour[first]):
        k = lists.neighbour[j] & DISK_MASK
        prefetch(w.disk, ROW * k)
        if cells.crosses(event):
            prefetch(lists.neighbour, neighbour_lists.room(lists.wide) * k)
            prefetch(lists.centre, 2 * k)


@kernel
def ask_for_three(w, middle, step):
    """Ask for two disks each of a cell, of the one a step before it and of the one after; few cells hold more."""
    cells = len(w.cell) // w.grid.slots
    for cell in (middle - step, middle, middle + step):
        first = w.grid.slots * min(max(cell, 0), cells - 1)
        prefetch(w.disk, ROW * (w.cell[first + 1] & DISK_MASK))
        prefetch(w.disk, ROW * (w.cell[first + 2] & DISK_MASK))


@kernel
def cell_of(w, i):
    """Return the number of the cell of disk i."""
    return cells.cell_at(w, np.int64(w.link[ROW * i + COLUMN]), np.int64(w.link[ROW * i + LINE]))
