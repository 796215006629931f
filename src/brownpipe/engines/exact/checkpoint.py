"""Checkpoints of a batch of runs: the finished runs, and the unfinished one at the end of a block, as named arrays."""

import json
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from brownpipe.engines.batch import Batch
from brownpipe.engines.exact.layout import LEAST_SLOTS
from brownpipe.engines.exact.run import RunState, Saving
from brownpipe.engines.recording import SAMPLES
from brownpipe.engines.state import Ensemble, Events, Track, blank
from brownpipe.errors import StorageError

Record = TypeVar("Record", bound=NamedTuple)
Layout = tuple[np.dtype, tuple[int, ...]]  # type and shape of an array


class Checkpoints(NamedTuple):
    """When to store a batch, how, and what to continue from."""

    due: Callable[[], bool]  # whether to store at the next end of a block
    store: Callable[[dict[str, np.ndarray]], None]  # takes the arrays of `pack`
    stored: dict[str, np.ndarray] | None = None  # arrays of an earlier call of `store`


MOST_STORED_SLOTS = 2**24  # of a cell in a stored state
NO_CHECKPOINTS = Checkpoints(lambda: False, lambda _: None)


def saving_of(checkpoints: Checkpoints, ensemble: Ensemble, column: int) -> Saving:
    """Return when and how the run of this column is stored, together with the finished runs before it."""
    return Saving(checkpoints.due, lambda state: checkpoints.store(pack(ensemble, column, state)))


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


def resume(arrays: dict[str, np.ndarray] | None, batch: Batch) -> tuple[int, RunState | None]:
    """Copy the finished runs of a checkpoint, if there is one, into a batch; return what `unpack` does.

    Raises StorageError for arrays that are not those of `pack` for such a batch.
    """
    if arrays is None:
        return 0, None
    try:
        batch.stopped.update(_stopped_in(arrays))
        expected = _expected(arrays, batch)
        found = {name: (array.dtype, array.shape) for name, array in arrays.items()}
        wrong = [name for name in found.keys() | expected if found.get(name) != expected.get(name)]
        finished, state = (0, None) if wrong else unpack(arrays, batch.ensemble)
        if state is not None and not LEAST_SLOTS <= state.slots <= MOST_STORED_SLOTS:
            wrong = ["run.slots"]
    except (AttributeError, IndexError, KeyError, RecursionError, TypeError, ValueError) as error:
        wrong = [type(error).__name__]
    if wrong:
        unfit = f"the checkpoint does not fit the scene and the seeds ({min(wrong)})"
        raise StorageError(f"{unfit}; delete it to begin anew")
    return finished, state


def _expected(arrays: dict[str, np.ndarray], batch: Batch) -> dict[str, Layout]:
    """Return the layout of each array that `pack` has for such a batch.

    The arrays themselves say how many runs are finished, which of them stopped, what observables they have, how many
    collisions there were and whether a run is unfinished; the arrays of its state are for `run.evolve` to compare.
    Raises KeyError for a missing array, and IndexError, TypeError or ValueError for one that says nothing of the kind.
    """
    ensemble, finished = batch.ensemble, arrays["done"].item()
    if not 0 <= finished <= len(ensemble.seeds):
        raise ValueError("number of runs")
    expected: dict[str, Layout] = {"done": (np.dtype(int), ())}
    if ensemble.tracer is not None:
        tracer = _named("tracer", ensemble.tracer.of(slice(finished)))
        expected |= {name: (values.dtype, values.shape) for name, values in tracer.items()}
    if finished:
        expected["observables"] = (arrays["observables"].dtype, (finished,))
    if batch.stopped:
        expected["stopped"] = (np.dtype(np.uint8), arrays["stopped"].shape)
    for seed in set(ensemble.seeds[:finished].tolist()) - batch.stopped.keys():
        expected |= _layouts_of_whole(f"whole.{seed}", batch) if "all" in batch.record else {}
        expected |= _layouts_of_log(f"events.{seed}", arrays) if "events" in batch.record else {}
    if "run.slots" in arrays:
        absent = {"samples", "events"} if batch.scene.box.periodic else {"samples", "events", "image"}
        names = [*(name for name in RunState._fields if name not in absent), *(f"samples.{name}" for name in SAMPLES)]
        expected |= {f"run.{name}": (arrays[f"run.{name}"].dtype, arrays[f"run.{name}"].shape) for name in names}
        expected |= {"run.equilibrating": (np.dtype(bool), ()), "run.slots": (np.dtype(int), ())}
        if "events" in batch.record and not arrays["run.equilibrating"].item():
            expected |= _layouts_of_log("run.events", arrays)
    return expected


def _layouts_of_whole(group: str, batch: Batch) -> dict[str, Layout]:
    """Return the layouts of the trajectories of all disks in one run."""
    shape = (len(batch.ensemble.times), batch.scene.particles, 2)
    layouts = {f"{group}.{name}": (np.dtype(float), shape) for name in ("position", "velocity")}
    return layouts | ({f"{group}.image": (np.dtype(np.int32), shape)} if batch.scene.box.periodic else {})


def _layouts_of_log(group: str, arrays: dict[str, np.ndarray]) -> dict[str, Layout]:
    """Return the layouts of a log of as many collisions as it has times."""
    count = arrays[f"{group}.time"].shape[0]
    times, disks, impulses = (np.dtype(float), (count,)), (np.dtype(np.int32), (count,)), (np.dtype(float), (count, 2))
    return {f"{group}.time": times, f"{group}.a": disks, f"{group}.b": disks, f"{group}.impulse": impulses}


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


def _stopped_in(arrays: dict[str, np.ndarray]) -> dict[int, str]:
    """Return why runs of a stored batch could not go on, by seed.

    Raises AttributeError, RecursionError or ValueError for other text.
    """
    stored = json.loads(arrays["stopped"].tobytes()) if "stopped" in arrays else {}
    return {int(seed): str(reason) for seed, reason in stored.items()}


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
