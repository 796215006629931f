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
from brownpipe.analysis.variables import Variable, with_interval
from brownpipe.engines import Engine
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


class Columns(NamedTuple):
    """The columns of numbers that an estimator takes from n runs."""

    means: Arrays = NONE  # name -> (n, ...): to be averaged over runs, with error and interval
    products: Arrays = NONE  # name -> (n, ...): averaged without error, for functions of several means
    counts: Arrays = NONE  # name -> (...): to be added up


class Averages(NamedTuple):
    """Averages over all runs of a group, by the name of the column."""

    sums: resampling.Sums | None = None  # None: no runs
    places: Mapping = NONE  # name -> (columns in the sums: slice, shape of one run's entry)
    counts: Mapping = NONE  # name -> sum over runs
    estimates: Estimate | None = None  # of all columns

    def __contains__(self, name: object) -> bool:
        return name in self.places

    @property
    def runs(self) -> int:
        return 0 if self.sums is None else self.sums.runs

    def estimate(self, name: str) -> Estimate:
        """Return mean, error and interval of one of the `means`."""
        columns, shape = self.places[name]
        return Estimate(*(values[columns].reshape(shape) for values in self.estimates))

    def mean(self, name: str) -> np.ndarray:
        """Return the mean over runs of one of the `means` or `products`."""
        return self._of(name, resampling.mean_of)

    def variance(self, name: str) -> np.ndarray:
        """Return the variance over runs (divided by n, not n - 1) of one of the `means`."""
        return self._of(name, resampling.variance_of)

    def drawn(self, name: str) -> np.ndarray:
        """Return the means (B, ...) over the runs of every replicate."""
        return self._of(name, resampling.drawn_mean)

    def drawn_variance(self, name: str) -> np.ndarray:
        """Return the variances (B, ...) over the runs of every replicate (divided by n) of one of the `means`."""
        return self._of(name, resampling.drawn_variance)

    def _of(self, name: str, function: Callable) -> np.ndarray:
        columns, shape = self.places[name]
        values = function(self.sums, columns)
        return values.reshape((*values.shape[:-1], *shape))


NO_RUNS = Averages()


class Estimator(NamedTuple):
    """From columns of numbers to variables of the dataset."""

    columns: Callable[..., Columns]  # (Case, runs.RunBlock); without entries for runs that lack what it needs
    variables: Mapping[str, Variable]  # one that is named like a column of `means` is its mean over runs
    derived: Callable[..., dict] = lambda case, averages: {}  # (Case, Averages) -> values of others, and of coordinates
    coordinates: Mapping[str, Variable] = NONE  # its own, beside those in observables.AXES
    always: bool = False  # whether its variables are in every dataset

    def estimate(self, case: Case, averages: Averages) -> dict[str, ArrayLike]:
        """Return all values by name of variable or coordinate; without the columns that they need there are none."""
        values: dict[str, ArrayLike] = {}
        for name in (name for name in self.variables if name in averages):
            values |= with_interval(name, averages.estimate(name))
        return values | self.derived(case, averages)


def add_runs(averages: Averages, seeds: np.ndarray, columns: Columns) -> Averages:
    """Return the averages with the runs `seeds` (n,), n > 0, of the next block added."""
    arrays = {name: np.asarray(values, float) for name, values in {**columns.means, **columns.products}.items()}
    flat = [values.reshape(len(seeds), -1) for values in arrays.values()]
    ends = np.cumsum([0, *(values.shape[1] for values in flat)]).tolist()
    sums = resampling.add_block(averages.sums, seeds, np.concatenate(flat, axis=1), ends[len(columns.means)])
    spans = [slice(*ends) for ends in pairwise(ends)]
    places = {name: (span, arrays[name].shape[1:]) for name, span in zip(arrays, spans, strict=True)}
    counts = {name: averages.counts.get(name, 0) + values for name, values in columns.counts.items()}
    return Averages(sums, places, counts)


def with_estimates(averages: Averages) -> Averages:
    """Return the averages with errors and intervals."""
    return averages._replace(estimates=resampling.estimate(averages.sums)) if averages.runs else averages


def scaled(estimate: Estimate, factor: np.ndarray | float) -> Estimate:
    """Return the Estimate of `factor` (>= 0, or NaN) times the mean."""
    return Estimate(*(values * factor for values in estimate))
