"""What an estimator is: a module that makes numbers from runs, one row per run, and variables from
their averages.

    VARIABLES, COORDINATES      what it adds to the dataset (`variables.Variable`)
    columns(case, runs)         numbers of a block of runs, as `Columns`; none for runs that lack
    what it needs results(case, averages)     variables and coordinates by name, from the averages
    over all runs with their errors

A variable with the name of one of the means takes its values, unless it is in the `results`.
Nothing else of a run stays in memory. To add one, enter it in `dataset.ESTIMATORS`.
"""

from collections import ChainMap
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
from brownpipe.observables.own import NO_OWN, Own
from brownpipe.scene import Scene


class Case(NamedTuple):
    """One scene, particle count and engine, and the settings of its analysis."""

    scene: Scene
    engine: Engine
    times: np.ndarray  # (T,) [time]
    # what displacements and autocorrelations are averaged over (observables.AVERAGES)
    average: str = "runs"
    windows: Sequence[tuple[float, float]] = ()  # (start, end) of the straight-line fits [time]
    displacement_times: Sequence[
        float
    ] = ()  # of the displacement distribution [time]; empty for the end of the run
    # (K + 1,) requested edges of its rings [length]; None: from the data
    edges: np.ndarray | None = None
    rings: tuple[np.ndarray, ...] = ()  # (K + 1,) edges of the rings at each of these times
    own: Own = NO_OWN  # arrays of the user's own functions
    varied: Sequence[str] = ()  # keys in which the scenes of the dataset differ


class Columns(NamedTuple):
    """What an estimator takes from n runs."""

    means: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be averaged over runs
    totals: Mapping[str, np.ndarray] = {}  # name -> (...): to be added up over runs
    kept: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be kept of every run


@dataclass
class Averages:
    """Averages over all runs of a case, by the name of the column."""

    runs: int = 0
    sums: Sums | None = None  # None: no runs
    places: dict = field(
        default_factory=dict
    )  # name of a mean -> (columns in the sums: slice, shape of a run's entry)
    totals: dict[str, np.ndarray] = field(default_factory=dict)  # sums over runs
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # (runs, ...) of every run

    def add(self, seeds: np.ndarray, columns: Columns) -> "Averages":
        """Add the runs `seeds` (n,), n > 0, of the next block."""
        flat, end = [np.zeros((len(seeds), 0))], 0
        for name, values in columns.means.items():
            flat.append(np.reshape(values, (len(seeds), -1)))
            self.places[name] = slice(end, end := end + flat[-1].shape[1]), np.shape(values)[1:]
        self.totals = {
            name: self.totals.get(name, 0) + values for name, values in columns.totals.items()
        }
        self.kept = {
            name: np.concatenate([self.kept.get(name, one[:0]), one])
            for name, one in columns.kept.items()
        }
        self.runs += len(seeds)
        self.sums = resampling.add_block(self.sums, seeds, np.concatenate(flat, axis=1))
        return self

    def of(self, name: str) -> Sums:
        """Return the sums behind one of the means, its entries flattened into columns."""
        return self.sums.at(self.places[name][0])

    def estimate(self, name: str) -> Estimate:
        """Return one of the means with error and interval."""
        return Estimate(
            *(values.reshape(self.places[name][1]) for values in resampling.estimate(self.of(name)))
        )

    def mean(self, name: str) -> np.ndarray:
        """Return one of the means."""
        return resampling.moments(self.of(name), 0)[0].reshape(self.places[name][1])


def columns_of(estimators: Iterable[Any], case: Case, runs: Ensemble) -> Columns:
    """Return the columns of some estimators, and the observables that are averaged as they are."""
    parts = zip(*(one.columns(case, runs) for one in estimators), strict=True)
    means, *others = (dict(ChainMap(*part)) for part in parts)
    names = [name for name in (*AVERAGED, *case.own) if name in runs.observables]
    return Columns(means | {name: runs.observables[name] for name in names}, *others)


def results_of(estimators: Sequence[Any], case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the values of the variables and coordinates of some estimators, by name, and of the
    `AVERAGED`.
    """
    derived = {
        name: value for one in estimators for name, value in one.results(case, averages).items()
    }
    variables = {*AVERAGED, *case.own, *(name for one in estimators for name in one.VARIABLES)}
    means = [name for name in averages.places if name in variables and name not in derived]
    return with_intervals(
        {name: averages.estimate(name).unless_alike() for name in means} | derived
    )
