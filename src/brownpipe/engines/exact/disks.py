"""What a disk is and where: its properties, and pairs of disks as seen from each other.

Arguments that a scene may do without (`mass`, `shift`) come first and are None then: Numba leaves out the branch.
"""

from brownpipe.engines.collisions import shares
from brownpipe.engines.exact.workspace import DISK_BITS, DISK_MASK, RADIUS, ROW, TIME, VX, VY, X, Y
from brownpipe.engines.kernels import kernel


@kernel
def contact_distance(mass, w, i, k):
    """Return sigma of a pair; without masses all disks are equal."""
    if mass is None:
        return w.grid.sigma
    return w.disk[ROW * i + RADIUS] + w.disk[ROW * k + RADIUS]


@kernel
def radius_of(mass, w, i):
    """Return the radius of a disk."""
    if mass is None:
        return 0.5 * w.grid.sigma
    return w.disk[ROW * i + RADIUS]


@kernel
def mass_of(mass, i):
    """Return the mass of a disk."""
    if mass is None:
        return 1.0
    return mass[i]


@kernel
def push_apart(mass, w, i, k, fx, fy):
    """Change the velocities of disks i and k, eqs. (5)-(6); return the mass that makes an impulse of f."""
    disk, a, b = w.disk, ROW * i, ROW * k
    if mass is None:
        disk[a + VX] += fx
        disk[a + VY] += fy
        disk[b + VX] -= fx
        disk[b + VY] -= fy
        return 1.0
    whole_a, part_a, whole_b, part_b, impulse = shares(mass[i], mass[k])
    disk[a + VX] = disk[a + VX] + whole_a * fx + part_a * fx
    disk[a + VY] = disk[a + VY] + whole_a * fy + part_a * fy
    disk[b + VX] = disk[b + VX] - whole_b * fx - part_b * fx
    disk[b + VY] = disk[b + VY] - whole_b * fy - part_b * fy
    return impulse


@kernel
def shifted(shift, candidate, x, y):
    """Move a disk's position to its image's."""
    if shift is None:
        return x, y
    image = candidate >> DISK_BITS
    return x + shift[image, 0], y + shift[image, 1]


@kernel
def displacement(w, i, candidate, now):
    """Return position and velocity of a candidate (a disk or an image of it) as seen from disk i."""
    disk, a, b = w.disk, ROW * i, ROW * (candidate & DISK_MASK)
    since_a, since_b = now - disk[a + TIME], now - disk[b + TIME]
    x = (disk[b + X] + disk[b + VX] * since_b) - (disk[a + X] + disk[a + VX] * since_a)
    y = (disk[b + Y] + disk[b + VY] * since_b) - (disk[a + Y] + disk[a + VY] * since_a)
    x, y = shifted(w.shift, candidate, x, y)
    return x, y, disk[b + VX] - disk[a + VX], disk[b + VY] - disk[a + VY]


@kernel
def move(w, i, now):
    """Bring disk i to the time now."""
    a = ROW * i
    since = now - w.disk[a + TIME]
    w.disk[a + X] += w.disk[a + VX] * since
    w.disk[a + Y] += w.disk[a + VY] * since
    w.disk[a + TIME] = now
