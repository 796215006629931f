"""Runs of the exact engine, which can be interrupted and continued.

Each run is drawn from its seed (`initial_state`), equilibrated, run from collision to collision (`run`) and measured
(`ensemble`).
"""

import json
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from brownpipe.engines.ensemble import Batch, Ensemble, Events, RunResult, blank, make_runs, new_batch
from brownpipe.engines.exact.run import (
    NO_CHECKPOINTS,
    Checkpoints,
    PreparedScene,
    RunState,
    beginning,
    new_recorder,
    prepare_scene,
    to_end,
)
from brownpipe.engines.initial_state import draw, without_total_momentum
from brownpipe.engines.units import State
from brownpipe.errors import RunError
from brownpipe.observables.observable import Track
from brownpipe.observables.own import own_arrays
from brownpipe.scene import Scene

Record = TypeVar("Record", bound=NamedTuple)


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
        saving = checkpoints._replace(store=lambda state: checkpoints.store(pack(batch.ensemble, column, state)))
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
    prepared: PreparedScene | None, state: State, stored: RunState | None = None, saving: Checkpoints = NO_CHECKPOINTS
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


# -- checkpoints: the finished runs, and the unfinished one at the end of a block, as named arrays -------------------


def pack(ensemble: Ensemble, finished: int, state: RunState | None) -> dict[str, np.ndarray]:
    """Return named arrays of the first `finished` runs and the state of the next one; they are views, not copies.

    `done` is the number of finished runs; `tracer.*`, `observables`, `whole.SEED.*` and `events.SEED.*` are their
    columns and records in the ensemble, `stopped` its reasons and `own` what is said of one's own arrays, as JSON, if
    there are any; `run.*` is the RunState of the unfinished run, with `run.events.*`.
    """
    arrays = {"done": np.array(finished)}
    if ensemble.tracer is not None:
        arrays |= _named("tracer", ensemble.tracer.of(slice(finished)))
    if finished:
        fields = [(name, values.dtype, values.shape[1:]) for name, values in ensemble.observables.items()]
        arrays["observables"] = np.empty(finished, fields)  # one table, which keeps the order of the observables
        for name, values in ensemble.observables.items():
            arrays["observables"][name] = values[:finished]
    for group, records in (("whole", ensemble.whole), ("events", ensemble.events)):
        for seed, record in records.items():
            arrays |= _named(f"{group}.{seed}", record)
    if ensemble.stopped:
        arrays["stopped"] = np.frombuffer(json.dumps(dict(ensemble.stopped)).encode(), np.uint8)
    if ensemble.own:
        arrays["own"] = np.frombuffer(json.dumps(ensemble.own).encode(), np.uint8)
    if state is not None:
        arrays |= _named("run", state._replace(arrays=None, events=None))
        arrays |= {f"run.{name}": values for name, values in state.arrays.items()}
        arrays |= _named("run.events", state.events)
    return arrays


def resume(arrays: dict[str, np.ndarray] | None, batch: Batch) -> tuple[int, RunState | None]:
    """Copy the finished runs of a checkpoint into a batch; return their number, and the unfinished run, if any."""
    if arrays is None:
        return 0, None
    ensemble = batch.ensemble
    if "stopped" in arrays:
        stopped = json.loads(arrays["stopped"].tobytes())
        ensemble.stopped.update((int(seed), reason) for seed, reason in stopped.items())
    if "own" in arrays:
        ensemble.own.update(own_arrays({"own_arrays": arrays["own"].tobytes()}))
    finished = int(arrays["done"])
    if ensemble.tracer is not None:
        for name, values in ensemble.tracer._asdict().items():
            if values is not None:
                values[:, :finished] = arrays[f"tracer.{name}"]
    for name in arrays["observables"].dtype.names if finished else ():
        column = arrays["observables"][name]
        ensemble.observables[name] = blank((len(ensemble.seeds), *column.shape[1:]), column.dtype)
        ensemble.observables[name][:finished] = column
    for seed in ensemble.seeds[:finished].tolist():
        if whole := _record(Track, arrays, f"whole.{seed}"):
            ensemble.whole[seed] = whole
        if events := _record(Events, arrays, f"events.{seed}"):
            ensemble.events[seed] = events
    if "run.motion" not in arrays:
        return finished, None
    run = {name.removeprefix("run."): values for name, values in arrays.items() if name.startswith("run.")}
    numbers, events = (bool(run["equilibrating"]), int(run["slots"])), _record(Events, arrays, "run.events")
    return finished, RunState(*numbers, run["first"], run["motion"], run, events)


def _named(group: str, record: Any) -> dict[str, np.ndarray]:
    """Return the fields of a record that are not None as arrays, by names that begin with `group`."""
    fields = record._asdict() if record is not None else {}
    return {f"{group}.{name}": np.asarray(value) for name, value in fields.items() if value is not None}


def _record(kind: type[Record], arrays: dict[str, np.ndarray], group: str) -> Record | None:
    """Return the record that `_named` took apart; None if it was None."""
    values = [arrays.get(f"{group}.{name}") for name in kind._fields]
    return None if all(value is None for value in values) else kind._make(values)
