"""Checkpoints of a batch of runs: the finished runs, and the unfinished one at the end of a block, as named arrays."""

import json
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from brownpipe.engines.ensemble import Batch, Ensemble, Events, blank
from brownpipe.engines.exact.run import RunState, Saving
from brownpipe.observables.own import own_arrays
from brownpipe.observables.tracks import Track

Record = TypeVar("Record", bound=NamedTuple)


class Checkpoints(NamedTuple):
    """When to store a batch, how, and what to continue from."""

    due: Callable[[], bool]  # whether to store at the next end of a block
    store: Callable[[dict[str, np.ndarray]], None]  # takes the arrays of `pack`
    stored: dict[str, np.ndarray] | None = None  # arrays of an earlier call of `store`


NO_CHECKPOINTS = Checkpoints(lambda: False, lambda _: None)


def saving_of(checkpoints: Checkpoints, ensemble: Ensemble, column: int) -> Saving:
    """Return when and how the run of this column is stored, together with the finished runs before it."""
    return Saving(checkpoints.due, lambda state: checkpoints.store(pack(ensemble, column, state)))


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
        numbers = {"equilibrating": state.equilibrating, "slots": state.slots}
        motions = {"first": state.first, "motion": state.motion}
        arrays |= {f"run.{name}": np.asarray(value) for name, value in (numbers | motions | state.arrays).items()}
        arrays |= {} if state.events is None else _named("run.events", state.events)
    return arrays


def resume(arrays: dict[str, np.ndarray] | None, batch: Batch) -> tuple[int, RunState | None]:
    """Copy the finished runs of a checkpoint into a batch; return their number, and the unfinished run, if any."""
    if arrays is None:
        return 0, None
    ensemble = batch.ensemble
    if "stopped" in arrays:
        stopped = json.loads(arrays["stopped"].tobytes())
        batch.stopped.update((int(seed), reason) for seed, reason in stopped.items())
    if "own" in arrays:
        batch.own.update(own_arrays({"own_arrays": arrays["own"].tobytes()}))
    finished = int(arrays["done"])
    if ensemble.tracer is not None:
        for values, stored in zip(ensemble.tracer, _record(Track, arrays, "tracer"), strict=True):
            if values is not None:
                values[:, :finished] = stored
    for name in arrays["observables"].dtype.names if finished else ():
        column = arrays["observables"][name]
        ensemble.observables[name] = blank((len(ensemble.seeds), *column.shape[1:]), column.dtype)
        ensemble.observables[name][:finished] = column
    for seed in ensemble.seeds[:finished].tolist():
        if f"whole.{seed}.position" in arrays:
            ensemble.whole[seed] = _record(Track, arrays, f"whole.{seed}")
        if f"events.{seed}.time" in arrays:
            ensemble.events[seed] = _record(Events, arrays, f"events.{seed}")
    if "run.motion" not in arrays:
        return finished, None
    run = {name.removeprefix("run."): values for name, values in arrays.items() if name.startswith("run.")}
    events = _record(Events, arrays, "run.events") if "run.events.time" in arrays else None
    return finished, RunState(bool(run["equilibrating"]), int(run["slots"]), run["first"], run["motion"], run, events)


def _named(group: str, record: NamedTuple) -> dict[str, np.ndarray]:
    """Return the fields of a record that are not None as arrays, by names that begin with `group`."""
    return {f"{group}.{name}": np.asarray(value) for name, value in record._asdict().items() if value is not None}


def _record(kind: type[Record], arrays: dict[str, np.ndarray], group: str) -> Record:
    """Return the record that `_named` took apart."""
    return kind._make(arrays.get(f"{group}.{name}") for name in kind._fields)
