"""What a measure is: columns of numbers, one row per run, and what becomes of their means.

To add one: a module with `MEASURE`, entered in `dataset.MEASURES`. Its `sample` sees some runs at a time, its
`estimate` the means over all of them, with their errors; nothing else of a run is kept.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import Estimate

NONE = MappingProxyType({})


class Asked(NamedTuple):
    """What the analysis is asked for."""

    windows: tuple  # (start, end) of the straight-line fits [time]
    edges: np.ndarray | None  # (K + 1,) of the rings of the displacement distribution [length]; None: from the data
    displacement_times: tuple  # of that distribution [time]; empty for the end of each run


class Case(NamedTuple):
    """What all runs of a group have in common."""

    scene: object  # brownpipe.scene.Scene
    engine: str  # with its settings: a label
    times: np.ndarray  # (T,) [time]
    asked: Asked
    average: str = "runs"  # over what `square_displacement` and the like are averaged in each run
    edges: tuple = ()  # (K + 1,) of the rings at each time of the distribution, `distribution.rings_of`

    @property
    def key(self):
        return self.scene.name, self.scene.particles, self.engine


class Columns(NamedTuple):
    """What a measure takes from n runs."""

    means: Mapping = NONE  # name -> (n, ...): to be averaged over runs, with error and interval
    products: Mapping = NONE  # name -> (n, ...): their means and replicates only, for functions of several means
    counts: Mapping = NONE  # name -> (...): to be added up


class Measure(NamedTuple):
    """A kind of measure. `sample` returns no columns for runs that do not have what it needs."""

    sample: Callable  # (Case, Runs) -> Columns
    estimate: Callable  # (Case, Found) -> values by name of variable; {} if the columns are not there
    variables: dict  # name -> variables.Variable
    axes: Callable = lambda case, found: {}  # (Case, Found) -> name of a coordinate: (its dimension, values)
    coordinates: Mapping = NONE  # name of such a coordinate -> attributes


class Found(NamedTuple):
    """What all runs of a group add up to."""

    sums: resampling.Sums | None  # None: nothing to average
    places: dict  # name -> (columns: slice, shape of one run's entry)
    counts: dict  # name -> sum over runs
    estimates: Estimate | None = None  # of all columns

    def __contains__(self, name):
        return name in self.places

    @property
    def runs(self):
        return 0 if self.sums is None else self.sums.runs

    def estimate(self, name):
        """Mean, error and interval of one of the `means`."""
        columns, _ = self.places[name]
        return Estimate(*(self._shaped(name, values[columns]) for values in self.estimates))

    def mean(self, name):
        """Mean over runs of one of the `means` or `products`."""
        return self._of(name, resampling.mean_of)

    def variance(self, name):
        """Variance over runs, divided by their number, of one of the `means`."""
        return self._of(name, resampling.variance_of)

    def drawn(self, name):
        """Means (B, ...) over the runs of every replicate."""
        return self._of(name, resampling.drawn_mean)

    def drawn_variance(self, name):
        """Variances (B, ...) over the runs of every replicate, divided by their number, of one of the `means`."""
        return self._of(name, resampling.drawn_variance)

    def _of(self, name, function):
        columns, _ = self.places[name]
        return self._shaped(name, function(self.sums, columns))

    def _shaped(self, name, values):
        return values.reshape((*values.shape[:-1], *self.places[name][1]))


NOTHING = Found(None, {}, {})


def add_runs(found, seeds, columns):
    """`found` and what the runs `seeds` (n,), n > 0, of the next block add to it: `columns`, a Columns."""
    both = {name: np.asarray(values, float) for name, values in (columns.means | columns.products).items()}
    flat = [values.reshape(len(seeds), -1) for values in both.values()]
    ends = np.cumsum([0, *(values.shape[1] for values in flat)]).tolist()
    sums = resampling.add_block(found.sums, seeds, np.concatenate(flat, axis=1), ends[len(columns.means)])
    spans = [slice(*ends) for ends in pairwise(ends)]
    places = {name: (span, both[name].shape[1:]) for name, span in zip(both, spans, strict=True)}
    counts = {name: found.counts.get(name, 0) + values for name, values in columns.counts.items()}
    return Found(sums, places, counts)


def estimated(found):
    """`found` with the Estimates of all its means."""
    return found._replace(estimates=resampling.estimate(found.sums)) if found.runs else found


def with_error(name, estimate):
    """Mean and standard error as values of the variables `name` and `name_standard_error`."""
    return {name: estimate.mean, f"{name}_standard_error": estimate.standard_error}


def with_interval(name, estimate):
    """The same with the ends of the interval, `name_low` and `name_high`."""
    return with_error(name, estimate) | {f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def scaled(estimate, factor):
    """The Estimate of `factor` (>= 0, or NaN) times the mean."""
    return Estimate(*(values * factor for values in estimate))
