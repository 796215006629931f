"""One run of the exact engine, and its state at the end of a block of time, from which it can be resumed.

At the end of a block all disks are at the same time, and the next block starts from their positions and velocities
alone (`events.begin_block`): cell list, event queue and neighbour lists are built anew. A run that continues from a
RunState is therefore bit-identical to one that was never interrupted.
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import NamedTuple

import numpy as np

from brownpipe import progress
from brownpipe.engines.compiling import compile_all
from brownpipe.engines.ensemble import Events, RunResult
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.events import advance
from brownpipe.engines.exact.layout import begin, prepare, with_fitting_buckets
from brownpipe.engines.exact.recording import joined, logged, new_recorder, quarter_of, report_of, take_totals
from brownpipe.engines.insertion import insert_nothing
from brownpipe.engines.recording import SAMPLES, report_nothing, tracks_of
from brownpipe.engines.units import Frame, State, frame_of, motion_of
from brownpipe.errors import RunError
from brownpipe.scene import Scene

FEW_EVENTS = 10_000  # and 2 per disk: of the first call of the kernel, and while buckets are shorter than estimated
EVENTS_PER_CALL = 2_000_000  # of all others; between two calls Python handles signals such as Ctrl-C
SHORTEST_PATH = 2e-16  # mean path of a disk between events [contact distances]; if shorter, the disks are jammed


class PreparedScene(NamedTuple):
    """A scene, the engine's units for it, and a workspace that its runs use one after the other."""

    scene: Scene
    frame: Frame
    workspace: ws.Workspace
    pinned: bool  # whether the tracer has infinite mass


class RunState(NamedTuple):
    """A run at its beginning or at the end of a block, all but `events` in the engine's units and order."""

    equilibrating: bool  # before t = 0
    slots: int  # capacity of a cell; above the default a run has no neighbour lists, which changes its round-off
    first: np.ndarray  # (N, 4) float64, positions and velocities at the beginning
    motion: np.ndarray  # (N, 4) float64, positions and velocities now
    arrays: dict[str, np.ndarray]  # those of `_arrays_of`, samples as far as they are taken; empty at the beginning
    events: Events | None = None  # the log so far, in the scene's units and order


class Saving(NamedTuple):
    """When and how the state of a run is stored."""

    due: Callable[[], bool]  # whether to store at the next end of a block
    store: Callable[[RunState], None]  # takes a state whose arrays are views of the workspace, which changes later


NOT_SAVED = Saving(lambda: False, lambda _: None)


def prepare_scene(scene: Scene, pinned: bool = False) -> PreparedScene:
    """Return a scene with its workspace and with its kernels compiled; a `pinned` tracer has infinite mass."""
    frame = frame_of(scene)
    w = prepare(scene, frame, pinned)
    compile_all(insert_nothing, report_nothing, partial(advance, w, new_recorder(scene, frame, w, np.zeros(0), ()), 0))
    return PreparedScene(scene, frame, w, pinned)


def beginning(prepared: PreparedScene, state: State) -> RunState:
    """Return a run that begins from the given state of all disks."""
    motion = motion_of(state, prepared.frame)
    return RunState(False, prepared.workspace.grid.slots, motion, motion, {})


def run(prepared: PreparedScene, state: State, times: np.ndarray, record: Collection[str] = ()) -> RunResult:
    """Run from a state without checkpoints, and sample at the given times (T,) [time]; raise RunError as `evolve`."""
    return evolve(prepared, beginning(prepared, state), times, record)


def evolve(
    prepared: PreparedScene,
    start: RunState,
    times: np.ndarray,
    record: Collection[str],
    saving: Saving = NOT_SAVED,
) -> RunResult:
    """Continue a run, sample it at the given times (T,) [time] and return its result.

    Raises RunError if the run makes no progress.
    """
    return to_end(prepared, start, recorder_of(prepared, times, record), saving)


def recorder_of(prepared: PreparedScene, times: np.ndarray, record: Collection[str]) -> ws.Recorder:
    """Return a recorder for runs one after the other, sampled at the given times (T,) [time].

    It also serves a run that restarts with larger cells: the duration of a block is that of the scene.
    """
    return new_recorder(prepared.scene, prepared.frame, prepared.workspace, times, record)


def to_end(prepared: PreparedScene, start: RunState, recorder: ws.Recorder, saving: Saving = NOT_SAVED) -> RunResult:
    """Continue a run to its end, as `evolve`; the tracer's track is in the recorder's arrays.

    A run in which a cell or a neighbour list overflows restarts with twice the capacity. The next run starts with the
    default capacity, as it must not depend on earlier runs.
    """
    scene, frame, w, pinned = prepared
    while True:
        if start.slots != w.grid.slots:
            w = prepare(scene, frame, pinned, start.slots)
        logs = _restore(start, w, recorder)
        if _to_last_sample(prepared, w, recorder, start, logs, saving):
            break
        start = RunState(start.equilibrating, 2 * w.grid.slots, start.first, start.first, {})
    tracer, whole, finite = tracks_of(scene, frame, recorder)
    return RunResult(tracer, whole, joined(logs), report_of(scene, frame, w, recorder, start.first, finite))


def _to_last_sample(
    prepared: PreparedScene,
    w: ws.Workspace,
    recorder: ws.Recorder,
    start: RunState,
    logs: list[Events],
    saving: Saving,
) -> bool:
    """Advance to the last sample and append to the logs; return False if a cell or a neighbour list overflowed."""
    scene, frame = prepared.scene, prepared.frame
    before, events, estimated = _block_and_time(w), 0, w.calendar.width
    few = most = min(FEW_EVENTS + 2 * scene.particles, EVENTS_PER_CALL)
    quarter = quarter_of(recorder, w)
    while True:
        w.progress[ws.STOP] = saving.due()
        done, elapsed = events_so_far(w), time_since_start(w)
        outcome = advance(w, quarter, most)
        if outcome in (ws.PAUSED, ws.LOG_FULL):
            events += most if outcome == ws.PAUSED else len(recorder.log_time)
            w = with_fitting_buckets(w, events_so_far(w) - done, time_since_start(w) - elapsed, estimated)
            most = few if w.calendar.width < estimated else EVENTS_PER_CALL
            if events >= max(EVENTS_PER_CALL, 2 * scene.particles):
                _refuse_standstill(w, frame, before, events)
                before, events = _block_and_time(w), 0
            progress.within(_fraction(scene, frame, w, start.equilibrating))
        if len(recorder.log_time):
            logs.append(logged(recorder, w, frame))
            w.progress[ws.LOGGED] = 0
        if outcome == ws.CELL_FULL:
            return False
        if outcome == ws.DONE:
            if len(recorder.quarter):
                take_totals(recorder, w)
            if w.progress[ws.SAMPLE] == len(recorder.block):
                return True
            quarter = quarter_of(recorder, w)
        if outcome == ws.BLOCK_OVER:
            saving.store(_state_of(w, recorder, start, logs))


def _state_of(w: ws.Workspace, recorder: ws.Recorder, start: RunState, logs: list[Events]) -> RunState:
    """Return a run at the end of a block, as views of the arrays of its workspace and recorder."""
    arrays = _arrays_of(w, recorder)
    arrays |= {name: arrays[name][: w.progress[ws.SAMPLE]] for name in SAMPLES}
    return start._replace(motion=_moving(w), arrays=arrays, events=joined(logs))


def _arrays_of(w: ws.Workspace, recorder: ws.Recorder) -> dict[str, np.ndarray]:
    """Return what a run changes in its workspace and recorder, besides the motion of its disks and the log."""
    arrays = {"progress": w.progress, "count": w.count, "tally": w.tally, "totals": recorder.totals}
    arrays |= {} if w.image is None else {"images_now": w.image}
    return arrays | {name: getattr(recorder, name) for name in SAMPLES}


def _moving(w: ws.Workspace) -> np.ndarray:
    """Return positions and velocities (N, 4) of all disks, a view of the workspace."""
    return w.disk.reshape(-1, ws.ROW)[:, ws.MOTION]


def _restore(state: RunState, w: ws.Workspace, recorder: ws.Recorder) -> list[Events]:
    """Set a workspace and a recorder to a run's state; return the log so far, in parts.

    Cells, event queue and neighbour lists are left alone, as the next block builds them anew.
    """
    begin(w, state.motion)
    if state.arrays:
        for name, array in _arrays_of(w, recorder).items():
            array[: len(state.arrays[name])] = state.arrays[name]
    return [] if state.events is None else [state.events]


def _block_and_time(w: ws.Workspace) -> tuple[int, float]:
    """Return the number of the current block and the time within it [engine's units]."""
    return int(w.progress[ws.BLOCK]), float(w.tally[ws.NOW])


def time_since_start(w: ws.Workspace) -> float:
    """Return the time since the beginning of a run [engine's unit]."""
    block, time = _block_and_time(w)
    return block * w.calendar.block + time


def events_so_far(w: ws.Workspace) -> int:
    """Return the number of events so far, without those that only predicted anew."""
    return int(w.count.sum() - w.count[ws.STALE])


def _fraction(scene: Scene, frame: Frame, w: ws.Workspace, equilibrating: bool) -> float:
    """Return the fraction of a run that is done, in simulated time with that to equilibrate."""
    elapsed = time_since_start(w) * frame.time
    before = 0.0 if equilibrating else scene.equilibrate.time
    return (before + elapsed) / (scene.equilibrate.time + scene.duration)


def _refuse_standstill(w: ws.Workspace, frame: Frame, before: tuple[int, float], events: int) -> None:
    """Raise RunError if at least `events` events since `before` took less time than round-off resolves.

    At the start of a block each disk has one event, its prediction, at the same time: `events` must be twice as many.
    """
    block, time = _block_and_time(w)
    elapsed = (block - before[0]) * w.calendar.block + (time - before[1])
    if elapsed * len(frame.order) < SHORTEST_PATH * events:
        now = (block * w.calendar.block + time) * frame.time
        raise RunError(
            f"no progress at t = {now:.9g}: {events} events took {elapsed * frame.time:.3g}; "
            "the disks touch all round, and must have room to move"
        )
