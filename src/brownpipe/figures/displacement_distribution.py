"""Figure `displacement_distribution`: how far the runs got, the note's figure 2, against eq. (18)."""

import re
import textwrap
from itertools import chain

import numpy as np

from brownpipe.figures.cases import distributions_of, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FIT, FREE, INK, MOST_COLUMNS, START, heads, tall_and_low
from brownpipe.figures.tables import Table

LOOKS = {"msd": (FIT, "-", "o"), "slope": (FREE, DASHED, "s"), "square": (INK, DOTTED, "^")}  # by where D comes from
SOURCES = {"msd": "D = MSD/4$t$", "slope": "D = slope/4", "square": "square, D"}
LINE, HEIGHT = 58, 6.4  # characters of a line below a column; height of a row [inch]
LEAST_VARIANCE = 1e-4  # of a count: runs where none are expected lie far off, but within the drawing
LIKELY = 2.0  # deviations of up to so many standard errors lie in the grey band
OVERFLOW = 2.6  # where the runs beyond the last ring are shown, in widths of a ring after it
VARIABLES = ("displacement_counts",)
LACKING = "no run with a tracer was kept"


def draw(cases):
    """Counts per ring with what is expected above, deviations with the runs beyond the last ring below.

    One column per case or, if the distribution was taken at several times, one row per case and one column per time.
    What is more than MOST_COLUMNS goes on in a new row.
    """
    table = [distributions_of(case) for case in cases]
    if all(len(row) == 1 for row in table):
        table = [[row[0] for row in table]]
    table = [row[k : k + MOST_COLUMNS] for row in table for k in range(0, len(row), MOST_COLUMNS)]
    alike = len({_width(case) for row in table for case in row}) == 1  # counts in rings of one width compare
    sharing = {"sharex": False, "sharey": "row" if alike else False}
    figure, axes = tall_and_low(max(map(len, table)), rows=len(table), ratio=2.2, height=HEIGHT, **sharing)
    for k, row in enumerate(table):
        _row(axes[2 * k : 2 * k + 2], row)
    return figure


def _row(axes, cases):
    for case, (main, low) in zip(cases, axes.T, strict=False):
        low.sharex(main)
        main.tick_params(labelbottom=False)
        _counts(main, case)
        _deviations(low, case)
        low.tick_params(labelbottom=True)
        low.set_xlabel("distance $r$ from the start")
        below = {"xycoords": ("axes fraction", low.xaxis.label), "fontsize": 8.8, "va": "top"}
        low.annotate(_words(case), (0, 0), (0, -5), textcoords="offset points", **below)
    heads(axes[0, : len(cases)], [f"{title_of(case)}, $t$ = {_time(case):g}" for case in cases])
    for main, low in axes.T[len(cases) :]:
        main.set_axis_off()
        low.set_axis_off()
    shared = axes[0, 0].get_shared_y_axes().get_siblings(axes[0, 0])
    for main, case in zip(axes[0], cases, strict=False):
        beside = cases if len(shared) > 1 else [case]
        main.set_ylim(0, 1.05 * max(float(one.displacement_counts_high.max()) for one in beside))
        if main is axes[0, 0] or len(shared) == 1:
            main.set_ylabel(f"runs between $r$ and $r$ + {_width(case):.4g}")
    for low in axes[1, : len(cases)]:
        low.locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10], integer=True)
    axes[1, 0].set_ylabel("(found - expected)\n/ standard error")


def _time(case):
    return case.displacement_time.item()


def _words(case):
    """The verdict on every model that is shown, the power of its test, and the kurtosis."""
    said = [(SOURCES[_source(model)], *model.verdict.item().partition("; ")) for model, _ in _models(case)]
    lines = [f"{source}: {verdict}" for source, verdict, _, _ in said] + [seen for *_, seen in said[:1]]
    if np.isfinite(case.kurtosis):
        lines.append(f"kurtosis {plus_minus(case.kurtosis, case.kurtosis_standard_error)}; 1 by eq. (18)")
    lines = [re.sub(r"\bp ([=<]) ", "p\u00a0\\1\u00a0", line) for line in lines]  # no break between p and its value
    return "\n".join(line for words in lines for line in textwrap.wrap(words, LINE))


def _counts(axes, case):
    found, r, edge = case.displacement_counts.values, case.r.values, case.r_outer[-1].item()
    axes.bar(r, found, 0.92 * _width(case), color=DATA, alpha=0.18, linewidth=0)
    bars = np.abs(np.stack([case.displacement_counts_low, case.displacement_counts_high]) - found)
    axes.errorbar(r, found, bars, fmt="none", ecolor=DATA, elinewidth=1.1)
    axes.plot(r, found, "o", color=DATA, markersize=3.5, label=f"{int(case.runs):,} runs, 95 % intervals")
    for model, (colour, line, _) in _models(case):
        axes.plot(r, model.expected_counts, color=colour, linestyle=line, label=_verdict(model))
    _overflow_strip(axes, case)
    beyond = f"{int(case.displacement_overflow):,} runs beyond $r$ = {edge:g}"
    at = (edge + OVERFLOW * _width(case), 0.5)
    axes.text(*at, beyond, rotation=90, ha="center", va="center", transform=axes.get_xaxis_transform())


def _overflow_strip(axes, case):
    """The part of the axis that stands for everything beyond the last ring."""
    edge = case.r_outer[-1].item()
    axes.axvspan(edge, edge + 2 * OVERFLOW * _width(case), color="#F3F3F3", linewidth=0, zorder=0)
    axes.axvline(edge, color=START, linewidth=0.8)


def _verdict(model):
    """Where D comes from, its chi-square, and how many runs it expects beyond the rings."""
    diffusion, beyond = float(model.model_diffusion_coefficient), float(model.expected_overflow)
    test = f"$\\chi^2$ = {float(model.chi_square):.1f} / {int(model.degrees_of_freedom)}"
    return f"{SOURCES[_source(model)]} = {diffusion:.3g}: {test}; {beyond:.0f} beyond"


def _source(model):
    """Where its D comes from: the first word of the model's name."""
    return str(model.model.values).partition(" ")[0]


def _deviations(axes, case):
    """Found less expected in standard errors of the expected count; last, in the strip, those beyond the rings."""
    edge, width = case.r_outer[-1].item(), _width(case)
    axes.axhspan(-LIKELY, LIKELY, color="#EFEFEF", linewidth=0)
    axes.axhline(0, color=START, linewidth=0.8)
    _overflow_strip(axes, case)
    models = _models(case)
    for k, (model, (colour, _, marker)) in enumerate(models):
        aside = (k - (len(models) - 1) / 2) * 0.22 * width  # one marker does not hide the other
        at = np.append(case.r, edge + OVERFLOW * width) + aside * np.append(np.ones(case.r.size), 4)
        axes.plot(at, _standardised(case, model), marker, color=colour, markersize=4)
    axes.set_xlim(0, edge + 2 * OVERFLOW * width)
    ticks = [tick for tick in axes.get_xticks() if 0 <= tick < edge - 2 * width]
    axes.set_xticks([*ticks, edge + OVERFLOW * width], [*(f"{tick:.2g}" for tick in ticks), f"> {edge:g}"])


def _standardised(case, model):
    """Deviations in standard errors of the expected count; NaN where nothing can be expected or found."""
    found = np.append(case.displacement_counts, case.displacement_overflow)
    expected = np.append(model.expected_counts, model.expected_overflow)
    variance = expected * (1 - expected / float(case.runs))
    known = (variance > 0.0) | (found != expected)
    return np.where(known, (found - expected) / np.sqrt(np.maximum(variance, LEAST_VARIANCE)), np.nan)


def _models(case):
    """The first defined model of each source of D, with its looks; the square only where its walls can be seen."""
    models = [case.isel(model=k) for k in range(case.sizes["model"])]
    first = {}
    for model in models:
        if np.isfinite(model.model_diffusion_coefficient):
            first.setdefault(_source(model), model)
    if {"msd", "square"} <= first.keys() and not _differ(first["msd"], first["square"]):
        del first["square"]
    return [(model, LOOKS[source]) for source, model in first.items()]


def _differ(one, other):
    """Do two models expect counts that differ by a tenth of a standard error or more?"""
    expected = [np.append(model.expected_counts, model.expected_overflow) for model in (one, other)]
    return bool((np.abs(expected[0] - expected[1]) > 0.1 * np.sqrt(np.maximum(expected[0], 1))).any())


def _width(case):
    return float(case.r_outer[0] - case.r_inner[0])


def table(cases):
    """One row per case, time and ring, the last ring being everything beyond."""
    header = ("scene", "particles", "engine", "time", "r_inner", "r_outer", "runs", "runs_low", "runs_high")
    models = [f"expected, {model}" for model in cases[0].model.values]
    names = ("r_inner", "r_outer", "displacement_counts", "displacement_counts_low", "displacement_counts_high")
    rows = []
    for case in chain.from_iterable(map(distributions_of, cases)):
        label = (case.scene.item(), case.particles.item(), case.engine.item(), _time(case))
        columns = [case[name].values for name in names]
        rows += [(*label, *values) for values in zip(*columns, *case.expected_counts.values, strict=True)]
        beyond = (case.r_outer.values[-1], np.inf, case.displacement_overflow.item(), np.nan, np.nan)
        rows.append((*label, *beyond, *case.expected_overflow.values))
    return Table((*header, *models), rows)
