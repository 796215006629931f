"""Prefetch the memory that upcoming events need, where the disks no longer fit into the processor's
cache.

Without this an event would wait for memory several times, as each access depends on the one before:
a bucket contains its disks, a disk refers to its partner and its cell or list, and these contain
the candidates for the next collision. Each of these accesses is therefore prefetched while an
earlier bucket is the current one:

    bucket + 6    the bucket
    bucket + 4    the rows of `link` of its disks, which tell the outdated ones
    bucket + 3    the other disks, and their partners
    bucket + 2    the cells or lists of both
    bucket + 1    the candidates in these

Each stage reads only what an earlier one prefetched. Processors (AMD's Zen 4, for one) drop
prefetches while they wait for some twenty cache lines. So the first two stages are for a whole
bucket, but the others for one entry with each
event: when e events of the current bucket are left, entry e of the later buckets is prefetched.

With cells and fewer than `layout.CANDIDATES_FIT_CACHE` disks the last stage is left out: it is many
instructions, and candidates do not wait for each other. Nothing is computed here, and no result
depends on it. Cells and lists are prefetched by functions next to the code that reads them
(`cells`, `neighbour_lists`).
"""

import numpy as np

from brownpipe.engines.compiled.kernels import kernel, prefetch
from brownpipe.engines.exact import calendar, cells, neighbour_lists
from brownpipe.engines.exact import workspace as ws


@kernel
def prefetch_upcoming(deferred: ws.Deferred | None, w: ws.Workspace) -> None:
    """Prefetch when a bucket has been opened; with few disks (`deferred` is None) do nothing.

    Entries of later buckets for which the current one has no event are prefetched now.
    """
    if deferred is None:
        return
    prefetch(w.bucket, calendar.BUCKET_WORDS * calendar.bucket_after(w, 6))
    for j in calendar.bucket_entries(w, calendar.bucket_after(w, 4)):
        prefetch(w.link, ws.ROW * np.int64(w.bucket[j]))
    calendar.keep_valid(w, calendar.bucket_after(w, 3))
    most = max(
        calendar.entries_after(w, 1), calendar.entries_after(w, 2), calendar.entries_after(w, 3)
    )
    for e in range(w.progress[ws.CURRENT_EVENTS], most):
        prefetch_entry(w.deferred, w, e)


@kernel
def prefetch_entry(deferred: ws.Deferred | None, w: ws.Workspace, e: int) -> None:
    """Prefetch for entry e of the next three buckets, if they have as many; with few disks do
    nothing.
    """
    if deferred is None:
        return
    if deferred.with_candidates and e < calendar.entries_after(w, 1):
        i = calendar.entry_after(w, 1, e)
        prefetch_candidates(w.lists, w, i, event_of(w, i))
        if event_of(w, i) == ws.PAIR:
            prefetch_candidates(w.lists, w, partner_of(w, i), ws.PAIR)
    if e < calendar.entries_after(w, 2):
        i = calendar.entry_after(w, 2, e)
        prefetch_cells_or_list(w.lists, w, i, event_of(w, i))
        if event_of(w, i) == ws.PAIR:
            prefetch_cells_or_list(w.lists, w, partner_of(w, i), ws.PAIR)
    if e < calendar.entries_after(w, 3):
        i = calendar.entry_after(w, 3, e)
        prefetch_disk(w.mass, w, i)
        prefetch_disk(w.mass, w, partner_of(w, i))


@kernel
def event_of(w: ws.Workspace, i: int) -> int:
    """Return the kind of the next event of disk i."""
    return int(w.link[ws.ROW * i + ws.EVENT])


@kernel
def partner_of(w: ws.Workspace, i: int) -> int:
    """Return the disk with which disk i is predicted to collide next, whether or not another event
    comes first.
    """
    return w.link[ws.ROW * i + ws.PARTNER] & ws.DISK_MASK


@kernel
def prefetch_disk(mass: np.ndarray | None, w: ws.Workspace, i: int) -> None:
    """Prefetch the rows of disk i."""
    prefetch(w.link, ws.ROW * i)
    prefetch(w.disk, ws.ROW * i)
    if mass is not None:
        prefetch(mass, i)


@kernel
def prefetch_cells_or_list(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int
) -> None:
    """Prefetch the list of disk i, or the cells, in which its candidates after an event are."""
    if lists is not None:
        neighbour_lists.prefetch_list(lists, w, i, event)
    else:
        cells.prefetch_cells(w, i, event)


@kernel
def prefetch_candidates(
    lists: ws.NeighbourLists | None, w: ws.Workspace, i: int, event: int
) -> None:
    """Prefetch the candidates of disk i after an event."""
    if lists is not None:
        neighbour_lists.prefetch_neighbours(lists, w, i, event)
    else:
        cells.prefetch_gathered(w, i, event)
