"""Figure `msd`: mean squared displacement against time, the note's figure 1, with what it should be compared to."""

import numpy as np

from brownpipe import theory
from brownpipe.figures.cases import fits_of, over_time, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FILL, FIT, FREE, START, head, tall_and_low
from brownpipe.figures.tables import Table

ROOM = 1.12  # of a vertical axis, times the largest value


def draw(cases):
    """One column per case: MSD(t) with fit, ballistic start and 4Dt above, MSD/4t with D below."""
    cases = [over_time(case) for case in cases]
    figure, axes = tall_and_low(len(cases))
    top = _top(case.msd_high.fillna(case.msd) for case in cases)
    low_top = _top((case.msd_high.fillna(case.msd) / (4 * case.time))[1:] for case in cases)
    for case, (main, low) in zip(cases, axes.T, strict=True):
        _curve(main, case, top)
        _running(low, case, low_top)
        head(main, title_of(case))
        low.set_xlabel("time $t$ (reduced units)")
    axes[0, 0].set_ylim(0, top)
    axes[1, 0].set_ylim(0, low_top)
    axes[1, 0].locator_params(axis="y", nbins=4)
    axes[0, 0].set_ylabel("mean squared displacement $\\langle r^2 \\rangle$\n(reduced units)")
    axes[1, 0].set_ylabel("$\\langle r^2 \\rangle / 4t$\n(reduced units)")
    return figure


def _top(curves):
    """Upper end of a vertical axis from 0 that has room for the curves."""
    return ROOM * max(float(curve.max()) for curve in curves) or 1.0


def _curve(axes, case, top):
    t, end = case.time.values, case.time.values[-1]
    axes.fill_between(t, case.msd_low, case.msd_high, color=DATA, alpha=FILL, linewidth=0)
    final = plus_minus(case.msd[-1], case.msd_standard_error[-1])
    axes.plot(t, case.msd, color=DATA, label=f"{int(case.runs):,} runs, 95 % band: MSD({end:g}) = {final}")
    for fit in fits_of(case)[:1]:
        _line(axes, fit, end)
    _start(axes, t, float(case.initial_square_speed), top)
    axes.set_xlim(0, end)


def _line(axes, fit, end):
    """The least-squares line in its window, and 4Dt with its D."""
    slope, intercept = float(fit.slope), float(fit.intercept)
    window = [float(fit.window_start), float(fit.window_end)]
    label = f"least squares over {fit.window.item()}: slope {plus_minus(slope, fit.slope_standard_error)}"
    axes.plot(window, [intercept + slope * t for t in window], color=FIT, linewidth=1.4, label=label)
    free = [theory.diffusive_msd(t, slope / 4) for t in (0, end)]
    diffusion = plus_minus(fit.diffusion_coefficient, fit.diffusion_coefficient_standard_error)
    axes.plot(
        [0, end], free, color=FREE, linestyle=DASHED, linewidth=1.4, label=f"$4Dt$ with D = slope/4 = {diffusion}"
    )


def _start(axes, t, square_speed, top):
    """The ballistic start as far as it fits, labelled at its upper end."""
    start = theory.ballistic_msd(t, square_speed)
    seen = start <= top
    if not seen.any():
        return
    axes.plot(t[seen], start[seen], color=START, linestyle=DOTTED)
    at = (t[seen][-1], start[seen][-1])
    text = f"ballistic\n$\\langle v_0^2 \\rangle t^2 = {square_speed:.3g}\\,t^2$"
    axes.annotate(text, at, (-13, 0), textcoords="offset points", ha="right", va="top", color=START)


def _running(axes, case, top):
    """MSD/4t with its band and ballistic start, and D over its window."""
    later = case.isel(time=slice(1, None))
    t, start = later.time.values, float(case.initial_square_speed) * later.time.values / 4
    axes.fill_between(t, later.msd_low / (4 * t), later.msd_high / (4 * t), color=DATA, alpha=FILL, linewidth=0)
    axes.plot(t, later.msd_over_4t, color=DATA)
    axes.plot(t[start <= top], start[start <= top], color=START, linestyle=DOTTED)
    for fit in fits_of(case)[:1]:
        window, diffusion = [float(fit.window_start), float(fit.window_end)], float(fit.diffusion_coefficient)
        low, high = float(fit.diffusion_coefficient_low), float(fit.diffusion_coefficient_high)
        axes.fill_between(window, low, high, color=FREE, alpha=FILL, linewidth=0)
        axes.plot(window, [diffusion, diffusion], color=FREE, linestyle=DASHED, linewidth=1.4)


def _fitted(fit, t):
    """The fitted line at the times t in its window, NaN at others."""
    start, end = float(fit.window_start), float(fit.window_end)
    inside = (t >= start * (1 - 1e-9)) & (t <= end * (1 + 1e-9))
    return np.where(inside, float(fit.intercept) + float(fit.slope) * t, np.nan)


def table(cases):
    """One row per case and time: the curves of the figure. Fits are given in their windows."""
    header = ("scene", "particles", "engine", "time", "msd", "msd_standard_error", "msd_low", "msd_high", "msd_over_4t")
    rows = []
    for case in map(over_time, cases):
        label = (case.scene.item(), case.particles.item(), case.engine.item())
        columns = [case[name].values for name in header[3:]]
        ballistic = theory.ballistic_msd(columns[0], float(case.initial_square_speed))
        lines = [_fitted(case.isel(window=k), columns[0]) for k in range(case.sizes["window"])]
        rows += [(*label, *values) for values in zip(*columns, ballistic, *lines, strict=True)]
    return Table((*header, "ballistic", *(f"fit over {window}" for window in cases[0].window.values)), rows)
