"""Figure `displacement_distribution`: runs counted by their displacement (the note's figure 2), against eq. (18).

This is the self part of the van Hove function, integrated over rings around the start.
"""

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe.analysis import goodness
from brownpipe.figures.cases import distributions_of, has, label_of, parts_of, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FIT, GREY, INK, MODEL, columns, heads, highest, residual_panel

# By the source of a model's D; msd and square are also the names of their models, all others are slopes:
LOOKS = {"msd": (FIT, "-", "o"), "slope": (MODEL, DASHED, "s"), "square": (INK, DOTTED, "^")}  # colour, line, marker
SOURCES = {"msd": "D = MSD/4$t$", "slope": "D = slope/4", "square": "reflecting square, D"}
LINE = 58  # characters of a line below a column
HEIGHTS = (4.4, 2.0)  # of the counts and of their residuals [inch]
LEAST_VARIANCE = 1e-4  # of a count: keeps the residual finite in a ring where no runs are expected
OVERFLOW = 2.6  # half the width of the strip that counts the runs beyond the last ring, in ring widths


def draw(cases: list[Dataset]) -> Figure:
    """Draw one column per case and time: observed and expected counts per ring above, their residuals below."""
    shown = [at_time for case in cases for at_time in distributions_of(case)]
    comparable = len({_width(case) for case in shown}) == 1  # counts in rings of equal width
    counted = f"runs between $r$ and $r$ + {_width(shown[0]):.4g}" if comparable else "runs per ring"
    labels = (counted, "(observed - expected)\n/ standard error")
    figure, axes = columns(labels, len(shown), HEIGHTS, sharey=comparable)
    for case, (main, low) in zip(shown, axes.T, strict=True):
        low.sharex(main)
        main.tick_params(labelbottom=False)
        _counts(main, case)
        _residuals(low, case)
        low.set_xlabel("displacement $r$")
        below = {"xycoords": ("axes fraction", low.xaxis.label), "fontsize": 8.8, "va": "top"}
        low.annotate(_verdicts(case), (0, 0), (0, -5), textcoords="offset points", **below)
        main.set_ylim(0, 1.05 * highest(shown if comparable else [case], "displacement_counts"))
    heads(axes[0], [f"{title_of(case)}, $t$ = {case.displacement_time.item():g}" for case in shown])
    return figure


def _verdicts(case: Dataset) -> str:
    """The verdict on every model that is shown, the power of the first test, and the kurtosis, in wrapped lines."""
    models = _models(case)
    names = {source: name if source == "square" else f"eq. (18) with {name}" for source, name in SOURCES.items()}
    lines = [f"{names[source]}: {_verdict(model)}" for source, model in models.items()]
    for first in (model for model in [*models.values()][:1] if np.isfinite(model.p_value)):
        power = 100 * first.power_5_percent.item()
        lines.append(f"power: rings reject a D off by 5 % with probability {power:.0f} %")
    if np.isfinite(case.kurtosis):
        lines.append(f"kurtosis: {plus_minus(case.kurtosis, case.kurtosis_standard_error)}; by eq. (18): 1")
    lines = [line.replace("p = ", "p\u00a0=\u00a0").replace("p < ", "p\u00a0<\u00a0") for line in lines]  # not parted
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


def _counts(axes: Axes, case: Dataset) -> None:
    """Draw the observed counts with their intervals, the expected ones, and the strip for runs beyond the last ring."""
    observed, r = case.displacement_counts.values, case.r.values
    axes.bar(r, observed, 0.92 * _width(case), color=DATA, alpha=0.18, linewidth=0)
    reach = np.abs(np.stack([case.displacement_counts_low, case.displacement_counts_high]) - observed)
    axes.errorbar(r, observed, reach, fmt="none", ecolor=DATA, elinewidth=1.1)
    axes.plot(r, observed, "o", color=DATA, markersize=3.5, label=f"{int(case.runs):,} runs, 95 % intervals")
    for source, model in _models(case).items():
        colour, line, _ = LOOKS[source]
        axes.plot(r, model.expected_counts, color=colour, linestyle=line, label=_legend(model, source))
    beyond = f"{int(case.displacement_overflow):,} runs beyond $r$ = {case.r_outer[-1].item():g}"
    place = _overflow_strip(axes, case)
    axes.text(place, 0.5, beyond, rotation=90, ha="center", va="center", transform=axes.get_xaxis_transform())


def _overflow_strip(axes: Axes, case: Dataset) -> float:
    """Mark the part of the axis that stands for all displacements beyond the last ring; return its middle."""
    edge = case.r_outer[-1].item()
    middle = edge + OVERFLOW * _width(case)
    axes.axvspan(edge, 2 * middle - edge, color="#F3F3F3", linewidth=0, zorder=0)
    axes.axvline(edge, color=GREY, linewidth=0.8)
    axes.set_xlim(0, 2 * middle - edge)
    return middle


def _legend(model: Dataset, source: str) -> str:
    """The D of a model, chi-square over the degrees of freedom if tested, and the runs expected beyond the rings."""
    diffusion = float(model.model_diffusion_coefficient)
    beyond = float(model.expected_overflow)
    test = f"$\\chi^2$/dof = {float(model.chi_square):.1f}/{int(model.degrees_of_freedom)}; "
    return f"{SOURCES[source]} = {diffusion:.3g}: {test if has(model, 'chi_square') else ''}{beyond:.0f} beyond"


def _residuals(axes: Axes, case: Dataset) -> None:
    """Draw the standardised residuals of every model; in the strip, those of the runs beyond the rings."""
    edge = case.r_outer[-1].item()
    residual_panel(axes)
    beyond = _overflow_strip(axes, case)
    for source, model in _models(case).items():
        colour, _, marker = LOOKS[source]
        residuals = _standardised(case, model)
        axes.plot(np.append(case.r, beyond), residuals, marker, color=colour, markersize=4, markerfacecolor="none")
    ticks = [tick for tick in axes.get_xticks() if 0 <= tick < edge - 2 * _width(case)]
    axes.set_xticks([*ticks, beyond], [*(f"{tick:.2g}" for tick in ticks), f"> {edge:g}"])


def _standardised(case: Dataset, model: Dataset) -> np.ndarray:
    """Observed less expected counts (K + 1,) over the standard error of the expected; NaN where both must be equal."""
    observed, expected = _all_counts(case, "displacement"), _all_counts(model, "expected")
    variance = expected * (1 - expected / float(case.runs))
    defined = (variance > 0.0) | (observed != expected)
    return np.where(defined, (observed - expected) / np.sqrt(np.maximum(variance, LEAST_VARIANCE)), np.nan)


def _models(case: Dataset) -> dict[str, Dataset]:
    """The first defined model of each source of D; the reflecting square only where its walls matter."""
    first: dict[str, Dataset] = {}
    for model in parts_of(case, "model", "model_diffusion_coefficient"):
        name = model.model.item()
        first.setdefault(name if name in LOOKS else "slope", model)
    if {"msd", "square"} <= first.keys():
        free, walled = (_all_counts(first[name], "expected") for name in ("msd", "square"))
        if np.all(np.abs(free - walled) < 0.1 * np.sqrt(np.maximum(free, 1))):  # a tenth of a standard error
            del first["square"]
    return first


def _all_counts(case: Dataset, of: str) -> np.ndarray:
    """Counts (K + 1,) in the rings and, at the end, beyond the last one."""
    return np.append(case[f"{of}_counts"], case[f"{of}_overflow"])


def _width(case: Dataset) -> float:
    """Width of the rings [length]."""
    return float(case.r_outer[0] - case.r_inner[0])


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, time and ring; the last one holds all displacements beyond the rings."""
    frames = []
    for case in (at_time for one in cases for at_time in distributions_of(one)):
        columns = {
            "time": case.displacement_time.item(),
            "r_inner": np.append(case.r_inner, case.r_outer[-1]),
            "r_outer": np.append(case.r_outer, np.inf),
            "runs": _all_counts(case, "displacement"),
            "runs_low": np.append(case.displacement_counts_low, np.nan),
            "runs_high": np.append(case.displacement_counts_high, np.nan),
        }
        expected = {f"expected, {name}": _all_counts(case.sel(model=name), "expected") for name in case.model.values}
        frames.append(DataFrame(label_of(case) | columns | expected))
    return concat(frames)
