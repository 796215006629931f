"""What a run hands back: samples, collisions and observables, in the scene's units and order."""

import math

import numpy as np

from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.recording import all_finite, energies, images_fit, represented
from brownpipe.engines.state import HEALTH_BOUND, Events
from brownpipe.engines.units import Frame
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

EVENTS_PER_LOG = 65_536  # then they are moved to where there is room for more
MOST_BLOCKS = 2.0**62  # that the clock can count; a run of as many would take longer than anybody can wait


def recorder(frame: Frame, w: ws.Workspace, times: np.ndarray, record) -> ws.Recorder:
    """Return room for samples at the given times [scene's units], and for what else `record` names."""
    n, t = len(frame.order), len(times)
    inner = times / frame.time
    block = np.floor(inner / w.calendar.block)
    if len(block) and not block[-1] < MOST_BLOCKS:
        longest = w.calendar.block * frame.time * MOST_BLOCKS
        raise RequestError(f"duration: must be at most {longest:.3g} for disks so fast, not {times[-1]:g}")
    m, room = n if "all" in record else 0, EVENTS_PER_LOG if "events" in record else 0
    return ws.Recorder(
        tracer=int(frame.back[0]) if n else 0,
        block=block.astype(np.int64),
        time=inner - block * w.calendar.block,  # exact, as the length of a block is a power of two
        position=np.empty((t, 1, 2)),
        velocity=np.empty((t, 1, 2)),
        image=np.zeros((t, 1, 2), np.int32),
        whole_position=np.empty((t, m, 2)),
        whole_velocity=np.empty((t, m, 2)),
        whole_image=np.zeros((t, m, 2), np.int32),
        log_block=np.empty(room, np.int64),
        log_time=np.empty(room),
        log_pair=np.empty((room, 2), np.int32),
        log_impulse=np.empty((room, 2)),
    )


def logged(r: ws.Recorder, w: ws.Workspace, frame: Frame) -> Events:
    """Return the collisions in the log."""
    n = w.clock[ws.LOGGED]
    time = (r.log_block[:n] * w.calendar.block + r.log_time[:n]) * frame.time
    pair = r.log_pair[:n]
    named = np.where(pair >= 0, frame.order[np.maximum(pair, 0)], pair).astype(np.int32)
    impulse = represented(r.log_impulse[:n], frame.mass, frame.length / frame.time)
    return Events(time, named[:, 0], named[:, 1], impulse)


def joined(logs: list[Events]) -> Events | None:
    """Return parts of a log as one, None if there is none."""
    return Events(*(np.concatenate(column) for column in zip(*logs, strict=True))) if logs else None


@np.errstate(over="ignore", invalid="ignore")  # what is no number fails the run
def observables(scene: Scene, frame: Frame, w: ws.Workspace, first: np.ndarray) -> dict[str, float | int]:
    """Return what is reported of a run that began with velocities `first` (N, 2), in the engine's units and order."""
    last = w.disk.reshape(-1, ws.ROW)[:, ws.VX : ws.VX + 2]
    moving = slice(None) if w.mass is None else np.isfinite(w.mass)  # all but a pinned tracer
    mass = np.ones(len(last)) if w.mass is None else w.mass[moving]
    first, last = first[moving], last[moving]
    before, after = (float(np.sum(mass * np.sum(v * v, axis=1))) for v in (first, last))
    drift = (after - before) / before if before > 0 else 0.0
    overlap = 1.0 - math.sqrt(max(0.0, 1.0 + min(w.tally[ws.NEAREST], 0.0)))
    if w.tally[ws.STRAY] > HEALTH_BOUND:  # then overlaps may have gone unseen
        overlap = max(overlap, float(w.tally[ws.STRAY]))
    residual = _momentum_residual(w, mass, first, last)
    pinned = len(mass) < len(w.disk) // ws.ROW  # a pinned tracer takes up momentum
    sound = all(size <= HEALTH_BOUND for size in (abs(drift), overlap, 0.0 if pinned else residual))
    sound &= all_finite(before, w.disk.reshape(-1, ws.ROW)[:, ws.MOTION], w.tally[ws.VIRIAL :])
    elapsed = w.clock[ws.BLOCK] * w.calendar.block + w.tally[ws.NOW]
    fastest = math.sqrt(before / mass.min()) if before > 0 else 0.0  # if one disk had all the energy
    sound &= images_fit(scene, frame, int(w.count[ws.CROSSINGS]), fastest * elapsed)
    found = {
        "pair_collisions": int(w.count[ws.PAIRS]),
        "wall_collisions": int(w.count[ws.WALLS]),
        "tracer_collisions": int(w.count[ws.TRACER_PAIRS]),
        "energy_drift": drift,
        "worst_overlap": overlap,
        "momentum_residual": residual,
        "failed": np.uint8(not sound),
        **energies(frame, before, float(w.tally[ws.VIRIAL])),
    }
    if not scene.box.periodic:
        given = float(w.tally[ws.WALL_IMPULSE :].sum())
        found["wall_impulse"] = float(represented(given, frame.mass, frame.length / frame.time))
    return found


def _momentum_residual(w: ws.Workspace, mass, first, last) -> float:
    """Return by how much momentum is not what the walls gave, relative to all momentum there was and was given."""
    left, right, bottom, top = w.tally[ws.WALL_IMPULSE :]
    missing = np.sum(mass[:, None] * (last - first), axis=0) - (left - right, bottom - top)
    scale = float(np.sum(mass * np.sqrt(np.sum(first * first, axis=1)))) + left + right + bottom + top
    return float(np.abs(missing).max() / scale) if scale > 0 else 0.0
