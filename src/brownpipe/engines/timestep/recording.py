"""Samples of a run by time steps, and what is reported of it."""

import math

import numpy as np

from brownpipe.engines.recording import all_finite, energies, images_fit, represented
from brownpipe.engines.state import HEALTH_BOUND
from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.workspace import Recorder, Workspace
from brownpipe.engines.units import Frame
from brownpipe.scene import Scene

ENERGY_BOUND = {np.float64: HEALTH_BOUND, np.float32: 1e-4}  # energy drift beyond which a run has failed
REACHES = 4.0  # steps of the fastest disk: one that is further beyond a wall has escaped


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
