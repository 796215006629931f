"""The exact engine: hard disks from collision to collision, nothing approximated but the last bit."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from brownpipe.engines.batch import Run, enter, request, room_for
from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.checkpoint import NEVER, Midway, Watch, midway_of, pack, restore, unpack
from brownpipe.engines.exact.events import advance
from brownpipe.engines.exact.layout import begin, prepare
from brownpipe.engines.exact.recording import joined, logged, observables, recorder
from brownpipe.engines.initial_state import at_rest_on_the_whole, draw
from brownpipe.engines.insertion import warm_up
from brownpipe.engines.kernels import one_compiler
from brownpipe.engines.recording import tracer_track, whole_track
from brownpipe.engines.state import Ensemble, Events, State
from brownpipe.engines.units import Frame, frame_of, motion_of
from brownpipe.errors import RequestError, RunError
from brownpipe.scene import Scene

EVENTS_PER_CALL = 2_000_000  # then Python may look at signals and at the progress
SHORTEST_PATH = 2e-16  # in contact distances: disks that move less between collisions are jammed


class Engine(NamedTuple):
    """A scene, and the workspace for its runs."""

    scene: Scene
    frame: Frame
    workspace: ws.Workspace
    pinned: bool


def simulate(
    scene: Scene,
    seeds,
    record=frozenset({"tracer"}),
    watch: Watch = NEVER,
    kept=None,
    *,
    observables=(),
    average: str = "runs",
) -> Ensemble:
    """Run the scene once for every seed.

    `record` holds words: "tracer" (disk 0 of all runs), "all" (every disk of every run), "events" (every collision).
    `observables` are measured in each run, whose tracks are then dropped if they are not to be kept; `average` says
    what displacements and autocorrelations among them are averages over (brownpipe.observables).
    Whenever the next checkpoint is due, `watch.keep` is given named arrays, and a call with these as `kept`, all else
    being the same, goes on from there and returns the same to the last bit.
    Raises RunError if a run makes no progress, RequestError if its disks cannot be placed or have no such observables.
    """
    asked = request(scene, record, observables, average)
    batch, engines = room_for(asked, seeds), _engines(scene)
    done, midway = (0, None) if kept is None else unpack(kept, batch)
    for column in range(done, len(batch.seeds)):
        seed = int(batch.seeds[column])
        inside = watch._replace(keep=partial(_keep, watch, batch, column))
        try:
            enter(batch, column, _one(engines, seed, asked.needed, inside, midway), asked)
        except (RunError, RequestError) as error:
            raise type(error)(f"{scene.name}, N = {scene.particles}, seed {seed}: {error}") from None
        midway = None
        if column + 1 < len(batch.seeds) and watch.due():
            _keep(watch, batch, column + 1, None)
    return batch


def run(
    engine: Engine,
    state: State | None,
    times: np.ndarray,
    record=frozenset(),
    watch: Watch = NEVER,
    midway: Midway | None = None,
) -> Run:
    """Run from a state, or on from midway, and sample at the given times.

    Where a cell or a list proves too small the run begins again with more room. That room is not handed on to the next
    run, which must not depend on it.
    """
    scene, frame, w, pinned = engine
    first = motion_of(state, frame) if midway is None else midway.first
    if midway is not None and midway.slots != w.grid.slots:
        w = prepare(scene, frame, pinned, midway.slots)
    while True:
        begin(w, first)
        room, logs = recorder(frame, w, times, record), []
        if midway is not None:
            logs = restore(midway, w, room)
        if _finish(frame, w, room, first, logs, watch):
            break
        w, midway = prepare(scene, frame, pinned, 2 * w.grid.slots), None
    found = observables(scene, frame, w, first[:, 2:])
    return Run(tracer_track(scene, frame, room), whole_track(scene, frame, room), joined(logs), found)


def prepared(scene: Scene, pinned: bool = False) -> Engine:
    """Return what runs of a scene need, with its kernels compiled."""
    frame = frame_of(scene)
    w = prepare(scene, frame, pinned)
    with one_compiler(w):
        advance(w, recorder(frame, w, scene.times[:0], ()), 0)
        warm_up()
    return Engine(scene, frame, w, pinned)


def states(scene: Scene) -> Callable[[int], State]:
    """Return the function from a seed to its state at t = 0, drawn and equilibrated, where any engine begins.

    It raises RunError if the time to equilibrate fails, RequestError if the disks cannot be placed.
    """
    return partial(_state, scene, _equilibrator(scene))


def _engines(scene: Scene) -> tuple[Engine, Engine | None]:
    """Return what runs, and what equilibrates before, if that is asked for."""
    before = _equilibrator(scene)
    return prepared(scene), before


def _equilibrator(scene: Scene) -> Engine | None:
    return prepared(scene, scene.tracer_while_equilibrating == "pinned") if scene.equilibrate > 0 else None


def _keep(watch: Watch, batch: Ensemble, done: int, midway: Midway | None) -> None:
    watch.keep(pack(batch, done, midway))


def _one(engines, seed: int, record, watch: Watch, midway: Midway | None) -> Run:
    """Run one seed, from its beginning or on from midway."""
    engine, before = engines
    if midway is not None and not midway.equilibrating:
        return run(engine, None, engine.scene.times, record, watch, midway)
    state = _state(engine.scene, before, seed, watch, midway)
    return run(engine, state, engine.scene.times, record, watch)


def _state(scene: Scene, before: Engine | None, seed: int, watch: Watch = NEVER, midway: Midway | None = None) -> State:
    state = draw(scene, seed)
    return state if before is None else _equilibrated(before, state, watch, midway)


def _equilibrated(engine: Engine, state: State, watch: Watch, midway: Midway | None) -> State:
    """Return a state after the scene's time to equilibrate; a tracer that was pinned then gets its own velocity."""
    scene, begun = engine.scene, state
    if engine.pinned:
        begun = state._replace(velocity=state.velocity * (np.arange(scene.particles) > 0)[:, None])
    watch = watch._replace(keep=lambda one, keep=watch.keep: keep(one._replace(equilibrating=True)))
    done = run(engine, begun, np.array([scene.equilibrate]), {"all"}, watch, midway)
    if done.observables["failed"]:
        raise RunError("the time to equilibrate failed its health check")
    position, velocity = done.whole.position[-1], done.whole.velocity[-1]
    if engine.pinned:
        position[0], velocity[0] = state.position[0], state.velocity[0]
    if scene.velocities.zero_momentum:
        velocity = at_rest_on_the_whole(velocity, state.mass)
    return state._replace(position=position, velocity=velocity)


def _finish(frame: Frame, w: ws.Workspace, room: ws.Recorder, first, logs: list[Events], watch: Watch) -> bool:
    """Run to the last sample and append to the logs; return False if a cell has too little room for that."""
    while True:
        w.clock[ws.STOP] = watch.due()
        begun = _now(w)
        outcome = advance(w, room, EVENTS_PER_CALL)
        if outcome in (ws.PAUSED, ws.LOG_FULL):
            _refuse_standstill(w, frame, begun, EVENTS_PER_CALL if outcome == ws.PAUSED else len(room.log_time))
        if len(room.log_time):
            logs.append(logged(room, w, frame))
            w.clock[ws.LOGGED] = 0
        if outcome in (ws.DONE, ws.CELL_FULL):
            return outcome == ws.DONE
        if outcome == ws.BLOCK_OVER:
            watch.keep(midway_of(w, room, first, logs))


def _now(w: ws.Workspace) -> tuple[int, float]:
    """Return block and local time."""
    return int(w.clock[ws.BLOCK]), float(w.tally[ws.NOW])


def _refuse_standstill(w: ws.Workspace, frame: Frame, begun: tuple[int, float], events: int) -> None:
    """Raise RunError if the (at least so many) events since `begun` took so little time that it is below round-off."""
    blocks, time = _now(w)
    elapsed = (blocks - begun[0]) * w.calendar.block + (time - begun[1])
    if elapsed * len(frame.order) < SHORTEST_PATH * events:
        at = (blocks * w.calendar.block + time) * frame.time
        raise RunError(
            f"no progress at t = {at:.9g}: {events} events took {elapsed * frame.time:.3g}; "
            "the disks touch all round, and must have room to move"
        )
