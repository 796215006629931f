"""Figure `velocity_autocorrelation`: tracer and bath, from the initial slope to the 1/t tail.

The initial slope, -gamma <v^2>, follows from the collision rate (docs/theory.md); the tail is that
of hydrodynamics in two dimensions.
"""

from collections.abc import Iterator
from itertools import product
from typing import Unpack

import numpy as np
from matplotlib.axes import Axes
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures import style
from brownpipe.figures.cases import (
    SUFFIXES,
    components_of,
    defined,
    frame_of,
    has,
    plus_minus,
    with_components,
)
from brownpipe.figures.figure import Figure
from brownpipe.figures.looks import NO_LOOKS, Looks

TRACER = "velocity_autocorrelation"
BATH = "bath_velocity_autocorrelation"
SLOPE = "vacf_initial_slope"
TAIL = "vacf_tail"
LABEL = "$\\langle v(0) \\cdot v(t) \\rangle\\ /\\ \\langle v(0)^2 \\rangle$"


def draw_autocorrelations(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw the correlation of the tracer; of a single case also that of the bath, and the initial
    slope.

    The slope follows from the tracer's collision rate. With `looks` there is one line per case.
    Where walls make the motion along x and y differ, both components of the tracer are curves.
    """
    axes.axhline(0, color=style.GREY, linewidth=0.8)
    parts = components_of(cases)
    for curve, line in _curves(parts, looks):
        style.band(axes, curve, TRACER, **line)
    if len(parts) == 1 and not looks:
        _initial_slope(axes, parts[0])
    style.time_axis(axes, cases)


def _initial_slope(axes: Axes, case: Dataset) -> None:
    """Draw the initial slope that follows from the collision rate, if it is known."""
    if not has(case, "vacf_initial_slope_expected") or not case[TRACER][0] > 0:
        return
    rate = -float(case.vacf_initial_slope_expected) / float(case[TRACER][0])
    least_rate = 1 / float(case.time[-1])
    t = np.linspace(0, 1 / max(rate, least_rate), 200)
    label = f"$1 - \\gamma t$, $\\gamma$ = {rate:.3g} from the collision rate"
    axes.plot(t, 1 - rate * t, color=style.INK, linestyle=style.DOTTED, label=label)


def _curves(cases: list[Dataset], looks: Looks) -> Iterator[tuple[Dataset, Looks]]:
    """The correlations divided by their values at t = 0, under the tracer's name, and their
    looks.
    """
    names = [TRACER, BATH] if len(cases) == 1 and not looks else [TRACER]
    curves = []
    for case in cases:
        curves += [_normalised(case, name) for name in names if has(case, name)]
    return style.styled_cases(curves, _rate_in_words, looks)


def _normalised(case: Dataset, name: str) -> Dataset:
    """The case with the correlation of this name and its initial slope, if it is the tracer's, over
    its first value.
    """
    replaced = [f"{variable}{suffix}" for variable, suffix in product((TRACER, SLOPE), SUFFIXES)]
    sources = {f"{TRACER}{suffix}": f"{name}{suffix}" for suffix in SUFFIXES}
    if name == TRACER:
        sources |= {f"{SLOPE}{suffix}": f"{SLOPE}{suffix}" for suffix in SUFFIXES}
    first = float(case[name][0])
    scaled = {new: case[old] / first for new, old in sources.items() if old in case}
    curve = case.drop_dims("species", errors="ignore").drop_vars(replaced, errors="ignore")
    curve = curve.assign(scaled)
    return curve.assign_coords(species="bath" if name == BATH else "tracer")


def _rate_in_words(curve: Dataset) -> str:
    """The measured initial decay rate of the tracer's correlation, for the legend; empty where it
    is not known.
    """
    if not has(curve, SLOPE):
        return ""
    rate = plus_minus(-curve[SLOPE], curve[f"{SLOPE}_standard_error"])
    return f"initial decay $1 - \\gamma t$, $\\gamma$ = {rate}"


def draw_decays(axes: np.ndarray, groups: list[list[Dataset]]) -> None:
    """Draw the decays on logarithmic axes as far as they are resolved."""
    for (upper, lower), group in zip(axes.T, groups, strict=True):
        _tails(upper, lower, group)
        times = np.concatenate([case.time.values for case in group])
        style.log_axis(lower, "x", times[times > 0].min(), times.max())
        lower.set_xlabel("time $t$")
    least = 0.5
    for panel in axes[1]:
        least = min([least, *(np.min(line.get_ydata()) for line in panel.lines)])
    style.log_axis(axes[1, 0], "y", least / 3, 1.5)


def _tails(upper: Axes, axes: Axes, cases: list[Dataset]) -> None:
    """Draw the decays on logarithmic axes as far as they are resolved, with the tail of theory of
    a single case or, where there is none, a slope of 1/t.

    A curve ends where its 95 % band, or without one the curve, first reaches zero: the rest is
    noise.
    """
    tails = []
    for curve, line in _curves(components_of(cases), NO_LOOKS):
        later = curve.isel(time=curve.time.values > 0)
        low = later.get(f"{TRACER}_low", later[TRACER]).values
        tail = later.isel(time=np.logical_and.accumulate(low > 0))
        if tail.sizes["time"] > 1:
            style.band(axes, tail, TRACER, **line)
            tails.append(tail)
    if not tails:
        axes.text(
            0.5, 0.5, "not resolved from 0", ha="center", color=style.GREY, transform=axes.transAxes
        )
    long_tails = [tail for tail in tails if tail.sizes["time"] > 2]
    if len(cases) == 1 and has(cases[0], TAIL):
        _theory(upper, axes, cases[0])
    elif long_tails:
        _guide(upper, axes, long_tails[0])


def _theory(upper: Axes, axes: Axes, case: Dataset) -> None:
    """Draw the tail of mode-coupling theory."""
    tail = defined(case, TAIL)
    line: Looks = {"color": style.INK, "linewidth": 1}
    is_positive = tail[TAIL].values > 0
    shown = tail.isel(time=is_positive)
    axes.plot(shown.time, shown[TAIL] / float(case[TRACER][0]), **line)
    upper.plot([], [], label="mode coupling, $a/t$ (lower panel)", **line)


def _guide(upper: Axes, axes: Axes, tail: Dataset) -> None:
    """Draw a line of slope 1/t above the end of a tail."""
    times = tail.time.values
    t = times[times >= times[-1] / 3]
    amplitude = float((tail[TRACER] * tail.time).sel(time=t).mean())
    axes.plot(t, 2.5 * amplitude / t, color=style.INK, linewidth=1)
    upper.plot([], [], color=style.INK, linewidth=1, label="decay as $1/t$ (lower panel)")


def table_of_autocorrelations(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time: the correlations of tracer and bath, and where walls make
    the motion along x and y differ those of the tracer's components.
    """
    shown = [with_components(case, [TRACER]) for case in cases]
    return frame_of(shown, ["time"], [TRACER, BATH, f"{TRACER} along x", f"{TRACER} along y"])


FIGURE = Figure(
    curves=draw_autocorrelations,
    labels=(f"velocity autocorrelation\n{LABEL}", LABEL),
    variables=(TRACER,),
    below=draw_decays,
    table=table_of_autocorrelations,
)
