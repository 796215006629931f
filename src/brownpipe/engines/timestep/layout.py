"""From a state to a workspace, and what is reported of a run."""

import math

import numpy as np

from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.settings import PRECISIONS
from brownpipe.engines.timestep.workspace import Pairs, Room, Workspace
from brownpipe.engines.units import Frame, common_radius, thermal_speed
from brownpipe.scene import Scene

REAL_ARRAYS = ("x", "y", "vx", "vy", "made_x", "made_y", "near_x", "near_y", "near_radius")
WHOLE_ARRAYS = ("disk", "image_x", "image_y", "order", "cell", "spare")
SKIN = 3.2  # see `skin_of`


def prepare(scene: Scene, frame: Frame, time_step: float, precision: str, collisions: str, room: int = 0) -> Workspace:
    """Lay out a workspace for the runs of a scene; `room` for pairs on a list where the usual proves too small."""
    real, n, box = PRECISIONS[precision], scene.particles, scene.box
    radius = scene.radius[frame.order] / frame.length
    common = common_radius(radius) if n else 0.5
    corner = (np.array((box.x[0], box.y[0])) - frame.origin) / frame.length
    inner = Room(float(corner[0]), float(corner[1]), box.width / frame.length, box.height / frame.length, box.periodic)
    dt = time_step / frame.time
    reals = np.zeros(ws.REALS, real)
    reals[ws.DT] = dt
    reals[[ws.LEFT, ws.BOTTOM]] = corner
    reals[[ws.RIGHT, ws.TOP]] = corner + np.array((inner.width, inner.height))
    room = max(room, 16 * n + 64)
    return Workspace(
        box=inner,
        step=dt,
        late=collisions == "late",
        skin=2 * common * skin_of(scene, time_step),
        largest=float(common),
        big=int(np.count_nonzero(radius > common)),
        tracer=int(frame.back[0]) if n else 0,
        **{name: np.zeros(n, real) for name in REAL_ARRAYS},
        radius=radius.astype(real),
        **{name: np.zeros(n, np.int32) for name in WHOLE_ARRAYS},
        mass=scene.mass[frame.order] / frame.mass,
        course=np.zeros(n),
        first=np.zeros(4 * n + 9, np.int32),
        real=reals,
        within=_pairs(room, real),
        across=_pairs(room if box.periodic else 0, real),
        hit=np.zeros(2 * room, np.uint32),
        contact_time=np.zeros(2 * room),
        contact_key=np.zeros(2 * room, np.int64),
        contact_pair=np.zeros(2 * room, np.uint32),
        clock=np.zeros(ws.CLOCK, np.int64),
        count=np.zeros(ws.COUNTS, np.int64),
        tally=np.zeros(ws.TALLY),
    )


def _pairs(room: int, real) -> Pairs:
    disks, places = (np.zeros(room, np.uint32) for _ in range(2)), (np.zeros(room, real) for _ in range(3))
    return Pairs(*disks, *places)


def skin_of(scene: Scene, time_step: float) -> float:
    """Return the skin of the lists, in contact distances, that costs least.

    A step costs pairs in proportion to phi skin, making lists steps/skin: the sum is least for a skin in proportion to
    sqrt(path per step/phi). The factor is measured.
    """
    sigma = 2 * common_radius(scene.radius) if scene.particles else 1.0
    path = thermal_speed(scene) * time_step / sigma
    most = 0.5 * min(scene.box.width, scene.box.height) / sigma
    return min(SKIN * math.sqrt(path / max(scene.packing_fraction, 1e-6)), most)


def begin(w: Workspace, motion: np.ndarray) -> None:
    """Set a workspace to the beginning of a run from positions and velocities (N, 4), as of `exact.setup.motion_of`."""
    w.x[:], w.y[:], w.vx[:], w.vy[:] = motion.T
    w.made_x[:], w.made_y[:] = w.x, w.y
    in_order = np.argsort(w.disk, kind="stable")
    w.radius[:] = w.radius[in_order]
    w.disk[:] = np.arange(len(w.disk))
    w.image_x[:], w.image_y[:], w.course[:] = 0, 0, 0.0
    w.clock[:], w.count[:], w.tally[:] = 0, 0, 0.0
    w.clock[ws.TRACER] = w.tracer
    w.tally[ws.BUDGET], w.tally[ws.NEAREST] = -1.0, 1.0
