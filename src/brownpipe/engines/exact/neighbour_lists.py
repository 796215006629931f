"""Neighbour lists, for dense scenes: every disk has a list of the disks that it may touch.

Neighbour lists in event-driven molecular dynamics are due to A. Donev, S. Torquato, F. H.
Stillinger, J. Comput. Phys. 202, 737 (2005). Here each disk has a small square around its position
at the time when its list was made. While two disks are in their squares, they can touch only if the
squares are less than a contact distance apart; such disks are on each other's lists. A disk that
leaves its square gets a new square around its position, and a new list. The cell list then holds
the disks by the centres of their squares, and is read only to make lists.

`lists` is `w.lists`, a `NeighbourLists`.
"""

from brownpipe.engines.compiled.fours import replace_in_four
from brownpipe.engines.compiled.kernels import kernel, prefetch
from brownpipe.engines.exact import cells
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.workspace import contact_distance, position, shifted


@kernel
def reversed_image(candidate: int, i: int) -> int:
    """Return disk i as a candidate of disk k, where `candidate` is disk k as a candidate of disk
    i.
    """
    image = candidate >> ws.DISK_BITS
    across, up = image % 3, image // 3
    return i + ((((3 - across) % 3) + 3 * ((3 - up) % 3)) << ws.DISK_BITS)


@kernel
def words_of_list(wide: bool | None) -> int:
    """Return the number of words of a list. It is a constant: a number in the workspace costs 4 %
    of the speed.
    """
    if wide is None:
        return ws.LIST_WORDS
    return ws.WIDE_LIST_WORDS


@kernel
def list_entries(lists: ws.NeighbourLists, i: int) -> range:
    """Return the range of indices in `lists.neighbour` at which the neighbours of disk i are."""
    first = words_of_list(lists.wide) * i
    return range(first + 1, first + 1 + lists.neighbour[first])


@kernel
def add_neighbour(lists: ws.NeighbourLists, w: ws.Workspace, i: int, candidate: int) -> None:
    """Add a candidate to the list of disk i; if the list is full, set the OVERFLOW flag."""
    first = words_of_list(lists.wide) * i
    n = lists.neighbour[first]
    if n + 1 == words_of_list(lists.wide):
        w.progress[ws.OVERFLOW] = 1
        return
    lists.neighbour[first + 1 + n] = candidate
    lists.neighbour[first] = n + 1


@kernel
def remove_neighbour(lists: ws.NeighbourLists, i: int, candidate: int) -> None:
    """Remove a candidate from the list of disk i; the last one of the list takes its place.

    The first four entries include the number of neighbours, which is written last.
    """
    first = words_of_list(lists.wide) * i
    n = lists.neighbour[first]
    last = lists.neighbour[first + n]
    for j in range(first, first + n, 4):
        replace_in_four(lists.neighbour, j, candidate, last)
    lists.neighbour[first] = n - 1


@kernel
def can_touch(lists: ws.NeighbourLists, w: ws.Workspace, i: int, candidate: int) -> bool:
    """Whether the squares of disk i and of a candidate are less than a contact distance apart."""
    k = candidate & ws.DISK_MASK
    x, y = (
        lists.centre[2 * k] - lists.centre[2 * i],
        lists.centre[2 * k + 1] - lists.centre[2 * i + 1],
    )
    x, y = shifted(w.shift, candidate, x, y)
    x, y = max(abs(x) - 2.0 * lists.half, 0.0), max(abs(y) - 2.0 * lists.half, 0.0)
    sigma = contact_distance(w.mass, w, i, k)
    return x * x + y * y < sigma * sigma


@kernel
def clear_list(lists: ws.NeighbourLists, i: int) -> None:
    """Empty the list of disk i, and remove disk i from the lists of its neighbours."""
    for j in list_entries(lists, i):
        remove_neighbour(
            lists, lists.neighbour[j] & ws.DISK_MASK, reversed_image(lists.neighbour[j], i)
        )
    lists.neighbour[words_of_list(lists.wide) * i] = 0


@kernel
def centre(lists: ws.NeighbourLists, w: ws.Workspace, i: int, now: float) -> None:
    """Centre the square of disk i at its position at the time now."""
    lists.centre[2 * i], lists.centre[2 * i + 1] = position(w, i, now)


@kernel
def list_neighbours(lists: ws.NeighbourLists, w: ws.Workspace, i: int, least: int) -> None:
    """Find the neighbours of disk i numbered `least` or more in the cell list, and add each to the
    other's list.
    """
    n = 0
    for j in range(cells.gather(w.big, w, i, ws.PAIR)):
        candidate = w.candidate[j]
        k = candidate & ws.DISK_MASK
        w.candidate[n] = candidate
        # a branch would be mispredicted often
        n += (k >= least) & (k != i) & can_touch(lists, w, i, candidate)
    for candidate in w.candidate[:n]:
        add_neighbour(lists, w, i, candidate)
        add_neighbour(lists, w, candidate & ws.DISK_MASK, reversed_image(candidate, i))


@kernel
def make_lists(lists: ws.NeighbourLists | None, w: ws.Workspace) -> None:
    """Make the lists of all disks, if there are any."""
    if lists is not None:
        lists.neighbour[:: words_of_list(lists.wide)] = 0
        n = len(w.disk) // ws.ROW
        for i in range(n):
            centre(lists, w, i, 0.0)
        for i in range(n):
            list_neighbours(lists, w, i, i)


@kernel
def prefetch_list(lists: ws.NeighbourLists, w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the list of disk i; if the event makes a new one, also the cells that
    `list_neighbours` reads.
    """
    prefetch(lists.neighbour, words_of_list(lists.wide) * i)
    prefetch(lists.centre, 2 * i)
    if cells.is_crossing(event):
        cells.prefetch_cells(w, i, ws.PAIR)


@kernel
def prefetch_neighbours(lists: ws.NeighbourLists, w: ws.Workspace, i: int, event: int) -> None:
    """Prefetch the disks on the list of disk i; if the event makes a new one, also their lists and
    the squares around.

    Four words of the list at a time, of which the first one is the number of neighbours and the
    last may be outdated: nobody can predict when a loop over the neighbours alone ends.
    """
    first = words_of_list(lists.wide) * i
    for four in range(first, first + 1 + lists.neighbour[first], 4):
        for j in range(four, four + 4):
            prefetch(w.disk, ws.ROW * (lists.neighbour[j] & ws.DISK_MASK))
    if cells.is_crossing(event):
        for j in list_entries(lists, i):
            prefetch(
                lists.neighbour, words_of_list(lists.wide) * (lists.neighbour[j] & ws.DISK_MASK)
            )
        for middle in cells.rows_around(w, cells.cell_of(w, i)):
            for cell in cells.three_cells(w.grid.slots * middle, w.grid.slots):
                for j in range(cell + 1, cell + 1 + w.cell[cell]):
                    prefetch(lists.centre, 2 * (w.cell[j] & ws.DISK_MASK))
