"""A batch of runs: the ensemble that an engine fills run by run; what of each run is recorded and measured."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import observables, stages
from brownpipe.engines.saturation import share_failing
from brownpipe.engines.state import Ensemble, Events, Track, blank, together
from brownpipe.engines.units import SMALLEST_NORMAL
from brownpipe.errors import PlacementError, RequestError, RunError
from brownpipe.scene import Scene

EVERY_RUN = 0.99  # share of runs without a place for all disks above which the scene is refused
MOST_TOGETHER = 64  # short runs that are reported at once when they have ended
ROWS_TOGETHER = 16_384  # disks and samples of these runs at most, which are kept in memory until then
Ended = TypeVar("Ended")  # what an engine keeps of a run that has ended


class RunResult(NamedTuple):
    """What an engine returns of one run."""

    tracer: Track  # M = 1
    whole: Track | None  # M = N, if recorded
    events: Events | None  # if recorded
    observables: Mapping[str, float | np.integer]  # reported by the engine itself, like counts of collisions


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


def most_together(batch: Batch, rows: int) -> int:
    """Return how many runs are reported (by the exact engine, also drawn) at once: several, if they are short.

    `rows` is the number of disks and samples of a run that are kept until then. From the second run on, the code for a
    report is in the processor's cache; the engine's run in between would displace it.
    """
    if batch.needed_record & {"all", "events"}:
        return 1
    return max(1, min(MOST_TOGETHER, ROWS_TOGETHER // max(rows, 1)))


def report_ended(
    batch: Batch, ended: dict[int, Ended], results_of: Callable[[list[Ended]], Sequence[RunResult]], least: int = 1
) -> None:
    """Move runs that have ended, by column, with their results to the batch, if they are at least so many.

    The first one is moved alone: files list the observables in the order of its report.
    """
    if ended and (len(ended) >= least or not batch.ensemble.observables):
        add_runs(batch, list(ended), results_of(list(ended.values())))
        ended.clear()


def add_runs(batch: Batch, columns: list[int], results: Sequence[RunResult]) -> None:
    """Measure finished runs, and copy what is recorded of each into its column of the ensemble."""
    ensemble = batch.ensemble
    for name, values in _measured(batch, results).items():
        if name not in ensemble.observables:
            ensemble.observables[name] = blank((len(ensemble.seeds), *values.shape[1:]), values.dtype)
        ensemble.observables[name][columns] = values
    for column, result in zip(columns, results, strict=True):
        seed, tracer = int(ensemble.seeds[column]), ensemble.tracer
        if tracer is not None:
            tracer.position[:, column] = result.tracer.position[:, 0]
            if tracer.image is not None:
                tracer.image[:, column] = result.tracer.image[:, 0]
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


def _measured(batch: Batch, results: Sequence[RunResult]) -> dict[str, np.ndarray]:
    """Return the engine's reports on K runs and the observables measured from their trajectories, name -> (K, ...)."""
    scene, average = batch.scene, batch.ensemble.average
    values = _columns([result.observables for result in results])
    if scene.particles and results[0].tracer.velocity is not None:
        values["initial_square_speed"] = _square_of(together([result.tracer.velocity[0, 0] for result in results]))
    values |= _columns([observables.observe(scene, result, batch.observables, average) for result in results])
    values["failed"] = values["failed"] | ~_are_finite(results)
    return {name: _without_infinity(of_runs) for name, of_runs in values.items()}


def _columns(rows: Sequence[Mapping[str, ArrayLike]]) -> dict[str, np.ndarray]:
    """Return values of K runs by name as arrays (K, ...)."""
    return {name: together([row[name] for row in rows]) for name in rows[0]}


@np.errstate(over="ignore")
def _square_of(velocity: np.ndarray) -> np.ndarray:
    """Return the squares (K,) of velocities (K, 2), NaN where they underflow."""
    x, y = velocity.T
    square = x * x + y * y
    return np.where((square >= SMALLEST_NORMAL) | ((x == 0.0) & (y == 0.0)), square, np.nan)


def _without_infinity(values: np.ndarray) -> np.ndarray:
    """Return an observable with NaN where it overflows in the scene's units."""
    infinite = np.isinf(values)
    return np.where(infinite, np.nan, values) if infinite.any() else values


def _are_finite(results: Sequence[RunResult]) -> np.ndarray:
    """Return of each run (K,) whether all recorded positions and velocities are finite numbers."""
    finite = np.ones(len(results), bool)
    for tracks in ([result.tracer for result in results], [result.whole for result in results]):
        for name in ("position", "velocity"):
            arrays = [getattr(track, name, None) for track in tracks]
            if arrays[0] is not None:
                finite &= np.isfinite(together(arrays)).all(axis=(1, 2, 3))
    return finite
