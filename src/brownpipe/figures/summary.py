"""The results of a study as a short table, printed at its end, and all numbers behind it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis import drift
from brownpipe.analysis.goodness import FAMILY_LEVEL, holm, in_words
from brownpipe.analysis.variables import FAILED, MISSING
from brownpipe.analysis.varied import labels_of_cases
from brownpipe.engines.ensemble import stopped_in_words
from brownpipe.engines.friction import window_caution
from brownpipe.figures.cases import (
    at_last_distribution,
    cases_of,
    drifts,
    early_mark,
    has,
    over_time,
    plus_minus,
    scene_of,
    title_of,
    varied_values,
)
from brownpipe.figures.tables import aligned, label_of
from brownpipe.quoting import in_lines
from brownpipe.scene.seeds import brief_seed_text

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

TESTS = ("with D = MSD/4t", "with fitted D")  # of eq. (18), the first two models of a dataset
QUESTION = "eq. (18) rejected?"  # above the columns of the tests
FIT = (
    *("window_start", "window_end", "slope", "slope_standard_error"),
    *("diffusion_coefficient", "diffusion_coefficient_standard_error"),
)
TESTED = ("chi_square", "degrees_of_freedom", "p_value", "p_value_joint")
SHAPE = ("kurtosis", "kurtosis_standard_error", "kurtosis_p_value")


LINE = 100  # characters


class Answer(NamedTuple):
    """The results of a study in words."""

    columns: list[tuple[str, ...]]  # heading and cells; those of TESTS, the last, only if there are tests
    legend: list[str]  # lines that explain the columns
    missing: list[str]  # lines that name failed and missing seeds
    drifting: list[str]  # lines that name cases that are not in equilibrium, or of which it cannot be told


def summary(dataset: Dataset) -> str:
    """Return the results as a text table with one line per scene, particle count and engine, and lines below it."""
    found = answer(dataset)
    lines = aligned(found.columns)
    above = [" " * lines[0].index(TESTS[0]) + QUESTION] if found.columns[-1][0] in TESTS else []
    return in_lines([*above, *lines, *found.legend, *found.missing, *found.drifting]) + "\n"


def answer(dataset: Dataset) -> Answer:
    """Return the results of each scene, particle count and engine.

    The columns are the number of runs, the MSD at the end and D = slope/4 over the first fit window with their standard
    errors over runs, and the verdict on eq. (18) with either D. All tests of the table are one family: a model
    is rejected at the family-wise level (Holm).
    """
    cases = cases_of(dataset)
    p = np.array([_p_values(case) for case in cases]).reshape(-1, len(TESTS))
    rejected = holm(p.ravel()).reshape(p.shape) < FAMILY_LEVEL
    durations = {case.duration.item() for case in cases}
    end = f"MSD(t = {durations.pop():g})" if len(durations) == 1 else "MSD at the end"
    keys = [name.replace("_", " ") for name in labels_of_cases(dataset)[1:-2]]
    rows = [("scene", *keys, "N", "engine", "runs", end, "D", *TESTS)]
    for case, of_case, no in zip(cases, p, rejected, strict=True):
        names = (case.scene.item(), *varied_values(case).values(), str(case.particles.item()), case.engine.item())
        rows.append((*names, str(int(case.runs)), *_estimates(case), *map(_verdict, of_case, no)))
    tests = int(np.count_nonzero(np.isfinite(p)))
    hidden = {*(() if tests else TESTS), *(("engine",) if dataset.sizes["engine"] == 1 else ())}
    columns = [column for column in zip(*rows, strict=True) if column[0] not in hidden]
    return Answer(columns, [*_legend(dataset, cases, tests)], [*missing_runs(cases)], [*drifting(cases)])


def _estimates(case: Dataset) -> list[str]:
    """Return the MSD at the end and D in the first fit window with their standard errors; `-` where there is none.

    A star marks those of runs that drift, a ring a D whose fit window begins before motion is diffusive.
    """
    if not has(case, "msd"):
        return ["-", "-"]
    estimates = [(over_time(case).isel(time=-1), "msd"), (case.isel(window=0), "diffusion_coefficient")]
    star = " *" * drifts(case)
    msd, d = (plus_minus(part[name], part[f"{name}_standard_error"]) + star for part, name in estimates)
    return [msd, d + early_mark(case.isel(window=0))]


def _p_values(case: Dataset) -> np.ndarray | list[float]:
    """The p-values (2,) of eq. (18) with either D, by rings and kurtosis together; NaN where there is no test."""
    return at_last_distribution(case).p_value_joint.values[: len(TESTS)] if has(case, "msd") else [np.nan] * len(TESTS)


def _verdict(p: float, rejected: bool) -> str:
    return "-" if np.isnan(p) else f"{'yes' if rejected else 'no'}, {in_words(p)}"


def _legend(dataset: Dataset, cases: list[Dataset], tests: int) -> Iterator[str]:
    """Lines that explain the columns, and the tests for equilibrium."""
    whose = dataset.attrs.get("msd_of", "the tracer")
    yield f"N: number of disks. MSD: mean squared displacement of {whose}. All in the scene's reduced units."
    yield f"D: a quarter of the slope of the MSD over t in {dataset.window.values[0]}. ±: one standard error over runs."
    starts = {f"{scene_of(case)}, N = {case.particles.item()}": case.diffusive_from.item() for case in cases}
    if caution := window_caution((dataset.window_start.values[0], dataset.window_end.values[0]), starts):
        yield from textwrap.wrap(f"° {caution}.", LINE)
    yield from _tests_of_equilibrium(cases)
    if tests:
        shown = [case for case in cases if has(case, "msd")]
        times = sorted({at_last_distribution(case).displacement_time.item() for case in shown})
        at = "at the end" if len(times) > 1 else f"at t = {times[0]:g}"
        family = f"the {tests} tests of this table" if tests > 1 else "the one test of this table"
        yield f"Eq. (18): x and y {at} are normal, of variance 2Dt; tested by ring counts and kurtosis."
        yield f"yes: rejected at a family-wise level of {FAMILY_LEVEL:.0%} for {family} (Holm); no: not rejected."
        power = max(float(at_last_distribution(case).power_5_percent.max()) for case in shown)
        yield f"Power: by ring counts alone, a D wrong by 5% is rejected with a probability of at most {power:.0%}."


def _tests_of_equilibrium(cases: list[Dataset]) -> Iterator[str]:
    """Two lines on the tests of cases that claim equilibrium: number, level, power, and what they do not see."""
    tested = [case for case in cases if has(case, "drift_p_value")]
    tests = sum(int(np.isfinite(case.drift_p_value).sum()) for case in tested)
    if tests:
        found = max(drift.found_with_power(case.drift_standard_error.values, int(case.runs), tests) for case in tested)
        family = f"level {drift.LEVEL:.0%} for all {tests} tests (Holm)"
        yield f"Equilibrium: the first and the last quarter of each run are compared, {family}."
        power = f"{drift.POWER:.0%} of the pressure's drifts by {100 * found:.2g} % are found"
        yield f"{power}; changes that take longer than the runs are not seen."


def drifting(cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the cases, marked by a star, whose runs drift, and those where it cannot be told."""
    for case in (case for case in cases if has(case, "time_to_try")):
        if drifts(case):
            values = (case[name].values for name in ("drift", "drift_standard_error", "drift_p_value"))
            found = drift.Drift(case["quantity"].values.tolist(), *values)
            words = drift.in_words(found, case.time_to_try.item())
            yield f"* {scene_of(case)}, N = {case.particles.item()}: {words}"
        elif not has(case, "drift_p_value"):
            yield f"{title_of(case)}: {drift.TOO_FEW}"


def missing_runs(cases: list[Dataset]) -> Iterator[str]:
    """Lines that name the seeds whose runs failed or are missing, why runs could not go on, and the risk of a bias.

    Missing are seeds from the first to the last of the same engine: engines may have seeds of their own.
    """
    for case in cases:
        run = np.any([other.run_status.values != MISSING for other in cases if other.engine == case.engine], axis=0)
        asked = np.logical_or.accumulate(run) & np.logical_or.accumulate(run[::-1])[::-1]
        for status, fate in ((FAILED, "failed and left out"), (MISSING, "missing")):
            seeds = case.seed.values[(case.run_status.values == status) & asked]
            if seeds.size:
                reasons = case.stopped.values.tolist() if status == FAILED and "stopped" in case else ()
                stopped = {seed: why for seed, why in zip(case.seed.values.tolist(), reasons, strict=False) if why}
                reason = f"; {stopped_in_words(stopped)}" if stopped else ""
                which = f"{seeds.size} of {np.count_nonzero(asked)} seeds ({brief_seed_text(seeds)})"
                yield f"{title_of(case)}: {fate}: {which}{reason}"
    if failed := sum(int(case.failed_runs) for case in cases):
        runs = "1 failed run" if failed == 1 else f"{failed} failed runs"
        yield f"The averages leave out {runs}; they are biased if runs that fail differ from the others."


def summary_table(dataset: Dataset) -> DataFrame:
    """Return every number of the summary, and those of the other fit windows: one row per case and window."""
    from pandas import DataFrame

    rows = []
    for case in cases_of(dataset):
        counts = {name: case[name].item() for name in ("runs", "failed_runs")}
        last = over_time(case).isel(time=slice(-1, None))
        end = {name: last[name].item() if last.sizes["time"] else np.nan for name in ("msd", "msd_standard_error")}
        distribution = at_last_distribution(case)
        shape = {name: distribution[name].item() if name in distribution else np.nan for name in SHAPE}
        of_models = [(test, model) for model in dataset.model.values for test in TESTED]
        tests = {f"{test}, {model}": distribution[test].sel(model=model).item() for test, model in of_models}
        before = label_of(case) | counts | {"time": case.duration.item()} | end
        for fit in (case.isel(window=k) for k in range(case.sizes["window"])):
            rows.append(before | {name: fit[name].item() for name in FIT} | shape | tests)
    return DataFrame(rows)
