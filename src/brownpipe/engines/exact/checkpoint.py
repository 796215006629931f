"""Checkpoints of a batch of runs: the finished runs, and the unfinished one at the end of a block, as named arrays."""

import json
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

import numpy as np

from brownpipe.engines.exact.run import RunState, never
from brownpipe.engines.recording import SAMPLES
from brownpipe.engines.state import Ensemble, Events, Track, blank
from brownpipe.errors import StorageError

Record = TypeVar("Record", bound=NamedTuple)


class Checkpoints(NamedTuple):
    """When to store a batch, how, and what to continue from."""

    due: Callable[[], bool]  # whether to store at the next end of a block
    store: Callable[[dict[str, np.ndarray]], None]  # takes the arrays of `pack`
    stored: dict[str, np.ndarray] | None = None  # arrays of an earlier call of `store`


MOST_SLOTS = 2**24  # of a cell in a stored state
NO_CHECKPOINTS = Checkpoints(never, lambda _: None)


def complete(
    ensemble: Ensemble,
    make_run: Callable[[int, RunState | None, Callable[[], bool]], Iterable[RunState]],
    checkpoints: Checkpoints,
) -> None:
    """Make all runs of an ensemble, after those in the stored checkpoint, and store checkpoints when they are due.

    `make_run(column, stored, due)` fills one column of the ensemble. It continues from the stored state of this run, if
    there is one, and yields the run's state at the end of a block when a checkpoint is due.
    """
    finished, stored = (0, None) if checkpoints.stored is None else _unpacked(checkpoints.stored, ensemble)
    runs = len(ensemble.seeds)
    for column in range(finished, runs):
        for state in make_run(column, stored, checkpoints.due):
            checkpoints.store(pack(ensemble, column, state))
        stored = None
        if column + 1 < runs and checkpoints.due():
            checkpoints.store(pack(ensemble, column + 1, None))


def pack(ensemble: Ensemble, finished: int, state: RunState | None) -> dict[str, np.ndarray]:
    """Return named arrays of the first `finished` runs and the state of the next one; they are views, not copies.

    `done` is the number of finished runs; `tracer.*`, `observables`, `whole.SEED.*` and `events.SEED.*` are their
    columns and records in the ensemble, `stopped` its reasons as JSON, if there are any; `run.*` is the RunState of the
    unfinished run, with `run.samples.*` and `run.events.*`.
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
    if state is not None:
        arrays |= _named("run", state._replace(samples=None, events=None))
        arrays |= {f"run.samples.{name}": rows for name, rows in state.samples.items()}
        arrays |= {} if state.events is None else _named("run.events", state.events)
    return arrays


def _unpacked(arrays: dict[str, np.ndarray], ensemble: Ensemble) -> tuple[int, RunState | None]:
    """Do the same as `unpack`; raise StorageError for arrays that are not those of `pack` for such an ensemble."""
    try:
        finished, state = unpack(arrays, ensemble)
        if not 0 <= finished <= len(ensemble.seeds) or (state is not None and not 0 < state.slots <= MOST_SLOTS):
            raise ValueError("number of runs")
        logs = [*ensemble.events.values(), *([state.events] if state is not None and state.events is not None else [])]
        if not all(map(_is_log, logs)) or not all(_is_track(track, ensemble) for track in ensemble.whole.values()):
            raise ValueError("shapes")
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        wrong = "the checkpoint does not fit the scene and the seeds"
        raise StorageError(f"{wrong} ({type(error).__name__}); delete it to begin anew") from error
    return finished, state


def _is_log(events: Events) -> bool:
    """Whether the arrays of collisions have the types and shapes of `state.Events`."""
    if any(values is None or values.ndim == 0 for values in events):
        return False
    count = len(events.time)
    shapes = [(values.shape, values.dtype) for values in events]
    disks, numbers = np.dtype(np.int32), np.dtype(float)
    return shapes == [((count,), numbers), ((count,), disks), ((count,), disks), ((count, 2), numbers)]


def _is_track(track: Track, ensemble: Ensemble) -> bool:
    """Whether the arrays of a whole run have one shape (T, N, 2)."""
    shapes = {values.shape for values in track if values is not None}
    (shape,) = shapes if len(shapes) == 1 else [()]
    return len(shape) == 3 and shape[0] == len(ensemble.times) and shape[2] == 2


def unpack(arrays: dict[str, np.ndarray], ensemble: Ensemble) -> tuple[int, RunState | None]:
    """Copy the finished runs into an ensemble; return their number, and the state of the unfinished run, if any."""
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
    return finished, _run_state(arrays) if "run.progress" in arrays else None


def stopped_in(checkpoints: Checkpoints) -> dict[int, str]:
    """Return why runs of a stored batch could not go on, by seed."""
    if checkpoints.stored is None or "stopped" not in checkpoints.stored:
        return {}
    return {int(seed): reason for seed, reason in json.loads(checkpoints.stored["stopped"].tobytes()).items()}


def _run_state(arrays: dict[str, np.ndarray]) -> RunState:
    state = _record(RunState, arrays, "run")
    return state._replace(
        equilibrating=bool(state.equilibrating),
        slots=int(state.slots),
        samples={name: arrays[f"run.samples.{name}"] for name in SAMPLES},
        events=_record(Events, arrays, "run.events") if "run.events.time" in arrays else None,
    )


def _named(group: str, record: NamedTuple) -> dict[str, np.ndarray]:
    """Return the fields of a record that are not None as arrays, by names that begin with `group`."""
    return {f"{group}.{name}": np.asarray(value) for name, value in record._asdict().items() if value is not None}


def _record(kind: type[Record], arrays: dict[str, np.ndarray], group: str) -> Record:
    """Return the record that `_named` took apart."""
    return kind._make(arrays.get(f"{group}.{name}") for name in kind._fields)
