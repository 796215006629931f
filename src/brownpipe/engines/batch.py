"""A batch of runs: the ensemble that an engine fills run by run; what of each run is recorded and measured."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from brownpipe import observables, stages
from brownpipe.engines import kernel_cache
from brownpipe.engines.saturation import share_failing
from brownpipe.engines.state import Ensemble, Events, Track, blank
from brownpipe.engines.units import SMALLEST_NORMAL
from brownpipe.errors import PlacementError, RequestError, RunError
from brownpipe.scene import Scene

EVERY_RUN = 0.99  # share of runs without a place for all disks above which the scene is refused

kernel_cache.on_compile.append(stages.remark)


class RunResult(NamedTuple):
    """What an engine returns of one run."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N, if recorded
    events: Events | None  # if recorded
    observables: Mapping[str, float | np.uint8]  # reported by the engine itself, like counts of collisions


class Batch(NamedTuple):
    """An ensemble, and what of every run is recorded and measured in it."""

    scene: Scene
    ensemble: Ensemble
    record: frozenset[str]  # "tracer", "all", "events"
    observables: tuple[str, ...]  # names out of observables.OBSERVABLES, in their order
    stopped: dict[int, str]  # that of the ensemble, to be filled

    @property
    def needed_record(self) -> frozenset[str]:
        """What the engine must record of a run: `record`, and every disk if an observable needs it."""
        every_disk = observables.needs_every_disk(self.scene, self.observables, self.ensemble.average)
        return self.record | {"all"} if every_disk else self.record


def new_batch(
    scene: Scene, seeds: Sequence[int], record: Collection[str], names: Collection[str], average: str
) -> Batch:
    """Return a batch with one column for each seed and no run yet; `names` are observables to be measured.

    Raises RequestError for observables that the scene does not have.
    """
    observables.refuse_unfit(scene, tuple(names), average)
    ordered = tuple(name for name in observables.OBSERVABLES if name in names)
    tracer = None
    if scene.particles and "tracer" in record:
        shape = (len(scene.times), len(seeds), 2)
        image = np.empty(shape, np.int32) if scene.box.periodic else None
        tracer = Track(np.empty(shape), None, image)
    stopped: dict[int, str] = {}
    ensemble = Ensemble(np.asarray(seeds, dtype=np.int64), scene.times, tracer, {}, {}, {}, average, stopped)
    return Batch(scene, ensemble, frozenset(record), ordered, stopped)


def add_run(batch: Batch, column: int, result: RunResult) -> None:
    """Measure a finished run, and copy what is recorded of it into its column of the ensemble."""
    ensemble = batch.ensemble
    seed, tracer = int(ensemble.seeds[column]), ensemble.tracer
    if tracer is not None:
        tracer.position[:, column] = result.tracer.position[:, 0]
        if tracer.image is not None:
            tracer.image[:, column] = result.tracer.image[:, 0]
    for name, value in _measured(batch, result).items():
        if name not in ensemble.observables:
            ensemble.observables[name] = blank((len(ensemble.seeds), *np.shape(value)), np.asarray(value).dtype)
        ensemble.observables[name][column] = value
    if result.whole is not None and "all" in batch.record:
        ensemble.whole[seed] = result.whole
    if result.events is not None:
        ensemble.events[seed] = result.events


@contextmanager
def making_run(batch: Batch, column: int) -> Iterator[None]:
    """Begin a run; if it cannot go on, by RunError or PlacementError, note the reason and leave the other runs alone.

    Put the scene's name, N and the seed before the message of any other RequestError, and of PlacementError if nearly
    every run of the scene is expected to lack places: such a scene is a mistake.
    """
    scene, seeds = batch.scene, batch.ensemble.seeds
    stages.begin_piece("runs", column, len(seeds))
    try:
        yield
    except (RunError, RequestError) as error:
        is_of_scene = isinstance(error, PlacementError) and share_failing(scene) > EVERY_RUN
        if is_of_scene or not isinstance(error, RunError | PlacementError):
            raise type(error)(f"{scene.name}, N = {scene.particles}, seed {seeds[column]}: {error}") from None
        _add_stopped(batch, column, str(error))
    stages.report("runs", column + 1, len(seeds))


def _add_stopped(batch: Batch, column: int, reason: str) -> None:
    """Note a run that could not go on: `failed`, NaN for every real number of its column, 0 for every count."""
    ensemble = batch.ensemble
    batch.stopped[int(ensemble.seeds[column])] = reason
    ensemble.observables.setdefault("failed", np.zeros(len(ensemble.seeds), np.uint8))[column] = 1
    for values in ensemble.tracer or ():
        if values is not None:
            values[:, column] = blank((), values.dtype)


def _measured(batch: Batch, result: RunResult) -> dict[str, np.ndarray | float | np.uint8]:
    """Return the engine's report on a run and the observables measured from its trajectories."""
    values: dict[str, np.ndarray | float | np.uint8] = dict(result.observables)
    if batch.scene.particles and result.tracer.velocity is not None:
        x, y = result.tracer.velocity[0, 0].tolist()  # as Python's floats, whose squares overflow without a warning
        square = x * x + y * y
        values["initial_square_speed"] = square if square >= SMALLEST_NORMAL or x == y == 0.0 else math.nan
    values |= observables.observe(batch.scene, result, batch.observables, batch.ensemble.average)
    if not _is_finite(result):
        values["failed"] = np.uint8(1)
    return {name: _without_infinity(value) for name, value in values.items()}


def _without_infinity(value: np.ndarray | float | np.uint8) -> np.ndarray | float | np.uint8:
    """Return an observable with NaN where it overflows in the scene's units."""
    if isinstance(value, float | int):
        return math.nan if math.isinf(value) else value
    return np.where(np.isinf(value), np.nan, value)[()] if np.isinf(value).any() else value


def _is_finite(result: RunResult) -> bool:
    """Whether all recorded positions and velocities of a run are finite numbers."""
    tracks = [track for track in (result.tracer, result.whole) if track is not None]
    arrays = [array for track in tracks for array in (track.position, track.velocity) if array is not None]
    return all(bool(np.isfinite(array).all()) for array in arrays)
