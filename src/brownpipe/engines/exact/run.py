"""One run of the exact engine: its samples, its report, and its state, from which it can be
resumed.

At the end of a block all disks are at the same time, and the next block starts from their positions
and velocities alone (`events.begin_block`): cell list, event queue and neighbour lists are built
anew. A run that continues from a RunState is therefore bit-identical to one that was never
interrupted.
"""

import math
from collections.abc import Collection
from functools import partial
from typing import NamedTuple

import numpy as np

from brownpipe import progress
from brownpipe.engines.compiled.kernels import compile_all
from brownpipe.engines.definition import Checkpoints
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.events import advance
from brownpipe.engines.exact.layout import begin_run, new_workspace, with_fitting_buckets
from brownpipe.engines.recording import (
    HEALTH_BOUND,
    blank_samples,
    can_count_images,
    conservation,
    report_in_scene_units,
    report_nothing,
    tracks_of,
)
from brownpipe.engines.start.insertion import insert_nothing
from brownpipe.engines.units import Frame, State, engine_frame, motion_of
from brownpipe.errors import RequestError, RunError
from brownpipe.observables.equilibrium import claims_equilibrium, ends_of_quarters
from brownpipe.observables.trajectory import Events, Run
from brownpipe.scene import Scene
from brownpipe.scene.sections import Box
from brownpipe.scene.species import species_table

# plus 2 per disk: in the kernel's first call, and while buckets are shorter than estimated; then
# twice as many in each call, so that buckets that fit badly are found soon
FEW_EVENTS = 10_000
# at most; between two calls Python handles signals such as Ctrl-C
EVENTS_PER_CALL = 2_000_000
# collisions that a recorder holds; a full log is emptied between two calls of the kernel
EVENTS_PER_LOG = 65_536
# mean path of a disk between two collisions [round-off of coordinates]; if shorter, the disks touch
# all round. Of 395 rows of disks that fill their box it is 0.5 at most, of a disk between two walls
# that it touches 2; in crystals it is 0.6 of the gap.
SHORTEST_PATH = 3.0
MOST_BLOCKS = 2.0**62  # an int64 counts the blocks of a run


class PreparedScene(NamedTuple):
    """A scene, the engine's units for it, and the workspace and recorder that its runs use one
    after the other.
    """

    scene: Scene
    frame: Frame
    pinned: bool  # whether the tracer has infinite mass
    workspace: ws.Workspace
    recorder: ws.Recorder


class RunState(NamedTuple):
    """A run at its beginning or at the end of a block, all but `events` in the engine's units and
    order.
    """

    equilibrating: bool  # before t = 0
    # capacity of a cell; above the default a run has no neighbour lists, which changes its
    # round-off
    slots: int
    first: np.ndarray  # (N, 4) float64, positions and velocities at the beginning
    motion: np.ndarray  # (N, 4) float64, positions and velocities now
    # those of `_arrays_of`, with the samples taken so far; empty at the beginning
    arrays: dict[str, np.ndarray]
    events: Events | None = None  # the log so far, in the scene's units and order


class Progress(NamedTuple):
    """How far a run has come within its current block."""

    block: int
    time: float  # since the beginning of the block [engine's unit]
    changes: np.ndarray  # (N,) how often the velocity of each disk has changed since then


NO_CHECKPOINTS: Checkpoints[object] = Checkpoints(lambda: False, lambda _: None)


def prepare_scene(
    scene: Scene, times: np.ndarray, record: Collection[str] = (), pinned: bool = False
) -> PreparedScene:
    """Return what runs of a scene need that are sampled at the times (T,) [scene's units], with its
    kernels compiled.

    `record` as in `simulate`; a `pinned` tracer has infinite mass. Raises RequestError if the last
    time is more blocks away than can be counted.
    """
    frame = engine_frame(scene)
    w = new_workspace(scene, frame, pinned)
    recorder = new_recorder(scene, frame, w.calendar.block, times, record)
    no_samples = recorder._replace(block=recorder.block[:0])
    compile_all(insert_nothing, report_nothing, partial(advance, w, no_samples, 0))
    return PreparedScene(scene, frame, pinned, w, recorder)


def state_at_start(prepared: PreparedScene, state: State, equilibrating: bool = False) -> RunState:
    """Return a run that begins from the given state of all disks."""
    motion = motion_of(state, prepared.frame)
    return RunState(equilibrating, prepared.workspace.grid.slots, motion, motion, {})


def run_to_end(
    prepared: PreparedScene, start: RunState, saving: Checkpoints[RunState] = NO_CHECKPOINTS
) -> Run:
    """Continue a run to its end and return its result; the tracer's track is in the recorder's
    arrays.

    A run in which a cell or a neighbour list overflows restarts with twice the capacity. The next
    run starts with the default capacity, as it must not depend on earlier runs. Raises RunError if
    the run makes no progress.
    """
    recorder = prepared.recorder
    w = prepared.workspace
    while True:
        if start.slots != w.grid.slots:
            w = new_workspace(prepared.scene, prepared.frame, prepared.pinned, start.slots)
        # cells, event queue and neighbour lists are built by the next block
        begin_run(w, start.motion)
        if start.arrays:
            w.progress[:] = start.arrays["progress"]  # with the number of samples taken
            for name, array in _arrays_of(w, recorder).items():
                array[:] = start.arrays[name]
        logs = [] if start.events is None else [start.events]
        if _to_last_sample(prepared, w, start, logs, saving):
            break
        start = RunState(start.equilibrating, 2 * w.grid.slots, start.first, start.first, {})
    tracer, whole, finite = tracks_of(prepared.scene, prepared.frame, recorder)
    return Run(tracer, whole, _join_logs(logs), report_of(prepared, w, start.first, finite))


def _to_last_sample(
    prepared: PreparedScene,
    w: ws.Workspace,
    start: RunState,
    logs: list[Events],
    saving: Checkpoints[RunState],
) -> bool:
    """Advance to the last sample and append to the logs; return False if a cell or a neighbour list
    overflowed.
    """
    scene = prepared.scene
    frame = prepared.frame
    recorder = prepared.recorder
    estimated = w.calendar.width
    few = min(FEW_EVENTS + 2 * scene.particles, EVENTS_PER_CALL)
    most = few
    # each block begins with an event of every disk
    between_looks = max(EVENTS_PER_CALL, 2 * scene.particles)
    before = _progress_of(w)
    events = 0
    while w.progress[ws.SAMPLE] < len(recorder.block):
        w.progress[ws.STOP] = saving.due()
        events_before = events_so_far(w)
        began = time_since_start(w)
        outcome = advance(w, quarter_of(recorder, w), most)
        if outcome in (ws.PAUSED, ws.LOG_FULL):
            now = time_since_start(w)
            events += most if outcome == ws.PAUSED else len(recorder.log_time)
            w = with_fitting_buckets(w, events_so_far(w) - events_before, now - began, estimated)
            most = few if w.calendar.width < estimated else min(2 * most, EVENTS_PER_CALL)
            if events >= between_looks:
                _refuse_standstill(scene.box, frame, w, before, events)
                before = _progress_of(w)
                events = 0
            _report_progress(scene, now * frame.time, start.equilibrating)
        if len(recorder.log_time):
            logs.append(_logged(recorder, w, frame))
            w.progress[ws.LOGGED] = 0
        if outcome == ws.CELL_FULL:
            return False
        if outcome == ws.DONE and len(recorder.quarter):
            _take_totals(recorder, w)
        if outcome == ws.BLOCK_OVER:
            arrays = _arrays_of(w, recorder)
            saving.store(
                start._replace(motion=_present_motion(w), arrays=arrays, events=_join_logs(logs))
            )
    return True


def _report_progress(scene: Scene, time: float, equilibrating: bool) -> None:
    """Show how far a run has come, `time` after its beginning, or that of its equilibration."""
    before = 0.0 if equilibrating else scene.equilibrate.time
    progress.within((before + time) / (scene.equilibrate.time + scene.duration))


def _arrays_of(w: ws.Workspace, recorder: ws.Recorder) -> dict[str, np.ndarray]:
    """Return what a run has changed in its workspace and recorder, besides the motion of its disks
    and the log.
    """
    arrays = {"progress": w.progress, "count": w.count, "tally": w.tally, "totals": recorder.totals}
    if w.image is not None:
        arrays["images_now"] = w.image
    samples = w.progress[ws.SAMPLE]
    for name, values in recorder.track._asdict().items():
        arrays[f"track_{name}"] = values[:samples]
    for name, values in recorder.whole._asdict().items():
        arrays[f"whole_{name}"] = values[:samples]
    return arrays


def _present_motion(w: ws.Workspace) -> np.ndarray:
    """Return positions and velocities (N, 4) of all disks, a view of the workspace."""
    return w.disk.reshape(-1, ws.ROW)[:, ws.MOTION]


def time_since_start(w: ws.Workspace) -> float:
    """Return the time since the beginning of a run [engine's unit]."""
    return float(w.progress[ws.BLOCK] * w.calendar.block + w.tally[ws.NOW])


def events_so_far(w: ws.Workspace) -> int:
    """Return the number of events so far, without those that only predicted anew."""
    return int(w.count.sum() - w.count[ws.STALE])


def _progress_of(w: ws.Workspace) -> Progress:
    """Return how far a run has come."""
    changes = w.disk.reshape(-1, ws.ROW)[:, ws.CHANGES].copy()
    if not w.progress[ws.BLOCK_BEGUN]:
        changes[:] = 0.0  # still those of the block before
    return Progress(int(w.progress[ws.BLOCK]), float(w.tally[ws.NOW]), changes)


def _refuse_standstill(
    box: Box, frame: Frame, w: ws.Workspace, before: Progress, events: int
) -> None:
    """Raise RunError if disks moved less than round-off of their coordinates between collisions,
    in the `events` since then.

    Disks that touch all round collide for ever at one time, or advance by the last bits of their
    gaps. The path is the mean over the disks that collide, each with the weight of its collisions
    n, so that disks that are free do not hide a few that are jammed: t sum(n v) / sum(n^2) along
    each axis.
    """
    now = _progress_of(w)
    collisions = now.changes - before.changes
    if now.block != before.block or not collisions.any():
        return
    elapsed = now.time - before.time
    speed = np.abs(w.disk.reshape(-1, ws.ROW)[:, [ws.VX, ws.VY]])
    path = elapsed * (collisions @ speed) / (collisions @ collisions)
    size = np.array((box.width, box.height))
    farthest = np.maximum(np.abs((box.x, box.y)).max(axis=1), size)
    if np.all(path * frame.length < SHORTEST_PATH * np.spacing(farthest)):
        raise RunError(
            f"no progress at t = {time_since_start(w) * frame.time:.9g}: {events} events took "
            f"{elapsed * frame.time:.3g}; the disks touch all round, and must have room to move"
        )


# -- samples and the log ---------------------------------------------------------------------------


def new_recorder(
    scene: Scene, frame: Frame, duration: float, times: np.ndarray, record: Collection[str]
) -> ws.Recorder:
    """Return an empty recorder for `prepare_scene`; `duration` is that of a block, whatever the
    size of cells.
    """
    n = scene.particles
    species = species_table(scene)
    quarters = ends_of_quarters(times) if claims_equilibrium(scene) else np.zeros(0, np.int64)
    log_length = EVENTS_PER_LOG if "events" in record else 0
    engine_times = times / frame.time
    block = np.floor(engine_times / duration)
    if len(block) and not block[-1] < MOST_BLOCKS:
        longest = duration * frame.time * MOST_BLOCKS
        raise RequestError(
            f"{scene.name}: duration: must be at most {longest:.3g} for disks so fast, not "
            f"{times[-1]:g}"
        )
    whole_disks = n if "all" in record else 0
    totals = np.zeros((len(quarters), 2 + len(species.name)))
    return ws.Recorder(
        tracer=int(frame.back[0]) if n else 0,
        block=block.astype(np.int64),
        time=engine_times - block * duration,  # exact, as the length of a block is a power of two
        track=blank_samples(len(times), 1),
        whole=blank_samples(len(times), whole_disks),
        quarter=quarters,
        species=species.species_index[frame.order],
        totals=totals,
        **_empty_log(log_length),
    )


def _empty_log(collisions: int) -> dict[str, np.ndarray]:
    """Return the fields of a recorder that log so many collisions."""
    log: dict[str, np.ndarray] = {}
    log["log_block"] = np.empty(collisions, np.int64)
    log["log_time"] = np.empty(collisions)
    log["log_pair"] = np.empty((collisions, 2), np.int32)
    log["log_impulse"] = np.empty((collisions, 2))
    return log


def _logged(recorder: ws.Recorder, w: ws.Workspace, frame: Frame) -> Events:
    """Return the collisions in the recorder's log, in the scene's units and numbers of the
    disks.
    """
    n = w.progress[ws.LOGGED]
    time = (recorder.log_block[:n] * w.calendar.block + recorder.log_time[:n]) * frame.time
    pair = recorder.log_pair[:n]
    is_disk = pair >= 0  # otherwise a wall
    disks = np.where(is_disk, frame.order[np.maximum(pair, 0)], pair).astype(np.int32)
    impulse = recorder.log_impulse[:n] * frame.mass * frame.speed
    return Events(time, disks[:, 0], disks[:, 1], impulse)


def _join_logs(logs: list[Events]) -> Events | None:
    """Return the parts of a log as one; None if there are none."""
    if not logs:
        return None
    return Events(*(np.concatenate(column) for column in zip(*logs, strict=True)))


# -- quarters of the run ---------------------------------------------------------------------------


def quarter_of(recorder: ws.Recorder, w: ws.Workspace) -> ws.Recorder:
    """Return the recorder for samples up to the next end of a quarter, or for all if there is none.

    The kernel takes no totals itself: code for it made every collision 2 to 3 % slower, even where
    it never ran.
    """
    ends = recorder.quarter[recorder.quarter >= w.progress[ws.SAMPLE]]
    return recorder._replace(block=recorder.block[: ends[0] + 1]) if len(ends) else recorder


def _take_totals(recorder: ws.Recorder, w: ws.Workspace) -> None:
    """Write pair collisions and virial so far, and the kinetic energy of each species now, at the
    end of a quarter.
    """
    for row in np.flatnonzero(recorder.quarter == w.progress[ws.SAMPLE] - 1):
        totals = recorder.totals[row]
        totals[0] = w.count[ws.PAIRS]
        totals[1] = w.tally[ws.VIRIAL]
        vx, vy = w.disk.reshape(-1, ws.ROW)[:, [ws.VX, ws.VY]].T
        half_mass = 0.5 if w.mass is None else 0.5 * w.mass
        energy = half_mass * (vx * vx + vy * vy)
        totals[2:] = np.bincount(recorder.species, energy, len(totals) - 2)


def _quarters(frame: Frame, recorder: ws.Recorder) -> dict[str, np.ndarray]:
    """Return what a run reports by quarters, in the scene's units; {} if nothing.

    The energy of a quarter is the mean of those at its beginning and its end, per disk. That of a
    single species is the energy of the run, which is conserved: it is left out.
    """
    totals = recorder.totals
    if not len(totals):
        return {}
    collisions, virial = np.diff(totals[:, :2], axis=0).T
    values = {
        "quarter_collisions": collisions.astype(np.int64),
        "quarter_virial": virial * frame.mass * frame.speed * frame.length,
    }
    if totals.shape[1] > 3:
        energy = (totals[1:, 2:] + totals[:-1, 2:]) / (2 * np.bincount(recorder.species))
        values["quarter_energy"] = energy * frame.mass * frame.speed * frame.speed
    return values


# -- the report ------------------------------------------------------------------------------------


def report_of(
    prepared: PreparedScene, w: ws.Workspace, first: np.ndarray, finite: bool
) -> dict[str, np.typing.ArrayLike]:
    """Return the report of a run from its workspace and recorder at the end, and its motion (N, 4)
    at the beginning.

    A run fails if its energy drift, deepest overlap or momentum residual is beyond HEALTH_BOUND, or
    if it has numbers that are not `finite`. A pinned tracer has infinite mass: it takes up any
    momentum, and is left out of the energy.
    """
    scene = prepared.scene
    frame = prepared.frame
    mass = np.ones(len(first)) if w.mass is None else w.mass
    count = w.count.tolist()
    impulses = w.tally[ws.VIRIAL :]
    conserved = conservation(mass, first, _present_motion(w).copy(), impulses[1:])
    overlap = _worst_overlap(w)
    keeps_momentum = prepared.pinned or conserved.momentum_residual <= HEALTH_BOUND
    longest_path = conserved.fastest * time_since_start(w)
    sound = finite and overlap <= HEALTH_BOUND and keeps_momentum
    sound = sound and can_count_images(scene, frame, count[ws.CROSSINGS], longest_path)
    collisions = [count[ws.PAIRS], count[ws.WALLS], count[ws.TRACER_PAIRS]]
    values = report_in_scene_units(scene, frame, conserved, collisions, impulses, overlap, sound)
    return values | _quarters(frame, prepared.recorder)


def _worst_overlap(w: ws.Workspace) -> float:
    """Return the deepest overlap of a pair in the run, in contact distances.

    A disk further outside its cell than HEALTH_BOUND may have had overlaps that were not seen: its
    distance from the cell [cells] then counts as an overlap.
    """
    square = 1.0 + min(w.tally[ws.NEAREST], 0.0)
    overlap = 1.0 - math.sqrt(max(0.0, square))
    stray = float(w.tally[ws.STRAY])
    return max(overlap, stray) if stray > HEALTH_BOUND else overlap
