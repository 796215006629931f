"""The time-stepping engine: all disks move straight for a fixed time; those that met on the way then collide.

Collisions are worked out at the moment of contact, in closed form; only what happens to three disks within a step is
approximate. Or, as simpler programs do, late: where disks overlap at the end of a step. Such collisions are up to a
step late, a little displaced, and short ones are missed. Energy and momentum, including what the walls take, are
conserved as by the exact engine.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.engines.batch import RunResult, add_run, errors_name_run, new_batch
from brownpipe.engines.exact.equilibration import states
from brownpipe.engines.kernels import one_compiler
from brownpipe.engines.recording import tracer_track, whole_track
from brownpipe.engines.state import Ensemble, State
from brownpipe.engines.timestep import workspace as ws
from brownpipe.engines.timestep.layout import begin, prepare
from brownpipe.engines.timestep.recording import observables, recorder
from brownpipe.engines.timestep.settings import largest_step, refuse_bad_step, smallest_step
from brownpipe.engines.timestep.steps import advance
from brownpipe.engines.units import Frame, frame_of, motion_of
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

__all__ = ["Engine", "largest_step", "prepared", "run", "simulate", "smallest_step"]

DISK_STEPS_PER_CALL = 100_000_000  # then Python may look at signals


class Engine(NamedTuple):
    """A scene, and the workspace for its runs."""

    scene: Scene
    frame: Frame
    time_step: float  # [time]
    precision: str
    collisions: str
    workspace: ws.Workspace


def simulate(
    scene: Scene,
    seeds,
    record=frozenset({"tracer"}),
    *,
    observables=(),
    average: str = "runs",
    time_step: float,
    precision: str = "double",
    collisions: str = "at_contact",
) -> Ensemble:
    """Run the scene once for every seed, from the same initial states as the exact engine.

    `record` holds words: "tracer" (disk 0 of all runs), "all" (every disk of every run). `precision` is "double" or
    "single": of positions, velocities and all that is computed for every disk and pair. `collisions` are "at_contact",
    where a pair met within the step, or "late", where it overlaps at the end of the step.
    A sample is a free flight from the last step before it, so that no step depends on when samples are taken.
    Raises RequestError for a time step that is no positive number, or too long or too short (`refuse_bad_step`), for a
    record of events, and if disks cannot be placed; RunError if the time to equilibrate fails.
    """
    if "events" in record:
        raise RequestError("record: must be tracer, all or none, as collisions happen between time steps; found events")
    batch = new_batch(scene, seeds, record, observables, average)
    initial_state = states(scene)
    engine = prepared(scene, time_step, precision, collisions)
    for column, seed in enumerate(batch.ensemble.seeds.tolist()):
        with errors_name_run(scene, seed):
            add_run(batch, column, run(engine, initial_state(seed), scene.times, batch.needed_record))
    return batch.ensemble


def prepared(scene: Scene, time_step: float, precision: str = "double", collisions: str = "at_contact") -> Engine:
    """Return what runs of a scene need, with its kernels compiled."""
    refuse_bad_step(scene, time_step, precision, collisions)
    frame = frame_of(scene)
    w = prepare(scene, frame, time_step, precision, collisions)
    with one_compiler(w):
        advance(w, recorder(scene, frame, time_step, scene.times[:0], ()), 0)
    return Engine(scene, frame, time_step, precision, collisions, w)


def run(engine: Engine, state: State, times: np.ndarray, record=frozenset()) -> RunResult:
    """Run from a state and sample at the given times."""
    scene, frame, time_step, w = engine.scene, engine.frame, engine.time_step, engine.workspace
    room = recorder(scene, frame, time_step, times, record)
    begin(w, motion_of(state, frame))
    first = np.stack([w.vx, w.vy], axis=1).astype(float)
    most = 1 + DISK_STEPS_PER_CALL // max(scene.particles, 1)
    while (outcome := advance(w, room, most)) != ws.DONE:
        if outcome == ws.NO_ROOM:
            w = _with_more_room(engine, w)
    found = observables(scene, frame, w, first)
    return RunResult(tracer_track(scene, frame, room), whole_track(scene, frame, room), None, found)


def _with_more_room(engine: Engine, w: ws.Workspace) -> ws.Workspace:
    """Return the workspace as it is, with twice the room for pairs on the lists."""
    scene, frame, time_step, precision, collisions, _ = engine
    more = prepare(scene, frame, time_step, precision, collisions, 2 * len(w.within.a))
    names = ("within", "across", "hit", "contact_time", "contact_key", "contact_pair")
    return w._replace(**{name: getattr(more, name) for name in names})
