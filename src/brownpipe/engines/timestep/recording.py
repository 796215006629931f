"""Memory for the samples of a run, and the report of a run of the time-stepping engine."""

import math
from collections.abc import Collection

import numpy as np

from brownpipe.engines.recording import Report, all_finite, conservation, images_fit, report, reports_of, sample_arrays
from brownpipe.engines.state import HEALTH_BOUND
from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.workspace import Recorder, Workspace
from brownpipe.engines.units import Frame
from brownpipe.scene import Scene

ENERGY_BOUND = {np.float64: HEALTH_BOUND, np.float32: 1e-4}  # energy drift beyond which a run has failed
REACHES = 4.0  # paths of the fastest disk in a step: a disk further beyond a wall has escaped and the run has failed


def recorder(scene: Scene, frame: Frame, time_step: float, times: np.ndarray, record: Collection[str]) -> Recorder:
    """Return memory for samples, free flights after the last step before each: no step depends on sample times."""
    n = scene.particles
    steps = times / time_step
    last = np.rint(steps)
    last = np.where(np.abs(steps - last) <= 1e-9 + 1e-12 * steps, last, np.floor(steps))
    return Recorder(
        tracer=int(frame.back[0]) if n else 0,
        step=last.astype(np.int64),
        rest=(times - last * time_step) / frame.time,
        **sample_arrays(len(times), n if "all" in record else 0),
    )


@np.errstate(over="ignore", invalid="ignore")  # a run with inf or NaN fails its health check
def report_of(scene: Scene, frame: Frame, w: Workspace, first: np.ndarray) -> Report:
    """Return the report of a run that began with velocities `first` (N, 2), in the engine's units and order."""
    last = np.empty((len(w.disk), 2))
    last[w.disk, 0], last[w.disk, 1] = w.vx, w.vy
    conserved = conservation(w.mass, first[None], last[None], w.tally[None, ws.WALL_IMPULSE :])
    sound = (np.abs(conserved.energy_drift) <= ENERGY_BOUND[w.x.dtype.type]) & _inside(w)
    sound &= all_finite(conserved.twice_energy, last, conserved.momentum_residual, w.tally[ws.VIRIAL :])
    steps = w.counters[ws.STEP]
    sound &= images_fit(scene, frame, steps, conserved.fastest * steps * w.step)
    collisions = w.count[None, [ws.PAIRS, ws.WALLS, ws.TRACER_PAIRS]]
    overlap = np.array([1.0 - math.sqrt(w.tally[ws.NEAREST])])
    missed = {"missed_collisions": w.count[[ws.MISSED]]} if w.late else {}
    impulses = w.tally[None, ws.VIRIAL :]
    return reports_of(report(scene, frame, conserved, collisions, impulses, overlap, sound, missed))[0]


def _inside(w: Workspace) -> bool:
    """Return whether all positions are finite and, between walls, no disk has escaped (REACHES)."""
    place = np.stack([w.x, w.y]).astype(float)
    if w.box.periodic:
        return bool(np.all(np.isfinite(place)))
    low = np.array([[w.box.x], [w.box.y]]) + w.radius
    high = np.array([[w.box.x + w.box.width], [w.box.y + w.box.height]]) - w.radius
    beyond = REACHES * w.tally[ws.FASTEST] * w.step + 1e-6 * max(w.box.width, w.box.height)
    return bool(np.all((place >= low - beyond) & (place <= high + beyond)))
