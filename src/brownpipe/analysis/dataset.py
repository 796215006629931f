"""One labelled dataset from the trajectory files of a study: all estimates for each scene, particle count, engine."""

from collections import ChainMap
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, chain, pairwise
from typing import TYPE_CHECKING

import numpy as np

from brownpipe import stages
from brownpipe.analysis import (
    averaged,
    conditions,
    displacement,
    distribution,
    drift,
    non_gaussian,
    pairs,
    profile,
    thermodynamics,
    velocity,
)
from brownpipe.analysis.displacement import labels as labels_of
from brownpipe.analysis.distribution import chosen_times, ring_edges, rings_of
from brownpipe.analysis.estimator import NO_RUNS, Case, Columns, Options, add_runs
from brownpipe.analysis.outer_join import Part, joined
from brownpipe.analysis.runs import Group, RunBlock, Source, blocks_of, groups_of, reported, select
from brownpipe.analysis.variables import (
    ATTRIBUTES,
    COORDINATES,
    EACH,
    FAILED,
    KEPT,
    SAME_TIME,
    VARIABLES,
    Variable,
    names_of,
    with_uncertainties,
)
from brownpipe.analysis.varied import over_keys
from brownpipe.engines.ensemble import HEALTH
from brownpipe.engines.friction import default_windows
from brownpipe.errors import AnalysisError, RequestError
from brownpipe.observables import AXES
from brownpipe.observables.own import Own, OwnArray
from brownpipe.storage.layout import MEANING
from brownpipe.storage.origin import made_by, origin_attributes
from brownpipe.storage.trajectories import Outline

if TYPE_CHECKING:
    import xarray

SINGLE = conditions, displacement, distribution, non_gaussian, velocity  # of single disks, above all the tracer
COLLECTIVE = averaged, pairs, profile, thermodynamics, drift
ESTIMATORS = [module.ESTIMATOR for module in (*SINGLE, *COLLECTIVE)]
TABLES = [VARIABLES, *(estimator.variables for estimator in ESTIMATORS)]
ALL_VARIABLES = {name: one for table in TABLES for name, one in with_uncertainties(table).items()}
ALWAYS = {name for estimator in ESTIMATORS if estimator.always for name in with_uncertainties(estimator.variables)}
ALL_COORDINATES = {dim: Variable((dim,), *axis[:2]) for dim, axis in AXES.items()} | COORDINATES
ALL_COORDINATES |= {name: one for estimator in ESTIMATORS for name, one in estimator.coordinates.items()}
RUNS_FOR_RINGS = 200  # of a case, or all that it has: for default rings, chosen from its first blocks


def aggregate(
    sources: Iterable[Source],
    windows: Sequence[tuple[float, float]] | None = None,
    dr: float | None = None,
    rings: int | None = None,
    displacement_times: Sequence[float] = (),
    vary: Sequence[str] = (),
    vary_together: bool = False,
) -> "xarray.Dataset":
    """Return all estimates from trajectory files, or runs in memory, as one dataset.

    A file that is given with what it is to hold (`StoredFile`) is refused if it holds other runs.
    The files may hold any scenes, particle counts, engines and batches of seeds: every value depends on the runs alone,
    to the bit, and peak memory does not grow with their number. Scenes, counts and engines keep the order of the files.
    Failed runs are counted and left out of every average. Values that a case lacks (a shorter duration, fewer seeds)
    are NaN.

    windows: (start, end) of the straight-line fits [time], by default from a tenth and from half of the shortest
        run to its end.
    dr, rings: width [length] and number of the rings of the displacement distribution, by default from the data.
    displacement_times: its times [time], by default the end of each run.
    vary, vary_together: keys in which the scenes differ, each a dimension (`varied.over_keys`).

    Raises AnalysisError for files that do not belong together, for windows and times that coincide or that no run
    reaches, and what `read_trajectories` raises for broken files.
    """
    if (dr is None) != (rings is None):
        raise AnalysisError("rings: width and number must be given together")
    edges = None if dr is None else ring_edges(dr, rings)
    groups = groups_of(sources)
    outlines = [group.outline for group in groups]
    fitted = windows or default_windows([outline.scene for outline in outlines])
    options = Options(fitted, edges, tuple(displacement_times or ()))
    own, cases = _own_of(outlines), [Case(*one[:2], one.times, options, one.average, own=one.own) for one in outlines]
    _refuse_unfit(options, cases)
    *before, total = accumulate((len(group.seeds) for group in groups), initial=0)
    parts = [part for given in zip(cases, groups, before, strict=True) for part in _results(*given, total)]
    drift.adjust(parts)
    times = [*options.displacement_times]
    asked = {"fit_windows": windows or None, "ring_width": dr, "rings": rings, "displacement_times": times}
    made = made_by("aggregate") | origin_attributes(((group.outline, group.seeds) for group in groups), asked)
    attributes = ATTRIBUTES | {"msd_of": " or ".join(sorted({_followed(one) for one in outlines}))} | made
    variables = ALL_VARIABLES | with_uncertainties(averaged.variables_of(own))
    dataset = joined(parts, variables, ALL_COORDINATES, attributes, ALWAYS)
    return over_keys(dataset, [outline.scene for outline in outlines], vary, vary_together)


def _own_of(outlines: Sequence[Outline]) -> Own:
    """Return the arrays of the user's own functions. Raises AnalysisError if cases differ in more than shapes."""
    own: dict[str, OwnArray] = {}
    for name, array in chain.from_iterable(outline.own.items() for outline in outlines):
        if own.setdefault(name, array)._replace(shape=()) != array._replace(shape=()):
            raise AnalysisError(f"{name}: was measured by another function, or has other dimensions, in other runs")
    return own


def refuse_taken(own: Own) -> None:
    """Raise RequestError for arrays of the user's own with names that variables of runs or datasets have."""
    new = [(name, array.observable) for name, array in own.items() for name in (name, *array.dims) if name not in AXES]
    for name, function in new:
        taken = {*names_of(name)} & (ALL_VARIABLES.keys() | ALL_COORDINATES.keys() | MEANING.keys())
        if taken:
            raise RequestError(f"{function}: {name}: {min(taken)} is a name in runs or datasets; choose another one")


def _followed(outline: Outline) -> str:
    """Return in words whose squared displacement is averaged."""
    over_disks = outline.average == "disks" and "square_displacement" in (outline.observables or ())
    return "all disks equal to the tracer" if over_disks else "the tracer"


def _refuse_unfit(options: Options, cases: Sequence[Case]) -> None:
    """Refuse windows and times that coincide, windows that end after every run, and times that no run samples."""
    names, last = labels_of(options.windows), max(case.times[-1] for case in cases)
    if len(set(names)) < len(names):
        raise AnalysisError(f"fit windows {', '.join(names)}: must differ in their first six digits")
    for name, (_, end) in zip(names, options.windows, strict=True):
        if end * (1 - SAME_TIME) > last:
            raise AnalysisError(f"fit window {name}: must end by {last:g}, when the longest run does")
    sampled = np.concatenate([case.times[chosen_times(case)] for case in cases])
    for before, time in pairwise((-np.inf, *sorted(options.displacement_times))):
        if time - before <= SAME_TIME * time:
            raise AnalysisError(f"displacement time {time:g}: must be given once")
        if not np.isclose(sampled, time, rtol=SAME_TIME, atol=0.0).any():
            raise AnalysisError(f"displacement time {time:g}: must be a sample time of some run")


def _results(case: Case, group: Group, before: int, total: int) -> list[Part]:
    """Return the values of all variables for a case, from its group; `before` of the `total` runs are analysed.

    Those of the displacement distributions come as a part for each time, since each may have rings of its own.
    """
    averages, health, stopped = NO_RUNS, list[np.ndarray](), dict[int, str]()

    def good_runs() -> Iterator[RunBlock]:
        """Yield the runs that have not failed, block by block."""
        for runs in blocks_of(group):
            health.append(np.stack([reported(runs, name) for name in ("failed", *HEALTH)]))
            stopped.update(runs.stopped)
            good = health[-1][0] == 0
            if good.any():
                yield select(runs, good)
            stages.report("runs", before + sum(one.shape[1] for one in health), total)

    blocks, first = good_runs(), list[RunBlock]()
    while sum(len(runs.seeds) for runs in first) < RUNS_FOR_RINGS and (runs := next(blocks, None)) is not None:
        first.append(runs)
    case = case._replace(edges=rings_of(case, first))
    of_runs: dict[str, np.ndarray] = {}
    for runs in chain(first, blocks):
        parts = zip(*(estimator.columns(case, runs) for estimator in ESTIMATORS), strict=True)
        columns = Columns(*(dict(ChainMap(*part)) for part in parts))
        averages = add_runs(averages, runs.seeds, columns)
        for name, values in displacement.of_each_run(columns).items():
            of_runs.setdefault(name, np.full(len(group.seeds), np.nan))[np.isin(group.seeds, runs.seeds)] = values
    failed, *numbers = np.concatenate(health, axis=1)
    labels: Part = {name: [label] for name, label in zip(EACH, group.files[0].key, strict=True)}
    part = labels | {"time": case.times, "seed": group.seeds, **dict(zip(HEALTH, numbers, strict=True))}
    part |= {"runs": np.count_nonzero(failed == 0), "failed_runs": np.count_nonzero(failed)}
    part["run_status"] = np.where(failed == 0, KEPT, FAILED)
    part |= of_runs
    if stopped:
        part["stopped"] = np.array([stopped.get(seed, "") for seed in group.seeds.tolist()], object)
    for estimator in ESTIMATORS:
        part |= estimator.estimate(case, averages)
    dims = {dim for name in part.keys() & ALL_VARIABLES.keys() for dim in ALL_VARIABLES[name].dims}
    dims |= {dim for array in case.own.values() for dim in array.dims}
    part |= {dim: AXES[dim].coordinates(case.scene) for dim in dims & AXES.keys() - part.keys()}
    return [part, *(labels | of_time for of_time in distribution.at_each_time(case, averages))]
