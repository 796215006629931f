"""Figure `displacement_distribution`: how far the runs got, the note's figure 2, against eq. (18)."""

import numpy as np

from brownpipe.figures.cases import at_last_displacement, title_of
from brownpipe.figures.style import DASHED, DATA, FIT, FREE, START, head, tall_and_low
from brownpipe.figures.tables import Table

LOOKS = ((FIT, "-", "o"), (FREE, DASHED, "s"))  # colour, line and marker of the first two models
LIKELY = 2.0  # deviations of up to so many standard errors lie in the grey band


def draw(cases):
    """One column per case: counts per ring with both expectations above, deviations with the overflow below."""
    figure, axes = tall_and_low(len(cases))
    cases = [at_last_displacement(case) for case in cases]
    for case, (main, low) in zip(cases, axes.T, strict=True):
        _counts(main, case)
        _deviations(low, case)
        head(main, title_of(case))
        low.set_xlabel(f"distance $r$ from the start at $t$ = {case.displacement_time.item():g} (reduced units)")
    axes[0, 0].set_ylim(0, 1.05 * max(float(case.displacement_counts_high.max()) for case in cases))
    axes[0, 0].set_ylabel(f"runs that end between $r$ and $r$ + {_width(cases[0]):g}")
    axes[1, 0].set_yticks([-LIKELY, 0, LIKELY])
    axes[1, 0].set_ylabel("(found - expected)\n/ standard error")
    return figure


def _counts(axes, case):
    found, r, edge = case.displacement_counts.values, case.r.values, case.r_outer[-1].item()
    axes.bar(r, found, 0.92 * _width(case), color=DATA, alpha=0.18, linewidth=0)
    bars = np.abs(np.stack([case.displacement_counts_low, case.displacement_counts_high]) - found)
    label = f"{int(case.runs):,} runs, 95 % intervals; {int(case.displacement_overflow):,} end beyond {edge:g}"
    axes.errorbar(r, found, bars, fmt="none", ecolor=DATA, elinewidth=1.1)
    axes.plot(r, found, "o", color=DATA, markersize=3.5, label=label)
    for model, (colour, line, _) in _models(case):
        axes.plot(r, model.expected_counts, color=colour, linestyle=line, label=_verdict(model))


def _verdict(model):
    """Where D comes from, its chi-square, and how many runs it expects beyond the rings."""
    source = "MSD/4$t$" if model.model == "msd" else "slope/4"
    diffusion, beyond = float(model.model_diffusion_coefficient), float(model.expected_overflow)
    test = f"$\\chi^2$ = {float(model.chi_square):.1f} / {int(model.degrees_of_freedom)}, p = {p_text(model.p_value)}"
    return f"D = {source} = {diffusion:.3f}: {test}; {beyond:.0f} beyond"


def p_text(p):
    """`0.33`, `0.020`, or a dash where there is no test."""
    return "-" if np.isnan(p) else f"{float(p):.2f}" if p >= 0.095 else f"{float(p):#.2g}"


def _deviations(axes, case):
    """Found less expected in standard errors of the expected count; last, beyond the line, the overflow."""
    edge, beyond = case.r_outer[-1].item(), case.r_outer[-1].item() + 1.6 * _width(case)
    axes.axhspan(-LIKELY, LIKELY, color="#EFEFEF", linewidth=0)
    axes.axhline(0, color=START, linewidth=0.8)
    axes.axvline(edge, color=START, linewidth=0.8)
    for k, (model, (colour, _, marker)) in enumerate(_models(case)):
        aside = (2 * k - 1) * 0.1 * _width(case)  # one marker does not hide the other
        axes.plot(np.append(case.r, beyond) + aside, _standardised(case, model), marker, color=colour, markersize=4)
    axes.set_xlim(0, beyond + 1.6 * _width(case))
    ticks = [tick for tick in axes.get_xticks() if 0 <= tick < edge - 2 * _width(case)]
    axes.set_xticks([*ticks, beyond], [*(f"{tick:.2g}" for tick in ticks), "beyond"])


def _standardised(case, model):
    found = np.append(case.displacement_counts, case.displacement_overflow)
    expected = np.append(model.expected_counts, model.expected_overflow)
    return (found - expected) / np.sqrt(expected * (1 - expected / float(case.runs)))


def _models(case):
    """The first two models that are defined, with their looks."""
    models = [case.isel(model=k) for k in range(case.sizes["model"])]
    defined = [model for model in models if np.isfinite(model.model_diffusion_coefficient)]
    return list(zip(defined, LOOKS, strict=False))


def _width(case):
    return float(case.r_outer[0] - case.r_inner[0])


def table(cases):
    """One row per case and ring, the last ring of a case being everything beyond."""
    header = ("scene", "particles", "engine", "r_inner", "r_outer", "runs", "runs_low", "runs_high")
    cases = [at_last_displacement(case) for case in cases]
    models = [f"expected, {model}" for model in cases[0].model.values]
    rows = []
    for case in cases:
        label = (case.scene.item(), case.particles.item(), case.engine.item())
        names = ("r_inner", "r_outer", "displacement_counts", "displacement_counts_low", "displacement_counts_high")
        columns = [case[name].values for name in names]
        rows += [(*label, *values) for values in zip(*columns, *case.expected_counts.values, strict=True)]
        beyond = (case.r_outer.values[-1], np.inf, case.displacement_overflow.item(), np.nan, np.nan)
        rows.append((*label, *beyond, *case.expected_overflow.values))
    return Table((*header, *models), rows)
