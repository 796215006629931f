"""How far a batch of runs is: the runs that are finished and one at the end of a block, as arrays that can be kept.

At the end of a block all disks are at the same time, and the next block begins from their positions and velocities
alone (`events.begin_block`): cells, calendar and links are made anew. A run that goes on from what is kept here
therefore takes the same course, to the last bit, as one that was never interrupted.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from brownpipe.engines.exact import workspace as ws
from brownpipe.engines.exact.recording import joined
from brownpipe.engines.state import Ensemble, Events, Track

SAMPLES = ("position", "velocity", "image", "whole_position", "whole_velocity", "whole_image")  # of a Recorder


class Midway(NamedTuple):
    """One run at the end of a block, in the engine's units and order."""

    equilibrating: bool  # on its way to t = 0
    slots: int  # of a cell: in more room than usual a run keeps no neighbour lists, and rounds otherwise
    first: np.ndarray  # (N, 4) positions and velocities that it began with
    motion: np.ndarray  # (N, 4) those it has now
    image: np.ndarray | None  # (2 N,) int32, periodic boxes
    clock: np.ndarray
    count: np.ndarray
    tally: np.ndarray
    samples: dict[str, np.ndarray]  # the rows of a Recorder that are taken
    events: Events | None  # so far, if logged; in the scene's units and order


class Watch(NamedTuple):
    """When to stop at the end of a block, and what to do with what is then known."""

    due: Callable[[], bool]
    keep: Callable[[object], None]  # takes what is to be kept: a Midway of a run, the arrays of `pack` of a batch


NEVER = Watch(lambda: False, lambda _: None)


def midway_of(w: ws.Workspace, r: ws.Recorder, first: np.ndarray, logs: list[Events]) -> Midway:
    """Return a run at the end of a block. The arrays are not copied: use them before the run goes on."""
    samples = {name: getattr(r, name)[: w.clock[ws.SAMPLE]] for name in SAMPLES}
    motion = w.disk.reshape(-1, ws.ROW)[:, ws.MOTION]
    return Midway(False, w.grid.slots, first, motion, w.image, w.clock, w.count, w.tally, samples, joined(logs))


def restore(kept: Midway, w: ws.Workspace, r: ws.Recorder) -> list[Events]:
    """Set a workspace and a recorder to the end of a block, and return the log so far.

    What the next block makes anew is left as it is.
    """
    disk = w.disk.reshape(-1, ws.ROW)
    disk[:, ws.MOTION], disk[:, ws.TIME] = kept.motion, 0.0
    w.clock[:], w.count[:], w.tally[:] = kept.clock, kept.count, kept.tally
    if w.image is not None:
        w.image[:] = kept.image
    for name, rows in kept.samples.items():
        getattr(r, name)[: len(rows)] = rows
    return [] if kept.events is None else [kept.events]


def pack(batch: Ensemble, done: int, kept: Midway | None) -> dict[str, np.ndarray]:
    """Return named arrays with the first `done` runs of a batch, and one run in mid-flight. They are not copied."""
    arrays = {"done": np.array(done)}
    if batch.tracer is not None:
        arrays |= _named("tracer", Track(*(_columns(value, done) for value in batch.tracer)))
    if done:
        kinds = [(name, value.dtype, value.shape[1:]) for name, value in batch.observables.items()]
        arrays["observables"] = np.empty(done, kinds)  # one table, as the order of its columns counts, too
        for name, value in batch.observables.items():
            arrays["observables"][name] = value[:done]
    for group, runs in (("whole", batch.whole), ("events", batch.events)):
        for seed, one in runs.items():
            arrays |= _named(f"{group}.{seed}", one)
    if kept is not None:
        arrays |= _named("run", kept._replace(samples=None, events=None))
        arrays |= {f"run.samples.{name}": value for name, value in kept.samples.items()}
        arrays |= {} if kept.events is None else _named("run.events", kept.events)
    return arrays


def unpack(arrays: dict[str, np.ndarray], batch: Ensemble) -> tuple[int, Midway | None]:
    """Enter the runs that are finished into a batch; return how many there are, and the one in mid-flight."""
    done = int(arrays["done"])
    for whole, part in zip(batch.tracer or (), _record(Track, arrays, "tracer"), strict=batch.tracer is not None):
        if whole is not None:
            whole[:, :done] = part
    for name in arrays["observables"].dtype.names if done else ():
        column = arrays["observables"][name]
        batch.observables[name] = np.empty((len(batch.seeds), *column.shape[1:]), column.dtype)
        batch.observables[name][:done] = column
    for seed in batch.seeds[:done].tolist():
        if f"whole.{seed}.position" in arrays:
            batch.whole[seed] = _record(Track, arrays, f"whole.{seed}")
        if f"events.{seed}.time" in arrays:
            batch.events[seed] = _record(Events, arrays, f"events.{seed}")
    return done, _midway(arrays) if "run.clock" in arrays else None


def _midway(arrays) -> Midway:
    kept = _record(Midway, arrays, "run")
    samples = {name: arrays[f"run.samples.{name}"] for name in SAMPLES}
    events = _record(Events, arrays, "run.events") if "run.events.time" in arrays else None
    return kept._replace(equilibrating=bool(kept.equilibrating), slots=int(kept.slots), samples=samples, events=events)


def _columns(value: np.ndarray | None, done: int) -> np.ndarray | None:
    return None if value is None else value[:, :done]


def _named(group: str, record) -> dict[str, np.ndarray]:
    return {f"{group}.{name}": np.asarray(value) for name, value in record._asdict().items() if value is not None}


def _record(kind, arrays, group):
    return kind(*(arrays.get(f"{group}.{name}") for name in kind._fields))
