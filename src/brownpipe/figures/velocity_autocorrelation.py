"""Figure `velocity_autocorrelation`: how tracer and bath forget their velocity, from first collision to late tail."""

import numpy as np

from brownpipe.figures.cases import has, over_time, plus_minus, title_of
from brownpipe.figures.style import (
    DASHED,
    DATA,
    DOTTED,
    FILL,
    FIT,
    INK,
    START,
    band,
    head,
    tall_and_low,
    time_axis,
)
from brownpipe.figures.tables import long_table

TRACER, BATH = "velocity_autocorrelation", "bath_velocity_autocorrelation"
LOOKS = {TRACER: ("tracer", DATA, "-"), BATH: ("bath", FIT, DASHED)}
NEEDS = (TRACER,)
LACKING = "the observable velocity_autocorrelation was not asked for"


def draw(cases):
    """One column per case: the correlation and how it must begin above, its decay on logarithmic axes below."""
    figure, axes = tall_and_low(len(cases), ratio=1.15, sharex=False, height=7.2)
    for case, (main, low) in zip(cases, axes.T, strict=True):
        case = over_time(case, TRACER)
        curves = {name: _normalised(case, name) for name in LOOKS if has(case, name)}
        _decay(main, case, curves)
        _tail(low, curves)
        head(main, title_of(case))
        time_axis(main, case.time.values)
        low.set_xlabel("time $t$ (reduced units, logarithmic)")
    axes[0, 0].set_ylabel("$\\langle v(0) v(t) \\rangle\\ /\\ \\langle v(0)^2 \\rangle$")
    axes[1, 0].set_ylabel("the same, logarithmic")
    return figure


def _normalised(case, name):
    """The correlation with its band over its value at t = 0."""
    parts = [part for part in (name, f"{name}_low", f"{name}_high") if part in case]
    return case[parts] / float(case[name][0])


def _decay(axes, case, curves):
    axes.axhline(0, color=START, linewidth=0.8)
    begins = {TRACER: _measured_rate(case)}
    for name, curve in curves.items():
        label, colour, line = LOOKS[name]
        label = label if BATH in curves else "disks"
        band(axes, curve.time.values, curve, name, colour, linestyle=line, label=label + begins.get(name, ""))
    if has(case, "vacf_initial_slope_expected"):
        rate = -float(case.vacf_initial_slope_expected) / float(case[TRACER][0])
        label = f"1 - $\\gamma t$, $\\gamma$ = {rate:.3g} from the collision rate"
        x = np.geomspace(1e-4, 1, 200)
        axes.plot(x / rate, 1 - x, color=INK, linestyle=DOTTED, label=label)
    axes.set_ylim(min(-0.05, *(float(curve[name].min()) for name, curve in curves.items())), 1.05)


def _measured_rate(case):
    """How fast the tracer's correlation begins to decay, in words; nothing where that is not known."""
    if not has(case, "vacf_initial_slope"):
        return ""
    rate, error = (float(case[f"vacf_initial_slope{part}"] / case[TRACER][0]) for part in ("", "_standard_error"))
    return f": begins as 1 - $\\gamma t$, $\\gamma$ = {plus_minus(-rate, error)}"


def _tail(axes, curves):
    """The decay on logarithmic axes, down to half of its error, with the slope of 1/t that it has in the plane."""
    floor, seen = 1.0, []
    for name, curve in curves.items():
        later = curve.isel(time=(curve.time.values > 0) & (curve[name].values > 0))
        t, _, colour, line = later.time.values, *LOOKS[name]
        if not t.size:
            continue
        floor = min(floor, max(_noise(later, name) / 2, float(later[name].min()) / 2))
        if f"{name}_low" in later:
            low = later[f"{name}_low"].clip(1e-12)
            axes.fill_between(t, low, later[f"{name}_high"], color=colour, alpha=FILL, linewidth=0)
            seen.append(later.isel(time=later[f"{name}_low"].values > 0)[name])
        axes.plot(t, later[name], color=colour, linestyle=line)
    axes.set(xscale="log", yscale="log", ylim=(floor, 1.5))
    for curve in seen[:1]:
        _guide(axes, curve.time.values, curve.values)
        axes.legend(loc="lower left")


def _noise(curve, name):
    """The typical half-width of the band at late times."""
    if f"{name}_low" not in curve:
        return 0.0
    late = curve.isel(time=slice(-max(1, curve.sizes["time"] // 4), None))
    return float((late[f"{name}_high"] - late[f"{name}_low"]).median()) / 2


def _guide(axes, t, curve):
    """A line of slope -1 above the end of the curve (where it is surely positive), over half a decade."""
    if t.size < 3:
        return
    end = t[-1]
    late = t >= end / 3
    height = 2.5 * np.exp(np.mean(np.log(curve[late] * t[late])))
    ends = np.array([end / 3, end])
    axes.plot(ends, height / ends, color=INK, linewidth=1, label="slope of $1/t$")


def table(cases):
    """One row per case and time."""
    return long_table(cases, ("time",), [name for name in LOOKS if any(has(case, name) for case in cases)])
