"""The exact engine: hard disks from collision to collision, nothing approximated but the last bit."""

from typing import NamedTuple

import numpy as np

from brownpipe.exact import workspace as ws
from brownpipe.exact.events import advance
from brownpipe.exact.setup import Frame, fill, frame_of, prepare
from brownpipe.kernels import one_compiler
from brownpipe.scene import Scene
from brownpipe.state import Ensemble, Events, State, Track, draw

EVENTS_PER_CALL = 2_000_000  # then Python may look at signals and at the progress
EVENTS_PER_LOG = 65_536  # then they are moved to where there is room for more
MOST_DRIFT = 1e-9  # of the energy, relative: a run beyond is marked failed
MOST_OVERLAP = 1e-9  # of a contact distance


class Run(NamedTuple):
    """One run from one seed."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N
    events: Events | None
    observables: dict[str, float | int]


def simulate(scene: Scene, seeds, record=frozenset({"tracer"})) -> Ensemble:
    """Run the scene once for every seed.

    `record` holds words: "tracer" (disk 0 of all runs), "all" (every disk of every run), "events" (every collision).
    Raises RunError if a run makes no progress, SceneError if its disks cannot be placed.
    """
    seeds = np.asarray(seeds, dtype=np.int64)
    times, frame = scene.times, frame_of(scene)
    w = prepare(scene, frame)
    with one_compiler():
        advance(w, _recorder(frame, w, times[:0], record), 0)
    position = np.empty((len(times), len(seeds), 2))
    image = np.empty((len(times), len(seeds), 2), np.int32) if scene.box.periodic else None
    observables, whole, events = {}, {}, {}
    for column, seed in enumerate(seeds.tolist()):
        w, run = run_one(scene, frame, w, draw(scene, seed), times, record)
        position[:, column] = run.tracer.position[:, 0]
        if image is not None:
            image[:, column] = run.tracer.image[:, 0]
        for name, value in run.observables.items():
            observables.setdefault(name, np.empty(len(seeds), np.asarray(value).dtype))[column] = value
        if run.whole is not None:
            whole[seed] = run.whole
        if run.events is not None:
            events[seed] = run.events
    tracer = Track(position, None, image) if scene.particles and "tracer" in record else None
    return Ensemble(seeds, times, tracer, observables, whole, events)


def run_one(scene: Scene, frame: Frame, w: ws.Workspace, state: State, times, record) -> tuple[ws.Workspace, Run]:
    """Run from a state and sample it at the given times; return the workspace (larger, if need be) and the run."""
    first = state.velocity[frame.order] / (frame.length / frame.time)
    while True:
        fill(w, state, frame)
        recorder = _recorder(frame, w, times, record)
        outcome = ws.PAUSED
        log = []
        while outcome in (ws.PAUSED, ws.LOG_FULL):
            outcome = advance(w, recorder, EVENTS_PER_CALL)
            if len(recorder.log_time):
                log.append(_events(recorder, w, frame))
                w.clock[ws.LOGGED] = 0
        if outcome != ws.CELL_FULL:
            return w, _run(scene, frame, w, recorder, first, log)
        w = prepare(scene, frame, 2 * w.grid.slots)


def _recorder(frame: Frame, w: ws.Workspace, times: np.ndarray, record) -> ws.Recorder:
    n, t = len(frame.order), len(times)
    inner = times / frame.time
    block = np.floor(inner / w.calendar.block)
    local = inner - block * w.calendar.block
    m = n if "all" in record else 0
    room = EVENTS_PER_LOG if "events" in record else 0
    return ws.Recorder(
        tracer=int(frame.back[0]) if n else 0,
        block=block.astype(np.int64),
        time=local,
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


def _track(scene: Scene, frame: Frame, position, velocity, image, back) -> Track:
    """Return a record in the scene's units and order."""
    return Track(
        position[:, back] * frame.length + frame.origin,
        velocity[:, back] * (frame.length / frame.time),
        image[:, back] if scene.box.periodic else None,
    )


def _events(r: ws.Recorder, w: ws.Workspace, frame: Frame) -> Events:
    n = w.clock[ws.LOGGED]
    time = (r.log_block[:n] * w.calendar.block + r.log_time[:n]) * frame.time
    pair = r.log_pair[:n]
    named = np.where(pair >= 0, frame.order[np.maximum(pair, 0)], pair).astype(np.int32)
    return Events(time, named[:, 0], named[:, 1], r.log_impulse[:n] * (frame.mass * frame.length / frame.time))


def _run(scene, frame, w, r, first, log) -> Run:
    disk = w.disk.reshape(-1, ws.ROW)
    mass = np.ones(len(disk)) if w.mass is None else w.mass
    last = disk[:, ws.VX : ws.VX + 2]
    energy = [np.sum(mass * np.sum(v * v, axis=1)) for v in (first, last)]
    drift = (energy[1] - energy[0]) / energy[0] if energy[0] > 0 else 0.0
    left, right, bottom, top = w.tally[ws.WALL_IMPULSE : ws.WALL_IMPULSE + 4]
    given = np.array((left - right, bottom - top))
    momentum = mass @ last - mass @ first - given
    scale = np.sum(mass * np.sqrt(np.sum(first * first, axis=1))) + left + right + bottom + top
    overlap = max(0.0, 1.0 - np.sqrt(max(0.0, 1.0 + min(w.tally[ws.NEAREST], 0.0))))
    observables = {
        "pair_collisions": int(w.count[ws.PAIRS]),
        "wall_collisions": int(w.count[ws.WALLS]),
        "tracer_collisions": int(w.count[ws.TRACER_PAIRS]),
        "energy_drift": float(drift),
        "worst_overlap": float(overlap),
        "momentum_residual": float(np.abs(momentum).max() / scale) if scale > 0 else 0.0,
        "failed": np.uint8(not (abs(drift) <= MOST_DRIFT and overlap <= MOST_OVERLAP)),
    }
    tracer = _track(scene, frame, r.position, r.velocity, r.image, [0])
    whole = None
    if r.whole_position.shape[1]:
        whole = _track(scene, frame, r.whole_position, r.whole_velocity, r.whole_image, frame.back)
    events = Events(*map(np.concatenate, zip(*log, strict=True))) if log else None
    return Run(tracer, whole, events, observables)
