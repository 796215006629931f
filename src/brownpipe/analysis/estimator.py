"""What an estimator is: a module that makes numbers from runs, one row per run, and variables from
their averages.

    VARIABLES, COORDINATES      what it adds to the dataset (`variables.Variable`)
    columns(case, runs)         numbers of a block of runs, as `Columns`; none for runs that lack
                                what it needs
    results(case, averages)     variables and coordinates by name, from the averages over all runs
                                with their errors

A variable with the name of one of the means takes its values, unless it is in the `results`.
Nothing else of a run stays in memory. To add one, enter it in `dataset.ESTIMATORS`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import Estimate, Sums
from brownpipe.analysis.variables import AVERAGED, with_intervals
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble
from brownpipe.observables.own import NO_OWN_ARRAYS, OwnArrays
from brownpipe.scene import Scene


class Case(NamedTuple):
    """One scene, particle count and engine, and the settings of its analysis."""

    scene: Scene
    engine: Engine
    times: np.ndarray  # (T,) [time]
    # what displacements and autocorrelations are averaged over (observables.AVERAGES)
    average: str = "runs"
    windows: Sequence[tuple[float, float]] = ()  # (start, end) of the straight-line fits [time]
    # of the displacement distribution [time]; empty for the end of the run
    displacement_times: Sequence[float] = ()
    # (K + 1,) requested edges of its rings [length]; None: from the data
    edges: np.ndarray | None = None
    rings: tuple[np.ndarray, ...] = ()  # (K + 1,) edges of the rings at each of these times
    own: OwnArrays = NO_OWN_ARRAYS  # arrays of the user's own functions
    varied: Sequence[str] = ()  # keys in which the scenes of the dataset differ


class Columns(NamedTuple):
    """What an estimator takes from n runs."""

    means: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be averaged over runs
    totals: Mapping[str, np.ndarray] = {}  # name -> (...): to be added up over runs
    kept: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be kept of every run


class Place(NamedTuple):
    """Where a mean stands in the sums."""

    columns: slice
    shape: tuple[int, ...]  # of a run's entry


@dataclass
class Averages:
    """Averages over all runs of a case, by the name of the column."""

    runs: int = 0
    sums: Sums | None = None  # None: no runs
    places: dict[str, Place] = field(default_factory=dict)  # by the name of the mean
    totals: dict[str, np.ndarray] = field(default_factory=dict)  # sums over runs
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # (runs, ...) of every run

    def add(self, seeds: np.ndarray, columns: Columns) -> "Averages":
        """Add the runs `seeds` (n,), n > 0, of the next block."""
        runs = len(seeds)
        flat = [np.zeros((runs, 0))]
        end = 0
        for name, values in columns.means.items():
            flat.append(np.reshape(values, (runs, -1)))
            start = end
            end = start + flat[-1].shape[1]
            self.places[name] = Place(slice(start, end), np.shape(values)[1:])
        self.totals = {
            name: self.totals.get(name, 0) + values for name, values in columns.totals.items()
        }
        kept = {}
        for name, values in columns.kept.items():
            kept_before = self.kept.get(name, values[:0])
            kept[name] = np.concatenate([kept_before, values])
        self.kept = kept
        self.runs += runs
        self.sums = resampling.add_block(self.sums, seeds, np.concatenate(flat, axis=1))
        return self

    def sums_of(self, name: str) -> Sums:
        """Return the sums behind one of the means, its entries flattened into columns."""
        return self.sums.at(self.places[name].columns)

    def estimate(self, name: str) -> Estimate:
        """Return one of the means with error and interval."""
        flat = resampling.estimate(self.sums_of(name))
        shape = self.places[name].shape
        return Estimate(*(values.reshape(shape) for values in flat))

    def mean(self, name: str) -> np.ndarray:
        """Return one of the means."""
        means, _ = resampling.moments(self.sums_of(name), 0)
        return means.reshape(self.places[name].shape)


def columns_of(estimators: Iterable[Any], case: Case, runs: Ensemble) -> Columns:
    """Return the columns of some estimators, and the observables that are averaged as they are."""
    means: dict[str, np.ndarray] = {}
    totals: dict[str, np.ndarray] = {}
    kept: dict[str, np.ndarray] = {}
    for estimator in estimators:
        columns = estimator.columns(case, runs)
        means |= columns.means
        totals |= columns.totals
        kept |= columns.kept
    for name in (*AVERAGED, *case.own):
        if name in runs.observables:
            means[name] = runs.observables[name]
    return Columns(means, totals, kept)


def results_of(estimators: Sequence[Any], case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the values of the variables and coordinates of some estimators, by name, and of the
    `AVERAGED`.
    """
    values: dict[str, Any] = {}
    names = {*AVERAGED, *case.own}
    for estimator in estimators:
        values |= estimator.results(case, averages)
        names.update(estimator.VARIABLES)
    means = {}
    for name in averages.places:
        if name in names and name not in values:
            means[name] = averages.estimate(name).unless_alike()
    return with_intervals(means | values)
