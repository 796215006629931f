"""What an estimator is: a module that makes numbers from runs, one row per run, and variables from their averages.

    VARIABLES, COORDINATES      what it adds to the dataset (`variables.Variable`)
    columns(case, runs)         numbers of a block of runs, as `Columns`; none for runs that lack what it needs
    results(case, averages)     variables and coordinates by name, from the averages over all runs with their errors

Nothing else of a run stays in memory. To add one, enter it in `dataset.ESTIMATORS`.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise, starmap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.variables import with_intervals
from brownpipe.engines import Engine
from brownpipe.observables.own import NO_OWN, Own
from brownpipe.scene import Scene


class Case(NamedTuple):
    """One scene, particle count and engine, and the settings of its analysis."""

    scene: Scene
    engine: Engine
    times: np.ndarray  # (T,) [time]
    average: str = "runs"  # what displacements and autocorrelations are averaged over (observables.AVERAGES)
    windows: Sequence[tuple[float, float]] = ()  # (start, end) of the straight-line fits [time]
    displacement_times: Sequence[float] = ()  # of the displacement distribution [time]; empty for the end of the run
    edges: np.ndarray | None = None  # (K + 1,) asked for, of its rings [length]; None: from the data
    rings: tuple[np.ndarray, ...] = ()  # (K + 1,) edges of the rings at each of these times
    own: Own = NO_OWN  # arrays of the user's own functions


class Columns(NamedTuple):
    """What an estimator takes from n runs."""

    means: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be averaged over runs
    totals: Mapping[str, np.ndarray] = {}  # name -> (...): to be added up over runs


class Averages:
    """Averages over all runs of a case, by the name of the column."""

    def __init__(self) -> None:
        self.runs = 0
        self.sums: resampling.Sums | None = None  # None: no runs
        self.places: dict = {}  # name of a mean -> (columns in the sums: slice, shape of one run's entry)
        self.totals: dict[str, np.ndarray] = {}  # sums over runs

    def __contains__(self, name: object) -> bool:
        return name in self.places

    def add(self, seeds: np.ndarray, columns: Columns) -> "Averages":
        """Add the runs `seeds` (n,), n > 0, of the next block."""
        flat = {name: np.reshape(values, (len(seeds), -1)) for name, values in columns.means.items()}
        ends = np.cumsum([0, *(values.shape[1] for values in flat.values())]).tolist()
        shapes = (np.shape(values)[1:] for values in columns.means.values())
        self.places = dict(zip(flat, zip(starmap(slice, pairwise(ends)), shapes, strict=True), strict=True))
        self.totals = {name: self.totals.get(name, 0) + values for name, values in columns.totals.items()}
        self.runs += len(seeds)
        together = np.concatenate([np.zeros((len(seeds), 0)), *flat.values()], axis=1)
        self.sums = resampling.add_block(self.sums, seeds, together)
        return self

    def of(self, name: str) -> resampling.Sums:
        """Return the sums of one of the means, its entries side by side."""
        return resampling.columns_of(self.sums, self.places[name][0])

    def estimate(self, name: str) -> Estimate:
        """Return one of the means with error and interval."""
        return Estimate(*(values.reshape(self.places[name][1]) for values in resampling.estimate(self.of(name))))

    def mean(self, name: str) -> np.ndarray:
        """Return one of the means."""
        return resampling.mean_of(self.of(name)).reshape(self.places[name][1])


def results_of(estimators: Iterable[Any], case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return the values of the variables and coordinates of some estimators, by name.

    A variable that is named like one of the means is that, unless it is in the `results` of the estimator.
    """
    derived = {name: value for one in estimators for name, value in one.results(case, averages).items()}
    means = [name for one in estimators for name in one.VARIABLES if name in averages and name not in derived]
    return with_intervals({name: averages.estimate(name) for name in means} | derived)
