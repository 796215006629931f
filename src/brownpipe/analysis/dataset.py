"""One labelled dataset from the trajectory files of a study: all estimates for each scene, particle count, engine."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, chain, pairwise
from typing import TYPE_CHECKING

import numpy as np

from brownpipe import stages
from brownpipe.analysis import (
    conditions,
    displacement,
    distribution,
    drift,
    non_gaussian,
    orientation,
    pairs,
    profile,
    thermodynamics,
    velocity,
)
from brownpipe.analysis.displacement import labels
from brownpipe.analysis.distribution import chosen_times, ring_edges, rings_of
from brownpipe.analysis.estimator import NO_RUNS, Case, Columns, Options, add_runs, with_estimates
from brownpipe.analysis.outer_join import Part, joined
from brownpipe.analysis.runs import Group, RunBlock, Source, blocks_of, groups_of, select
from brownpipe.analysis.variables import (
    ATTRIBUTES,
    COORDINATES,
    EACH,
    FAILED,
    KEPT,
    SAME_TIME,
    VARIABLES,
    Variable,
    with_uncertainties,
)
from brownpipe.engines.failures import HEALTH
from brownpipe.errors import AnalysisError
from brownpipe.observables import AXES
from brownpipe.scene.sample_times import default_fit_windows
from brownpipe.storage import Outline, made_by, origin_attributes

if TYPE_CHECKING:
    import xarray

ESTIMATORS = tuple(
    module.ESTIMATOR
    for module in (
        conditions,
        displacement,
        distribution,
        non_gaussian,
        velocity,
        pairs,
        orientation,
        profile,
        thermodynamics,
        drift,
    )
)
TABLES = [VARIABLES, *(estimator.variables for estimator in ESTIMATORS)]
ALL_VARIABLES = {name: one for table in TABLES for name, one in with_uncertainties(table).items()}
ALWAYS = {name for estimator in ESTIMATORS if estimator.always for name in with_uncertainties(estimator.variables)}
ALL_COORDINATES = {
    **COORDINATES,
    **{name: one for estimator in ESTIMATORS for name, one in estimator.coordinates.items()},
    **{
        dim: Variable((dim,), axis.units, axis.long_name)
        for dim, axis in AXES.items()
        if dim not in ("time", "quarter")
    },
}
RUNS_FOR_RINGS = 200  # of a case, or all that it has: for default rings, chosen from its first blocks
WIDEST_RING = 1000.0  # ring, in units of the longer side of the box


def aggregate(
    sources: Iterable[Source],
    windows: Sequence[tuple[float, float]] | None = None,
    dr: float | None = None,
    rings: int | None = None,
    displacement_times: Sequence[float] = (),
) -> "xarray.Dataset":
    """Return all estimates from trajectory files, or runs in memory, as one dataset.

    A file that is given with what it is to hold (`storage.StoredFile`) is refused if it holds other runs.
    The files may hold any scenes, particle counts, engines and batches of seeds: every value depends on the runs alone,
    to the bit, and peak memory does not grow with their number. Scenes, counts and engines keep the order of the files.
    Failed runs are counted and left out of every average. Values that a case lacks (a shorter duration, fewer seeds)
    are NaN.

    windows: (start, end) of the straight-line fits [time], by default from a tenth and from half of the shortest
        run to its end.
    dr, rings: width [length] and number of the rings of the displacement distribution, by default from the data.
    displacement_times: its times [time], by default the end of each run.

    Raises AnalysisError for files that do not belong together, for windows and times that coincide or that no run
    reaches, for rings far wider than any box, and what `storage.read_trajectories` raises for broken files.
    """
    if (dr is None) != (rings is None):
        raise AnalysisError("rings: width and number must be given together")
    edges = None if dr is None else ring_edges(dr, rings)
    groups = groups_of(sources)
    fitted = windows or default_fit_windows(min(group.outline.scene.duration for group in groups))
    options = Options(fitted, edges, tuple(displacement_times or ()))
    _refuse_same(options)
    outlines = [group.outline for group in groups]
    cases = [Case(one.scene, one.engine, one.times, options, one.average) for one in outlines]
    _refuse_out_of_reach(cases, windows or (), dr or 0.0)
    _refuse_unsampled(cases, options.displacement_times)
    *before, total = accumulate((len(group.seeds) for group in groups), initial=0)
    parts = [_results(*given, total) for given in zip(cases, groups, before, strict=True)]
    drift.adjust(parts)
    seeds = np.unique(np.concatenate([group.seeds for group in groups]))
    for part, group in zip(parts, groups, strict=True):
        ends = [other.seeds[[0, -1]] for other in groups if other.outline.engine == group.outline.engine]
        asked = (seeds >= np.min(ends)) & (seeds <= np.max(ends))
        part["missing_seeds"] = np.count_nonzero(asked) - len(group.seeds)
    times = [*options.displacement_times]
    asked = {"fit_windows": windows or None, "ring_width": dr, "rings": rings, "displacement_times": times}
    made = made_by("aggregate") | origin_attributes(((group.outline, group.seeds) for group in groups), asked)
    attributes = ATTRIBUTES | {"msd_of": " or ".join(sorted({_followed(one) for one in outlines}))} | made
    return joined(parts, ALL_VARIABLES, ALL_COORDINATES, attributes, ALWAYS, kept=EACH)


def _followed(outline: Outline) -> str:
    """Return in words whose squared displacement is averaged."""
    over_disks = outline.average == "disks" and "square_displacement" in (outline.observables or ())
    return "all disks equal to the tracer" if over_disks else "the tracer"


def _refuse_same(options: Options) -> None:
    if len(set(labels(options.windows))) < len(options.windows):
        raise AnalysisError(f"fit windows {', '.join(labels(options.windows))}: must differ in their first six digits")
    times = sorted(options.displacement_times)
    for earlier, later in pairwise(times):
        if later - earlier <= SAME_TIME * later:
            raise AnalysisError(f"displacement time {later:g}: must be given once")


def _refuse_out_of_reach(cases: Sequence[Case], windows: Sequence[tuple[float, float]], dr: float) -> None:
    """Refuse windows that end after every run, and rings far wider than every box."""
    last = max(case.times[-1] for case in cases)
    for label in (label for label, (_, end) in zip(labels(windows), windows, strict=True) if end * (1 - 1e-9) > last):
        raise AnalysisError(f"fit window {label}: must end by {last:g}, when the longest run does")
    widest = WIDEST_RING * max(max(case.scene.box.width, case.scene.box.height) for case in cases)
    if dr > widest:
        raise AnalysisError(f"ring width {dr:g}: must be at most {widest:g}, {WIDEST_RING:g} times the longest box")


def _refuse_unsampled(cases: Sequence[Case], times: Sequence[float]) -> None:
    sampled = [time for case in cases for time in case.times[chosen_times(case)]]
    for time in times:
        if not np.isclose(sampled, time, rtol=SAME_TIME, atol=0.0).any():
            raise AnalysisError(f"displacement time {time:g}: must be a sample time of some run")


def _results(case: Case, group: Group, before: int, total: int) -> Part:
    """Return the values of all variables for a case, from its group; `before` of the `total` runs are analysed."""
    averages, health, masks, stopped = NO_RUNS, [], [], dict[int, str]()

    def good_runs() -> Iterator[RunBlock]:
        """Yield the runs that have not failed, block by block."""
        for runs in blocks_of(group):
            bad = np.asarray(runs.observables["failed"], bool)
            masks.append(bad)
            stopped.update(runs.stopped)
            health.append(np.stack([runs.observables.get(name, np.full(len(bad), np.nan)) for name in HEALTH]))
            if not bad.all():
                yield select(runs, ~bad) if bad.any() else runs
            stages.report("runs", before + sum(map(len, masks)), total)

    blocks = good_runs()
    first = _enough_for_rings(blocks)
    case = case._replace(edges=rings_of(case, first))
    for runs in chain(first, blocks):
        averages = add_runs(averages, runs.seeds, _columns(case, runs))
    averages = with_estimates(averages)
    failed = np.concatenate(masks)
    part: Part = {name: [label] for name, label in zip(EACH, group.files[0].key, strict=True)}
    part |= {
        "time": case.times,
        "seed": group.seeds,
        "runs": np.count_nonzero(~failed),
        "failed_runs": np.count_nonzero(failed),
        "run_status": np.where(failed, FAILED, KEPT),
        **dict(zip(HEALTH, np.concatenate(health, axis=1), strict=True)),
    }
    if stopped:
        part["stopped"] = np.array([stopped.get(seed, "") for seed in group.seeds.tolist()], object)
    for estimator in ESTIMATORS:
        part |= estimator.estimate(case, averages)
    dims = {dim for name in part.keys() & ALL_VARIABLES.keys() for dim in ALL_VARIABLES[name].dims}
    return part | {dim: AXES[dim].coordinates(case.scene) for dim in dims & AXES.keys() - part.keys()}


def _enough_for_rings(blocks: Iterator[RunBlock]) -> list[RunBlock]:
    """Return the next blocks up to RUNS_FOR_RINGS runs or more, all if there are fewer."""
    first: list[RunBlock] = []
    while sum(len(runs.seeds) for runs in first) < RUNS_FOR_RINGS and (runs := next(blocks, None)) is not None:
        first.append(runs)
    return first


def _columns(case: Case, runs: RunBlock) -> Columns:
    """The columns of all estimators."""
    parts = zip(*(estimator.columns(case, runs) for estimator in ESTIMATORS), strict=True)
    return Columns(*({name: values for one in part for name, values in one.items()} for part in parts))
