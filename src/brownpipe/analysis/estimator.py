"""What an estimator is: columns of numbers, one row per run, and the function from their averages to results.

To add one: a module with an `ESTIMATOR`, entered in `dataset.ESTIMATORS`. Its `columns` sees a block of runs at a time,
its `estimate` the averages over all runs with their errors; nothing else of a run stays in memory.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple, Never

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.variables import Variable
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

    @property
    def key(self) -> tuple[str, int, str]:
        return self.scene.name, self.scene.particles, self.engine.label


class Columns(NamedTuple):
    """The columns of numbers that an estimator takes from n runs."""

    means: Arrays = NONE  # name -> (n, ...): to be averaged over runs, with error and interval
    products: Arrays = NONE  # name -> (n, ...): averaged without error, for functions of several means
    counts: Arrays = NONE  # name -> (...): to be added up


class Estimator(NamedTuple):
    """From columns of numbers to variables of the dataset."""

    columns: Callable  # (Case, runs.RunBlock) -> Columns; without entries for runs that lack what it needs
    estimate: Callable  # (Case, Averages) -> values by name of variable; {} if the columns are not there
    variables: dict[str, Variable]
    axes: Callable = lambda case, averages: {}  # (Case, Averages) -> name of a coordinate: (its dimension, values)
    coordinates: Mapping[str, dict] = NONE  # name of such a coordinate -> attributes


class Averages(NamedTuple):
    """Averages over all runs of a group, by the name of the column."""

    sums: resampling.Sums | None  # None: no runs
    places: dict  # name -> (columns in the sums: slice, shape of one run's entry)
    counts: dict  # name -> sum over runs
    estimates: Estimate | None = None  # of all columns

    def __contains__(self, name: object) -> bool:
        return name in self.places

    @property
    def runs(self) -> int:
        return 0 if self.sums is None else self.sums.runs

    def estimate(self, name: str) -> Estimate:
        """Return mean, error and interval of one of the `means`."""
        columns, _ = self.places[name]
        return Estimate(*(self._shaped(name, values[columns]) for values in self.estimates))

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
        columns, _ = self.places[name]
        return self._shaped(name, function(self.sums, columns))

    def _shaped(self, name: str, values: np.ndarray) -> np.ndarray:
        return values.reshape((*values.shape[:-1], *self.places[name][1]))


NO_RUNS = Averages(None, {}, {})


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


def with_error(name: str, estimate: Estimate) -> dict[str, np.ndarray]:
    """Return mean and standard error as values of the variables `name` and `name_standard_error`."""
    return {name: estimate.mean, f"{name}_standard_error": estimate.standard_error}


def with_interval(name: str, estimate: Estimate) -> dict[str, np.ndarray]:
    """Return mean, standard error and the ends of the interval, `name_low` and `name_high`."""
    return with_error(name, estimate) | {f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def intervals(averages: Averages, names: Iterable[str]) -> dict[str, ArrayLike]:
    """Return the values of the variables of those of the `means` in `names` that are there, with their intervals."""
    estimates = {name: averages.estimate(name) for name in names if name in averages}
    return {key: values for name in estimates for key, values in with_interval(name, estimates[name]).items()}


def scaled(estimate: Estimate, factor: np.ndarray | float) -> Estimate:
    """Return the Estimate of `factor` (>= 0, or NaN) times the mean."""
    return Estimate(*(values * factor for values in estimate))
