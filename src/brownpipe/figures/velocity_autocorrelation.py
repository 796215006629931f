"""Figure `velocity_autocorrelation`: tracer and bath, from the initial slope to the 1/t tail.

The initial slope, -gamma <v^2>, follows from the collision rate (docs/theory.md); the tail is that of hydrodynamics in
two dimensions.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import has, over_time, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FIT, GREY, INK, band, columns, heads, log_axis, time_axis
from brownpipe.figures.tables import frame_of

TRACER = "velocity_autocorrelation"
BATH = "bath_velocity_autocorrelation"
LOOKS = {TRACER: ("tracer", DATA, "-"), BATH: ("bath", FIT, DASHED)}  # label, colour, line
LABEL = "$\\langle v(0) \\cdot v(t) \\rangle\\ /\\ \\langle v(0)^2 \\rangle$"
TAIL = 10  # the logarithmic axis extends at most by this factor below a curve to show its band


def draw(cases: list[Dataset]) -> Figure:
    """Draw one column per case: the correlation and its initial slope above, its decay on logarithmic axes below."""
    cases = [over_time(case, TRACER) for case in cases]
    curves = [{name: _normalised(case, name) for name in LOOKS if has(case, name)} for case in cases]
    figure, axes = columns((f"velocity autocorrelation\n{LABEL}", LABEL), len(cases), (3.85, 3.35))
    tails = [_resolved(of_case) for of_case in curves]
    for case, of_case, tail, (main, low) in zip(cases, curves, tails, axes.T, strict=True):
        _decay(main, case, of_case)
        _tail(main, low, tail)
        times = case.time.values
        time_axis(main, times)
        log_axis(low, "x", times[times > 0][0], times[-1])
        low.set_xlabel("time $t$")
    log_axis(axes[1, 0], "y", *_tail_extent(tails))
    heads(axes[0], map(title_of, cases))
    return figure


def _tail_extent(tails: list[dict[str, Dataset]]) -> tuple[float, float]:
    """Limits of the logarithmic axis that all cases share; bands that come close to 0 are cut off (TAIL)."""
    low, high = [0.5], [1.2, *np.concatenate([_guide(of_case)[1] for of_case in tails])]
    for name, tail in (named for of_case in tails for named in of_case.items()):
        low.append(max(float(tail.get(f"{name}_low", tail[name]).min()), float(tail[name].min()) / TAIL))
        high.append(float(np.nanmax(tail.to_dataarray())))
    return min(low) / 1.2, max(high) * 1.2


def _normalised(case: Dataset, name: str) -> Dataset:
    """The correlation and its band, divided by its value at t = 0."""
    parts = [part for part in (name, f"{name}_low", f"{name}_high") if part in case]
    return case[parts] / float(case[name][0])


def _decay(axes: Axes, case: Dataset, curves: dict[str, Dataset]) -> None:
    """Draw the correlations, and the initial slope that follows from the tracer's collision rate."""
    axes.axhline(0, color=GREY, linewidth=0.8)
    for name, curve in curves.items():
        label, colour, line = LOOKS[name]
        label = (label if BATH in curves else "disks") + (_measured_rate(case) if name == TRACER else "")
        band(axes, curve, name, colour, linestyle=line, label=label)
    if has(case, "vacf_initial_slope_expected"):
        rate = -float(case.vacf_initial_slope_expected) / float(case[TRACER][0])
        label = f"$1 - \\gamma t$, $\\gamma$ = {rate:.3g} from the collision rate"
        last = float(case.time[-1])
        t = np.linspace(0, 1 / rate if rate * last > 1 else last, 200)
        axes.plot(t, 1 - rate * t, color=INK, linestyle=DOTTED, label=label)


def _measured_rate(case: Dataset) -> str:
    """The measured initial decay rate of the tracer's correlation, for the legend; empty where it is not known."""
    if not has(case, "vacf_initial_slope"):
        return ""
    rate, error = (float(case[f"vacf_initial_slope{part}"] / case[TRACER][0]) for part in ("", "_standard_error"))
    return f": initial decay $1 - \\gamma t$, $\\gamma$ = {plus_minus(-rate, error)}"


def _tail(main: Axes, axes: Axes, tails: dict[str, Dataset]) -> None:
    """Draw the decay on logarithmic axes as far as it is resolved, and the slope of the 1/t tail in two dimensions."""
    for name, tail in tails.items():
        _, colour, line = LOOKS[name]
        band(axes, tail, name, colour, linestyle=line)
    guide = _guide(tails)
    if guide.size:
        axes.plot(*guide, color=INK, linewidth=1)
        main.plot([], [], color=INK, linewidth=1, label="decay as $1/t$ (lower panel)")
    if not tails:
        axes.text(0.5, 0.5, "not resolved from 0", ha="center", color=GREY, transform=axes.transAxes)


def _resolved(curves: dict[str, Dataset]) -> dict[str, Dataset]:
    """The curves after t = 0 until their 95 % band, or without one the curve, first reaches zero: the rest is noise."""
    tails = {}
    for name, curve in curves.items():
        later = curve.isel(time=curve.time.values > 0)
        positive = later.get(f"{name}_low", later[name]).values > 0
        tails[name] = later.isel(time=np.logical_and.accumulate(positive))
    return {name: tail for name, tail in tails.items() if tail.sizes["time"]}


def _guide(tails: dict[str, Dataset]) -> np.ndarray:
    """Times and values (2, 2) of a line of slope -1 above the end of the first tail; (2, 0) if that is too short."""
    name, tail = next(iter(tails.items()), (TRACER, None))
    if tail is None or tail.sizes["time"] < 3:
        return np.empty((2, 0))
    t = tail.time.values
    late = t >= t[-1] / 3
    height = 2.5 * np.exp(np.mean(np.log(tail[name].values[late] * t[late])))
    ends = np.array([max(t[-1] / 3, t[0]), t[-1]])
    return np.array([ends, height / ends])


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time."""
    return frame_of(cases, ("time",), LOOKS)
