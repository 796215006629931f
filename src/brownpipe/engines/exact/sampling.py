"""Samples of a run: positions, velocities and images of its disks. Taking a sample changes no disk and no event."""

import math

import numpy as np

from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.audit import audit
from brownpipe.engines.exact.disks import position
from brownpipe.engines.kernels import kernel


@kernel
def boxes_beyond(image: np.ndarray | None, w: ws.Workspace, x: float, y: float) -> tuple[int, int]:
    """Return how many boxes to the right and above a position is.

    It can be outside a periodic box, as with neighbour lists a disk is wrapped only when it leaves its square.
    """
    if image is None:
        return 0, 0
    return math.floor((x - w.grid.x) / w.grid.width), math.floor((y - w.grid.y) / w.grid.height)


@kernel
def write_image(
    image: np.ndarray | None, i: int, images: np.ndarray, sample: int, column: int, across: int, up: int
) -> None:
    """Write the image of disk i, how often it has left a periodic box, to (sample, column) of a record."""
    if image is not None:
        images[sample, column, 0] = image[2 * i] + across
        images[sample, column, 1] = image[2 * i + 1] + up


@kernel
def write_motion(
    w: ws.Workspace,
    i: int,
    now: float,
    positions: np.ndarray,
    velocities: np.ndarray,
    images: np.ndarray,
    sample: int,
    column: int,
) -> None:
    """Write position, velocity and image of disk i at the time now to (sample, column) of a record."""
    x, y = position(w, i, now)
    across, up = boxes_beyond(w.image, w, x, y)
    positions[sample, column, 0] = x - across * w.grid.width
    positions[sample, column, 1] = y - up * w.grid.height
    velocities[sample, column, 0] = w.disk[ws.ROW * i + ws.VX]
    velocities[sample, column, 1] = w.disk[ws.ROW * i + ws.VY]
    write_image(w.image, i, images, sample, column, across, up)


@kernel
def take_sample(w: ws.Workspace, r: ws.Recorder, now: float) -> None:
    """Record the next sample, and audit the disks recorded; at the last one of the recorder audit all disks."""
    sample = w.progress[ws.SAMPLE]
    w.progress[ws.SAMPLE] = sample + 1
    if len(w.disk) == 0:
        return
    write_motion(w, r.tracer, now, r.position, r.velocity, r.image, sample, 0)
    whole = r.whole_position.shape[1] > 0
    is_last = sample == len(r.block) - 1
    first, end = (0, len(w.disk) // ws.ROW) if whole or is_last else (r.tracer, r.tracer + 1)
    for i in range(first, end):
        audit(w, i, now)
        if whole:
            write_motion(w, i, now, r.whole_position, r.whole_velocity, r.whole_image, sample, i)
