"""Figure `health`: energy drift, worst overlap and momentum ledger of every run. Round-off is all there should be."""

import numpy as np

from brownpipe.figures.cases import title_of
from brownpipe.figures.style import DASHED, DATA, FIT, grid
from brownpipe.figures.tables import Table

MEASURES = {
    "energy_drift": ("relative energy drift", 1e-13),
    "worst_overlap": ("worst overlap (contact distances)", 1e-12),
    "momentum_residual": ("residual of the momentum ledger", 1e-12),
}  # what is shown, and what round-off is expected to stay below; a run fails at state.HEALTH_BOUND
SMALLEST = 1e-17  # left end of the axis: smaller values, zero among them, are drawn there
QUANTILES = (0.05, 0.5, 0.95)
VARIABLES = ()
LACKING = "there are no runs"


def draw(cases):
    """One panel per measure, one line per case: all runs (thin), 90 % of them (thick), the median (dot)."""
    figure, axes = grid(1, len(MEASURES), 3.4, 1.3 + 0.28 * len(cases), sharex=True, sharey=True)
    for panel, (name, (label, bound)) in zip(axes[0], MEASURES.items(), strict=True):
        for row, case in enumerate(cases):
            _range(panel, row, _sizes(case, name))
        panel.axvline(bound, color=FIT, linewidth=1.2, linestyle=DASHED)
        panel.text(
            bound,
            1.0,
            f"expected below {bound:g} ",
            ha="right",
            va="bottom",
            color=FIT,
            transform=panel.get_xaxis_transform(),
        )
        panel.set_xscale("log")
        panel.minorticks_off()
        panel.set_xlabel(label)
    key = f"dot: median run; thick: 90 % of the runs; thin: all (zero is drawn at {SMALLEST:g})"
    axes[0, 0].set_title(key, pad=22, fontweight="normal", fontsize=9)
    _name_rows(axes[0, 0], cases)
    return figure


def _range(axes, row, sizes):
    """From least to greatest, the middle 90 % and the median, on a log axis that ends at SMALLEST."""
    if not sizes.size:
        return
    sizes = np.maximum(sizes, SMALLEST)
    low, middle, high = np.quantile(sizes, QUANTILES)
    axes.plot([sizes.min(), sizes.max()], [row, row], color=DATA, linewidth=1.2)
    axes.plot([low, high], [row, row], color=DATA, linewidth=6, alpha=0.45, solid_capstyle="butt")
    axes.plot([middle], [row], "o", color=DATA, markersize=5)


def _name_rows(axes, cases):
    axes.set_yticks(range(len(cases)), map(title_of, cases))
    axes.set_ylim(len(cases) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)


def _sizes(case, name):
    """Absolute values of a measure over the runs that there are."""
    values = np.abs(case[name].values)
    return values[np.isfinite(values)]


def table(cases):
    """One row per case and measure."""
    header = (
        "scene",
        "particles",
        "engine",
        "runs",
        "failed_runs",
        "measure",
        "bound",
        "least",
        "5 %",
        "median",
        "95 %",
        "greatest",
    )
    rows = []
    for case in cases:
        label = [case[name].item() for name in header[:5]]
        for name, (_, bound) in MEASURES.items():
            sizes = _sizes(case, name)
            spread = np.quantile(sizes, (0, *QUANTILES, 1)) if sizes.size else [np.nan] * 5
            rows.append((*label, name, bound, *spread))
    return Table(header, rows)
