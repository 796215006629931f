"""Figure `diffusion`: D against the time it is taken at, by three routes, and by kinetic theory."""

import numpy as np

from brownpipe.figures.cases import fits_of, has, over_time, plus_minus, title_of
from brownpipe.figures.style import (
    DASH_DOT,
    DASHED,
    DATA,
    DOTTED,
    FIT,
    FREE,
    INK,
    START,
    band,
    columns,
    heads,
    time_axis,
)
from brownpipe.figures.tables import long_table

ROUTES = {
    "diffusion_running": ("d$\\langle r^2 \\rangle$/d$t$ / 4", DATA, "-"),
    "msd_over_4t": ("$\\langle r^2 \\rangle$ / 4$t$", FIT, DASHED),
    "green_kubo": ("Green-Kubo: $\\langle v(0) \\cdot [r(t) - r(0)] \\rangle$ / 2", FREE, DASH_DOT),
}
SPREADING = ("diffusion_running", "msd_over_4t")  # shown in every case; they decide the axis
ROOM = 1.25  # above the largest mean
VARIABLES = ("msd",)
LACKING = "no run with a tracer was kept"


def draw(cases):
    """One column per case: every D(t) that there is with its 95 % band, Enskog's D, and D = slope/4 in its window."""
    figure, axes = columns(["$D(t)$"], len(cases), [4.6], sharey=False)
    for case, panel in zip(map(over_time, cases), axes[0], strict=True):
        _routes(panel, case)
        for fit in fits_of(case)[:1]:
            _window(panel, fit)
        if has(case, "enskog_diffusion"):
            panel.axhline(float(case.enskog_diffusion), color=START, linestyle=DOTTED, label=_enskog(case))
        time_axis(panel, case.time.values)
        panel.set_ylim(min(0.0, _extreme(case, min)), ROOM * _extreme(case, max) or 1.0)
    heads(axes[0], map(title_of, cases))
    return figure


def _routes(axes, case):
    later = case.isel(time=case.time.values > 0)
    for name in (name for name in ROUTES if has(case, name) and (name in SPREADING or _in_equilibrium(case))):
        label, colour, line = ROUTES[name]
        band(axes, later.time.values, later, name, colour, linestyle=line, label=label)


def _in_equilibrium(case):
    """Does theory know its temperature? Out of equilibrium the Green-Kubo integral is no D."""
    return has(case, "enskog_diffusion")


def _window(axes, fit):
    """D = slope/4 as a bar across its window."""
    ends, diffusion = [float(fit.window_start), float(fit.window_end)], float(fit.diffusion_coefficient)
    value = plus_minus(diffusion, fit.diffusion_coefficient_standard_error)
    label = f"slope/4 over {fit.window.item()}: {value}"
    axes.plot(ends, [diffusion, diffusion], color=INK, linewidth=1.2, marker="|", markersize=9, label=label)


def _enskog(case):
    contact = f" ($\\chi$ = {float(case.enskog_contact_value):.4g})" if has(case, "enskog_contact_value") else ""
    return f"Enskog and Langevin, $kT/\\zeta$: {float(case.enskog_diffusion):.4g}{contact}"


def _extreme(case, which):
    values = [case[name].values for name in SPREADING if has(case, name)]
    return which(float(which(np.nanmin(each), np.nanmax(each))) for each in values)


def table(cases):
    """One row per case and time."""
    return long_table(cases, ("time",), [name for name in ROUTES if any(has(case, name) for case in cases)])
