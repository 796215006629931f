"""One labelled dataset from the trajectory files of a study: all estimates for each scene, particle
count, engine.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from brownpipe.analysis import (
    diffusive,
    displacement,
    distribution,
    drift,
    pairs,
    thermodynamics,
    variables,
    velocity,
)
from brownpipe.analysis.estimator import Averages, Case, columns_of, results_of
from brownpipe.analysis.goodness import holm
from brownpipe.analysis.runs import (
    Group,
    Source,
    blocks_of,
    first_good_runs,
    groups_of,
    reported,
    without_failed,
)
from brownpipe.analysis.variables import EACH, SAME_TIME, VARIED, Mean, Variable, with_uncertainties
from brownpipe.analysis.windows import Window, candidate_windows, labels
from brownpipe.engines.ensemble import HEALTH
from brownpipe.errors import AnalysisError
from brownpipe.observables import AXES
from brownpipe.observables.observable import RunArray
from brownpipe.observables.own import taken
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.variation import short_name, unit_of, value_of
from brownpipe.storage.datasets import origin_attributes
from brownpipe.storage.layout import VARIABLES
from brownpipe.storage.trajectories import Trajectories

if TYPE_CHECKING:
    from xarray import Dataset

Part = dict[
    str, Any
]  # results of one case: variable or coordinate -> array whose size is that of its dimensions

ESTIMATORS = displacement, distribution, velocity, pairs, thermodynamics, drift
# These come first in a dataset, so that xarray shows them among its hundred variables; then other
# physics, then health.
FIRST = (
    "msd",
    "diffusion_coefficient",
    "compressibility",
    "contact_value",
    "velocity_autocorrelation",
)
BY_NAME = with_uncertainties(
    {
        name: one
        for part in (displacement, diffusive, *ESTIMATORS[1:], variables)
        for name, one in part.VARIABLES.items()
    }
)
ALL_VARIABLES = {name: BY_NAME[name] for name in (*FIRST, *BY_NAME)}
LABELS_AND_HEALTH = {
    *displacement.COORDINATES,
    *distribution.COORDINATES,
    *HEALTH,
    "runs",
    "failed_runs",
    "run_status",
}
ALWAYS = LABELS_AND_HEALTH.union(
    with_uncertainties(displacement.VARIABLES | diffusive.VARIABLES | distribution.AT_TIMES)
)  # in every dataset
ALL_COORDINATES = {
    dim: Variable((dim,), *axis[:2]) for dim, axis in AXES.items()
} | variables.COORDINATES
ALL_COORDINATES |= displacement.COORDINATES | distribution.COORDINATES | drift.COORDINATES
taken.update(ALL_VARIABLES, ALL_COORDINATES, VARIABLES)
Table = Mapping[str, Variable]


def aggregate(
    sources: Iterable[Source],
    windows: Sequence[tuple[float, float]] | None = None,
    dr: float | None = None,
    rings: int | None = None,
    displacement_times: Sequence[float] = (),
    vary: Sequence[str] = (),
    vary_together: bool = False,
) -> "Dataset":
    """Return all estimates from trajectory files, or runs in memory, as one dataset.

    A `StoredFile` is refused if it holds other runs than those stated. The files may hold any
    scenes, particle counts, engines and batches of seeds: every value depends on the runs alone, to
    the bit, and peak memory does not grow with their number. Scenes, counts and engines keep the
    order of the files. Failed runs are counted and left out of every average. Values that a case
    lacks (a shorter duration, fewer seeds) are NaN.

    windows: (start, end) of the straight-line fits [time], by default those of
    `windows.candidate_windows` in whose first most cases have a D without a mark (`diffusive`).
    dr, rings: width [length] and number of the rings of the displacement distribution, by default
    from the data.
    displacement_times: its times [time], by default the end of each run.
    vary, vary_together: keys in which the scenes differ, each a dimension in place of a scene for
    each combination of
        their values; together, keys beyond the first are coordinates along the dimension of the
        first.

    Raises AnalysisError for files that do not belong together, for windows that coincide, or
    windows and times that no run reaches or can use, and what `read_trajectories` raises for broken
    files.
    """
    if (dr is None) != (rings is None):
        raise AnalysisError("rings: width and number must be given together")
    groups = groups_of(sources)
    every = [group.pattern.contents for group in groups]
    scenes = [contents.scene for contents in every]
    times = [*displacement_times]
    cases = [
        Case(
            contents.scene,
            contents.engine,
            contents.ensemble.times,
            contents.ensemble.average,
            windows or (),
            times,
            None if dr is None else dr * np.arange(rings + 1),
            own=contents.ensemble.own,
            varied=vary,
        )
        for contents in every
    ]
    ended = [{*one.record, *one.measured} for one in every if one.measured is not None]
    if (
        ended
        and set().union(*ended).isdisjoint({"tracer", "square_displacement"})
        and (windows or dr or times)
    ):
        raise AnalysisError(
            "fit windows, rings and displacement times: must go with runs that have displacements"
        )
    refuse_windows(windows or (), [case.times for case in cases])
    _refuse_times(cases)
    own = _own_variables(groups)
    pairs_of_windows: list[tuple[Window, Window]] = []
    if not windows:
        end = displacement.best_end(cases, groups)
        pairs_of_windows = candidate_windows(scenes, end)
        all_windows = tuple(dict.fromkeys(chain.from_iterable(pairs_of_windows)))
        cases = [case._replace(windows=all_windows) for case in cases]
    parts: list[Part] = []
    for case, group in tracked([*zip(cases, groups, strict=True)], "cases"):
        parts += _results(case, group)
    asked = {
        "fit_windows": windows or None,
        "ring_width": dr,
        "rings": rings,
        "displacement_times": times,
    }
    made = origin_attributes(
        "aggregate", ((group.pattern.contents, group.seeds) for group in groups), asked
    )
    attributes = (
        variables.ATTRIBUTES
        | {"msd_of": " or ".join(sorted({*map(_followed, every)})), "average": cases[0].average}
        | made
    )
    found = ALWAYS.union(*parts)
    held = {
        name: one
        for name, one in (ALL_VARIABLES | with_uncertainties(own)).items()
        if name in found
    }
    table, keys = _over_keys(held, scenes, vary, vary_together)
    attributes |= {VARIED: " ".join(keys)} if keys else {}
    dataset = joined(parts, table, {**ALL_COORDINATES, **keys}, attributes, (*EACH, *keys))
    if "drift_p_value" in dataset:  # all cases are one family of tests
        p = dataset.drift_p_value
        p.values = holm(p.values.ravel()).reshape(p.shape)
    if windows:
        return diffusive.marked(dataset)
    return diffusive.best_windows(dataset, pairs_of_windows)


def _over_keys(
    table: Table, scenes: Sequence[Scene], paths: Sequence[str], together: bool
) -> tuple[Table, Table]:
    """Return variables with a dimension for each varied key behind that of the scene, and the keys
    as coordinates.

    With `together`, keys beyond the first are coordinates along the dimension of the first. A
    variable with the name of a key, such as the packing fraction, is the coordinate then.
    """
    values = {
        short_name(path): np.array([value_of(scene, path) for scene in scenes]) for path in paths
    }
    dims = [*values][: 1 if together else None]
    keys = {
        key: Variable(
            (key if key in dims else dims[0],), unit_of(path), path, (), of_key.dtype, of_key[0]
        )
        for path, (key, of_key) in zip(paths, values.items(), strict=True)
    }
    spread = {
        name: one._replace(dims=(EACH[0], *dims, *one.dims[1:])) for name, one in table.items()
    }
    return {name: one for name, one in spread.items() if name not in keys}, keys


def _difference(one: RunArray, other: RunArray) -> str:
    """Return how an array of the user's own differs between runs that cannot be joined, and the
    cure.
    """
    if one.observable != other.observable:
        return f"is of {other.observable}, in other runs of {one.observable}; rename one of them"
    if one.source != other.source:
        return (
            f"was measured by another function {one.observable}, or by its file before an edit; "
            "measure all runs by the same"
        )
    return f"must be alike in all runs; has {other[:3]}, in other runs {one[:3]}"


def _own_variables(groups: Sequence[Group]) -> dict[str, Variable]:
    """Return the variables of the user's own functions. Raises AnalysisError if arrays differ in
    more than shape.
    """
    own: dict[str, RunArray] = {}
    for file in chain.from_iterable(group.files for group in groups):
        for name, array in file.contents.ensemble.own.items():
            if own.setdefault(name, array)._replace(shape=()) != array._replace(shape=()):
                raise AnalysisError(f"{file.path}: {name}: {_difference(own[name], array)}")
    return {
        name: Mean(
            (*EACH, *one.dims), one.units, one.long_name, extra={"observable": one.observable}
        )
        for name, one in own.items()
    }


def _followed(runs: Trajectories) -> str:
    """Return in words whose squared displacement is averaged."""
    over_disks = runs.ensemble.average == "disks" and "square_displacement" in (runs.measured or ())
    return "all disks equal to the tracer" if over_disks else "the tracer"


def refuse_windows(windows: Sequence[tuple[float, float]], times: Sequence[np.ndarray]) -> None:
    """Refuse fit windows that coincide, and one that fits no run; `times` has the sample times of
    each scene.
    """
    names, last = labels(windows), max(one[-1] for one in times)
    if len(set(names)) < len(names):
        raise AnalysisError(
            f"fit windows {', '.join(names)}: must differ in their first six digits"
        )
    for name, window in zip(names, windows, strict=True):
        if all(np.isnan(displacement.line_weights(one, window)).all() for one in times):
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


def _results(case: Case, group: Group) -> list[Part]:
    """Return the values of all variables for a case, from its group.

    Those of the displacement distributions come as a part for each time, since each may have rings
    of its own.
    """
    first = first_good_runs(group) if case.edges is None else []
    case = case._replace(rings=distribution.rings_of(case, first))
    averages = Averages()
    stopped: dict[int, str] = {}
    health = []
    for runs in blocks_of(group):
        health.append([reported(runs, name) for name in ("failed", *HEALTH)])
        stopped.update(runs.stopped)
        good_runs = without_failed(runs)
        if len(good_runs.seeds):
            averages.add(good_runs.seeds, columns_of(ESTIMATORS, case, good_runs))
    failed, *numbers = np.concatenate(health, axis=1)
    name = case.scene.name.partition(",")[0] if case.varied else case.scene.name
    names: Part = {
        "scene": [name],
        "particles": [case.scene.particles],
        "engine": [case.engine.label],
    }
    names |= {short_name(path): [value_of(case.scene, path)] for path in case.varied}
    part = names | {
        "time": case.times,
        "seed": group.seeds,
        **dict(zip(HEALTH, numbers, strict=True)),
    }
    part |= {"runs": np.count_nonzero(failed == 0), "failed_runs": np.count_nonzero(failed)}
    part["run_status"] = np.where(failed == 0, variables.KEPT, variables.FAILED)
    if stopped:
        part["stopped"] = np.array([stopped.get(seed, "") for seed in group.seeds.tolist()], object)
    part |= results_of(ESTIMATORS, case, averages) | names
    dims = {dim for name in part.keys() & ALL_VARIABLES.keys() for dim in ALL_VARIABLES[name].dims}
    own = {
        dim: size
        for array in case.own.values()
        for dim, size in zip(array.dims, array.shape, strict=True)
    }
    for dim in (dims | own.keys()) - part.keys():
        part[dim] = AXES[dim].coordinates(case.scene) if dim in AXES else np.arange(own[dim])
    good = names | {"seed": group.seeds[failed == 0], "window": part["window"]} | averages.kept
    return [
        part,
        good,
        *(names | of_time for of_time in distribution.at_each_time(case, averages)),
    ]


# --- cases that differ in times, seeds, ...


def joined(
    parts: Sequence[Part],
    variables: Table,
    coordinates: Table,
    attributes: dict,
    labels: Collection[str] = EACH,
) -> "Dataset":
    """Return the outer join of `parts`; where a part has no value, a variable has its value
    `absent`.

    Values of `labels` and texts come in order of appearance; other numbers ascend. Numbers that
    differ by less than SAME_TIME count as equal. `xarray.concat` and `unstack` give the same
    values, but sort all labels and hold every array twice.
    """
    import xarray

    dims = {dim for one in variables.values() for dim in one.dims}
    held = {
        **variables,
        **{name: one for name, one in coordinates.items() if dims.issuperset(one.dims)},
    }
    axes = {
        dim: _union([part[dim] for part in parts if dim in part], dim in labels) for dim in dims
    }
    data = {}
    for name, variable in held.items():
        full: np.ndarray = np.full(
            [len(axes[dim]) for dim in variable.dims], variable.absent, variable.dtype
        )
        for part in (part for part in parts if name in part and name not in axes):
            places = [_positions(part[dim], axes[dim]) for dim in variable.dims]
            full[np.ix_(*places)] = np.reshape(part[name], [len(rows) for rows in places])
        data[name] = (variable.dims, axes.get(name, full), variable.attributes)
    return xarray.Dataset(data, attrs=attributes).set_coords(
        [name for name in coordinates if name in data]
    )


def _union(parts: Sequence[Any], in_order: bool) -> list | np.ndarray:
    """All labels in order of appearance, or all numbers ascending unless `in_order`, each once."""
    axis = np.concatenate(parts)
    if in_order or axis.dtype.kind == "U":
        return list(dict.fromkeys(axis.tolist()))
    axis = np.unique(axis)
    return (
        axis
        if axis.dtype.kind in "iu"
        else axis[np.append(True, np.diff(axis) > SAME_TIME * np.abs(axis[1:]))]
    )


def _positions(values: Any, axis: list | np.ndarray) -> np.ndarray:
    """Indices of a part's values in the union."""
    if isinstance(axis, list):
        return np.array([axis.index(label) for label in values])
    values = np.asarray(values)
    return np.searchsorted(
        axis, values - SAME_TIME * np.abs(values) if values.dtype.kind == "f" else values
    )
