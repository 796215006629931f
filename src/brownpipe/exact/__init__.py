"""The exact engine: hard disks from collision to collision, nothing approximated but the last bit."""

from typing import NamedTuple

import numpy as np

from brownpipe.exact import workspace as ws
from brownpipe.exact.events import advance
from brownpipe.exact.recording import joined, logged, observables, recorder, tracer_track, whole_track
from brownpipe.exact.setup import Frame, fill, frame_of, prepare
from brownpipe.kernels import RunError, one_compiler
from brownpipe.placement import warm_up
from brownpipe.scene import Scene
from brownpipe.state import Ensemble, Events, State, Track, at_rest_on_the_whole, draw

EVENTS_PER_CALL = 2_000_000  # then Python may look at signals and at the progress
SHORTEST_PATH = 2e-16  # in contact distances: disks that move less between collisions are jammed


class Run(NamedTuple):
    """One run from one state."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N
    events: Events | None
    observables: dict[str, float | int]


class Engine(NamedTuple):
    """A scene, and the workspace for its runs."""

    scene: Scene
    frame: Frame
    workspace: ws.Workspace
    pinned: bool


def simulate(scene: Scene, seeds, record=frozenset({"tracer"})) -> Ensemble:
    """Run the scene once for every seed.

    `record` holds words: "tracer" (disk 0 of all runs), "all" (every disk of every run), "events" (every collision).
    Raises RunError if a run makes no progress, SceneError if its disks cannot be placed.
    """
    seeds = np.asarray(seeds, dtype=np.int64)
    times, engine, before = scene.times, prepared(scene), None
    if scene.equilibrate > 0:
        before = prepared(scene, pinned=scene.tracer_while_equilibrating == "pinned")
    tracer = Track(np.empty((len(times), len(seeds), 2)), None, np.empty((len(times), len(seeds), 2), np.int32))
    measured, whole, events = {}, {}, {}
    for column, seed in enumerate(seeds.tolist()):
        try:
            state = draw(scene, seed)
            if before is not None:
                state = _equilibrated(before, state)
            one = run(engine, state, times, record)
        except RunError as error:
            raise RunError(f"{scene.name}, N = {scene.particles}, seed {seed}: {error}") from None
        tracer.position[:, column] = one.tracer.position[:, 0]
        if scene.box.periodic:
            tracer.image[:, column] = one.tracer.image[:, 0]
        for name, value in one.observables.items():
            measured.setdefault(name, np.empty(len(seeds), np.asarray(value).dtype))[column] = value
        if one.whole is not None:
            whole[seed] = one.whole
        if one.events is not None:
            events[seed] = one.events
    tracer = tracer if scene.box.periodic else tracer._replace(image=None)
    return Ensemble(seeds, times, tracer if scene.particles and "tracer" in record else None, measured, whole, events)


def run(engine: Engine, state: State, times: np.ndarray, record=frozenset()) -> Run:
    """Run from a state and sample it at the given times.

    Where a cell or a list proves too small the run begins again with more room. That room is not handed on to the next
    run, which must not depend on it.
    """
    scene, frame, w, pinned = engine
    while True:
        fill(w, state, frame)
        room = recorder(frame, w, times, record)
        outcome, logs = ws.PAUSED, []
        while outcome in (ws.PAUSED, ws.LOG_FULL):
            begun = _now(w)
            outcome = advance(w, room, EVENTS_PER_CALL)
            if outcome in (ws.PAUSED, ws.LOG_FULL):
                _refuse_standstill(w, frame, begun, EVENTS_PER_CALL if outcome == ws.PAUSED else len(room.log_time))
            if len(room.log_time):
                logs.append(logged(room, w, frame))
                w.clock[ws.LOGGED] = 0
        if outcome != ws.CELL_FULL:
            break
        w = prepare(scene, frame, pinned, 2 * w.grid.slots)
    first = state.velocity[frame.order] / (frame.length / frame.time)
    found = observables(scene, frame, w, first)
    return Run(tracer_track(scene, frame, room), whole_track(scene, frame, room), joined(logs), found)


def prepared(scene: Scene, pinned: bool = False) -> Engine:
    """Return what runs of a scene need, with its kernels compiled."""
    frame = frame_of(scene)
    w = prepare(scene, frame, pinned)
    with one_compiler():
        advance(w, recorder(frame, w, scene.times[:0], ()), 0)
        warm_up()
    return Engine(scene, frame, w, pinned)


def _equilibrated(engine: Engine, state: State) -> State:
    """Return a state after the scene's time to equilibrate; a tracer that was pinned then gets its own velocity."""
    scene, begin = engine.scene, state
    if engine.pinned:
        begin = state._replace(velocity=state.velocity * (np.arange(scene.particles) > 0)[:, None])
    done = run(engine, begin, np.array([scene.equilibrate]), {"all"})
    if done.observables["failed"]:
        raise RunError("the time to equilibrate failed its health check")
    position, velocity = done.whole.position[-1], done.whole.velocity[-1]
    if engine.pinned:
        position[0], velocity[0] = state.position[0], state.velocity[0]
    if scene.velocities.zero_momentum:
        velocity = at_rest_on_the_whole(velocity, state.mass)
    return state._replace(position=position, velocity=velocity)


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
