"""The answer of a study as a short table: text to print, rows to write."""

import numpy as np

from brownpipe.analysis.goodness import FAMILY_LEVEL, holm, in_words
from brownpipe.analysis.variables import FAILED, MISSING
from brownpipe.figures.cases import at_last_distribution, cases_of, has_msd, over_time, plus_minus, title_of
from brownpipe.figures.tables import Table
from brownpipe.scene.seeds import seed_text

TESTS = ("with D = MSD/4t", "with fitted D")  # of eq. (18), the first two models of a dataset
QUESTION = "eq. (18) rejected?"  # above the columns of the tests
SHAPE = ("kurtosis", "kurtosis_standard_error", "kurtosis_p_value")


def summary(dataset):
    """The answer as a plain-text table with one line per scene, particle count and engine.

    Runs, MSD at the end and D = slope/4 over the first window with their standard errors over runs, and p-values of
    eq. (18) with either D. Those of the whole table are one family: what is rejected is so at the family-wise level
    (Holm). Below it, what the columns mean, and seeds that failed or are missing.
    """
    cases = cases_of(dataset)
    durations = sorted({case.duration.item() for case in cases})
    end = f"MSD(t = {durations[0]:g})" if len(durations) == 1 else "MSD at the end"
    p = np.array([_p_values(case) for case in cases]).reshape(-1, len(TESTS))
    rejected = holm(p.ravel()).reshape(p.shape) < FAMILY_LEVEL
    rows = [("scene", "N", "engine", "runs", end, "D", *TESTS), *map(_row, cases, p, rejected)]
    tests, left_out = np.count_nonzero(np.isfinite(p)), set()
    if len({row[2] for row in rows}) == 2:
        left_out.add("engine")
    if not tests:
        left_out.update(TESTS)
    columns = [column for column in zip(*rows, strict=True) if column[0] not in left_out]
    widths = [max(map(len, column)) for column in columns]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in zip(*columns, strict=True)]
    above = [" " * lines[0].index(TESTS[0]) + QUESTION] if tests else []
    return "\n".join([*above, *lines, *_legend(dataset, cases, tests), *_left_out(cases)]) + "\n"


def _p_values(case):
    """Of eq. (18) with either D, by rings and kurtosis together; NaN where there is no test."""
    return at_last_distribution(case).p_value_joint.values[: len(TESTS)] if has_msd(case) else [np.nan] * len(TESTS)


def _row(case, p, rejected):
    """One line of the text table."""
    names = (case.scene.item(), str(case.particles.item()), case.engine.item(), str(int(case.runs)))
    if not has_msd(case):
        return (*names, *["-"] * 4)
    estimates = [(over_time(case).isel(time=-1), "msd"), (case.isel(window=0), "diffusion_coefficient")]
    numbers = [plus_minus(part[name], part[f"{name}_standard_error"]) for part, name in estimates]
    return (*names, *numbers, *map(_verdict, p, rejected))


def _verdict(p, rejected):
    return "-" if np.isnan(p) else f"{'yes' if rejected else 'no'}, {in_words(p)}"


def _legend(dataset, cases, tests):
    """What the columns mean."""
    shown = [case for case in cases if has_msd(case)]
    yield "N: number of disks. MSD: mean squared displacement of the tracer. All in the scene's reduced units."
    yield f"D: a quarter of the slope of the MSD over t in {dataset.window.values[0]}. ±: one standard error over runs."
    if tests:
        times = sorted({at_last_distribution(case).displacement_time.item() for case in shown})
        at = "at the end" if len(times) > 1 else f"at t = {times[0]:g}"
        family = f"the {tests} tests of this table" if tests > 1 else "the one test of this table"
        yield f"Eq. (18): x and y {at} are normal, of variance 2Dt; tested by ring counts and kurtosis."
        yield f"yes: rejected at a family-wise level of {FAMILY_LEVEL:.0%} for {family} (Holm); no: not rejected."


def _left_out(cases):
    """Which runs the table lacks."""
    for case in cases:
        for status, what in ((FAILED, "failed and left out"), (MISSING, "missing")):
            seeds = case.seed.values[case.run_status.values == status]
            if seeds.size:
                yield f"{title_of(case)}: {what}: {seeds.size} of {case.seed.size} seeds ({_short(seed_text(seeds))})"


def _short(text, most=60):
    return text if len(text) <= most else text[: most - 4] + " ..."


def summary_table(dataset):
    """Every number of the summary: one row per case and window."""
    header = (
        "scene",
        "particles",
        "engine",
        "runs",
        "failed_runs",
        "missing_seeds",
        "time",
        "msd",
        "msd_standard_error",
    )
    fits = ("window_start", "window_end", "slope", "slope_standard_error", "naive_slope_error")
    fits += ("diffusion_coefficient", "diffusion_coefficient_standard_error")
    tests = [
        (test, k, model)
        for k, model in enumerate(dataset.model.values)
        for test in ("chi_square", "degrees_of_freedom", "p_value", "p_value_joint")
    ]
    rows = []
    for case in cases_of(dataset):
        counts, end = [case[name].item() for name in header[:6]], at_last_distribution(case)
        last = over_time(case).isel(time=slice(-1, None))
        final = [case.duration.item(), *(last[name].item() if last.sizes["time"] else np.nan for name in header[7:])]
        shape = [end[name].item() if name in end else np.nan for name in SHAPE]
        verdicts = [end[test].values[k] for test, k, _ in tests]
        for k in range(case.sizes["window"]):
            fit = case.isel(window=k)
            rows.append((*counts, *final, *(fit[name].item() for name in fits), *shape, *verdicts))
    return Table((*header, *fits, *SHAPE, *(f"{test}, {model}" for test, _, model in tests)), rows)
