"""Figure `diffusion`: the diffusion coefficient D(t) against time, by three routes, and that of
kinetic theory.

The routes (docs/theory.md): the running slope of the MSD over 4, MSD/4t, and the Green-Kubo
integral. In two dimensions D(t) has no limit, as the velocity autocorrelation decays as 1/t.
"""

from itertools import product
from typing import Unpack

from matplotlib.axes import Axes
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import (
    SUFFIXES,
    component_of,
    diffusion_symbol,
    fits_of,
    fitted_diffusion,
    frame_of,
    has,
    motions_of,
    with_components,
)
from brownpipe.figures.figure import Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import DOTTED, GREY, INK, SERIES, band, styled_cases, time_axis

ROUTES = {
    "diffusion_running": "d$\\langle r^2 \\rangle$/d$t$ / 4",
    "msd_over_4t": "$\\langle r^2 \\rangle$ / 4$t$",
    "green_kubo": "Green-Kubo: $\\langle v(0) \\cdot [r(t) - r(0)] \\rangle$ / 2",
}  # variable: label
ALONG = "msd_along_over_2t"  # of motion along an axis
# Shown in every case; they set the limits of the axis
FROM_MSD = ("diffusion_running", "msd_over_4t", ALONG)
# Shown in equilibrium, up to REACH times the largest value from the MSD
OTHERS = ("green_kubo", "enskog_diffusion")
HEADROOM = 1.25
REACH = 2.0
ENSKOG = "Enskog's theory"


def draw_diffusion(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw D(t) with its 95 % band, Enskog's D, and slope/4 across its window, of a single case by
    every route.

    Of several cases or with `looks` it is the running slope, or MSD/4t without one; of motion along
    an axis MSD/2t.
    """
    motions: list[Dataset] = []
    for case in cases:
        motions += [_with_route_along(motion) for motion in motions_of(case)]
    if len(motions) == 1 and not looks:
        _routes(axes, motions[0])
    else:
        for case, line in styled_cases(motions, fitted_diffusion, looks):
            name = next(name for name in FROM_MSD if has(case, name))
            band(axes, case.isel(time=case.time.values > 0), name, **line)
            _bar(axes, case, color=line["color"])
            if has(case, "enskog_diffusion"):
                theory = float(case.enskog_diffusion)
                _, labels = axes.get_legend_handles_labels()
                label = f"_{ENSKOG}" if looks or ENSKOG in labels else ENSKOG
                axes.axhline(theory, color=line["color"], linestyle=DOTTED, label=label)
        axes.set_ylim(bottom=min(0, axes.get_ylim()[0]))
    time_axis(axes, cases)


def _with_route_along(motion: Dataset) -> Dataset:
    """Return the motion; along an axis with MSD/2t in place of MSD/4t."""
    if not component_of(motion):
        return motion
    per_2t = 0.5 / motion.time.where(motion.time > 0)
    route = {f"{ALONG}{suffix}": motion[f"msd{suffix}"] * per_2t for suffix in SUFFIXES}
    return motion.drop_vars("msd_over_4t").assign(route)


def _routes_along(axis: str) -> dict[str, str]:
    """Return the labels of the routes to D along an axis, by variable."""
    return {
        "diffusion_running": f"d$\\langle {axis}^2 \\rangle$/d$t$ / 2",
        ALONG: f"$\\langle {axis}^2 \\rangle$ / 2$t$",
        "green_kubo": f"Green-Kubo: $\\langle v_{axis}(0) [{axis}(t) - {axis}(0)] \\rangle$",
    }


def _routes(axes: Axes, case: Dataset) -> None:
    """Draw D(t) of one case by every route; without a temperature, the Green-Kubo integral is not a
    D.
    """
    names = (*FROM_MSD, *OTHERS) if has(case, "enskog_diffusion") else FROM_MSD
    highest = {name: float(case[name].max()) for name in names if has(case, name)}
    lowest = {name: float(case[name].min()) for name in highest}
    from_msd = max(highest[name] for name in FROM_MSD if name in highest)
    end = HEADROOM * min(max(highest.values()), REACH * from_msd) or 1.0
    later = case.isel(time=case.time.values > 0)
    axis = component_of(case)
    routes = _routes_along(axis) if axis else ROUTES
    for (name, label), (colour, line, _) in zip(routes.items(), SERIES, strict=False):
        if name in highest:
            if (later[name] > end).any():
                label += ", leaves the panel"
            band(axes, later, name, color=colour, linestyle=line, label=label)
    share = "slope/2" if axis else "slope/4"
    _bar(axes, case, color=INK, label=f"{share}: {fitted_diffusion(case)}")
    if "enskog_diffusion" in highest:
        theory = float(case.enskog_diffusion)
        label = f"{ENSKOG}: {diffusion_symbol(case)} = {theory:.4g}"
        if theory > end:
            label += ", above the panel"
        axes.axhline(theory, color=GREY, linestyle=DOTTED, label=label)
    axes.set_ylim(min(0.0, *lowest.values()), end)


def _bar(axes: Axes, case: Dataset, **looks: Unpack[Looks]) -> None:
    """Draw D of the first fit across its window."""
    for fit in fits_of(case)[:1]:
        ends = [float(fit.window_start), float(fit.window_end)]
        diffusion = float(fit.diffusion_coefficient)
        axes.plot(ends, [diffusion] * 2, linewidth=1.2, marker="|", markersize=9, **looks)


def table_of_diffusion(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time: D by every route; where the motion along x and y differs
    also, along each, D by the running slope and by Green-Kubo, and the MSD.
    """
    curves = ("diffusion_running", "msd", "green_kubo")
    names = [f"{name} along {axis}" for name, axis in product(curves, "xy")]
    shown = [with_components(case, curves) for case in cases]
    return frame_of(shown, ["time"], [*ROUTES, *names])


FIGURE = Figure(
    curves=draw_diffusion,
    labels=("diffusion coefficient $D(t)$, 95 % bands",),
    variables=("msd",),
    table=table_of_diffusion,
)
