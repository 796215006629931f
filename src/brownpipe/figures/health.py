"""Figure `health`: energy drift, deepest overlap and momentum balance of every run, in the exact
engine round-off.
"""

import textwrap

import numpy as np
from matplotlib import figure as matplotlib_figure
from pandas import DataFrame, Series
from xarray import Dataset

from brownpipe.figures.cases import label_of, title_of
from brownpipe.figures.figure import Figure
from brownpipe.figures.style import DASHED, DATA, FIT, broken_into_lines, grid, panel_width

# Axis label, and the bound below which round-off is expected; a run fails only far beyond
# (figures/health.rst).
MEASURES = {
    "energy_drift": ("relative energy drift", 1e-13),
    "worst_overlap": ("deepest overlap (contact distances)", 1e-12),
    "momentum_residual": ("residual of the momentum balance", 1e-12),
}
LEFT_END = 1e-17  # left end of the axis, where smaller values and zeros are drawn
WIDTH = 3.6  # of a panel, with its share of the labels beside the panels [inch]
LABEL = 32  # characters of a line of such a label
BOX = ("whislo", "q1", "med", "q3", "whishi")  # matplotlib's names of the QUANTILES
QUANTILES = {"least": 0, "5 %": 0.05, "median": 0.5, "95 %": 0.95, "greatest": 1}


def draw_health(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw one panel per measure, one box per case: all runs (whiskers), the central 90 % (box),
    the median (line).
    """
    labels = [textwrap.fill(_name(case), LABEL) for case in cases]
    row = 0.44 + 0.16 * max(
        0, *(label.count("\n") - 1 for label in labels)
    )  # its height [inch], by lines of its label
    figure, axes = grid(1, len(MEASURES), WIDTH, 1.3 + row * len(cases), sharex=True, sharey=True)
    for panel, (name, (label, bound)) in zip(axes[0], MEASURES.items(), strict=True):
        boxes = [
            dict(zip(BOX, np.maximum(_quantiles(case, name), LEFT_END), strict=True))
            for case in cases
        ]
        panel.bxp(
            boxes,
            range(len(cases)),
            orientation="horizontal",
            showfliers=False,
            medianprops={"color": DATA},
        )
        panel.axvline(bound, color=FIT, linewidth=1.2, linestyle=DASHED)
        title = f"expected below {bound:g}"
        panel.set_title(title, color=FIT, loc="right", fontsize="medium", fontweight="normal")
        words = broken_into_lines(label, panel_width(panel), "axes.labelsize")
        panel.set(xscale="log", xlabel=words)
        panel.minorticks_off()
    axes[0, 0].set_yticks(range(len(cases)), labels)
    axes[0, 0].set_ylim(len(cases) - 0.4, -0.6)
    axes[0, 0].tick_params(axis="y", length=0)
    return figure


def _name(case: Dataset) -> str:
    """The title of a case with the number of its failed runs, to be wrapped between its parts."""
    failed = int(case.failed_runs)
    counted = f" ({failed} of {int(case.runs) + failed} failed)" if failed else ""
    return f"{title_of(case)}{counted}".replace(" = ", "\u00a0=\u00a0")


def _quantiles(case: Dataset, name: str) -> np.ndarray:
    """Return the QUANTILES of the absolute values of a measure over the runs that have one; NaN if
    none has.
    """
    return Series(np.abs(case[name].values)).quantile([*QUANTILES.values()]).values


def table_of_health(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and measure: its bound, and minimum, quantiles and maximum over the
    runs.
    """
    rows = []
    for case in cases:
        for name, (_, bound) in MEASURES.items():
            sizes = dict(zip(QUANTILES, _quantiles(case, name), strict=True))
            rows.append(
                label_of(case, "runs", "failed_runs") | {"measure": name, "bound": bound} | sizes
            )
    return DataFrame(rows)


FIGURE = Figure(
    draw=draw_health, variables=("run_status",), table=table_of_health, every_count=True
)
