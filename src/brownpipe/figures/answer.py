"""The answer of a study as a short table: text to print, rows to write."""

import numpy as np

from brownpipe.analysis.variables import FAILED, MISSING
from brownpipe.figures.cases import at_last_distribution, cases_of, has_msd, over_time, plus_minus, title_of
from brownpipe.figures.displacement_distribution import p_text
from brownpipe.figures.tables import Table

PASSES = 0.01  # smallest p at which a distribution is said to pass


def summary(dataset):
    """The answer as a plain-text table with one line per scene, particle count and engine.

    Runs, MSD at the end, slope and D = slope/4 over the first window with their standard errors over runs, and whether
    eq. (18) passes its chi-square test with either D. Below it, seeds that failed or are missing.
    """
    cases = cases_of(dataset)
    durations = sorted({case.duration.item() for case in cases})
    end = f"{durations[0]:g}" if len(durations) == 1 else "end"
    window = dataset.window.values[0]
    head = ("scene", "N", "engine", "runs", f"MSD({end})", f"slope {window}", f"D {window}", "MSD/4t", "slope/4")
    rows = [head, *map(_row, cases)]
    columns = [column for column in zip(*rows, strict=True) if column[0] != "engine" or len(set(column)) > 2]
    widths = [max(map(len, column)) for column in columns]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in zip(*columns, strict=True)]
    return "\n".join([*lines, *_remarks(cases)]) + "\n"


def _row(case):
    """One line of the text table."""
    names = (case.scene.item(), str(case.particles.item()), case.engine.item(), str(int(case.runs)))
    if not has_msd(case):
        return (*names, *["-"] * 5)
    last, fit = over_time(case).isel(time=-1), case.isel(window=0)
    estimates = [(last, "msd"), (fit, "slope"), (fit, "diffusion_coefficient")]
    numbers = [plus_minus(part[name], part[f"{name}_standard_error"]) for part, name in estimates]
    return (*names, *numbers, *map(_verdict, at_last_distribution(case).p_value.values[:2]))


def _verdict(p):
    return "-" if np.isnan(p) else f"{'passes' if p >= PASSES else 'fails'} p={p_text(p)}"


def _remarks(cases):
    """How to read the table, and which runs it lacks."""
    from brownpipe.storage import seed_text

    yield "±: one standard error over runs. D belongs to its window. MSD/4t, slope/4: eq. (18) with this D, chi-square."
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
        for test in ("chi_square", "degrees_of_freedom", "p_value")
    ]
    rows = []
    for case in cases_of(dataset):
        counts = [case[name].item() for name in header[:6]]
        last = over_time(case).isel(time=slice(-1, None))
        final = [case.duration.item(), *(last[name].item() if last.sizes["time"] else np.nan for name in header[7:])]
        verdicts = [at_last_distribution(case)[test].values[k] for test, k, _ in tests]
        for k in range(case.sizes["window"]):
            rows.append((*counts, *final, *(case.isel(window=k)[name].item() for name in fits), *verdicts))
    return Table((*header, *fits, *(f"{test}, {model}" for test, _, model in tests)), rows)
