"""What a run of the exact engine returns: samples, the log of collisions and its report."""

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from brownpipe.engines.ensemble import Events
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.recording import HEALTH_BOUND, conservation, images_fit, report, represented, sample_arrays
from brownpipe.engines.units import Frame
from brownpipe.errors import RequestError
from brownpipe.observables.quarters import claims_equilibrium, ends_of_quarters
from brownpipe.observables.species import species_table
from brownpipe.scene import Scene

EVENTS_PER_LOG = 65_536  # collisions that a recorder holds; a full log is emptied between two calls of the kernel
MOST_BLOCKS = 2.0**62  # an int64 counts the blocks of a run


def new_recorder(
    scene: Scene, frame: Frame, w: ws.Workspace, times: np.ndarray, record: Collection[str]
) -> ws.Recorder:
    """Return an empty recorder for samples at the times (T,) [scene's units]; `record` as of `simulate`.

    Raises RequestError if the last time is more blocks away than can be counted.
    """
    n = len(frame.order)
    log_length = EVENTS_PER_LOG if "events" in record else 0
    engine_times = times / frame.time
    block = np.floor(engine_times / w.calendar.block)
    if len(block) and not block[-1] < MOST_BLOCKS:
        longest = w.calendar.block * frame.time * MOST_BLOCKS
        raise RequestError(
            f"{scene.name}: duration: must be at most {longest:.3g} for disks so fast, not {times[-1]:g}"
        )
    return ws.Recorder(
        tracer=int(frame.back[0]) if n else 0,
        block=block.astype(np.int64),
        time=engine_times - block * w.calendar.block,  # exact, as the length of a block is a power of two
        **sample_arrays(len(times), n if "all" in record else 0),
        **quarter_arrays(scene, frame, times),
        log_block=np.empty(log_length, np.int64),
        log_time=np.empty(log_length),
        log_pair=np.empty((log_length, 2), np.int32),
        log_impulse=np.empty((log_length, 2)),
    )


def quarter_arrays(scene: Scene, frame: Frame, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of an empty Recorder for quarters of a run sampled at `times` (T,); empty if it has none.

    The energy of a single species is that of the run, which is conserved: it is left out.
    """
    ends = ends_of_quarters(times)
    if not (len(ends) and claims_equilibrium(scene)):
        return {"quarter": ends[:0], "species": ends[:0], "totals": np.zeros((0, 2))}
    table = species_table(scene)
    kinds = len(table.name) if len(table.name) > 1 else 0
    species = table.label[frame.order] if kinds else ends[:0]
    return {"quarter": ends, "species": species, "totals": np.zeros((len(ends), 2 + kinds))}


def quarter_of(recorder: ws.Recorder, w: ws.Workspace) -> ws.Recorder:
    """Return the recorder for samples up to the next end of a quarter, or for all if there is none.

    The kernel takes no totals itself: even where it never did, this made every collision 2 to 3 % slower.
    """
    ends = recorder.quarter[recorder.quarter >= w.progress[ws.SAMPLE]]
    return recorder._replace(block=recorder.block[: ends[0] + 1]) if len(ends) else recorder


def take_totals(recorder: ws.Recorder, w: ws.Workspace) -> None:
    """Write pair collisions and virial so far, and the kinetic energy of each species now, at the end of a quarter."""
    (row,) = np.flatnonzero(recorder.quarter == w.progress[ws.SAMPLE] - 1)
    totals = recorder.totals[row]
    totals[:2] = w.count[ws.PAIRS], w.tally[ws.VIRIAL]
    if len(recorder.species):
        vx, vy = w.disk.reshape(-1, ws.ROW)[:, [ws.VX, ws.VY]].T
        half_mass = 0.5 if w.mass is None else 0.5 * w.mass
        totals[2:] = np.bincount(recorder.species, half_mass * (vx * vx + vy * vy), len(totals) - 2)


def quarters(frame: Frame, recorder: ws.Recorder) -> dict[str, np.ndarray]:
    """Return what a run reports by quarters, in the scene's units; {} if nothing.

    The energy of a quarter is the mean of those at its beginning and its end, per disk.
    """
    totals, speed = recorder.totals, frame.length / frame.time
    if not len(totals):
        return {}
    collisions, virial = np.diff(totals[:, :2], axis=0).T
    values = {
        "quarter_collisions": collisions.astype(np.int64),
        "quarter_virial": represented(virial, frame.mass, speed, frame.length),
    }
    if len(recorder.species):
        energy = (totals[1:, 2:] + totals[:-1, 2:]) / (2 * np.bincount(recorder.species))
        values["quarter_energy"] = represented(energy, frame.mass, speed, speed)
    return values


def logged(recorder: ws.Recorder, w: ws.Workspace, frame: Frame) -> Events:
    """Return the collisions in the recorder's log, in the scene's units and numbers of the disks."""
    n = w.progress[ws.LOGGED]
    time = (recorder.log_block[:n] * w.calendar.block + recorder.log_time[:n]) * frame.time
    pair = recorder.log_pair[:n]
    disks = np.where(pair >= 0, frame.order[np.maximum(pair, 0)], pair).astype(np.int32)  # < 0: a wall
    impulse = represented(recorder.log_impulse[:n], frame.mass, frame.length / frame.time)
    return Events(time, disks[:, 0], disks[:, 1], impulse)


def joined(logs: list[Events]) -> Events | None:
    """Return the parts of a log as one; None if there are none."""
    return Events(*(np.concatenate(column) for column in zip(*logs, strict=True))) if logs else None


def report_of(
    scene: Scene, frame: Frame, w: ws.Workspace, r: ws.Recorder, first: np.ndarray, finite: bool
) -> dict[str, Any]:
    """Return the report of a run from its workspace and recorder at the end, and its motion (N, 4) at the beginning.

    A run fails if its energy drift, deepest overlap or momentum residual is beyond HEALTH_BOUND, or if it has numbers
    that are not `finite`. A pinned tracer has infinite mass: it takes up any momentum, and is left out of the energy.
    """
    mass = np.ones(len(first)) if w.mass is None else w.mass
    count, impulses = w.count.tolist(), w.tally[ws.VIRIAL :].tolist()
    last = w.disk.reshape(-1, ws.ROW)[:, ws.MOTION].copy()
    conserved = conservation(mass, first, last, impulses[1:])
    elapsed = float(w.progress[ws.BLOCK] * w.calendar.block + w.tally[ws.NOW])
    overlap = _worst_overlap(float(w.tally[ws.NEAREST]), float(w.tally[ws.STRAY]))
    pinned = len(mass) > 0 and mass.max() == np.inf
    sound = finite and overlap <= HEALTH_BOUND and (pinned or conserved.momentum_residual <= HEALTH_BOUND)
    sound = sound and images_fit(scene, frame, count[ws.CROSSINGS], conserved.fastest * elapsed)
    collisions = [count[ws.PAIRS], count[ws.WALLS], count[ws.TRACER_PAIRS]]
    return report(scene, frame, conserved, collisions, impulses, overlap, sound, quarters(frame, r))


def _worst_overlap(nearest: float, stray: float) -> float:
    """Return the deepest overlap of a pair in a run [contact distances], >= 0.

    A disk further outside its cell than HEALTH_BOUND may have had overlaps that were not seen: its distance from the
    cell then counts as an overlap.
    """
    overlap = 1.0 - math.sqrt(max(0.0, 1.0 + min(nearest, 0.0)))
    return max(overlap, stray) if stray > HEALTH_BOUND else overlap
