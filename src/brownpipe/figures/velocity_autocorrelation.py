"""Figure `velocity_autocorrelation`: how tracer and bath forget their velocity, from first collision to late tail."""

import numpy as np

from brownpipe.figures.cases import has, over_time, plus_minus, title_of
from brownpipe.figures.style import (
    DASHED,
    DATA,
    DOTTED,
    FIT,
    INK,
    START,
    band,
    columns,
    heads,
    time_axis,
)
from brownpipe.figures.tables import long_table

TRACER, BATH = "velocity_autocorrelation", "bath_velocity_autocorrelation"
LOOKS = {TRACER: ("tracer", DATA, "-"), BATH: ("bath", FIT, DASHED)}
LABELS = ("$\\langle v(0) v(t) \\rangle\\ /\\ \\langle v(0)^2 \\rangle$", "the same, logarithmic")
NEEDS = (TRACER,)
LACKING = "the observable velocity_autocorrelation was not asked for"


def draw(cases):
    """One column per case: the correlation and how it must begin above, its decay on logarithmic axes below."""
    figure, axes = columns(LABELS, len(cases), (3.85, 3.35))
    for case, (main, low) in zip(cases, axes.T, strict=True):
        case = over_time(case, TRACER)
        curves = {name: _normalised(case, name) for name in LOOKS if has(case, name)}
        _decay(main, case, curves)
        _tail(low, curves)
        time_axis(main, case.time.values)
        low.set_xlabel("time $t$ (reduced units, logarithmic)")
    heads(axes[0], map(title_of, cases))
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
    """The decay on logarithmic axes as far as it is resolved, with the slope of 1/t that it has in the plane."""
    floor = 1.0
    for name, curve in curves.items():
        seen, (_, colour, line) = _resolved(curve, name), LOOKS[name]
        if seen.sizes["time"]:
            band(axes, seen.time.values, seen, name, colour, linestyle=line)
            floor = min(floor, float(seen[name].min()) / 1.6)
    axes.set(xscale="log", yscale="log", ylim=(floor, 1.5))
    for name, curve in list(curves.items())[:1]:
        seen = _resolved(curve, name)
        _guide(axes, seen.time.values, seen[name].values)


def _resolved(curve, name):
    """The curve after t = 0 up to where its 95 % band, or without one the curve, first reaches zero: noise follows."""
    later = curve.isel(time=curve.time.values > 0)
    least = later[f"{name}_low"] if f"{name}_low" in later else later[name]
    reached = np.flatnonzero(~(least.values > 0))
    return later.isel(time=slice(0, reached[0] if reached.size else None))


def _guide(axes, t, curve):
    """A line of slope -1 above the end of the curve, over half a decade."""
    if t.size < 3:
        return
    end = t[-1]
    late = t >= end / 3
    height = 2.5 * np.exp(np.mean(np.log(curve[late] * t[late])))
    ends = np.array([end / 3, end])
    axes.plot(ends, height / ends, color=INK, linewidth=1, label="slope of $1/t$")
    axes.legend(loc="lower left")


def table(cases):
    """One row per case and time."""
    return long_table(cases, ("time",), [name for name in LOOKS if any(has(case, name) for case in cases)])
