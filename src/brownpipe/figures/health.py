"""Figure `health`: energy drift, deepest overlap and momentum balance of every run, in the exact engine round-off."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from brownpipe.analysis.variables import EACH, FAILED
from brownpipe.figures.cases import title_of
from brownpipe.figures.style import DASHED, DATA, FIT, FONT_SIZE, grid, text_width
from brownpipe.figures.tables import Table
from brownpipe.scene.seeds import brief_seed_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import Dataset

MEASURES = {
    "energy_drift": ("relative energy drift", 1e-13),
    "worst_overlap": ("deepest overlap (contact distances)", 1e-12),
    "momentum_residual": ("residual of the momentum balance", 1e-12),
}  # axis label, and the bound below which round-off is expected; a run fails only far beyond (figures/health.rst)
LEFT_END = 1e-17  # left end of the axis, where smaller values and zeros are drawn
WIDTH = 3.4  # of a panel, with its share of the labels beside the panels [inch]
ROOM = 2.2  # for these labels [inch]; longer ones widen the figure
LABEL = 36  # characters of a line of such a label, unless a word is longer
BESIDE = 0.75  # width of the words on a bound, as a fraction of a panel
LINE = 0.16  # height of a line of text [inch]
ABOVE = 22  # the panels begin the lines over them [point],
SMALL = 9  # in this size [point]
BLANK = 1.4  # distance of blank lines that are as far apart as lines with words
HEADING = 96  # characters of a line above the panels
MOST_LINES = 8  # of cases with failed runs
QUANTILES = (0.05, 0.5, 0.95)
VARIABLES = ()
LACKING = "there are no runs"


def draw(cases: list[Dataset]) -> Figure:
    """Draw one panel per measure, one line per case: all runs (thin), the central 90 % (thick), the median (dot).

    Panels keep their width: the figure is wider for long labels, and higher for labels of several lines.
    """
    words = "dot: median; thick: central 90 % of the runs; thin: all runs"
    lines = [f"{words}; values below {LEFT_END:g} are drawn at {LEFT_END:g}"]
    lines += [part for line in failed_of(cases) for part in textwrap.wrap(line, HEADING)]
    labels = [_label(case) for case in cases]
    wider = max(0.0, text_width("\n".join(labels).splitlines(), FONT_SIZE) - ROOM)
    each = 0.28 + LINE * max(label.count("\n") for label in labels)
    height = 1.3 + each * len(cases) + LINE * (len(lines) - 1)
    figure, axes = grid(1, len(MEASURES), WIDTH + wider / len(MEASURES), height, sharex=True, sharey=True)
    for panel, (name, (label, bound)) in zip(axes[0], MEASURES.items(), strict=True):
        for row, case in enumerate(cases):
            _range(panel, row, sizes_of(case, name))
        panel.axvline(bound, color=FIT, linewidth=1.2, linestyle=DASHED)
        panel.set_xscale("log")
        panel.minorticks_off()
        panel.set_xlabel(label)
    low, high = axes[0, 0].get_xlim()
    for panel, (_, bound) in zip(axes[0], MEASURES.values(), strict=True):
        end = max(bound, low * (high / low) ** BESIDE)  # so that the words begin within the panel
        place = {"ha": "right", "va": "bottom", "transform": panel.get_xaxis_transform()}
        panel.text(end, 1.0, f"expected below {bound:g} ", color=FIT, **place)
    _head(axes[0, 0], lines)
    axes[0, 0].set_yticks(range(len(cases)), labels)
    axes[0, 0].set_ylim(len(cases) - 0.4, -0.6)
    axes[0, 0].tick_params(axis="y", length=0)
    return figure


def _head(axes: Axes, lines: list[str]) -> None:
    """Put lines above all panels, beginning at the first.

    A title would take room beside its panel if its middle is there; a blank one keeps the height for the lines.
    """
    axes.set_title("\n".join(" " * len(lines)), pad=ABOVE, fontsize=SMALL, linespacing=BLANK)
    at: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "fontsize": SMALL}
    axes.annotate("\n".join(lines), (0, 1), (0, ABOVE), **at).set_in_layout(False)


def _label(case: Dataset) -> str:
    """Return scene, number of disks and engine of a case, in lines of LABEL characters and never within a word."""
    title = title_of(case).replace(" = ", "\u00a0=\u00a0")  # no break in N = 150
    return textwrap.fill(title, LABEL, break_long_words=False, break_on_hyphens=False)


def _range(axes: Axes, row: int, sizes: np.ndarray) -> None:
    """Draw the range, the central 90 % and the median of values on a logarithmic axis that begins at LEFT_END."""
    if not sizes.size:
        return
    sizes = np.maximum(sizes, LEFT_END)
    low, middle, high = np.quantile(sizes, QUANTILES)
    axes.plot([sizes.min(), sizes.max()], [row, row], color=DATA, linewidth=1.2, label="all runs")
    thick: dict[str, Any] = {"linewidth": 6, "alpha": 0.45, "solid_capstyle": "butt"}
    axes.plot([low, high], [row, row], color=DATA, label="central 90 % of the runs", **thick)
    axes.plot([middle], [row], "o", color=DATA, markersize=5, label="median")


def failed_of(cases: list[Dataset]) -> list[str]:
    """Return a line for each case with failed runs: how many, and their seeds."""
    lines = []
    for case in cases:
        seeds = case.seed.values[case.run_status.values == FAILED]
        if seeds.size:
            runs = int(case.runs) + seeds.size
            lines.append(f"{title_of(case)}: {seeds.size} of {runs} runs failed: seeds {brief_seed_text(seeds)}")
    more = len(lines) - MOST_LINES
    return lines if more <= 0 else [*lines[:MOST_LINES], f"and runs of {more} other cases"]


def sizes_of(case: Dataset, name: str) -> np.ndarray:
    """Return the absolute values of a measure over the runs that have one."""
    values = np.abs(case[name].values)
    return values[np.isfinite(values)]


def table(cases: list[Dataset]) -> Table:
    """Return one row per case and measure: its bound, and minimum, quantiles and maximum over the runs."""
    of_case = (*EACH, "runs", "failed_runs")
    rows = []
    for case in cases:
        label = [case[name].item() for name in of_case]
        for name, (_, bound) in MEASURES.items():
            sizes = sizes_of(case, name)
            quantiles = np.quantile(sizes, (0, *QUANTILES, 1)) if sizes.size else [np.nan] * 5
            rows.append((*label, name, bound, *quantiles))
    return Table((*of_case, "measure", "bound", "least", "5 %", "median", "95 %", "greatest"), rows)
