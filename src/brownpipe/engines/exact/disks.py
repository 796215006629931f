"""Properties and motion of a disk, and a pair of disks as seen from one of them.

A disk's position is that at its own time TIME, from which it moves straight. `mass` and `shift` may be None.
"""

import numpy as np

from brownpipe.engines.collisions import shares
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.fours import all_bits, four, four_columns
from brownpipe.engines.kernels import kernel


@kernel
def contact_distance(mass: np.ndarray | None, w: ws.Workspace, i: int, k: int) -> float:
    """Return sigma of disks i and k; without masses all disks are equal."""
    if mass is None:
        return w.grid.sigma
    return w.disk[ws.ROW * i + ws.RADIUS] + w.disk[ws.ROW * k + ws.RADIUS]


@kernel
def radius_of(mass: np.ndarray | None, w: ws.Workspace, i: int) -> float:
    """Return the radius of disk i."""
    if mass is None:
        return 0.5 * w.grid.sigma
    return w.disk[ws.ROW * i + ws.RADIUS]


@kernel
def mass_of(mass: np.ndarray | None, i: int) -> float:
    """Return the mass of disk i."""
    if mass is None:
        return 1.0
    return mass[i]


@kernel
def apply_impulse(mass: np.ndarray | None, w: ws.Workspace, i: int, k: int, fx: float, fy: float) -> float:
    """Apply eqs. (5)-(6) to the velocities of disks i and k; return m, where m f is the impulse given to disk i."""
    disk, a, b = w.disk, ws.ROW * i, ws.ROW * k
    if mass is None:
        disk[a + ws.VX] += fx
        disk[a + ws.VY] += fy
        disk[b + ws.VX] -= fx
        disk[b + ws.VY] -= fy
        return 1.0
    whole_a, part_a, whole_b, part_b, impulse_mass = shares(mass[i], mass[k])
    disk[a + ws.VX] = disk[a + ws.VX] + whole_a * fx + part_a * fx
    disk[a + ws.VY] = disk[a + ws.VY] + whole_a * fy + part_a * fy
    disk[b + ws.VX] = disk[b + ws.VX] - whole_b * fx - part_b * fx
    disk[b + ws.VY] = disk[b + ws.VY] - whole_b * fy - part_b * fy
    return impulse_mass


@kernel
def shifted(shift: np.ndarray | None, candidate: int, x: float, y: float) -> tuple[float, float]:
    """Return the position of the candidate whose disk is at (x, y): periodic images are displaced by a box."""
    if shift is None:
        return x, y
    a = ws.SHIFT_ROW * (candidate >> ws.DISK_BITS)
    return x + shift[a], y + shift[a + 1]


@kernel
def position(w: ws.Workspace, i: int, now: float) -> tuple[float, float]:
    """Return the position of disk i at the time now."""
    a = ws.ROW * i
    dt = now - w.disk[a + ws.TIME]
    return w.disk[a + ws.X] + w.disk[a + ws.VX] * dt, w.disk[a + ws.Y] + w.disk[a + ws.VY] * dt


@kernel
def relative_motion(w: ws.Workspace, i: int, candidate: int, now: float) -> tuple[float, float, float, float]:
    """Return position and velocity of a candidate relative to disk i, (x, y, u, v) of `collisions.encounter`."""
    k = candidate & ws.DISK_MASK
    x_i, y_i = position(w, i, now)
    x_k, y_k = position(w, k, now)
    x, y = shifted(w.shift, candidate, x_k - x_i, y_k - y_i)
    disk, a, b = w.disk, ws.ROW * i, ws.ROW * k
    return x, y, disk[b + ws.VX] - disk[a + ws.VX], disk[b + ws.VY] - disk[a + ws.VY]


@kernel
def move(w: ws.Workspace, i: int, now: float) -> None:
    """Advance disk i to the time now."""
    a = ws.ROW * i
    w.disk[a + ws.X], w.disk[a + ws.Y] = position(w, i, now)
    w.disk[a + ws.TIME] = now


# -- four disks at a time, see `engines.fours` ------------------------------------------------------------------------


@kernel
def four_disks(w: ws.Workspace, k: np.ndarray, now: float) -> tuple[np.ndarray, ...]:
    """Return position at the time now, velocity, time of the next pair collision and radius of four disks."""
    x, y, vx, vy = four_columns(w.disk, ws.ROW * k)
    time, pair_time, _, radius = four_columns(w.disk, ws.ROW * k + ws.TIME)
    dt = now - time
    return x + vx * dt, y + vy * dt, vx, vy, pair_time, radius


@kernel
def four_contact_distances(mass: np.ndarray | None, w: ws.Workspace, i: int, radius: np.ndarray) -> np.ndarray:
    """Return sigma of disk i and four others, as of `contact_distance`."""
    if mass is None:
        return four(w.grid.sigma)
    return w.disk[ws.ROW * i + ws.RADIUS] + radius


@kernel
def four_shifted(
    shift: np.ndarray | None, candidate: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of four candidates, as of `shifted`; seldom is one of them an image."""
    if shift is None:
        return x, y
    if all_bits(candidate) <= ws.DISK_MASK:
        return x, y
    across, up, _, _ = four_columns(shift, (candidate >> ws.DISK_BITS) * ws.SHIFT_ROW)
    return x + across, y + up
