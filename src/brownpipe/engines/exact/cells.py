"""Where the neighbours are: cells at least one contact distance wide, so that 3 x 3 of them hold every partner.

A cell is a short list in place: how many disks, and which. Around the box lies a rim of ghost cells. Between walls
they stay empty; in a periodic box they hold the images of the disks at the opposite side, so that no search ever
wraps round.

A disk much bigger than the cells is listed not only in its own cell but in a sparse pattern of cells around it, such
that a small disk anywhere within its reach finds it among its own 3 x 3 cells. Small disks need to know nothing of it.
"""

import math

import numpy as np

from brownpipe.engines.exact.workspace import (
    COLUMN,
    DISK_BITS,
    DISK_MASK,
    DOWN,
    LEFT,
    LINE,
    OVERFULL,
    RIGHT,
    ROW,
    TIME,
    UP,
    VX,
    VY,
    X,
    Y,
)
from brownpipe.engines.kernels import kernel


@kernel
def cell_at(w, column, line):
    """Return the number of a cell; column and line count from 0, the ghost rim has -1 and the number of them."""
    return (line + 1) * (w.grid.columns + 2) + column + 1


@kernel
def inside(shift, w, column, line):
    """Return the nearest cell between walls; in a periodic box a place outside is one of an image."""
    if shift is not None:
        return column, line
    return min(max(column, 0), w.grid.columns - 1), min(max(line, 0), w.grid.rows - 1)


@kernel
def place(w, i, now):
    """Return column and line of the place where disk i is; outside a periodic box they are beyond the last."""
    a, box = ROW * i, w.grid
    since = now - w.disk[a + TIME]
    column = math.floor((w.disk[a + X] + w.disk[a + VX] * since - box.x) / box.cell_width)
    line = math.floor((w.disk[a + Y] + w.disk[a + VY] * since - box.y) / box.cell_height)
    return inside(w.shift, w, int(column), int(line))


@kernel
def add(w, cell, candidate):
    """List a candidate in a cell; if the cell is full, say so in the clock."""
    first = cell * w.grid.slots
    n = w.cell[first] + 1
    if n < w.grid.slots:
        w.cell[first + n] = candidate
        w.cell[first] = n
    else:
        w.progress[OVERFULL] = 1


@kernel
def remove(w, cell, candidate):
    """Take a candidate off the list of a cell, the last one taking its place."""
    first = cell * w.grid.slots
    n = w.cell[first]
    last = w.cell[first + n]
    for j in range(first + 1, first + n):
        if w.cell[j] == candidate:
            w.cell[j] = last
    w.cell[first] = n - 1


@kernel
def change(w, cell, candidate, entering):
    """Add a candidate to a cell or remove it."""
    if entering:
        add(w, cell, candidate)
    else:
        remove(w, cell, candidate)


@kernel
def image_of(i, across, up):
    """Return the candidate that is disk i seen `across` boxes to the right and `up` boxes above, each -1, 0 or 1."""
    return i + (((across + 3) % 3 + 3 * ((up + 3) % 3)) << DISK_BITS)


@kernel
def enlist(shift, w, i, column, line, across, up, entering):
    """Add disk i, seen as an image, to a cell and to the ghosts of that cell, or remove it."""
    columns, lines = w.grid.columns, w.grid.rows
    change(w, cell_at(w, column, line), image_of(i, across, up), entering)
    if shift is None:
        return
    if 0 < column < columns - 1 and 0 < line < lines - 1:
        return
    for a in range(-1 if column == columns - 1 else 0, 2 if column == 0 else 1):
        for u in range(-1 if line == lines - 1 else 0, 2 if line == 0 else 1):
            if a != 0 or u != 0:
                cell = cell_at(w, column + a * columns, line + u * lines)
                change(w, cell, image_of(i, across + a, up + u), entering)


@kernel
def enlist_big(shift, w, i, column, line, entering):
    """Add big disk i to a cell of its pattern, wherever that is, or remove it."""
    if shift is not None:
        a, u = column // w.grid.columns, line // w.grid.rows
        enlist(shift, w, i, column - a * w.grid.columns, line - u * w.grid.rows, -a, -u, entering)
    elif -1 <= column <= w.grid.columns and -1 <= line <= w.grid.rows:
        enlist(shift, w, i, column, line, 0, 0, entering)


@kernel
def enlist_all(big, w, i, column, line, entering):
    """Add disk i to its cell, or if it is big to the cells of its pattern, or remove it."""
    if big is not None:
        if i < big.number:
            for j in range(big.listed_first[i], big.listed_first[i + 1]):
                enlist_big(w.shift, w, i, column + big.listed[j, 0], line + big.listed[j, 1], entering)
            return
    enlist(w.shift, w, i, column, line, 0, 0, entering)


@kernel
def enter(big, w, i, column, line):
    """Let disk i be in a cell."""
    w.link[ROW * i + COLUMN] = column
    w.link[ROW * i + LINE] = line
    enlist_all(big, w, i, column, line, True)


@kernel
def leave(big, w, i, column, line):
    """Let disk i no longer be in a cell."""
    enlist_all(big, w, i, column, line, False)


@kernel
def gather_three(w, middle, step, m):
    """Append the disks of a cell, of the one a step before it and the one after to the m candidates; return the sum.

    Three disks a cell are copied whether they count or not: most cells have fewer, and no branch has to guess.
    """
    for cell in range(middle - step, middle + 2 * step, step):
        first = cell * w.grid.slots
        n = w.cell[first]
        for j in range(3):
            w.candidate[m + j] = w.cell[first + 1 + j]
        for j in range(3, n):
            w.candidate[m + j] = w.cell[first + 1 + j]
        m += n
    return m


@kernel
def gather_around(w, column, line):
    """Make the disks of the 3 x 3 cells around a cell the candidates; return how many there are."""
    above, middle, m = w.grid.columns + 2, cell_at(w, column, line), 0
    for across in range(middle - above, middle + 2 * above, above):
        m = gather_three(w, across, 1, m)
    return m


@kernel
def crosses(event):
    """Whether a disk leaves its cell, or the square of its list."""
    return LEFT <= event <= UP


@kernel
def steps(w, event):
    """Return what the number of a cell changes by from one to the one entered, and along the edge between them."""
    above = w.grid.columns + 2
    sideways = event <= RIGHT
    return (event == RIGHT) - (event == LEFT) + above * ((event == UP) - (event == DOWN)), above if sideways else 1


@kernel
def gather_entered(w, column, line, event):
    """Make the disks of the three cells that are new after a crossing the candidates."""
    ahead, along = steps(w, event)
    return gather_three(w, cell_at(w, column, line) + ahead, along, 0)


@kernel
def is_outside(shift, w, column, line):
    """Whether there is no cell at a place, nor, in a periodic box, an image of one."""
    if shift is not None:
        return False
    return column < 0 or column >= w.grid.columns or line < 0 or line >= w.grid.rows


@kernel
def boxes_away(shift, w, column, line):
    """How many boxes to the right and above a place is."""
    if shift is None:
        return 0, 0
    return column // w.grid.columns, line // w.grid.rows


@kernel
def images_across(shift):
    """How far images reach to either side."""
    if shift is None:
        return 0
    return 1


@kernel
def gather_within_reach(big, w, i, column, line):
    """Make all disks that big disk i can touch while it stays in its cell, other big ones included, the candidates."""
    m = 0
    for j in range(big.reach_first[i], big.reach_first[i + 1]):
        c, r = column + big.reach[j, 0], line + big.reach[j, 1]
        if is_outside(w.shift, w, c, r):
            continue
        across, up = boxes_away(w.shift, w, c, r)
        first = cell_at(w, c - across * w.grid.columns, r - up * w.grid.rows) * w.grid.slots
        for entry in range(first + 1, first + 1 + w.cell[first]):
            k = np.int64(w.cell[entry])
            if k & DISK_MASK >= big.number:
                w.candidate[m] = image_of(k, across, up)
                m += 1
    far = images_across(w.shift)
    for k in range(big.number):
        for a in range(-far, far + 1):
            for u in range(-far, far + 1):
                w.candidate[m] = image_of(k, a, u)
                m += 1
    return m


@kernel
def gather(big, w, i, column, line):
    """Make all disks that disk i, in a cell, can touch while it stays there the candidates; return their number."""
    if big is not None:
        if i < big.number:
            return gather_within_reach(big, w, i, column, line)
    return gather_around(w, column, line)


@kernel
def gather_new(big, w, i, column, line, event):
    """Make at least the disks that are new neighbours after disk i crossed into a cell the candidates."""
    if big is not None:
        if i < big.number:
            return gather_within_reach(big, w, i, column, line)
    return gather_entered(w, column, line, event)
