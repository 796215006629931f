"""Figure `displacement_distribution`: runs counted by their displacement (the note's figure 2), against eq. (18).

This is the self part of the van Hove function, integrated over rings around the start.
"""

from __future__ import annotations

import re
import textwrap
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis import goodness
from brownpipe.analysis.variables import EACH
from brownpipe.figures.cases import distributions_of, has, parts_of, plus_minus, title_of
from brownpipe.figures.style import (
    DASHED,
    DATA,
    DOTTED,
    FIT,
    GREY,
    INK,
    MODEL,
    MOST_COLUMNS,
    WIDTH,
    grid,
    heads,
    residual_panel,
)
from brownpipe.figures.tables import Table, label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

# By the source of a model's D; msd and square are also the names of their models, all others are slopes:
LOOKS = {"msd": (FIT, "-", "o"), "slope": (MODEL, DASHED, "s"), "square": (INK, DOTTED, "^")}  # colour, line, marker
SOURCES = {"msd": "D = MSD/4$t$", "slope": "D = slope/4", "square": "reflecting square, D"}
LINE = 58  # characters of a line below a column
HEIGHT = 6.4  # of a row: the counts and their residuals [inch]
RATIO = 2.2  # of the heights of these two
LEAST_VARIANCE = 1e-4  # of a count: keeps the residual finite in a ring where no runs are expected
OVERFLOW = 2.6  # half the width of the strip that counts the runs beyond the last ring, in ring widths
VARIABLES = ("displacement_counts", "displacement_overflow")
LACKING = "no run with a tracer was kept"


def draw(cases: list[Dataset]) -> Figure:
    """Draw observed and expected counts per ring above, their residuals below, and the runs beyond the last ring.

    There is one column per case or, for a distribution at several times, one row per case and one column per time.
    Rows longer than MOST_COLUMNS are continued in a new row.
    """
    table = [distributions_of(case) for case in cases]
    if all(len(row) == 1 for row in table):
        table = [[row[0] for row in table]]
    table = [row[k : k + MOST_COLUMNS] for row in table for k in range(0, len(row), MOST_COLUMNS)]
    comparable = len({_width(case) for row in table for case in row}) == 1  # counts in rings of equal width
    options = {"sharey": "row" if comparable else False, "height_ratios": (RATIO, 1) * len(table)}
    figure, axes = grid(2 * len(table), max(map(len, table)), WIDTH, HEIGHT / 2, **options)
    for k, row in enumerate(table):
        _row(axes[2 * k : 2 * k + 2], row, comparable)
    return figure


def _row(axes: np.ndarray, cases: list[Dataset], comparable: bool) -> None:
    """Draw one row of columns on axes (2, columns), with the verdicts below them; hide the axes that are left over.

    Cases that are comparable share their vertical axes.
    """
    for case, (main, low) in zip(cases, axes.T, strict=False):
        low.sharex(main)
        main.tick_params(labelbottom=False)
        _counts(main, case)
        _residuals(low, case)
        low.tick_params(labelbottom=True)
        low.set_xlabel("displacement $r$")
        low.locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10], integer=True)
        below = {"xycoords": ("axes fraction", low.xaxis.label), "fontsize": 8.8, "va": "top"}
        low.annotate(_verdicts(case), (0, 0), (0, -5), textcoords="offset points", **below)
    heads(axes[0, : len(cases)], [f"{title_of(case)}, $t$ = {_time(case):g}" for case in cases])
    for main, low in axes.T[len(cases) :]:
        main.set_axis_off()
        low.set_axis_off()
    for main, case in zip(axes[0], cases, strict=False):
        beside = cases if comparable else [case]
        main.set_ylim(0, 1.05 * max(float(other.displacement_counts_high.max()) for other in beside))
        if main is axes[0, 0] or not comparable:
            main.set_ylabel(f"runs between $r$ and $r$ + {_width(case):.4g}")
    axes[1, 0].set_ylabel("(observed - expected)\n/ standard error")


def _time(case: Dataset) -> float:
    return case.displacement_time.item()


def _verdicts(case: Dataset) -> str:
    """The verdict on every model that is shown, the power of the first test, and the kurtosis, in wrapped lines."""
    models = _models(case)
    tested = [SOURCES[source] if source == "square" else f"eq. (18) with {SOURCES[source]}" for source in models]
    lines = [f"{name}: {_verdict(model)}" for name, model in zip(tested, models.values(), strict=True)]
    lines += [_power(model) for model in [*models.values()][:1] if np.isfinite(model.p_value)]
    if np.isfinite(case.kurtosis):
        lines.append(f"kurtosis: {plus_minus(case.kurtosis, case.kurtosis_standard_error)}; by eq. (18): 1")
    lines = [re.sub(r"\bp ([=<]) ", "p\u00a0\\1\u00a0", line) for line in lines]  # no break between p and its value
    return "\n".join(part for line in lines for part in textwrap.wrap(line, LINE))


def _verdict(model: Dataset) -> str:
    """The result of a model's tests in words: p-values of the rings and, for eq. (18), of the kurtosis."""
    p, joint = model.p_value.item(), model.p_value_joint.item()
    if np.isnan(p):
        return "not tested: too few runs, too few rings with runs, or no diffusion coefficient"
    said = "rejected" if joint < goodness.LEVEL else "not rejected"
    of_each = f"rings {goodness.in_words(p)}"
    if model.model != "square" and np.isfinite(model.kurtosis_p_value):
        of_each = f"{goodness.in_words(joint)} ({of_each}, kurtosis {goodness.in_words(model.kurtosis_p_value.item())})"
    return f"{said} at the {100 * goodness.LEVEL:.0f} % level: {of_each}"


def _power(model: Dataset) -> str:
    return f"power: rings reject a D off by 5 % with probability {100 * model.power_5_percent.item():.0f} %"


def _counts(axes: Axes, case: Dataset) -> None:
    """Draw the observed counts with their intervals, the expected ones, and the strip for runs beyond the last ring."""
    observed = case.displacement_counts.values
    r = case.r.values
    edge = case.r_outer[-1].item()
    axes.bar(r, observed, 0.92 * _width(case), color=DATA, alpha=0.18, linewidth=0)
    bars = np.abs(np.stack([case.displacement_counts_low, case.displacement_counts_high]) - observed)
    axes.errorbar(r, observed, bars, fmt="none", ecolor=DATA, elinewidth=1.1)
    axes.plot(r, observed, "o", color=DATA, markersize=3.5, label=f"{int(case.runs):,} runs, 95 % intervals")
    for source, model in _models(case).items():
        colour, line, _ = LOOKS[source]
        axes.plot(r, model.expected_counts, color=colour, linestyle=line, label=_legend(model, source))
    _overflow_strip(axes, case)
    beyond = f"{int(case.displacement_overflow):,} runs beyond $r$ = {edge:g}"
    at = (edge + OVERFLOW * _width(case), 0.5)
    axes.text(*at, beyond, rotation=90, ha="center", va="center", transform=axes.get_xaxis_transform())


def _overflow_strip(axes: Axes, case: Dataset) -> None:
    """Mark the part of the axis that stands for all displacements beyond the last ring."""
    edge = case.r_outer[-1].item()
    axes.axvspan(edge, edge + 2 * OVERFLOW * _width(case), color="#F3F3F3", linewidth=0, zorder=0)
    axes.axvline(edge, color=GREY, linewidth=0.8)


def _legend(model: Dataset, source: str) -> str:
    """The D of a model, chi-square over the degrees of freedom if tested, and the runs expected beyond the rings."""
    diffusion = float(model.model_diffusion_coefficient)
    beyond = float(model.expected_overflow)
    test = f"$\\chi^2$/dof = {float(model.chi_square):.1f}/{int(model.degrees_of_freedom)}; "
    return f"{SOURCES[source]} = {diffusion:.3g}: {test if has(model, 'chi_square') else ''}{beyond:.0f} beyond"


def _residuals(axes: Axes, case: Dataset) -> None:
    """Draw the standardised residuals of every model; in the strip, those of the runs beyond the rings."""
    edge = case.r_outer[-1].item()
    width = _width(case)
    residual_panel(axes)
    _overflow_strip(axes, case)
    models = _models(case)
    for k, (source, model) in enumerate(models.items()):
        colour, _, marker = LOOKS[source]
        aside = (k - (len(models) - 1) / 2) * 0.22 * width  # so that no marker hides another
        at = np.append(case.r, edge + OVERFLOW * width) + aside * np.append(np.ones(case.r.size), 4)
        axes.plot(at, _standardised(case, model), marker, color=colour, markersize=4)
    axes.set_xlim(0, edge + 2 * OVERFLOW * width)
    ticks = [tick for tick in axes.get_xticks() if 0 <= tick < edge - 2 * width]
    axes.set_xticks([*ticks, edge + OVERFLOW * width], [*(f"{tick:.2g}" for tick in ticks), f"> {edge:g}"])


def _standardised(case: Dataset, model: Dataset) -> np.ndarray:
    """Observed less expected counts (K + 1,) over the standard error of the expected; NaN where both must be equal."""
    observed = np.append(case.displacement_counts, case.displacement_overflow)
    expected = np.append(model.expected_counts, model.expected_overflow)
    variance = expected * (1 - expected / float(case.runs))
    defined = (variance > 0.0) | (observed != expected)
    return np.where(defined, (observed - expected) / np.sqrt(np.maximum(variance, LEAST_VARIANCE)), np.nan)


def _models(case: Dataset) -> dict[str, Dataset]:
    """The first defined model of each source of D; the reflecting square only where its walls matter."""
    first: dict[str, Dataset] = {}
    for model in parts_of(case, "model", "model_diffusion_coefficient"):
        name = model.model.item()
        first.setdefault(name if name in LOOKS else "slope", model)
    if {"msd", "square"} <= first.keys() and not _differ(first["msd"], first["square"]):
        del first["square"]
    return first


def _differ(a: Dataset, b: Dataset) -> bool:
    """Return whether two models expect counts that differ by more than a tenth of a standard error."""
    expected = [np.append(model.expected_counts, model.expected_overflow) for model in (a, b)]
    return bool((np.abs(expected[0] - expected[1]) > 0.1 * np.sqrt(np.maximum(expected[0], 1))).any())


def _width(case: Dataset) -> float:
    """Width of the rings [length]."""
    return float(case.r_outer[0] - case.r_inner[0])


def table(cases: list[Dataset]) -> Table:
    """Return one row per case, time and ring; the last one holds all displacements beyond the rings."""
    header = (*EACH, "time", "r_inner", "r_outer", "runs", "runs_low", "runs_high")
    models = [f"expected, {model}" for model in cases[0].model.values]
    names = ("r_inner", "r_outer", "displacement_counts", "displacement_counts_low", "displacement_counts_high")
    rows = []
    for case in chain.from_iterable(map(distributions_of, cases)):
        label = (*label_of(case), _time(case))
        columns = [case[name].values for name in names]
        rows += [(*label, *values) for values in zip(*columns, *case.expected_counts.values, strict=True)]
        beyond = (case.r_outer.values[-1], np.inf, case.displacement_overflow.item(), np.nan, np.nan)
        rows.append((*label, *beyond, *case.expected_overflow.values))
    return Table((*header, *models), rows)
