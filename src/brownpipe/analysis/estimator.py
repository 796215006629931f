"""What an estimator is: a record of what makes variables of the dataset from the runs of each case.

Its `columns` are numbers of every run of a block, its `results` follow from their averages over all
runs; nothing else of a run stays in memory. Each module of an estimator has its record at the foot;
`dataset.ESTIMATORS` lists them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.resampling import NO_SUMS, Estimate, Sums
from brownpipe.analysis.variables import AVERAGED, Variable, with_intervals, with_uncertainties
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble
from brownpipe.errors import AnalysisError
from brownpipe.observables.own import NO_OWN_ARRAYS, OwnArrays
from brownpipe.scene import Scene


class Case(NamedTuple):
    """One scene, particle count and engine, and the settings of its analysis."""

    scene: Scene
    engine: Engine
    times: np.ndarray  # (T,) [time]
    # what displacements and autocorrelations are averaged over (observables.average.AVERAGES)
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
    """What an estimator takes from n runs.

    >>> import brownpipe as bp
    >>> speed = np.array([0.5, 1.5, 1.0])  # (3,) [length/time] of three runs
    >>> columns = bp.Columns(means={"speed": speed}, totals={"fast": np.sum(speed > 0.9)})
    >>> int(columns.totals["fast"])
    2
    """

    means: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be averaged over runs
    totals: Mapping[str, np.ndarray] = {}  # name -> (...): to be added up over runs
    run_values: Mapping[str, np.ndarray] = {}  # name -> (n, ...): to be kept of every run


class Place(NamedTuple):
    """Where a mean stands in the sums."""

    columns: slice
    shape: tuple[int, ...]  # of a run's entry


@dataclass
class Averages:
    """Averages over all runs of a case, by the name of the column."""

    runs: int = 0
    sums: Sums = NO_SUMS
    places: dict[str, Place] = field(default_factory=dict)  # by the name of the mean
    totals: dict[str, np.ndarray] = field(default_factory=dict)  # sums over runs
    run_values: dict[str, np.ndarray] = field(default_factory=dict)  # (runs, ...) of every run

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
        for name, values in columns.run_values.items():
            earlier_runs = self.run_values.get(name, values[:0])
            self.run_values[name] = np.concatenate([earlier_runs, values])
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


def no_results(case: Case, averages: Averages) -> Mapping[str, ArrayLike]:
    """Return no values: the variables of an estimator are the means of its columns."""
    return {}


class Estimator(NamedTuple):
    """What makes variables of a dataset from the runs of each case.

    name: in error messages and, of an estimator of the user's own, in the dataset.
    variables: what it adds to the dataset, by name, each with the dimensions scene, particles and
    engine, and perhaps others.
    columns: from a case and a block of its runs numbers of every run; none for runs that lack what
    it needs.
    results: from a case and the averages over all its runs the values of variables and coordinates,
    by name. A variable with the name of one of the means has its values and errors unless it is in
    the results.
    coordinates: of dimensions that no other variable has, by name.

    >>> import brownpipe as bp
    >>> def speed_columns(case, runs):
    ...     return bp.Columns(means={"speed": np.sqrt(runs.observables["initial_square_speed"])})
    >>> dims = ("scene", "particles", "engine")
    >>> initial_speed = bp.Variable(dims, "length/time", "initial speed of the tracer")
    >>> speed = bp.Estimator("speed", {"speed": initial_speed}, speed_columns)
    >>> disk = {"position": [1, 1], "velocity": [3, 4], "radius": 0.5, "mass": 1}
    >>> scene = bp.Scene(box={"x": [0, 4], "y": [0, 4]}, disks=[disk], duration=9)
    >>> result = bp.analyse(bp.simulate(scene), estimators=[speed])
    >>> result.speed.values.tolist()
    [[[5.0]]]
    """

    name: str
    variables: Mapping[str, Variable]
    columns: Callable[[Case, Ensemble], Columns]
    results: Callable[[Case, Averages], Mapping[str, ArrayLike]] = no_results
    coordinates: Mapping[str, Variable] = MappingProxyType({})


def collect_columns(estimators: Sequence[Estimator], case: Case, runs: Ensemble) -> Columns:
    """Return the columns of all estimators, and the observables that are averaged as they are.

    Raises AnalysisError for a column that another estimator has already, and for one without a row
    for each run.
    """
    averaged = {}
    for name in (*AVERAGED, *case.own):
        if name in runs.observables:
            averaged[name] = runs.observables[name]
    columns = Columns(averaged)
    for estimator in estimators:
        new_columns = estimator.columns(case, runs)
        _refuse_misfits(estimator, new_columns, columns, len(runs.seeds))
        columns = Columns(
            {**columns.means, **new_columns.means},
            {**columns.totals, **new_columns.totals},
            {**columns.run_values, **new_columns.run_values},
        )
    return columns


def _refuse_misfits(estimator: Estimator, new: Columns, known: Columns, runs: int) -> None:
    """Refuse columns whose names are taken, and those of runs that have not a row for each run."""
    names = {*known.means, *known.totals, *known.run_values}
    for columns in new:
        clashes = names & columns.keys()
        if clashes:
            raise AnalysisError(
                f"estimator {estimator.name}: {min(clashes)} is a column of another estimator; "
                "choose another name"
            )
    for name, values in (*new.means.items(), *new.run_values.items()):
        shape = np.shape(values)
        if shape[:1] != (runs,):
            raise AnalysisError(
                f"estimator {estimator.name}: column {name}: must have a row for each of {runs} "
                f"runs, not the shape {shape}"
            )


def collect_results(
    estimators: Sequence[Estimator], case: Case, averages: Averages
) -> dict[str, ArrayLike]:
    """Return the values of the variables and coordinates of all estimators, by name, and of the
    `AVERAGED`.

    Raises AnalysisError for results that an estimator does not declare.
    """
    values: dict[str, ArrayLike] = {}
    names = {*AVERAGED, *case.own}
    for estimator in estimators:
        results = with_intervals(estimator.results(case, averages))
        declared = with_uncertainties(estimator.variables) | {**estimator.coordinates}
        undeclared = results.keys() - declared.keys()
        if undeclared:
            raise AnalysisError(
                f"estimator {estimator.name}: {min(undeclared)} is a result, but none of its "
                "variables"
            )
        values |= results
        names.update(estimator.variables)
    means = {}
    for name in averages.places:
        if name in names and name not in values:
            means[name] = averages.estimate(name).unless_alike()
    return with_intervals(means) | values
