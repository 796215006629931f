"""Figure `velocity_autocorrelation`: how tracer and bath forget their velocity, from first collision to late tail."""

import numpy as np

from brownpipe.figures.cases import has, over_time, plus_minus, title_of
from brownpipe.figures.style import DASHED, DATA, DOTTED, FIT, INK, START, band, columns, heads, log_axis, time_axis
from brownpipe.figures.tables import long_table

TRACER, BATH = "velocity_autocorrelation", "bath_velocity_autocorrelation"
LOOKS = {TRACER: ("tracer", DATA, "-"), BATH: ("bath", FIT, DASHED)}
LABEL = "$\\langle v(0) v(t) \\rangle\\ /\\ \\langle v(0)^2 \\rangle$"
TAIL = 10  # by this factor at most the logarithmic axis goes on below a curve to show its band
VARIABLES = (TRACER,)
LACKING = "the observable velocity_autocorrelation was not asked for"


def draw(cases):
    """One column per case: the correlation and its initial slope above, its decay on logarithmic axes below."""
    cases = [over_time(case, TRACER) for case in cases]
    curves = [{name: _normalised(case, name) for name in LOOKS if has(case, name)} for case in cases]
    figure, axes = columns((LABEL, LABEL), len(cases), (3.85, 3.35))
    for case, mine, (main, low) in zip(cases, curves, axes.T, strict=True):
        _decay(main, case, mine)
        _tail(main, low, mine)
        times = case.time.values
        time_axis(main, times)
        log_axis(low, "x", times[times > 0][0], times[-1])
        low.set_xlabel("time $t$")
    axes[0, 0].set_ylim(*_extent(curves))
    log_axis(axes[1, 0], "y", *_tail_extent(curves))
    heads(axes[0], map(title_of, cases))
    return figure


def _extent(curves):
    """Ends of the vertical axis of all cases: beyond 0, 1, the curves and their bands."""
    values = np.concatenate([part.values for mine in curves for curve in mine.values() for part in curve.values()])
    low, high = min(0.0, np.nanmin(values)), max(1.0, np.nanmax(values))
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


def _tail_extent(curves):
    """The same on the logarithmic axis, where bands may come close to 0."""
    low, high = [0.5], [1.2]
    for mine in curves:
        resolved = [(_resolved(curve, name), name) for name, curve in mine.items()]
        for seen, name in ((seen, name) for seen, name in resolved if seen.sizes["time"]):
            low.append(max(float(seen.get(f"{name}_low", seen[name]).min()), float(seen[name].min()) / TAIL))
            high.append(float(np.nanmax(seen.to_dataarray())))
        high += list(_guide(mine)[1])
    return min(low) / 1.2, max(high) * 1.2


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
        last = float(case.time[-1])
        t = np.linspace(0, 1 / rate if rate * last > 1 else last, 200)
        axes.plot(t, 1 - rate * t, color=INK, linestyle=DOTTED, label=label)


def _measured_rate(case):
    """How fast the tracer's correlation begins to decay, in words; nothing where that is not known."""
    if not has(case, "vacf_initial_slope"):
        return ""
    rate, error = (float(case[f"vacf_initial_slope{part}"] / case[TRACER][0]) for part in ("", "_standard_error"))
    return f": begins as 1 - $\\gamma t$, $\\gamma$ = {plus_minus(-rate, error)}"


def _tail(main, axes, curves):
    """The decay on logarithmic axes as far as it is resolved, with the slope of 1/t that it has in the plane."""
    for name, curve in curves.items():
        seen, (_, colour, line) = _resolved(curve, name), LOOKS[name]
        band(axes, seen.time.values, seen, name, colour, linestyle=line)
    guide = _guide(curves)
    if guide[0].size:
        axes.plot(*guide, color=INK, linewidth=1)
        main.plot([], [], color=INK, linewidth=1, label="slope of $1/t$ (lower panel)")
    if not any(_resolved(curve, name).sizes["time"] for name, curve in curves.items()):
        axes.text(0.5, 0.5, "not resolved from 0", ha="center", color=START, transform=axes.transAxes)


def _resolved(curve, name):
    """The curve after t = 0 up to where its 95 % band, or without one the curve, first reaches zero: noise follows."""
    later = curve.isel(time=curve.time.values > 0)
    least = later[f"{name}_low"] if f"{name}_low" in later else later[name]
    reached = np.flatnonzero(~(least.values > 0))
    return later.isel(time=slice(0, reached[0] if reached.size else None))


def _guide(curves):
    """A line of slope -1 above the last half decade of the first curve: times and values (2,), or (0,) without it."""
    name, curve = next(iter(curves.items()))
    seen = _resolved(curve, name)
    t, values = seen.time.values, seen[name].values
    if t.size < 3:
        return np.empty((2, 0))
    late = t >= t[-1] / 3
    height = 2.5 * np.exp(np.mean(np.log(values[late] * t[late])))
    ends = np.array([max(t[-1] / 3, t[0]), t[-1]])
    return np.array([ends, height / ends])


def table(cases):
    """One row per case and time."""
    return long_table(cases, ("time",), [name for name in LOOKS if any(has(case, name) for case in cases)])
