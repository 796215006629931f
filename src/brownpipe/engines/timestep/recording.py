"""Memory for the samples of a run, and the reports of runs of the time-stepping engine."""

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from brownpipe.engines.recording import conservation, images_fit, report, sample_arrays
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


def report_of(scene: Scene, frame: Frame, w: Workspace, first: np.ndarray, finite: bool) -> dict[str, Any]:
    """Return the report of a run from its workspace at the end and its motion (N, 4) at the beginning.

    It fails, too, if its samples are not `finite`.
    """
    last = np.empty((len(w.disk), 4))
    last[w.disk] = np.stack([w.x, w.y, w.vx, w.vy], axis=1)
    count, impulses, elapsed = w.count.tolist(), w.tally[ws.VIRIAL :].tolist(), float(w.counters[ws.STEP] * w.step)
    conserved = conservation(w.mass, first, last, impulses[1:])
    sound = finite and math.isfinite(conserved.momentum_residual) and _are_inside(scene, frame, w, last[:, :2])
    sound = sound and images_fit(scene, frame, elapsed / w.step, conserved.fastest * elapsed)
    collisions = [count[ws.PAIRS], count[ws.WALLS], count[ws.TRACER_PAIRS]]
    overlap = 1.0 - math.sqrt(w.tally[ws.NEAREST])
    missed = {"missed_collisions": count[ws.MISSED]} if w.late else {}
    return report(scene, frame, conserved, collisions, impulses, overlap, sound, missed)


def _are_inside(scene: Scene, frame: Frame, w: Workspace, place: np.ndarray) -> bool:
    """Whether, between walls, no disk at `place` (N, 2) has escaped: REACHES."""
    if w.box.periodic:
        return True
    radius = (scene.radius[frame.order] / frame.length)[:, None]
    low = np.array([w.box.x, w.box.y]) + radius
    high = np.array([w.box.x + w.box.width, w.box.y + w.box.height]) - radius
    beyond = REACHES * w.tally[ws.FASTEST] * w.step + 1e-6 * max(w.box.width, w.box.height)
    return bool(((place >= low - beyond) & (place <= high + beyond)).all())
