"""Figure `msd`: mean squared displacement against time (the note's figure 1), ballistic flight and diffusion."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe import theory
from brownpipe.figures import style
from brownpipe.figures.cases import early_mark, estimate_of, fits_of, frame_of, has, over_time

HEADROOM = 1.12  # upper end of a linear axis over the largest value
MARGIN = 1.6  # ends of a logarithmic axis over the largest value, and under the smallest
DOTS = {"linestyle": "", "marker": "o", "markersize": 3}
MOST_DOTS = 60  # samples shown as dots
LABELS = ("mean squared displacement $\\langle r^2 \\rangle$", "$\\langle r^2 \\rangle$")
FORGOTTEN = 0.5  # MSD over ballistic MSD below which the initial velocity is forgotten and the slope gives D


def curves(axes: Axes, cases: list[Dataset], **looks: Any) -> None:
    """Draw MSD(t) with its band and fit: of several cases or with `looks` a line each, otherwise with models."""
    cases = [over_time(case) for case in cases]
    single = len(cases) == 1 and not looks
    for case, line in style.told_apart(cases, _last_in_words if single else _fitted_diffusion, looks):
        dots = DOTS | {"markevery": -(-case.time.size // MOST_DOTS)} if single else {}  # models are lines
        style.band(axes, case, "msd", **line | dots)
    for k, fit in enumerate(fit for case in cases for fit in fits_of(case)[:1]):
        t = np.array([fit.window_start.item(), fit.window_end.item()])
        slope = f": slope {estimate_of(fit, 'slope')}{early_mark(fit)}" if single else ""
        label = "_" if looks or k else f"least squares over {fit.window.item()}{slope}"
        axes.plot(t, _fitted(fit, t), color=style.FIT if single else style.INK, linewidth=1.2, label=label)
        if single:
            axes.axline(*zip(t, _fitted(fit, t), strict=True), color=style.FIT, linewidth=0.7)
    if single:
        _models(axes, cases[0], np.linspace(0, cases[0].time.values[-1], 201))
        axes.set_ylim(0, _top(cases))
    axes.set_xlim(0, 1.01 * max(axes.dataLim.x1, *(case.time.values[-1] for case in cases)))
    axes.set_xlabel("time $t$")


def _fitted_diffusion(case: Dataset) -> str:
    """D in the first fit window, for the legend."""
    fits = fits_of(case)[:1]
    return "".join(f"D = {estimate_of(fit, 'diffusion_coefficient')}{early_mark(fit)}" for fit in fits)


def _last_in_words(case: Dataset) -> str:
    """The number of runs and the MSD at their end, for the legend."""
    with_band = ", 95 % band" if case.msd_low.notnull().any() else ""
    return f"{int(case.runs):,} runs{with_band}: MSD({case.time[-1]:g}) = {estimate_of(case.isel(time=-1), 'msd')}"


def _top(cases: list[Dataset]) -> float:
    """The upper end of a linear axis."""
    return HEADROOM * style.highest(cases, "msd") or 1.0


def _models(axes: Axes, case: Dataset, t: np.ndarray) -> None:
    """Draw the MSD of diffusion and of ballistic flight at times t."""
    for diffusion, label in _diffusing(case):
        looks: dict[str, Any] = {"color": style.MODEL, "linestyle": style.DASHED, "linewidth": 1.4}
        axes.plot(t, _diffusion(case, t, diffusion), label=label, **looks)
    square_speed = float(case.initial_square_speed)
    if np.isfinite(square_speed):  # known before the runs
        label = f"ballistic flight, $\\langle v_0^2 \\rangle t^2 = {square_speed:.3g}\\,t^2$"
        axes.plot(t, theory.ballistic_msd(t, square_speed), color=style.GREY, linestyle=style.DOTTED, label=label)


def _diffusing(case: Dataset) -> Iterator[tuple[float, str]]:
    """Yield the diffusion coefficient whose MSD is drawn, and its legend; nothing where there is no diffusion yet.

    D is that of the fit window that begins last, where the initial velocity is forgotten most. Once walls have stopped
    the spreading (MSD above half of its limit, 2/3 of the squared accessible half-width), the slope there says nothing
    of D, which then follows from the last MSD below that half. There is no D if no line could be fitted, if it does not
    rise, or if the tracer still moves ballistically where the window begins.
    """
    stopped = np.flatnonzero(_walled(case) and case.msd > float(case.accessible_half_width) ** 2 / 3)
    if len(stopped) and stopped[0] > 1 and _diffuses(case, case.time.values[stopped[0] - 1]):
        t = case.time.values[stopped[0] - 1]
        msd = float(case.msd[stopped[0] - 1])
        diffusion = theory.reflecting_square_diffusion(msd, t, float(case.accessible_half_width))
        yield diffusion, f"diffusion between walls: D from MSD({t:.3g}) = {diffusion:.3g}"
        return
    fits = [fit for fit in fits_of(case) if _diffuses(case, float(fit.window_start))]
    for fit in sorted(fits, key=lambda fit: float(fit.window_start))[-1:]:
        value = estimate_of(fit, "diffusion_coefficient")
        model = "diffusion between walls" if _walled(case) else "free diffusion, $4Dt$"
        if fit.diffusion_coefficient > 0:
            yield float(fit.diffusion_coefficient), f"{model}: D over {fit.window.item()} = {value}"


def _diffuses(case: Dataset, time: float) -> bool:
    """Return whether the MSD at this time is far below that of ballistic flight; False if that is unknown (NaN)."""
    ballistic = float(theory.ballistic_msd(time, float(case.initial_square_speed)))
    return float(np.interp(time, case.time.values, case.msd.values)) < FORGOTTEN * ballistic


def _walled(case: Dataset) -> bool:
    return has(case, "accessible_half_width")


def _diffusion(case: Dataset, t: np.ndarray, diffusion: float) -> np.ndarray:
    """MSD [length^2] of diffusion at times t: 4Dt, or that from the centre of the reflecting square of the tracer."""
    if _walled(case):
        return theory.reflecting_square_msd(t, diffusion, float(case.accessible_half_width))
    return theory.diffusive_msd(t, diffusion)


def below(axes: np.ndarray, groups: list[list[Dataset]]) -> None:
    """Draw MSD(t) on logarithmic axes, where ballistic flight has slope 2 and diffusion slope 1; of one case both."""
    cases = [over_time(case) for group in groups for case in group]
    axes[0, 0].set_ylim(0, _top(cases))
    for panel, group in zip(axes[1], groups, strict=True):
        _decades(panel, [over_time(case) for case in group])
    msd = np.concatenate([case.msd.values for case in cases])
    if (msd > 0).any():
        style.log_axis(axes[1, 0], "y", msd[msd > 0].min() / MARGIN, max(msd.max() * MARGIN, _top(cases)))


def _decades(axes: Axes, cases: list[Dataset]) -> None:
    axes.set_xlabel("time $t$")
    cases = [case.isel(time=(case.time.values > 0) & (case.msd.values > 0)) for case in cases]
    cases = [case for case in cases if case.sizes["time"] > 1]
    if cases:
        for case, line in style.told_apart(cases, lambda _: "", {}):
            style.band(axes, case, "msd", **line)
        start, end = min(case.time.values[0] for case in cases), max(case.time.values[-1] for case in cases)
        style.log_axis(axes, "x", start, end)
    if len(cases) == 1:
        _models(axes, cases[0], np.geomspace(start, end, 201))


def _fitted(fit: Dataset, t: np.ndarray) -> np.ndarray:
    """The fitted line at times t in its window, NaN outside."""
    start, end = float(fit.window_start), float(fit.window_end)
    inside = (t >= start * (1 - 1e-9)) & (t <= end * (1 + 1e-9))
    return np.where(inside, float(fit.intercept) + float(fit.slope) * t, np.nan)


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time: the curves of the figure. Fitted lines are empty outside their windows."""
    frames = []
    for case in map(over_time, cases):
        t = case.time.values
        curves = {"ballistic": theory.ballistic_msd(t, float(case.initial_square_speed)), "diffusion": np.nan}
        for diffusion, _ in _diffusing(case):
            curves["diffusion"] = _diffusion(case, t, diffusion)
        curves |= {f"fit over {window}": _fitted(case.sel(window=window), t) for window in case.window.values}
        frames.append(frame_of([case], ["time"], ["msd", "msd_over_4t"]).assign(**curves))
    return concat(frames)
