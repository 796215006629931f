"""One labelled dataset from the trajectory files of a study: all estimates for each scene, particle
count, engine.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import (
    components,
    diffusive,
    displacement,
    distribution,
    drift,
    first_passage,
    pairs,
    thermodynamics,
    variables,
    velocity,
)
from brownpipe.analysis.estimator import (
    Averages,
    Case,
    Estimator,
    collect_columns,
    collect_results,
)
from brownpipe.analysis.goodness import holm
from brownpipe.analysis.own_estimators import (
    refuse_misshapen,
    refuse_names,
    refuse_unfit,
    title_with_source,
)
from brownpipe.analysis.runs import (
    Group,
    Source,
    blocks_of,
    first_good_runs,
    group_by_case,
    reported,
    without_failed,
)
from brownpipe.analysis.variables import (
    CASE_DIMS,
    SAME_TIME,
    VARIED,
    Mean,
    Variable,
    with_uncertainties,
)
from brownpipe.engines.ensemble import HEALTH
from brownpipe.engines.windows import Window, candidate_windows, window_labels
from brownpipe.errors import AnalysisError
from brownpipe.observables import AXES
from brownpipe.observables.average import over_disks
from brownpipe.observables.observable import RunArray
from brownpipe.observables.own import OwnArrays, is_coordinate, own_coordinates
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.variation import short_name, unit_of, value_of
from brownpipe.storage.datasets import origin_attributes
from brownpipe.storage.trajectories import Trajectories

if TYPE_CHECKING:
    from xarray import Dataset

# A piece of a dataset, most often of one case: variable or coordinate -> array, whose size is that
# of its dimensions.
Values = dict[str, ArrayLike]

ESTIMATORS: tuple[Estimator, ...] = (
    displacement.ESTIMATOR,
    components.ESTIMATOR,
    distribution.ESTIMATOR,
    velocity.ESTIMATOR,
    pairs.ESTIMATOR,
    thermodynamics.ESTIMATOR,
    drift.ESTIMATOR,
    first_passage.ESTIMATOR,
)
# These come first in a dataset, so that xarray shows them among its hundred variables; then other
# physics, then health.
FIRST = (
    "msd",
    "diffusion_coefficient",
    "compressibility",
    "contact_value",
    "velocity_autocorrelation",
)
TABLES = (
    displacement.VARIABLES,
    diffusive.VARIABLES,  # which follow from those of the displacement
    *(estimator.variables for estimator in ESTIMATORS[1:]),
    variables.VARIABLES,
)
BY_NAME = with_uncertainties(dict(chain.from_iterable(table.items() for table in TABLES)))
ALL_VARIABLES = {name: BY_NAME[name] for name in (*FIRST, *BY_NAME)}
LABELS_AND_HEALTH = {
    *displacement.COORDINATES,
    *distribution.COORDINATES,
    *HEALTH,
    "runs",
    "failed_runs",
    "run_status",
}
# In every dataset.
ALWAYS = LABELS_AND_HEALTH.union(
    with_uncertainties(displacement.VARIABLES | diffusive.VARIABLES | distribution.AT_TIMES)
)
ALL_COORDINATES = {dim: Variable((dim,), axis.units, axis.long_name) for dim, axis in AXES.items()}
ALL_COORDINATES |= variables.COORDINATES
for _estimator in ESTIMATORS:
    ALL_COORDINATES |= _estimator.coordinates
Table = dict[str, Variable]  # by name
Axis = list[object] | np.ndarray  # labels in order of appearance, or ascending numbers


class Schema(NamedTuple):
    """The variables and coordinates that a dataset may have, by name."""

    variables: Table
    coordinates: Table


def aggregate(
    sources: Iterable[Source],
    windows: Sequence[tuple[float, float]] | None = None,
    dr: float | None = None,
    rings: int | None = None,
    displacement_times: Sequence[float] = (),
    vary: Sequence[str] = (),
    vary_together: bool = False,
    estimators: Sequence[Estimator] = (),
) -> "Dataset":
    """Return all estimates from trajectory files, or runs in memory, as one dataset.

    A `StoredFile` is refused if it holds other runs than those stated. The files may hold any
    scenes, particle counts, engines and batches of seeds: every value depends on the runs alone, to
    the bit, and peak memory does not grow with their number. Scenes, counts and engines keep the
    order of the files. Failed runs are counted and left out of every average. Values that a case
    lacks (a shorter duration, fewer seeds) are NaN.

    windows: (start, end) of the straight-line fits [time], by default those of
    `windows.candidate_windows` in whose first most D that are stated have no mark (`diffusive`).
    dr, rings: width [length] and number of the rings of the displacement distribution, by default
    from the data.
    displacement_times: its times [time], by default the end of each run.
    vary, vary_together: keys in which the scenes differ, each a dimension in place of a scene for
    each combination of their values; together, keys beyond the first are coordinates along the
    dimension of the first.
    estimators: the user's own, whose variables are added.

    Raises AnalysisError for files that do not belong together, for windows that coincide, or
    windows and times that no run reaches or can use, and what `read_trajectories` raises for broken
    files.
    """
    edges = None
    if dr is not None and rings is not None:
        edges = dr * np.arange(rings + 1)
    elif dr is not None or rings is not None:
        raise AnalysisError("rings: width and number must be given together")
    groups = group_by_case(sources)
    outlines = [group.pattern.contents for group in groups]
    scenes = [contents.scene for contents in outlines]
    times = [*displacement_times]
    cases = [_case_of(contents, windows or (), times, edges, vary) for contents in outlines]
    if windows or dr or times:
        _refuse_without_displacements(outlines)
    refuse_windows(windows or (), [case.times for case in cases])
    _refuse_times(cases)
    schema = _schema_of(groups, estimators)
    pairs_of_windows: list[tuple[Window, Window]] = []
    if not windows:
        end = displacement.best_end(cases, groups)
        pairs_of_windows = candidate_windows(scenes, end)
        all_windows = tuple(dict.fromkeys(chain.from_iterable(pairs_of_windows)))
        cases = [case._replace(windows=all_windows) for case in cases]
    pieces: list[Values] = []
    runs_of_cases = [*zip(cases, groups, strict=True)]
    for case, group in tracked(runs_of_cases, "cases"):
        pieces += _pieces_of_case(case, group, estimators, schema.variables)
    table = _variables_in(pieces, schema.variables)
    spread_table, keys = _over_keys(table, scenes, vary, vary_together)
    settings = {
        "fit_windows": windows or None,
        "ring_width": dr,
        "rings": rings,
        "displacement_times": times,
    }
    attributes = _attributes(groups, settings)
    if estimators:
        attributes["estimators"] = ", ".join(map(title_with_source, estimators))
    if keys:
        attributes[VARIED] = " ".join(keys)
    coordinates = schema.coordinates | keys
    dataset = outer_join(pieces, spread_table, coordinates, attributes, (*CASE_DIMS, *keys))
    if "drift_p_value" in dataset:  # all cases are one family of tests
        p = dataset.drift_p_value
        p.values = holm(p.values.ravel()).reshape(p.shape)
    if windows:
        return diffusive.marked(dataset)
    return diffusive.best_windows(dataset, pairs_of_windows)


def refuse_unfit_estimators(estimators: Sequence[Estimator], vary: Iterable[str] = ()) -> None:
    """Raise AnalysisError for an estimator whose names are taken, also by a varied key, or whose
    dimensions are not known, before there are runs.
    """
    _schema_of((), estimators)
    keys = {short_name(path) for path in vary}
    for estimator in estimators:
        refuse_names(estimator, keys)


def _schema_of(groups: Sequence[Group], estimators: Sequence[Estimator]) -> Schema:
    """Return the schema with the arrays of the user's own functions and of these estimators.

    Raises AnalysisError for an estimator whose names are taken or whose dimensions are not known.
    """
    own = _own_arrays(groups)
    table = ALL_VARIABLES | with_uncertainties(_own_variables(own))
    coordinates = {**ALL_COORDINATES}
    for name, array in own_coordinates(own).items():
        coordinates[name] = Variable(array.dims, array.units, array.long_name)
    for estimator in estimators:
        refuse_unfit(estimator, table, coordinates)
        table |= with_uncertainties(estimator.variables)
        coordinates |= estimator.coordinates
    return Schema(table, coordinates)


def _attributes(groups: Sequence[Group], settings: Mapping[str, object]) -> dict[str, str]:
    """Return the attributes of a dataset: its meaning, and what it is made from."""
    outlines = [group.pattern.contents for group in groups]
    msd_disks = {_followed(contents, "square_displacement") for contents in outlines}
    autocorrelation_disks = {
        _followed(contents, "velocity_autocorrelation") for contents in outlines
    }
    origins = [(group.pattern.contents, group.seeds) for group in groups]
    return {
        **variables.ATTRIBUTES,
        "msd_of": " or ".join(sorted(msd_disks)),
        "velocity_autocorrelation_of": " or ".join(sorted(autocorrelation_disks)),
        "average": outlines[0].ensemble.average,
        **origin_attributes("aggregate", origins, settings),
    }


def _case_of(
    contents: Trajectories,
    windows: Sequence[Window],
    displacement_times: Sequence[float],
    edges: np.ndarray | None,
    varied: Sequence[str],
) -> Case:
    """Return the case of a file of runs, with the settings of its analysis."""
    return Case(
        scene=contents.scene,
        engine=contents.engine,
        times=contents.ensemble.times,
        average=contents.ensemble.average,
        windows=windows,
        displacement_times=displacement_times,
        edges=edges,
        own=contents.ensemble.own,
        varied=varied,
    )


def _refuse_without_displacements(outlines: Sequence[Trajectories]) -> None:
    """Refuse settings of the analysis of displacements if no run that came to its end has them."""
    arrays = [
        {*contents.record, *contents.measured}
        for contents in outlines
        if contents.measured is not None
    ]
    if arrays and set().union(*arrays).isdisjoint({"tracer", "square_displacement"}):
        raise AnalysisError(
            "fit windows, rings and displacement times: must go with runs that have displacements"
        )


def _variables_in(pieces: Sequence[Values], table: Table) -> Table:
    """Return the variables of a table that pieces of a dataset have, and those of every dataset."""
    names = ALWAYS.union(*pieces)
    return {name: variable for name, variable in table.items() if name in names}


def _over_keys(
    table: Table, scenes: Sequence[Scene], paths: Sequence[str], together: bool
) -> tuple[Table, Table]:
    """Return variables with a dimension for each varied key behind that of the scene, and the keys
    as coordinates.

    With `together`, keys beyond the first are coordinates along the dimension of the first. A
    variable with the name of a key, such as the packing fraction, is the coordinate then.
    """
    names = [short_name(path) for path in paths]
    dims = names[:1] if together else names
    keys = {}
    for name, path in zip(names, paths, strict=True):
        values = np.array([value_of(scene, path) for scene in scenes])
        dim = name if name in dims else dims[0]
        keys[name] = Variable((dim,), unit_of(path), path, (), values.dtype, values[0])
    spread = {}
    for name, variable in table.items():
        if name not in keys:
            spread[name] = variable._replace(dims=(CASE_DIMS[0], *dims, *variable.dims[1:]))
    return spread, keys


def _difference(array: RunArray, other: RunArray) -> str:
    """Return how an array of the user's own differs between runs that cannot be joined, and the
    cure.
    """
    if array.observable != other.observable:
        return f"is of {other.observable}, in other runs of {array.observable}; rename one of them"
    if array.source != other.source:
        return (
            f"was measured by another function {array.observable}, or by its file before an edit; "
            "measure all runs by the same"
        )
    return f"must be alike in all runs; has {other[:3]}, in other runs {array[:3]}"


def _without_lengths(array: RunArray) -> RunArray:
    """Return the description of an array without what differs between cases."""
    return array._replace(shape=(), coordinates=())


def _own_arrays(groups: Sequence[Group]) -> OwnArrays:
    """Return the arrays of the user's own functions.

    Raises AnalysisError if they differ in more than shape and values of coordinates, or within a
    case in these values.
    """
    own: dict[str, RunArray] = {}
    for file in chain.from_iterable(group.files for group in groups):
        for name, array in file.contents.ensemble.own.items():
            first = own.setdefault(name, array)
            if _without_lengths(first) != _without_lengths(array):
                raise AnalysisError(f"{file.path}: {name}: {_difference(first, array)}")
    for group in groups:
        coordinates = own_coordinates(group.pattern.contents.ensemble.own)
        for file in group.files:
            for name, array in own_coordinates(file.contents.ensemble.own).items():
                if coordinates.get(name, array) != array:
                    raise AnalysisError(f"{file.path}: {name}: must be alike in all runs of a case")
    return own


def _own_variables(own: OwnArrays) -> dict[str, Variable]:
    """Return the variables of the user's own functions."""
    table = {}
    for name, array in own.items():
        if is_coordinate(name, array):
            continue
        attributes = {"observable": array.observable}
        table[name] = Mean(
            (*CASE_DIMS, *array.dims), array.units, array.long_name, extra=attributes
        )
    return table


def _followed(runs: Trajectories, observable: str) -> str:
    """Return in words whose squared displacement or velocity autocorrelation is averaged."""
    is_measured = observable in (runs.measured or ())
    follows_all = is_measured and over_disks(runs.ensemble.average)
    return "all disks equal to the tracer" if follows_all else "the tracer"


def refuse_windows(windows: Sequence[tuple[float, float]], times: Sequence[np.ndarray]) -> None:
    """Refuse fit windows that coincide, and one that fits no run; `times` has the sample times of
    each scene.
    """
    names = window_labels(windows)
    last = max(times_of_scene[-1] for times_of_scene in times)
    if len(set(names)) < len(names):
        raise AnalysisError(
            f"fit windows {', '.join(names)}: must differ in their first six digits"
        )
    for name, window in zip(names, windows, strict=True):
        weights = [displacement.line_weights(times_of_scene, window) for times_of_scene in times]
        if all(np.isnan(weights_of_scene).all() for weights_of_scene in weights):
            allowed = (
                f"must end by {last:g}, when the longest run does, and have three samples or more "
                "of a run"
            )
            raise AnalysisError(f"fit window {name}: {allowed}")


def _refuse_times(cases: Sequence[Case]) -> None:
    """Refuse times of the displacement distribution that no run samples."""
    sampled = np.concatenate([case.times[distribution.chosen_times(case)] for case in cases])
    for time in cases[0].displacement_times:
        if not np.isclose(sampled, time, rtol=SAME_TIME, atol=0.0).any():
            raise AnalysisError(f"displacement time {time:g}: must be a sample time of some run")


def _pieces_of_case(
    case: Case, group: Group, own_estimators: Sequence[Estimator], table: Table
) -> list[Values]:
    """Return the values of all variables for a case, from its group.

    Those of the runs that did not fail are a piece of their own, as there may be fewer, and so are
    the displacement distributions at each time, which may have rings of their own.
    """
    first_runs = first_good_runs(group) if case.edges is None else []
    case = case._replace(rings=distribution.rings_of(case, first_runs))
    estimators = (*ESTIMATORS, *own_estimators)
    averages = Averages()
    stopped: dict[int, str] = {}
    health = []
    for runs in blocks_of(group):
        health.append([reported(runs, name) for name in ("failed", *HEALTH)])
        stopped.update(runs.stopped)
        good_runs = without_failed(runs)
        if len(good_runs.seeds):
            averages.add(good_runs.seeds, collect_columns(estimators, case, good_runs))
    failed, *health_numbers = np.concatenate(health, axis=1)
    is_good = failed == 0
    labels_of_case = _labels_of(case)
    values: Values = {
        "time": case.times,
        "seed": group.seeds,
        "runs": np.count_nonzero(is_good),
        "failed_runs": np.count_nonzero(failed),
        "run_status": np.where(is_good, variables.KEPT, variables.FAILED),
    }
    values |= zip(HEALTH, health_numbers, strict=True)
    if stopped:
        reasons = [stopped.get(seed, "") for seed in group.seeds.tolist()]
        values["stopped"] = np.array(reasons, object)
    values |= collect_results(estimators, case, averages)
    values |= labels_of_case  # a varied key, such as packing_fraction, may be a variable otherwise
    values |= _missing_coordinates(case, values, table)
    values_of_good_runs = {
        **labels_of_case,
        "seed": group.seeds[is_good],
        "window": values["window"],
        **averages.run_values,
    }
    values_of_good_runs |= _missing_coordinates(case, values_of_good_runs, table)
    for estimator in own_estimators:
        refuse_misshapen(estimator, values)
        refuse_misshapen(estimator, values_of_good_runs)
    pieces = [values, values_of_good_runs]
    for values_at_time in distribution.at_each_time(case, averages):
        pieces.append(labels_of_case | values_at_time)
    return pieces


def _labels_of(case: Case) -> Values:
    """Return the labels of a case: scene, count, engine and the varied keys of its scene."""
    name = case.scene.name.partition(",")[0] if case.varied else case.scene.name
    labels_of_case: Values = {
        "scene": [name],
        "particles": [case.scene.particles],
        "engine": [case.engine.label],
    }
    for path in case.varied:
        labels_of_case[short_name(path)] = [value_of(case.scene, path)]
    return labels_of_case


def _missing_coordinates(case: Case, values: Values, table: Table) -> Values:
    """Return the coordinates, such as species and bins, of dimensions for which a case has none.

    Along dimensions of the user's own arrays they are 0, 1, ... unless these have coordinates.
    """
    own_sizes: dict[str, int] = {}
    for array in case.own.values():
        own_sizes |= zip(array.dims, array.shape, strict=True)
    coordinates_of_own = own_coordinates(case.own)
    dims = set(own_sizes)
    for name in values.keys() & table.keys():
        dims.update(table[name].dims)
    coordinates: Values = {}
    for dim in dims - values.keys():
        if dim in AXES:
            coordinates[dim] = AXES[dim].coordinates(case.scene)
        elif dim in coordinates_of_own:
            coordinates[dim] = np.array(coordinates_of_own[dim].coordinates)
        elif dim in own_sizes:
            coordinates[dim] = np.arange(own_sizes[dim])
    return coordinates


# --- cases that differ in times, seeds, ...


def outer_join(
    pieces: Sequence[Values],
    variables: Table,
    coordinates: Table,
    attributes: Mapping[str, str],
    labels: Collection[str] = CASE_DIMS,
) -> "Dataset":
    """Return the outer join of `pieces`; where no piece has a value, a variable has its value
    `absent`.

    Values of `labels` and texts come in order of appearance; other numbers ascend. Numbers that
    differ by less than SAME_TIME count as equal. `xarray.concat` and `unstack` give the same
    values, but sort all labels and hold every array twice.
    """
    import xarray

    dims = set(chain.from_iterable(variable.dims for variable in variables.values()))
    table = {**variables}
    for name, coordinate in coordinates.items():
        if dims.issuperset(coordinate.dims):
            table[name] = coordinate
    axes = {}
    for dim in dims:
        values = [piece[dim] for piece in pieces if dim in piece]
        axes[dim] = _union(values, dim in labels)
    data = {}
    for name, variable in table.items():
        array = axes[name] if name in axes else _filled(name, variable, pieces, axes)
        data[name] = (variable.dims, array, variable.attributes)
    names = [name for name in coordinates if name in data]
    return xarray.Dataset(data, attrs=attributes).set_coords(names)


def _filled(
    name: str, variable: Variable, pieces: Sequence[Values], axes: Mapping[str, Axis]
) -> np.ndarray:
    """Return the array of a variable over the axes of its dimensions, filled from all pieces."""
    shape = [len(axes[dim]) for dim in variable.dims]
    array: np.ndarray = np.full(shape, variable.absent, variable.dtype)
    for piece in pieces:
        if name in piece:
            positions = [_positions(piece[dim], axes[dim]) for dim in variable.dims]
            shape_of_piece = [len(rows) for rows in positions]
            array[np.ix_(*positions)] = np.reshape(piece[name], shape_of_piece)
    return array


def _union(values: Sequence[ArrayLike], in_order: bool) -> Axis:
    """Return all labels in order of appearance, or all numbers ascending unless `in_order`, each
    once.

    >>> _union([[0.0, 1.0], [0.5, 1.0 + 1e-12]], in_order=False)
    array([0. , 0.5, 1. ])
    """
    axis = np.concatenate(values)
    if in_order or axis.dtype.kind == "U":
        return list(dict.fromkeys(axis.tolist()))
    numbers = np.unique(axis)
    if numbers.dtype.kind in "iu":
        return numbers
    is_new = np.diff(numbers) > SAME_TIME * np.abs(numbers[1:])
    return numbers[np.append(True, is_new)]


def _positions(values: ArrayLike, axis: Axis) -> np.ndarray:
    """Return the indices of a piece's values in the union, which has numbers as texts if other
    pieces have texts.
    """
    if isinstance(axis, list):
        labels = np.asarray(values, np.asarray(axis).dtype)
        return np.array([axis.index(label) for label in labels.tolist()])
    numbers = np.asarray(values)
    if numbers.dtype.kind == "f":
        numbers = numbers - SAME_TIME * np.abs(numbers)
    return np.searchsorted(axis, numbers)
