"""Memory for the samples of a run, and the reports of runs of the time-stepping engine."""

from collections.abc import Collection, Sequence

import numpy as np

from brownpipe.engines.recording import Ending, conservation, images_fit, report, sample_arrays
from brownpipe.engines.state import HEALTH_BOUND, together
from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.workspace import Recorder, Workspace
from brownpipe.engines.units import Frame
from brownpipe.scene import Scene

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


def ending_of(w: Workspace, first: np.ndarray) -> Ending:
    """Return the ending of a run that began with velocities `first` (N, 2); two arrays are the workspace's."""
    motion = np.empty((len(w.disk), 4))
    motion[w.disk] = np.stack([w.x, w.y, w.vx, w.vy], axis=1)
    return Ending(first, motion, float(w.counters[ws.STEP] * w.step), w.count, w.tally)


@np.errstate(over="ignore", invalid="ignore")  # a run with inf or NaN fails its health check
def each_report(scene: Scene, frame: Frame, w: Workspace, endings: Sequence[Ending]) -> dict[str, np.ndarray]:
    """Return the reports of K runs in a workspace, name -> (K,)."""
    first, motion, elapsed, count, tally, _ = (together(values) for values in zip(*endings, strict=True))
    conserved = conservation(w.mass, first, motion[:, :, 2:], tally[:, ws.WALL_IMPULSE :])
    sound = np.abs(conserved.energy_drift) <= HEALTH_BOUND
    sound &= _are_inside(scene, frame, w, motion[:, :, :2], tally[:, ws.FASTEST])
    sound &= np.isfinite(motion).all(axis=(1, 2)) & np.isfinite(tally[:, ws.VIRIAL :]).all(axis=1)
    sound &= np.isfinite(conserved.twice_energy) & np.isfinite(conserved.momentum_residual)
    sound &= images_fit(scene, frame, elapsed / w.step, conserved.fastest * elapsed)
    collisions = count[:, [ws.PAIRS, ws.WALLS, ws.TRACER_PAIRS]]
    overlap = 1.0 - np.sqrt(tally[:, ws.NEAREST])
    missed = {"missed_collisions": count[:, ws.MISSED]} if w.late else {}
    return report(scene, frame, conserved, collisions, tally[:, ws.VIRIAL :], overlap, sound, missed)


def _are_inside(scene: Scene, frame: Frame, w: Workspace, place: np.ndarray, fastest: np.ndarray) -> np.ndarray:
    """Return (K,) whether, between walls, no disk at `place` (K, N, 2) has escaped: REACHES, `fastest` (K,) speeds."""
    if w.box.periodic:
        return np.ones(len(place), bool)
    radius = (scene.radius[frame.order] / frame.length)[:, None]
    low = np.array([w.box.x, w.box.y]) + radius
    high = np.array([w.box.x + w.box.width, w.box.y + w.box.height]) - radius
    beyond = (REACHES * fastest * w.step + 1e-6 * max(w.box.width, w.box.height))[:, None, None]
    return ((place >= low - beyond) & (place <= high + beyond)).all(axis=(1, 2))
