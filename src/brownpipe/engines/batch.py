"""A batch of runs: an ensemble that any engine fills, run by run."""

import math
from typing import NamedTuple

import numpy as np

from brownpipe import observables
from brownpipe.engines.state import Ensemble, Events, Track
from brownpipe.scene import Scene

SMALLEST_SQUARE = float(np.finfo(float).smallest_normal)
on_entry = []  # functions called with the number of runs done and of all runs, whenever a run has been entered


class Run(NamedTuple):
    """What an engine hands back of one run."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N
    events: Events | None
    observables: dict[str, float | int]


class Request(NamedTuple):
    """What is to be kept of every run, and what is to be measured in it."""

    scene: Scene
    record: frozenset[str]  # "tracer", "all", "events"
    observables: tuple[str, ...]  # names out of observables.OBSERVABLES
    average: str  # one of observables.AVERAGES

    @property
    def needed(self) -> frozenset[str]:
        """What the engine has to record of a run: every disk, too, if something is measured that needs them."""
        every = observables.needs_every_disk(self.scene, self.observables, self.average)
        return self.record | {"all"} if every else self.record


def request(scene: Scene, record, names=(), average: str = "runs") -> Request:
    """Return a request. Raises RequestError for observables that the scene does not have."""
    observables.refuse_unfit(scene, tuple(names), average)
    ordered = tuple(name for name in observables.OBSERVABLES if name in names)
    return Request(scene, frozenset(record), ordered, average)


def room_for(asked: Request, seeds) -> Ensemble:
    """Return an ensemble to be filled."""
    scene, seeds, tracer = asked.scene, np.asarray(seeds, dtype=np.int64), None
    if scene.particles and "tracer" in asked.record:
        shape = (len(scene.times), len(seeds), 2)
        image = np.empty(shape, np.int32) if scene.box.periodic else None
        tracer = Track(np.empty(shape), None, image)
    return Ensemble(seeds, scene.times, tracer, {}, {}, {}, asked.average)


def enter(batch: Ensemble, column: int, one: Run, asked: Request) -> None:
    """Measure a run that is finished, and keep of it what was asked for."""
    seed, track = int(batch.seeds[column]), batch.tracer
    if track is not None:
        track.position[:, column] = one.tracer.position[:, 0]
        if track.image is not None:
            track.image[:, column] = one.tracer.image[:, 0]
    for name, value in _measured(one, asked).items():
        value = np.asarray(value)
        if name not in batch.observables:
            batch.observables[name] = np.empty((len(batch.seeds), *value.shape), value.dtype)
        batch.observables[name][column] = value
    if one.whole is not None and "all" in asked.record:
        batch.whole[seed] = one.whole
    if one.events is not None:
        batch.events[seed] = one.events
    for tell in on_entry:
        tell(column + 1, len(batch.seeds))


def _measured(one: Run, asked: Request) -> dict[str, np.ndarray | float | int]:
    """Return what the engine reports of a run, and what follows from its tracks."""
    found = dict(one.observables)
    if asked.scene.particles and one.tracer.velocity is not None:
        x, y = one.tracer.velocity[0, 0].tolist()  # Python's numbers: beyond 1e154 the square is inf, without a warning
        square = x * x + y * y
        found["initial_square_speed"] = square if square >= SMALLEST_SQUARE or x == y == 0.0 else math.nan
    found |= observables.observe(asked.scene, one, asked.observables, asked.average)
    if not _is_finite(one):
        found["failed"] = np.uint8(1)
    return {name: _without_infinity(value) for name, value in found.items()}


def _without_infinity(value):
    """Return an observable with NaN where it is beyond the floating-point numbers in the scene's units."""
    return np.where(np.isinf(value), np.nan, value)[()] if np.isinf(value).any() else value


def _is_finite(one: Run) -> bool:
    """Whether all positions and velocities of a run are numbers."""
    tracks = [track for track in (one.tracer, one.whole) if track is not None]
    arrays = [each for track in tracks for each in (track.position, track.velocity) if each is not None]
    return all(bool(np.isfinite(each).all()) for each in arrays)
