"""Figure `displacement_distribution`: runs counted by their displacement (the note's figure 2),
against eq. (18).

This is the self part of the van Hove function, integrated over rings around the start.
"""

import numpy as np
from matplotlib import figure as matplotlib_figure
from matplotlib.axes import Axes
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe.analysis import goodness
from brownpipe.figures.cases import Label, distributions_of, label_of, parts_of, title_of
from brownpipe.figures.figure import Figure
from brownpipe.figures.style import (
    DASHED,
    DATA,
    DOTTED,
    FIT,
    INK,
    MODEL,
    highest,
    put_titles_and_legends,
    residual_panel,
    stacked_panels,
)

# By the source of a model's D; msd and square are also the names of their models, all others are
# slopes: colour, line, marker
LOOKS = {
    "msd": (FIT, "-", "o"),
    "slope": (MODEL, DASHED, "s"),
    "square": (INK, DOTTED, "^"),
}
SOURCES = {"msd": "D = MSD/4$t$", "slope": "D = slope/4", "square": "reflecting square, D"}
HEIGHTS = (4.4, 2.0)  # of the counts and of their residuals [inch]
LEAST_VARIANCE = 1e-4  # of a count: keeps the residual finite in a ring where no runs are expected


def draw_distributions(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw one column per case and time: observed and expected counts per ring above, their
    residuals below.
    """
    shown = distributions_of(cases)
    comparable = len({_width(case) for case in shown}) == 1  # counts in rings of equal width
    counted = "runs per ring"
    if comparable:
        counted = f"runs between $r$ and $r$ + {_width(shown[0]):.4g}"
    labels = (counted, "(observed - expected)\n/ standard error")
    figure, axes = stacked_panels(labels, len(shown), HEIGHTS, sharey=comparable)
    for case, (main, low) in zip(shown, axes.T, strict=True):
        low.sharex(main)
        main.tick_params(labelbottom=False)
        _counts(main, low, case)
        low.set_xlabel("displacement $r$")
        main.set_ylim(0, 1.05 * highest(shown if comparable else [case], "displacement_counts"))
    titles = [f"{title_of(case)}, $t$ = {case.displacement_time.item():g}" for case in shown]
    put_titles_and_legends(axes[0], titles)
    return figure


def _counts(axes: Axes, low: Axes, case: Dataset) -> None:
    """Draw observed counts with their intervals and expected ones, and the residuals of every model
    below.

    The legend has the p-value of each model by all its tests, the runs beyond the last ring, and
    those expected there.
    """
    observed = case.displacement_counts.values
    r = case.r.values
    edge = case.r_outer[-1].item()
    axes.bar(r, observed, 0.92 * _width(case), color=DATA, alpha=0.18, linewidth=0)
    interval = np.stack([case.displacement_counts_low, case.displacement_counts_high])
    reach = np.abs(interval - observed)
    overflow = f"{int(case.displacement_overflow):,} beyond $r$ = {edge:g}"
    runs = f"{int(case.runs):,} runs, 95 % intervals; {overflow}"
    axes.errorbar(r, observed, reach, fmt="none", ecolor=DATA, elinewidth=1.1)
    axes.plot(r, observed, "o", color=DATA, markersize=3.5, label=runs)
    axes.set_xlim(0, edge)
    residual_panel(low)
    for source, model in _models(case).items():
        colour, line, marker = LOOKS[source]
        diffusion = model.model_diffusion_coefficient.item()
        beyond = model.expected_overflow.item()
        p = model.p_value_joint.item()
        tested = goodness.p_value_in_words(p) if np.isfinite(p) else "not tested"
        label = f"{SOURCES[source]} = {diffusion:.3g}: {beyond:.0f} beyond; {tested}"
        expected = model.expected_counts.values
        variance = expected * (1 - expected / float(case.runs))
        residual = (observed - expected) / np.sqrt(np.maximum(variance, LEAST_VARIANCE))
        axes.plot(r, expected, color=colour, linestyle=line, label=label)
        low.plot(r, residual, marker, color=colour, markersize=4, markerfacecolor="none")


def _models(case: Dataset) -> dict[str, Dataset]:
    """The first defined model of each source of D; the reflecting square only where its walls
    matter.
    """
    first: dict[str, Dataset] = {}
    for model in parts_of(case, "model", "model_diffusion_coefficient"):
        name = model.model.item()
        first.setdefault(name if name in LOOKS else "slope", model)
    if {"msd", "square"} <= first.keys():
        free = first["msd"].expected_counts.values
        walled = first["square"].expected_counts.values
        negligible = 0.1 * np.sqrt(np.maximum(free, 1))  # a tenth of a standard error
        if np.all(np.abs(free - walled) < negligible):
            del first["square"]
    return first


def _all_counts(case: Dataset, name: str) -> np.ndarray:
    """Counts (K + 1,) in the rings and, at the end, beyond the last one."""
    return np.append(case[f"{name}_counts"], case[f"{name}_overflow"])


def _width(case: Dataset) -> float:
    """Width of the rings [length]."""
    return float(case.r_outer[0] - case.r_inner[0])


def table_of_counts(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, time and ring; the last one holds all displacements beyond the
    rings.
    """
    frames = []
    for case in distributions_of(cases):
        columns: dict[str, Label | np.ndarray] = {**label_of(case)}
        columns["time"] = case.displacement_time.item()
        columns["r_inner"] = np.append(case.r_inner, case.r_outer[-1])
        columns["r_outer"] = np.append(case.r_outer, np.inf)
        columns["runs"] = _all_counts(case, "displacement")
        columns["runs_low"] = np.append(case.displacement_counts_low, np.nan)
        columns["runs_high"] = np.append(case.displacement_counts_high, np.nan)
        for name in case.model.values:
            columns[f"expected, {name}"] = _all_counts(case.sel(model=name), "expected")
        frames.append(DataFrame(columns))
    return concat(frames)


FIGURE = Figure(
    draw=draw_distributions,
    variables=("displacement_counts", "displacement_overflow"),
    table=table_of_counts,
)
