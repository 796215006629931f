"""Figure `msd`: mean squared displacement against time (the note's figure 1), ballistic flight and
diffusion.
"""

from typing import Unpack

import numpy as np
from matplotlib.axes import Axes
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe import theory
from brownpipe.engines.windows import times_in_window
from brownpipe.figures import style
from brownpipe.figures.cases import (
    component_of,
    components_of,
    diffusion_ring,
    diffusion_symbol,
    estimate_of,
    fits_of,
    fitted_diffusion,
    frame_of,
    has,
    square_symbol,
    square_symbols,
    with_components,
)
from brownpipe.figures.figure import Figure
from brownpipe.figures.looks import Looks, replaced

HEADROOM = 1.12  # upper end of a linear axis over the largest value
MARGIN = 1.6  # ends of a logarithmic axis over the largest value, and under the smallest
# One at every fiftieth of the length of a curve
DOTS: Looks = {"linestyle": "", "marker": "o", "markersize": 3, "markevery": 0.02}
# MSD over ballistic MSD below which the initial velocity is forgotten and the slope gives D
FORGOTTEN = 0.5


def draw_msd(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw MSD(t) with its band and fit: of several cases or with `looks` a line each, otherwise
    with models.

    Where walls make the motion along x and y differ, both components are curves.
    """
    single = len(cases) == 1 and not looks
    parts = components_of(cases)
    number = _last_in_words if single else fitted_diffusion
    for part, line in style.styled_cases(parts, number, looks):
        if single:
            line = replaced(line, DOTS)  # models are lines
        style.band(axes, part, "msd", **line)
    first_fits: list[Dataset] = []
    for part in parts:
        first_fits += fits_of(part)[:1]
    for k, fit in enumerate(first_fits):
        t = np.array([fit.window_start.item(), fit.window_end.item()])
        label = "_" if looks or k else f"least squares over {fit.window.item()}"
        if single:
            label = _fit_in_words(fit)
        colour = style.FIT if single and len(parts) == 1 else style.INK
        axes.plot(t, _fitted(fit, t), color=colour, linewidth=1.2, label=label)
    if single:
        _models(axes, parts, np.linspace(0, cases[0].time.values[-1], 201))
        axes.set_ylim(0, HEADROOM * style.highest(parts, "msd") or 1.0)
    end = max(axes.dataLim.x1, *(case.time.values[-1] for case in cases))
    axes.set_xlim(0, 1.01 * end)
    axes.set_xlabel("time $t$")


def _fit_in_words(fit: Dataset) -> str:
    """Window and slope of a fitted line, for the legend of a single case."""
    window = f"least squares over {fit.window.item()}"
    if component_of(fit):
        return f"{window}: {diffusion_symbol(fit)} = {_diffusion_of(fit)}"
    return f"{window}: slope {estimate_of(fit, 'slope')}{diffusion_ring(fit)}"


def _diffusion_of(fit: Dataset) -> str:
    """The D of a fit in words."""
    return f"{estimate_of(fit, 'diffusion_coefficient')}{diffusion_ring(fit)}"


def _last_in_words(case: Dataset) -> str:
    """The number of runs and the MSD at their end, for the legend."""
    last = case.isel(time=-1)
    name = square_symbol(case) if component_of(case) else "MSD"
    return f"{int(case.runs):,} runs: {name}({last.time:g}) = {estimate_of(last, 'msd')}"


def _models(axes: Axes, parts: list[Dataset], t: np.ndarray) -> None:
    """Draw the MSD of diffusion and of ballistic flight of a case at times t, each if it is known;
    of its components diffusion along those whose D has no mark.
    """
    if len(parts) == 1:
        _models_of_all_motion(axes, parts[0], t)
        return
    for part in parts:
        plain = [fit for fit in fits_of(part) if not fit.diffusion_mark.item()]
        if plain:
            fit = plain[-1]
            symbol = diffusion_symbol(fit)
            label = f"diffusion, 2{symbol}$t$: {symbol} over {fit.window.item()}"
            label += f" = {_diffusion_of(fit)}"
            d = float(fit.diffusion_coefficient)
            axes.plot(
                t, 2 * d * t, color=style.MODEL, linestyle=style.DASHED, linewidth=1.4, label=label
            )


def _models_of_all_motion(axes: Axes, case: Dataset, t: np.ndarray) -> None:
    diffusion, label = _diffusion(case, t)
    if label:
        axes.plot(
            t, diffusion, color=style.MODEL, linestyle=style.DASHED, linewidth=1.4, label=label
        )
    square_speed = float(case.initial_square_speed)
    if np.isfinite(square_speed):
        label = f"ballistic flight, $\\langle v_0^2 \\rangle t^2 = {square_speed:.3g}\\,t^2$"
        ballistic = theory.ballistic_msd(t, square_speed)
        axes.plot(t, ballistic, color=style.GREY, linestyle=style.DOTTED, label=label)


def _diffusion(case: Dataset, t: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the MSD of diffusion at times t and its legend; NaN and "" where there is no diffusion
    yet.

    D is that of the fit window that begins last, where the initial velocity is forgotten most. Once
    walls have stopped the spreading (MSD above half of its limit, 2/3 of the squared accessible
    half-width), the slope there says nothing of D, which then follows from the last MSD below that
    half. There is no D if no line could be fitted, if it does not rise, or if the tracer still
    moves ballistically where the window begins.
    """
    unknown = np.full(t.shape, np.nan)
    half_width = float(case.accessible_half_width) if has(case, "accessible_half_width") else np.inf
    stopped = np.flatnonzero(case.msd > half_width**2 / 3)
    fits = fits_of(case)
    if len(stopped) and stopped[0] > 1:
        last = case.isel(time=stopped[0] - 1)
        start = float(last.time)
        value = theory.reflecting_square_diffusion(float(last.msd), start, half_width)
        source = f"D from MSD({start:.3g}) = {value:.3g}"
    elif fits:
        fit = max(fits, key=lambda fit: float(fit.window_start))
        start = float(fit.window_start)
        value = float(fit.diffusion_coefficient)
        source = f"D over {fit.window.item()} = {_diffusion_of(fit)}"
    else:
        return unknown, ""
    msd = np.interp(start, case.time, case.msd)
    ballistic = theory.ballistic_msd(start, float(case.initial_square_speed))
    if not (value > 0 and msd < FORGOTTEN * ballistic):  # nor if any is unknown: NaN
        return unknown, ""
    if half_width < np.inf:
        confined = theory.reflecting_square_msd(t, value, half_width)
        return confined, f"diffusion between walls: {source}"
    return theory.diffusive_msd(t, value), f"free diffusion, $4Dt$: {source}"


def draw_logarithmic_msd(axes: np.ndarray, groups: list[list[Dataset]]) -> None:
    """Draw MSD(t) on logarithmic axes, where ballistic flight has slope 2 and diffusion slope 1; of
    one case both.
    """
    groups_of_parts = [components_of(group) for group in groups]
    parts = [part for group in groups_of_parts for part in group]
    top = HEADROOM * style.highest(parts, "msd") or 1.0
    axes[0, 0].set_ylim(0, top)
    for panel, cases, group in zip(axes[1], groups, groups_of_parts, strict=True):
        panel.set_xlabel("time $t$")
        moving = [part.isel(time=(part.time.values > 0) & (part.msd.values > 0)) for part in group]
        moving = [part for part in moving if part.sizes["time"] > 1]
        if moving:
            for part, line in style.styled_cases(moving):
                style.band(panel, part, "msd", **line)
            start = min(part.time.values[0] for part in moving)
            end = max(part.time.values[-1] for part in moving)
            style.log_axis(panel, "x", start, end)
        if len(cases) == 1 and moving:
            _models(panel, moving, np.geomspace(start, end, 201))
    msd = np.concatenate([part.msd.values for part in parts])
    if (msd > 0).any():
        least = msd[msd > 0].min() / MARGIN
        style.log_axis(axes[1, 0], "y", least, max(msd.max() * MARGIN, top))


def _fitted(fit: Dataset, t: np.ndarray) -> np.ndarray:
    """The fitted line at times t in its window, NaN outside."""
    inside = times_in_window(t, (float(fit.window_start), float(fit.window_end)))
    return np.where(inside, float(fit.intercept) + float(fit.slope) * t, np.nan)


def table_of_msd(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time: the curves of the figure. Fitted lines are empty outside
    their windows.
    """
    frames = []
    names = ["msd", "msd_over_4t", "msd along x", "msd along y"]
    for case in cases:
        t = case.time.values
        fits = {}
        parts = components_of([case])
        for part in parts:
            axis = component_of(part)
            words = f" along {axis}" if axis else ""
            for window in part.window.values:
                fits[f"fit{words} over {window}"] = _fitted(part.sel(window=window), t)
        frame = frame_of([with_components(case, ["msd"])], ["time"], names)
        if len(parts) == 1:
            diffusion, _ = _diffusion(case, t)
            ballistic = theory.ballistic_msd(t, float(case.initial_square_speed))
            frame = frame.assign(ballistic=ballistic, diffusion=diffusion)
        frames.append(frame.assign(**fits))
    return concat(frames)


def labels_of_msd(cases: list[Dataset]) -> tuple[str, str]:
    """Return the labels of both rows of panels: along which axes the displacements are."""
    symbols = square_symbols(components_of(cases))
    return f"mean squared displacement {symbols}", symbols


FIGURE = Figure(
    curves=draw_msd,
    labels=("mean squared displacement", "MSD"),
    labels_of=labels_of_msd,
    variables=("msd",),
    below=draw_logarithmic_msd,
    table=table_of_msd,
)
