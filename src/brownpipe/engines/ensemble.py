"""Ensembles: what an engine returns for a batch of seeds, how it is filled run by run, and failed
runs in words.

All is in the scene's units and in the scene's order of the disks; the tracer is disk 0.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from brownpipe import observables, progress
from brownpipe.engines.start.placement import never_placed
from brownpipe.errors import PlacementError, RequestError, RunError
from brownpipe.observables.observable import RunArray
from brownpipe.observables.own import is_own, measure
from brownpipe.observables.trajectory import Events, Run, Track
from brownpipe.scene.scene import Scene
from brownpipe.scene.seeds import seed_text

# observables with bounds that a run must not exceed
HEALTH = ("energy_drift", "worst_overlap", "momentum_residual")

Value = TypeVar("Value")


class Ensemble(NamedTuple):
    """What an engine returns for a batch of S seeds."""

    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) sample times [time]
    # disk 0 of every run, M = S, if recorded; its velocity only if that is recorded, too
    tracer: Track | None
    observables: dict[str, np.ndarray]  # name -> (S, ...): one number or array per run
    whole: dict[int, Track]  # seed -> trajectories of all disks, M = N, if recorded
    events: dict[int, Events]  # seed -> collisions, if recorded
    # seed -> why its run could not go on; it counts as failed and has no data
    stopped: dict[int, str]
    # descriptions of the arrays of a user's own functions in `observables`
    own: dict[str, RunArray]
    # what displacements and autocorrelations are averaged over, of observables.average.AVERAGES
    average: str = "runs"

    @property
    def failed_seeds(self) -> np.ndarray:
        """The seeds (F,) of the runs that failed: stopped, or beyond the bounds of the health
        check.
        """
        return self.seeds[self.observables["failed"] > 0]

    def run_of(self, seed: int) -> Run:
        """Return what is recorded of the run of a seed, which has all disks or the tracer's track.
        Raises ValueError if it has neither.
        """
        whole = self.whole.get(seed)
        if whole is not None:
            return Run(whole.select(slice(1)), whole, self.events.get(seed))
        if self.tracer is None:
            raise ValueError(f"seed {seed}: has no track")
        column = self.seeds.tolist().index(seed)
        tracer = self.tracer.select(slice(column, column + 1))
        return Run(tracer, None, self.events.get(seed))


class Batch(NamedTuple):
    """An ensemble to be filled, and what is recorded and measured of every run."""

    scene: Scene
    ensemble: Ensemble
    record: frozenset[str]  # "tracer", "velocity", "all", "events"
    # what the engine must record: `record`, and every disk or collision if an observable needs it
    needed_record: frozenset[str]
    observables: tuple[str, ...]  # names in observables.OBSERVABLES, or of the user's own functions


def blank_array(shape: tuple[int, ...], dtype: np.typing.DTypeLike) -> np.ndarray:
    """Return an array for values that are not there: NaN, or 0 where the type has no NaN."""
    missing = np.nan if np.dtype(dtype).kind == "f" else 0
    return np.full(shape, missing, dtype)


def new_batch(
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str],
    names: Collection[str],
    average: str,
) -> Batch:
    """Return a batch with one column for each seed and no run yet; `names` are observables to be
    measured.

    Raises RequestError for observables that the scene does not have.
    """
    observables.refuse_unfit_observables(scene, tuple(names), average)
    tracer = None
    if scene.particles and "tracer" in record:
        shape = (len(scene.times), len(seeds), 2)
        velocity = blank_array(shape, float) if "velocity" in record else None
        image = blank_array(shape, np.int32) if scene.box.has_images else None
        tracer = Track(blank_array(shape, float), velocity, image)
    ensemble = _empty(np.asarray(seeds, dtype=np.int64), scene.times, tracer, average)
    needed = {*record}
    if observables.needs_every_disk(names, average):
        needed.add("all")
    if observables.needs_events(names):
        needed.add("events")
    return Batch(scene, ensemble, frozenset(record), frozenset(needed), tuple(names))


def _empty(seeds: np.ndarray, times: np.ndarray, tracer: Track | None, average: str) -> Ensemble:
    """Return an ensemble without any run yet; its tracer is blank."""
    return Ensemble(
        seeds,
        times,
        tracer,
        observables={},
        whole={},
        events={},
        stopped={},
        own={},
        average=average,
    )


def make_runs(
    batch: Batch,
    run: Callable[[int], Run],
    first: int = 0,
    after: Callable[[int], object] = lambda done: None,
) -> Ensemble:
    """Return the ensemble of a batch with `run(column)` for each column from `first` on; call
    `after(done)` after each.

    If a run raises RunError or PlacementError, note the reason and continue with the next. Put the
    scene's name, N and the seed before the message of any other RequestError, and of PlacementError
    if nearly every run of the scene is expected to lack places: such a scene is a mistake.
    """
    scene = batch.scene
    ensemble = batch.ensemble
    for column, seed in enumerate(ensemble.seeds[first:].tolist(), first):
        progress.begin_piece("runs", column, len(ensemble.seeds))
        try:
            _add_run(batch, column, run(column))
        except (RunError, RequestError) as error:
            is_of_scene = isinstance(error, PlacementError) and never_placed(scene)
            if is_of_scene or not isinstance(error, RunError | PlacementError):
                raise type(error)(f"{scene.title}, seed {seed}: {error}") from None
            ensemble.stopped[seed] = str(error)
            write_columns(ensemble, slice(column, column + 1), None, {"failed": [np.uint8(1)]})
        progress.report("runs", column + 1, len(ensemble.seeds))
        after(column + 1)
    for values in ensemble.observables.values():
        if values.dtype.kind == "f":
            # beyond the floating-point numbers in the scene's units
            values[np.isinf(values)] = np.nan
    return ensemble


def _add_run(batch: Batch, column: int, run: Run) -> None:
    """Measure a finished run, and copy what is recorded of it into its column of the ensemble."""
    scene = batch.scene
    ensemble = batch.ensemble
    seed = int(ensemble.seeds[column])
    values = dict(run.observables)
    if scene.particles and run.tracer.velocity is not None:
        x, y = run.tracer.velocity[0, 0].tolist()
        values["initial_square_speed"] = x * x + y * y
    values |= observables.observe(scene, run, batch.observables, ensemble.average)
    for name in filter(is_own, batch.observables):
        values |= measure(name, scene, run, observables.AXES, ensemble.own)
    columns = {name: np.asarray(value)[np.newaxis] for name, value in values.items()}
    write_columns(ensemble, slice(column, column + 1), run.tracer, columns)
    if run.whole is not None and "all" in batch.record:
        ensemble.whole[seed] = run.whole
    if run.events is not None and "events" in batch.record:
        ensemble.events[seed] = run.events


def write_columns(
    ensemble: Ensemble,
    columns: slice,
    tracer: Track | None,
    values: Mapping[str, np.typing.ArrayLike],
) -> None:
    """Write track and observables of n runs into their columns; an observable that a run lacks is
    NaN, a count 0.
    """
    for name, value in values.items():
        if name not in ensemble.observables:
            array = np.asarray(value)  # (n, ...)
            shape = (len(ensemble.seeds), *array.shape[1:])
            ensemble.observables[name] = blank_array(shape, array.dtype)
        ensemble.observables[name][columns] = value
    for recorded, track in zip(ensemble.tracer or (), tracer or (), strict=False):
        if recorded is not None:
            recorded[:, columns] = track


def select(runs: Ensemble, rows: np.ndarray | slice) -> Ensemble:
    """Return the runs at `rows`: indices, a mask (S,), or a slice."""
    seeds = runs.seeds[rows]
    arrays = {name: values[rows] for name, values in runs.observables.items()}
    selected = runs._replace(
        whole=_of_seeds(runs.whole, seeds),
        events=_of_seeds(runs.events, seeds),
        stopped=_of_seeds(runs.stopped, seeds),
    )
    tracer = runs.tracer and runs.tracer.select(rows)
    return selected._replace(seeds=seeds, tracer=tracer, observables=arrays)


def _of_seeds(values: Mapping[int, Value], seeds: np.ndarray) -> dict[int, Value]:
    """Return what a mapping has of these seeds, in their order.

    >>> _of_seeds({3: "c", 7: "g"}, np.array([7, 5, 3]))
    {7: 'g', 3: 'c'}
    """
    return {seed: values[seed] for seed in seeds.tolist() if seed in values}


def join_ensembles(ensembles: Sequence[Ensemble]) -> Ensemble:
    """Return ensembles of one scene and engine as one, seeds ascending.

    Raises RequestError if arrays of the user's own differ.
    """
    first = ensembles[0]
    if len(ensembles) == 1:
        return first
    seeds = np.concatenate([runs.seeds for runs in ensembles])
    tracer = None if first.tracer is None else _blank_as(first.tracer, len(seeds))
    ensemble = _empty(seeds, first.times, tracer, first.average)
    end = 0
    for runs in ensembles:
        start = end
        end = start + len(runs.seeds)
        write_columns(ensemble, slice(start, end), runs.tracer, runs.observables)
        ensemble.whole.update(runs.whole)
        ensemble.events.update(runs.events)
        ensemble.stopped.update(runs.stopped)
        for name, description in runs.own.items():
            known = ensemble.own.setdefault(name, description)
            if known.shape == description.shape and known != description:
                raise RequestError(f"{name}: must be alike in all runs")
            if known != description:
                raise RequestError(
                    f"{name}: must have one shape in all runs, not {description.shape} in some"
                )
    return select(ensemble, np.argsort(seeds, kind="stable"))


def _blank_as(track: Track, runs: int) -> Track:
    """Return a blank track of the tracer in so many runs, with the arrays that `track` has."""

    def blank(values: np.ndarray) -> np.ndarray:
        return blank_array((len(values), runs, 2), values.dtype)

    return track.transformed(blank)


# -- failed runs in words --------------------------------------------------------------------------


def failures(ensemble: Ensemble) -> str:
    """Return which runs failed their health check, which could not go on and why the first could
    not; "" for none.
    """
    runs = len(ensemble.seeds)
    unhealthy = [seed for seed in ensemble.failed_seeds.tolist() if seed not in ensemble.stopped]
    stopped = sorted(ensemble.stopped)
    kinds = []
    if unhealthy:
        count = f"{len(unhealthy)} of {runs} runs"
        kinds.append(f"failed their health check: {count}: {seed_text(unhealthy)}")
    if stopped:
        count = f"{len(stopped)} of {runs} runs"
        reason = f"seed {stopped[0]}: {ensemble.stopped[stopped[0]]}"
        kinds.append(f"could not go on: {count}: {seed_text(stopped)} ({reason})")
    return "; ".join(kinds)


def stopped_in_words(stopped: Mapping[int, str]) -> str:
    """Return how many runs could not go on, and why the first of them could not, in one line."""
    seed = min(stopped)
    return f"{len(stopped)} could not go on, seed {seed}: {stopped[seed]}"
