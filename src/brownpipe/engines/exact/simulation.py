"""Runs of the exact engine, which can be interrupted and continued (`checkpoint`).

Each run is drawn from its seed (`initial_state`), equilibrated, run from collision to collision (`run`) and measured
(`ensemble`).
"""

from collections.abc import Collection, Sequence

import numpy as np

from brownpipe.engines.ensemble import Ensemble, RunResult, make_runs, new_batch
from brownpipe.engines.exact.checkpoint import NO_CHECKPOINTS, Checkpoints, pack, resume, saving_of
from brownpipe.engines.exact.run import (
    NOT_SAVED,
    PreparedScene,
    RunState,
    Saving,
    beginning,
    new_recorder,
    prepare_scene,
    to_end,
)
from brownpipe.engines.initial_state import draw, without_total_momentum
from brownpipe.engines.units import State
from brownpipe.errors import RunError
from brownpipe.scene import Scene


def simulate(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str] = frozenset({"tracer"}),
    checkpoints: Checkpoints = NO_CHECKPOINTS,
    *,
    observables: Collection[str] = (),
    average: str = "runs",
) -> Ensemble:
    """Run the scene once for every seed.

    `record` is a set of words: "tracer" (disk 0 of all runs), "all" (every disk of every run), "events" (every
    collision). `observables` are measured in each run, even if its trajectory is not recorded; `average` says over
    what displacements and autocorrelations among them are averaged (brownpipe.observables).
    `checkpoints` says when the state of the batch is stored, and which stored state to continue from; the result is
    bit-identical to that of an uninterrupted batch.
    A run that makes no progress, whose equilibration fails or whose disks find no place at random is failed, with
    the reason in `stopped`. Raises RequestError if the scene leaves no place for its disks in any run, or has no such
    observables.
    """
    batch = new_batch(scene, seeds, record, observables, average)
    equilibrator, prepared = prepare_equilibration(scene), prepare_scene(scene)
    recorder = new_recorder(prepared, scene.times, batch.needed_record)
    finished, unfinished = resume(checkpoints.stored, batch)

    def run(column: int) -> RunResult:
        saving = saving_of(checkpoints, batch.ensemble, column)
        start = unfinished if column == finished else None
        if start is None or start.equilibrating:
            drawn = draw(scene, int(batch.ensemble.seeds[column]))
            start = beginning(prepared, equilibrate(equilibrator, drawn, start, saving))
        return to_end(prepared, start, recorder, saving)

    def store(done: int) -> None:
        if done < len(batch.ensemble.seeds) and checkpoints.due():
            checkpoints.store(pack(batch.ensemble, done, None))

    return make_runs(batch, run, finished, store)


# -- the state at t = 0, from which all engines that move all disks start ---------------------------------------------


def prepare_equilibration(scene: Scene) -> PreparedScene | None:
    """Return what equilibrates the states of a scene; None if it has no time to equilibrate."""
    return prepare_scene(scene, scene.equilibrate.tracer == "pinned") if scene.equilibrate.time > 0 else None


def equilibrate(
    prepared: PreparedScene | None, state: State, stored: RunState | None = None, saving: Saving = NOT_SAVED
) -> State:
    """Run a drawn state for the scene's time to equilibrate, or continue a stored run; return the state at t = 0.

    `prepared` is from `prepare_equilibration`; if it is None, the drawn state is returned. A pinned tracer keeps its
    place and regains its velocity at t = 0. Raises RunError if the run fails its health check or makes no progress.
    """
    if prepared is None:
        return state
    scene = prepared.scene
    moving = np.arange(len(state.mass)) >= int(prepared.pinned)  # all disks, or all but the tracer
    start = stored or beginning(prepared, state._replace(velocity=state.velocity * moving[:, None]), True)
    result = to_end(prepared, start, new_recorder(prepared, np.array([scene.equilibrate.time]), {"all"}), saving)
    if result.observables["failed"]:
        raise RunError("the time to equilibrate failed its health check")
    position, velocity = result.whole.position[-1], result.whole.velocity[-1]
    if prepared.pinned:
        position[0] = state.position[0]
        velocity[0] = state.velocity[0]
    if scene.velocities.zero_momentum:
        velocity = without_total_momentum(velocity, state.mass)
    return state._replace(position=position, velocity=velocity)
