"""The workspace for the runs of a scene, and its initial values from a state."""

import math

import numpy as np

from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.workspace import EngineBox, PairList, Workspace
from brownpipe.engines.units import Frame, common_radius, rms_speed
from brownpipe.scene import Scene

REAL_ARRAYS = ("x", "y", "vx", "vy", "x_at_build", "y_at_build", "sorted_x", "sorted_y", "sorted_radius")
INT_ARRAYS = ("disk", "image_x", "image_y", "order", "cell", "scratch")
SKIN_FACTOR = 3.2  # measured factor of `skin_of`


def prepare(scene: Scene, frame: Frame, time_step: float, collisions: str, capacity: int = 0) -> Workspace:
    """Return a workspace for the runs of a scene; `capacity` of the lists of pairs where the default was too small."""
    n, box = scene.particles, scene.box
    radius = scene.radius[frame.order] / frame.length
    common = common_radius(radius) if n else 0.5
    x, y = ((np.array((box.x[0], box.y[0])) - frame.origin) / frame.length).tolist()
    width, height = box.width / frame.length, box.height / frame.length
    capacity = max(capacity, 16 * n + 64)
    return Workspace(
        box=EngineBox(x, y, width, height, x + width, y + height, box.periodic),
        step=time_step / frame.time,
        late=collisions == "late",
        skin=2 * common * skin_of(scene, time_step),
        common_radius=float(common),
        big=int(np.count_nonzero(radius > common)),
        tracer=int(frame.back[0]) if n else 0,
        **{name: np.zeros(n) for name in REAL_ARRAYS},
        radius=radius,
        **{name: np.zeros(n, np.int32) for name in INT_ARRAYS},
        mass=scene.mass[frame.order] / frame.mass,
        straight_since=np.zeros(n),
        cell_start=np.zeros(4 * n + 9, np.int32),
        within=_pair_list(capacity),
        across=_pair_list(capacity if box.periodic else 0),
        candidate=np.zeros(2 * capacity, np.uint32),
        contact_time=np.zeros(2 * capacity),
        contact_key=np.zeros(2 * capacity, np.int64),
        contact_pair=np.zeros(2 * capacity, np.uint32),
        counters=np.zeros(ws.COUNTERS, np.int64),
        count=np.zeros(ws.COUNTS, np.int64),
        tally=np.zeros(ws.TALLY),
    )


def _pair_list(capacity: int) -> PairList:
    """Return an empty list of pairs."""
    disks = (np.zeros(capacity, np.uint32) for _ in range(2))
    lengths = (np.zeros(capacity) for _ in range(3))
    return PairList(*disks, *lengths)


def skin_of(scene: Scene, time_step: float) -> float:
    """Return the skin of the lists, in contact distances, at which a run costs least.

    Per step, listed pairs cost in proportion to phi skin, and building lists costs in proportion to (path per
    step)/skin. The sum is least for a skin in proportion to sqrt(path per step/phi).
    """
    sigma = 2 * common_radius(scene.radius) if scene.particles else 1.0
    path = rms_speed(scene) * time_step / sigma
    most = 0.5 * min(scene.box.width, scene.box.height) / sigma
    return min(SKIN_FACTOR * math.sqrt(path / max(scene.packing_fraction, 1e-6)), most)


def begin(w: Workspace, motion: np.ndarray) -> None:
    """Set a workspace to the start of a run with positions and velocities (N, 4), as `engines.units.motion_of` returns.

    BUDGET is negative, so that the first step builds the lists.
    """
    w.x[:], w.y[:], w.vx[:], w.vy[:] = motion.T
    w.x_at_build[:], w.y_at_build[:] = w.x, w.y
    w.radius[:] = w.radius[np.argsort(w.disk, kind="stable")]
    w.disk[:] = np.arange(len(w.disk))
    w.image_x[:], w.image_y[:], w.straight_since[:] = 0, 0, 0.0
    w.counters[:], w.count[:], w.tally[:] = 0, 0, 0.0
    w.counters[ws.TRACER] = w.tracer
    w.tally[ws.BUDGET], w.tally[ws.NEAREST] = -1.0, 1.0
