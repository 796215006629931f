"""Figure `msd`: mean squared displacement against time, the note's figure 1, with what it should be compared to."""

import numpy as np

from brownpipe import theory
from brownpipe.figures.cases import fits_of, has, over_time, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FIT, FREE, START, band, columns, heads, log_axis
from brownpipe.figures.tables import Table

ROOM = 1.12  # of a vertical axis, times the largest value
MOST_DOTS = 60  # of samples shown one by one
LABELS = ("mean squared displacement $\\langle r^2 \\rangle$", "$\\langle r^2 \\rangle$")
FORGOTTEN = 0.5  # of the ballistic MSD: below, a tracer has left its first flight, and a slope tells of diffusion
HEIGHTS = (4.4, 3.2)  # of the two panels of a column [inch]
VARIABLES = ("msd",)
LACKING = "no run with a tracer was kept"


def draw(cases):
    """One column per case: MSD(t) with the fit and what diffusion would do above, all decades of it below."""
    cases = [over_time(case) for case in cases]
    figure, axes = columns(LABELS, len(cases), HEIGHTS)
    top = ROOM * max(float(case.msd_high.fillna(case.msd).max()) for case in cases) or 1.0
    for case, (main, low) in zip(cases, axes.T, strict=True):
        _linear(main, case, top)
        _decades(low, case)
        main.set_xlabel("time $t$")
        low.set_xlabel("time $t$")
    axes[0, 0].set_ylim(0, top)
    moved = [values[values > 0] for case in cases for values in [case.msd.values]]
    if any(values.size for values in moved):
        moved = np.concatenate(moved)
        log_axis(axes[1, 0], "y", moved.min() / 1.6, moved.max() * 1.6)
    heads(axes[0], map(title_of, cases))
    return figure


def _linear(axes, case, top):
    """MSD(t) with its band, the line over its window and how it misses the origin, and diffusion from the origin."""
    t, end, smooth = case.time.values, case.time.values[-1], np.linspace(0, case.time.values[-1], 201)
    final = plus_minus(case.msd[-1], case.msd_standard_error[-1])
    label = f"{int(case.runs):,} runs, 95 % band: MSD({end:g}) = {final}"
    every = -(-t.size // MOST_DOTS)
    band(axes, t, case, "msd", DATA, linestyle="", marker="o", markersize=3, markevery=every, label=label)
    for fit in fits_of(case)[:1]:
        _line(axes, fit, end)
    for diffusion, label in _diffusing(case):
        axes.plot(smooth, _diffusion(case, smooth, diffusion), color=FREE, linestyle=DASHED, linewidth=1.4, label=label)
    square_speed = float(case.initial_square_speed)
    start = theory.ballistic_msd(smooth, square_speed)
    label = f"ballistic flight, $\\langle v_0^2 \\rangle t^2 = {square_speed:.3g}\\,t^2$"
    axes.plot(smooth[start <= top], start[start <= top], color=START, linestyle=DOTTED, label=label)
    axes.set_xlim(0, 1.01 * end)


def _line(axes, fit, end):
    """The least-squares line, strong in its window and faint beyond."""
    slope, intercept = float(fit.slope), float(fit.intercept)
    window = np.array([float(fit.window_start), float(fit.window_end)])
    label = f"least squares over {fit.window.item()}: slope {plus_minus(slope, fit.slope_standard_error)}"
    beyond = np.array([max(0.0, -intercept / slope) if slope > 0 else 0.0, end])
    axes.plot(beyond, intercept + slope * beyond, color=FIT, linewidth=0.7)
    axes.plot(window, intercept + slope * window, color=FIT, linewidth=1.5, label=label)


def _diffusing(case):
    """The diffusion coefficient that is drawn, with its words: that of the last window, which forgets the start most.

    Where walls have stopped the tracer that window says nothing of D: then the D whose curve meets the data when they
    last were below half of what the walls allow. Empty if no line could be fitted, if it does not rise, or if the
    tracer still flies as it started where the window begins: there is no diffusion to speak of yet.
    """
    stopped = np.flatnonzero(case.msd > float(case.accessible_half_width) ** 2 / 3) if _walled(case) else ()
    if len(stopped) and stopped[0] > 1 and _diffuses(case, case.time.values[stopped[0] - 1]):
        t, msd = case.time.values[stopped[0] - 1], float(case.msd[stopped[0] - 1])
        diffusion = theory.reflecting_square_diffusion(msd, t, float(case.accessible_half_width))
        yield diffusion, f"diffusion between walls, met at $t$ = {t:.3g}: D = {diffusion:.3g}"
        return
    for fit in [fit for fit in fits_of(case) if _diffuses(case, float(fit.window_start))][-1:]:
        diffusion = plus_minus(fit.diffusion_coefficient, fit.diffusion_coefficient_standard_error)
        what = "diffusion between walls" if _walled(case) else "free diffusion, $4Dt$"
        if fit.diffusion_coefficient > 0:
            yield float(fit.diffusion_coefficient), f"{what}: D over {fit.window.item()} = {diffusion}"


def _diffuses(case, time):
    """Is the MSD at this time far below that of the first flight?"""
    ballistic = theory.ballistic_msd(time, float(case.initial_square_speed))
    return float(np.interp(time, case.time.values, case.msd.values)) < FORGOTTEN * ballistic


def _walled(case):
    return has(case, "accessible_half_width")


def _diffusion(case, t, diffusion):
    """MSD [length^2] of diffusion from t = 0: 4Dt, or from the centre of the reflecting square that the tracer has."""
    if _walled(case):
        return theory.reflecting_square_msd(t, diffusion, float(case.accessible_half_width))
    return theory.diffusive_msd(t, diffusion)


def _decades(axes, case):
    """MSD(t) on logarithmic axes: the ballistic start has slope 2, diffusion has slope 1."""
    later = case.isel(time=(case.time.values > 0) & (case.msd.values > 0))
    t, msd = later.time.values, later.msd.values
    if t.size < 2:
        return
    band(axes, t, later, "msd", DATA)
    low, high = msd.min() / 1.6, msd.max() * 1.6
    square_speed, smooth = float(case.initial_square_speed), np.geomspace(t[0], t[-1], 201)
    ballistic = theory.ballistic_msd(smooth, square_speed)
    seen = (ballistic <= high) & (ballistic >= low)
    if seen.any():
        axes.plot(smooth[seen], ballistic[seen], color=START, linestyle=DOTTED)
    for diffusion, _ in _diffusing(case):
        curve = _diffusion(case, smooth, diffusion)
        axes.plot(smooth[curve >= low], curve[curve >= low], color=FREE, linestyle=DASHED, linewidth=1.4)
    log_axis(axes, "x", t[0], t[-1])


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
        diffusing = np.full(len(columns[0]), np.nan)
        for diffusion, _ in _diffusing(case):
            diffusing = _diffusion(case, columns[0], diffusion)
        lines = [_fitted(case.isel(window=k), columns[0]) for k in range(case.sizes["window"])]
        rows += [(*label, *values) for values in zip(*columns, ballistic, diffusing, *lines, strict=True)]
    lines = (f"fit over {window}" for window in cases[0].window.values)
    return Table((*header, "ballistic", "diffusion", *lines), rows)
