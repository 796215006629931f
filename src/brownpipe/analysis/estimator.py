"""What an estimator is: columns of numbers, one row per run, and their means over runs by the names of variables.

To add one: a module with an `ESTIMATOR`, entered in `dataset.ESTIMATORS`. Its `columns` sees a block of runs at a time,
its `derived` the averages over all runs with their errors; nothing else of a run stays in memory.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple, Never

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.variables import Variable, with_intervals
from brownpipe.engines import Engine
from brownpipe.observables.own import NO_OWN, Own
from brownpipe.scene import Scene

Arrays = Mapping[str, np.ndarray]
NONE: Mapping[str, Never] = MappingProxyType({})  # empty, and so a mapping to values of any type


class Options(NamedTuple):
    """Settings of the analysis."""

    windows: Sequence[tuple[float, float]]  # (start, end) of the straight-line fits [time]
    edges: np.ndarray | None  # (K + 1,) of the rings of the displacement distribution [length]; None: from the data
    displacement_times: tuple[float, ...]  # of that distribution [time]; empty for the end of each run


class Case(NamedTuple):
    """One scene, particle count and engine, and the settings of its analysis."""

    scene: Scene
    engine: Engine
    times: np.ndarray  # (T,) [time]
    options: Options
    average: str = "runs"  # what displacements and autocorrelations are averaged over (observables.AVERAGES)
    edges: tuple[np.ndarray, ...] = ()  # (K + 1,) edges of the rings at each of the displacement times
    own: Own = NO_OWN  # arrays of the user's own functions


class Columns(NamedTuple):
    """What an estimator takes from n runs."""

    means: Arrays = NONE  # name -> (n, ...): to be averaged over runs
    totals: Arrays = NONE  # name -> (...): to be added up over runs


class Averages(NamedTuple):
    """Averages over all runs of a group, by the name of the column."""

    sums: resampling.Sums | None = None  # None: no runs
    places: Mapping = NONE  # name of a mean -> (columns in the sums: slice, shape of one run's entry)
    totals: Mapping = NONE  # name -> sum over runs

    def __contains__(self, name: object) -> bool:
        return name in self.places

    @property
    def runs(self) -> int:
        return 0 if self.sums is None else self.sums.runs

    def of(self, name: str) -> resampling.Sums:
        """Return the sums of one of the means, its entries side by side."""
        return resampling.columns_of(self.sums, self.places[name][0])

    def estimate(self, name: str) -> Estimate:
        """Return one of the means with error and interval."""
        return Estimate(*(values.reshape(self.places[name][1]) for values in resampling.estimate(self.of(name))))

    def mean(self, name: str) -> np.ndarray:
        """Return one of the means."""
        return resampling.mean_of(self.of(name)).reshape(self.places[name][1])


NO_RUNS = Averages()


class Estimator(NamedTuple):
    """From columns of numbers to variables of the dataset."""

    columns: Callable[..., Columns]  # (Case, runs.RunBlock); without entries for runs that lack what it needs
    variables: Mapping[str, Variable]  # one that is named like one of the means is that, unless it is `derived`
    derived: Callable[..., dict] = lambda case, averages: {}  # (Case, Averages) -> other variables, and coordinates
    coordinates: Mapping[str, Variable] = NONE  # its own, beside those in observables.AXES
    always: bool = False  # whether its variables are in every dataset

    def estimate(self, case: Case, averages: Averages) -> dict[str, ArrayLike]:
        """Return all values by name of variable or coordinate; without the columns that they need there are none."""
        derived = self.derived(case, averages)
        means = [name for name in self.variables if name in averages and name not in derived]
        return with_intervals({name: averages.estimate(name) for name in means} | derived)


def add_runs(averages: Averages, seeds: np.ndarray, columns: Columns) -> Averages:
    """Return the averages with the runs `seeds` (n,), n > 0, of the next block added."""
    flat = [np.reshape(values, (len(seeds), -1)) for values in columns.means.values()]
    spans = [slice(*ends) for ends in pairwise(np.cumsum([0, *(values.shape[1] for values in flat)]).tolist())]
    shapes = [np.shape(values)[1:] for values in columns.means.values()]
    places = dict(zip(columns.means, zip(spans, shapes, strict=True), strict=True))
    totals = {name: averages.totals.get(name, 0) + values for name, values in columns.totals.items()}
    return Averages(resampling.add_block(averages.sums, seeds, np.concatenate(flat, axis=1)), places, totals)


def scaled(estimate: Estimate, factor: np.ndarray | float) -> Estimate:
    """Return the Estimate of `factor` (>= 0, or NaN) times the mean."""
    return Estimate(*(values * factor for values in estimate))
