"""Trajectory files of a study in, one labelled dataset out: every measure of every (scene, particle count, engine)."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from brownpipe.analysis import conditions, displacement, distribution, pairs, thermodynamics, velocity
from brownpipe.analysis.displacement import SAME_TIME, labels
from brownpipe.analysis.distribution import chosen_times, ring_edges, rings_of
from brownpipe.analysis.measure import NOTHING, Asked, Case, Columns, add_runs, estimated
from brownpipe.analysis.runs import blocks_of, chosen, groups_of
from brownpipe.analysis.variables import ATTRIBUTES, COORDINATES, EACH, FAILED, KEPT, VARIABLES
from brownpipe.errors import AnalysisError

MODULES = (conditions, displacement, distribution, velocity, pairs, thermodynamics)
MEASURES = tuple(module.MEASURE for module in MODULES)
HEALTH = ("energy_drift", "worst_overlap", "momentum_residual")
WINDOWS = ((0.1, 1.0), (0.5, 1.0))  # of the fits, where none are asked for
WIDEST = 1000.0  # ring, in units of the longer side of the box


class Measured(NamedTuple):
    """Every variable of one group of runs, and the axes it lies along."""

    case: Case
    values: dict  # name -> value of the shape its dimensions say
    axes: dict  # name of a coordinate -> (dimension, values)


def aggregate(paths, windows=None, dr=None, rings=None, displacement_times=()):
    """All measures of the trajectory files `paths` as one `xarray.Dataset`.

    The files may hold any scenes, particle counts, engines and batches of seeds, in any order: the result depends on
    the runs alone, to the bit, and the memory taken not on how many they are. Runs that failed are counted and left out
    of every average. `windows` are the times (start, end) of the straight-line fits, WINDOWS by default; `dr` and
    `rings` the displacement histogram's, by default from the data, `displacement_times` its times, by default the end
    of each run. What a scene does not have (a shorter duration, fewer seeds) is NaN. Raises `AnalysisError` for files
    that do not belong together (the same seed twice, one name for two scenes, two sources), for windows and times that
    are the same or that no run reaches, for rings far wider than any box, and what `storage.read_trajectories` raises
    for broken files.
    """
    if (dr is None) != (rings is None):
        raise AnalysisError("rings: width and number must be given together")
    edges = None if dr is None else ring_edges(dr, rings)
    asked = Asked(windows or WINDOWS, edges, tuple(displacement_times or ()))
    _refuse_same(asked)
    groups = groups_of(paths)
    cases = [_case(group, asked) for group in groups]
    _refuse_out_of_reach(cases, windows or (), dr or 0.0)
    _refuse_unsampled(cases, asked.displacement_times)
    return _assemble([_measured(case, group) for case, group in zip(cases, groups, strict=True)])


def _case(group, asked):
    outline = group.outline
    return Case(outline.scene, group.key[2], outline.times, asked, outline.average)


def _refuse_same(asked):
    if len(set(labels(asked.windows))) < len(asked.windows):
        raise AnalysisError(f"fit windows {', '.join(labels(asked.windows))}: must differ in their first six digits")
    times = sorted(asked.displacement_times)
    for earlier, later in pairwise(times):
        if later - earlier <= SAME_TIME * later:
            raise AnalysisError(f"displacement time {later:g}: must be given once")


def _refuse_out_of_reach(cases, windows, dr):
    """Windows that end after every run, and rings that would hold all of a box and much more."""
    last = max(case.times[-1] for case in cases)
    for label in (label for label, (_, end) in zip(labels(windows), windows, strict=True) if end * (1 - 1e-9) > last):
        raise AnalysisError(f"fit window {label}: must end by {last:g}, when the longest run does")
    most = WIDEST * max(max(case.scene.box.width, case.scene.box.height) for case in cases)
    if dr > most:
        raise AnalysisError(f"ring width {dr:g}: must be at most {most:g}, {WIDEST:g} times the longest box")


def _refuse_unsampled(cases, times):
    sampled = [time for case in cases for time in case.times[chosen_times(case)]]
    for time in times:
        if not np.isclose(sampled, time, rtol=SAME_TIME, atol=0.0).any():
            raise AnalysisError(f"displacement time {time:g}: must be a sample time of some run")


# --- runs to measures


def _measured(case, group):
    """Every variable of one group."""
    found, health, failed = NOTHING, [], []
    for runs in blocks_of(group):
        bad = np.asarray(runs.observables["failed"], bool)
        failed.append(bad)
        health.append(np.stack([runs.observables.get(name, np.full(len(bad), np.nan)) for name in HEALTH]))
        if not bad.all():
            kept = runs if not bad.any() else chosen(runs, ~bad)
            case = case if case.edges else case._replace(edges=rings_of(case, kept))
            found = add_runs(found, kept.seeds, _columns(case, kept))
    found, failed = estimated(found), np.concatenate(failed)
    values = {
        "runs": np.count_nonzero(~failed),
        "failed_runs": np.count_nonzero(failed),
        "run_status": np.where(failed, FAILED, KEPT),
        **dict(zip(HEALTH, np.concatenate(health, axis=1), strict=True)),
    }
    axes = {name: (name, [label]) for name, label in zip(EACH, case.key, strict=True)}
    axes |= {"time": ("time", case.times), "seed": ("seed", group.seeds)}
    for measure in MEASURES:
        mine = measure.estimate(case, found)
        if mine or any(variable.always for variable in measure.variables.values()):
            values, axes = values | mine, axes | measure.axes(case, found)
    return Measured(case, values, axes)


def _columns(case, runs):
    """What all measures take from some runs."""
    parts = [measure.sample(case, runs) for measure in MEASURES]
    return Columns(
        *({name: values for part in kind for name, values in part.items()} for kind in zip(*parts, strict=True))
    )


# --- measures to a dataset


def _assemble(measured):
    """Outer join of all groups over the union of their axes."""
    import xarray

    coordinates = _joined_axes([one.axes for one in measured])
    size = {name: len(values) for name, (dim, values) in coordinates.items() if name == dim}
    for one in measured:
        one.values["missing_seeds"] = size["seed"] - one.values["run_status"].size
    data = {}
    for name, variable in _table().items():
        holders = [one for one in measured if name in one.values]
        if holders or variable.always:
            full = np.full([size[dim] for dim in variable.dims], variable.absent, variable.dtype)
            for one in holders:
                at = [_positions(one.axes[dim][1], coordinates[dim][1]) for dim in variable.dims]
                full[np.ix_(*at)] = np.reshape(one.values[name], [len(places) for places in at])
            data[name] = (variable.dims, full, variable.attributes)
    used = {dim for dims, _, _ in data.values() for dim in dims}
    described = _described()
    along = {name: (dim, values, described[name]) for name, (dim, values) in coordinates.items() if dim in used}
    return xarray.Dataset(data, along, ATTRIBUTES)


def _table():
    """Every variable there can be."""
    return VARIABLES | {name: variable for measure in MEASURES for name, variable in measure.variables.items()}


def _described():
    return COORDINATES | {name: text for measure in MEASURES for name, text in measure.coordinates.items()}


def _joined_axes(axes):
    """Every coordinate over the union of what the groups have: name -> (dimension, values).

    Numbers and the names of cases ascend; other labels are in the order in which they appear.
    """
    joined = {}
    for name, (dim, _) in {name: along for one in axes for name, along in one.items()}.items():
        if name == dim:
            joined[name] = (dim, _union([one[name][1] for one in axes if name in one], name in EACH))
    for name, (dim, _) in {name: along for one in axes for name, along in one.items()}.items():
        if name != dim:
            joined[name] = (dim, _along([one for one in axes if name in one], name, dim, joined[dim][1]))
    return joined


def _union(parts, ascending):
    if isinstance(parts[0][0], str):
        labels = dict.fromkeys(label for part in parts for label in part)
        return sorted(labels) if ascending else list(labels)
    axis = np.unique(np.concatenate(parts))
    return axis if axis.dtype.kind in "iu" else axis[np.append(True, np.diff(axis) > SAME_TIME * np.abs(axis[1:]))]


def _along(axes, name, dim, axis):
    """The values of the coordinate `name`, which belong to the values of another."""
    values = np.full(len(axis), np.nan)
    for one in axes:
        values[_positions(one[dim][1], axis)] = one[name][1]
    return values


def _positions(own, axis):
    """Where the values of a group are in the union of all."""
    if isinstance(axis, list):
        return np.array([axis.index(label) for label in own])
    own = np.asarray(own)
    return np.searchsorted(axis, own - SAME_TIME * np.abs(own) if own.dtype.kind == "f" else own)
