"""Prefetch the memory that upcoming events need, where the disks no longer fit into the processor's cache.

Without this an event would wait for memory several times, as each access depends on the one before: a bucket contains
its disks, a disk refers to its partner and its cell or list, and these contain the candidates for the next collision.
Whenever a bucket is opened, each of these accesses is therefore prefetched for a later bucket:

    bucket + 5    the bucket
    bucket + 3    its disks
    bucket + 2    their partners, and their cells or lists
    bucket + 1    the candidates in these; the cells or lists of the partners
    current       the candidates of the partners

Each stage reads only what an earlier one prefetched. With fewer than `layout.CANDIDATES_FIT_CACHE` disks the last two
are left out: they are many instructions, and candidates do not wait for each other.

Nothing is computed here, and no result depends on it. Cells and lists are prefetched by functions next to the code that
reads them (`cells`, `neighbour_lists`).
"""

import numpy as np

from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.kernels import kernel, prefetch


@kernel
def prefetch_upcoming(deferred: ws.Deferred | None, w: ws.Workspace) -> None:
    """Prefetch for the current bucket and those after it; with few disks (`deferred` is None) do nothing."""
    if deferred is None:
        return
    prefetch(w.bucket, calendar.BUCKET_WORDS * calendar.bucket_after(w, 5))
    for j in calendar.entries(w, calendar.bucket_after(w, 3)):
        prefetch_disk(w.mass, w, np.int64(w.bucket[j]))
    bucket = calendar.bucket_after(w, 2)
    for j in calendar.entries(w, bucket):
        i = np.int64(w.bucket[j])
        if calendar.is_valid(w, i, bucket):
            prefetch_disk(w.mass, w, partner_of(w, i))
            prefetch_cells_or_list(w.lists, w, i, event_of(w, i))
    if not deferred.with_candidates:
        return
    bucket = calendar.bucket_after(w, 1)
    for j in calendar.entries(w, bucket):
        i = np.int64(w.bucket[j])
        if calendar.is_valid(w, i, bucket):
            event = event_of(w, i)
            prefetch_candidates(w.lists, w, i, event)
            if event == ws.PAIR:
                prefetch_cells_or_list(w.lists, w, partner_of(w, i), ws.PAIR)
    for i in w.current_disk[: w.progress[ws.CURRENT_EVENTS]]:
        if event_of(w, i) == ws.PAIR:
            prefetch_candidates(w.lists, w, partner_of(w, i), ws.PAIR)


@kernel
def event_of(w: ws.Workspace, i: int) -> int:
    """Return the kind of the next event of disk i."""
    return int(w.link[ws.ROW * i + ws.EVENT])


@kernel
def partner_of(w: ws.Workspace, i: int) -> int:
    """Return the disk with which disk i is predicted to collide next, whether or not another event comes first."""
    return w.link[ws.ROW * i + ws.PARTNER] & ws.DISK_MASK


@kernel
def prefetch_disk(mass: np.ndarray | None, w: ws.Workspace, i: int) -> None:
    """Prefetch the rows of disk i."""
    prefetch(w.link, ws.ROW * i)
    prefetch(w.disk, ws.ROW * i)
    if mass is not None:
        prefetch(mass, i)


@kernel
def prefetch_cells_or_list(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the list of disk i, or the cells, in which its candidates after an event are."""
    if lists is not None:
        neighbour_lists.prefetch_list(lists, w, i, event)
    else:
        cells.prefetch_cells(w, i, event)


@kernel
def prefetch_candidates(lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the candidates of disk i after an event."""
    if lists is not None:
        neighbour_lists.prefetch_neighbours(lists, w, i, event)
    else:
        cells.prefetch_candidates(w, i, event)
