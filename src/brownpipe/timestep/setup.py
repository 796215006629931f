"""From a state to a workspace, and what is reported of a run."""

import math

import numpy as np

from brownpipe.exact.recording import all_finite, energies, images_fit, represented
from brownpipe.exact.setup import Frame, thermal_speed
from brownpipe.placement import common_radius
from brownpipe.scene import Scene, SceneError
from brownpipe.state import HEALTH_BOUND
from brownpipe.timestep import workspace as ws
from brownpipe.timestep.workspace import Pairs, Recorder, Room, Workspace

PRECISIONS = {"double": np.float64, "single": np.float32}
COLLISIONS = ("at_contact", "late")
ENERGY_BOUND = {np.float64: HEALTH_BOUND, np.float32: 1e-4}  # energy drift beyond which a run has failed
MOST_STEPS = 1e10
FINEST = 64  # in units of round-off of the largest coordinate: disks that move less in a step stand still, or nearly so
REAL_ARRAYS = ("x", "y", "vx", "vy", "made_x", "made_y", "near_x", "near_y", "near_radius")
WHOLE_ARRAYS = ("disk", "image_x", "image_y", "order", "cell", "spare")
SKIN = 3.2  # see `skin_of`
REACHES = 4.0  # steps of the fastest disk: one that is further beyond a wall has escaped


def refuse_bad_step(scene: Scene, time_step: float, precision: str, collisions: str) -> None:
    """Raise SceneError, one line, for settings that a scene cannot be run with."""
    if collisions not in COLLISIONS:
        raise SceneError(f"collisions: must be one of {', '.join(COLLISIONS)}, found {collisions!r}")
    if precision not in PRECISIONS:
        raise SceneError(f"precision: must be one of {', '.join(PRECISIONS)}, found {precision!r}")
    most, least = largest_step(scene), smallest_step(scene, precision)
    if not (isinstance(time_step, int | float) and math.isfinite(time_step) and time_step > 0):
        raise SceneError(
            f"{scene.name}: time_step: must be a finite number above 0 and at most {most:.4g}, found {time_step!r}"
        )
    if time_step > most:
        raise SceneError(
            f"{scene.name}: time_step: must be at most {most:.4g}, in which a disk at thermal speed covers its radius, "
            f"found {time_step!r}"
        )
    if time_step < least:
        raise SceneError(
            f"{scene.name}: time_step: must be at least {least:.4g} in {precision} precision, for at most "
            f"{MOST_STEPS:g} steps in which disks move by more than round-off, found {time_step!r}"
        )


def largest_step(scene: Scene) -> float:
    """Return the shortest time in which a disk at its thermal speed, sqrt(2 kT/m), covers its own radius."""
    speed = thermal_speed(scene)
    if speed == 0.0 or scene.particles == 0:
        return math.inf
    return float(np.min(scene.radius * np.sqrt(scene.mass / scene.mass.min()))) / speed


def smallest_step(scene: Scene, precision: str) -> float:
    """Return the time step below which there are too many steps, or disks at thermal speed hardly move in one."""
    speed, size = thermal_speed(scene), max(scene.box.width, scene.box.height)
    moving = FINEST * float(np.finfo(PRECISIONS[precision]).eps) * size / speed if speed > 0 else 0.0
    return max(scene.duration / MOST_STEPS, moving)


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


def recorder(scene: Scene, frame: Frame, time_step: float, times: np.ndarray, record) -> Recorder:
    """Return room for samples: each a free flight after the last step before it, so that no step depends on it."""
    n, t = scene.particles, len(times)
    m = n if "all" in record else 0
    steps = times / time_step
    last = np.rint(steps)
    last = np.where(np.abs(steps - last) <= 1e-9 + 1e-12 * steps, last, np.floor(steps))
    return Recorder(
        tracer=int(frame.back[0]) if n else 0,
        step=last.astype(np.int64),
        rest=(times - last * time_step) / frame.time,
        position=np.empty((t, 1, 2)),
        velocity=np.empty((t, 1, 2)),
        image=np.zeros((t, 1, 2), np.int32),
        whole_position=np.empty((t, m, 2)),
        whole_velocity=np.empty((t, m, 2)),
        whole_image=np.zeros((t, m, 2), np.int32),
    )


@np.errstate(over="ignore", invalid="ignore")  # what is no number fails the run
def observables(scene: Scene, frame: Frame, w: Workspace, first: np.ndarray) -> dict[str, float | int]:
    """Return what is reported of a run that began with velocities `first` (N, 2), in the engine's units and order."""
    last = np.empty((len(w.disk), 2))
    last[w.disk, 0], last[w.disk, 1] = w.vx, w.vy
    before, after = (float(np.sum(w.mass * np.sum(v * v, axis=1))) for v in (first, last))
    drift = (after - before) / before if before > 0 else 0.0
    sound = abs(drift) <= ENERGY_BOUND[w.x.dtype.type] and _inside(w)
    residual = _momentum_residual(w, first, last)
    sound &= all_finite(before, last, residual, w.tally[ws.VIRIAL :])
    fastest = math.sqrt(before / w.mass.min()) if before > 0 else 0.0  # if one disk had all the energy
    sound &= images_fit(scene, frame, int(w.clock[ws.STEP]), fastest * w.clock[ws.STEP] * w.step)
    found = {
        "pair_collisions": int(w.count[ws.PAIRS]),
        "wall_collisions": int(w.count[ws.WALLS]),
        "tracer_collisions": int(w.count[ws.TRACER_PAIRS]),
        "energy_drift": drift,
        "worst_overlap": 1.0 - math.sqrt(w.tally[ws.NEAREST]),
        "momentum_residual": residual,
        "failed": np.uint8(not sound),
        **energies(frame, before, float(w.tally[ws.VIRIAL])),
    }
    if w.late:
        found["missed_collisions"] = int(w.count[ws.MISSED])
    if not scene.box.periodic:
        given = float(w.tally[ws.WALL_IMPULSE :].sum())
        found["wall_impulse"] = float(represented(given, frame.mass, frame.length / frame.time))
    return found


def _inside(w: Workspace) -> bool:
    """Whether all disks are somewhere, and between walls not further beyond one than a few steps of the fastest."""
    place = np.stack([w.x, w.y]).astype(float)
    if w.box.periodic:
        return bool(np.all(np.isfinite(place)))
    low = np.array([[w.box.x], [w.box.y]]) + w.radius
    high = np.array([[w.box.x + w.box.width], [w.box.y + w.box.height]]) - w.radius
    beyond = REACHES * w.tally[ws.FASTEST] * w.step + 1e-6 * max(w.box.width, w.box.height)
    return bool(np.all((place >= low - beyond) & (place <= high + beyond)))


def _momentum_residual(w: Workspace, first, last) -> float:
    """Return by how much momentum is not what the walls gave, relative to all momentum there was and was given."""
    left, right, bottom, top = w.tally[ws.WALL_IMPULSE :]
    missing = np.sum(w.mass[:, None] * (last - first), axis=0) - (left - right, bottom - top)
    scale = float(np.sum(w.mass * np.sqrt(np.sum(first * first, axis=1)))) + left + right + bottom + top
    return float(np.abs(missing).max() / scale) if scale > 0 else 0.0
