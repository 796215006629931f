"""Figure `diffusion`: the diffusion coefficient D(t) against time, by three routes, and that of
kinetic theory.

The routes (docs/theory.md): the running slope of the MSD over 4, MSD/4t, and the Green-Kubo
integral. In two dimensions D(t) has no limit, as the velocity autocorrelation decays as 1/t.
"""

from typing import Any

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import fits_of, fitted_diffusion, has
from brownpipe.figures.style import DOTTED, GREY, INK, SERIES, band, time_axis, told_apart

LABELS = ("diffusion coefficient $D(t)$, 95 % bands",)
ROUTES = {
    "diffusion_running": "d$\\langle r^2 \\rangle$/d$t$ / 4",
    "msd_over_4t": "$\\langle r^2 \\rangle$ / 4$t$",
    "green_kubo": "Green-Kubo: $\\langle v(0) \\cdot [r(t) - r(0)] \\rangle$ / 2",
}  # variable: label
TABLE = (("time",), ROUTES)
FROM_MSD = (
    "diffusion_running",
    "msd_over_4t",
)  # shown in every case; they set the limits of the axis
OTHERS = (
    "green_kubo",
    "enskog_diffusion",
)  # shown in equilibrium, up to REACH times the largest value from the MSD
HEADROOM, REACH = 1.25, 2.0
ENSKOG = "Enskog's theory"


def curves(axes: Axes, cases: list[Dataset], **looks: Any) -> None:
    """Draw D(t) with its 95 % band, Enskog's D, and slope/4 across its window, of a single case by
    every route.

    Of several cases or with `looks` it is the running slope, or MSD/4t without one.
    """
    if len(cases) == 1 and not looks:
        _routes(axes, cases[0])
    else:
        for case, line in told_apart(cases, fitted_diffusion, looks):
            name = next(name for name in FROM_MSD if has(case, name))
            band(axes, case.isel(time=case.time.values > 0), name, **line)
            _bar(axes, case, color=line["color"])
            if has(case, "enskog_diffusion"):
                hidden = "_" * (bool(looks) or ENSKOG in axes.get_legend_handles_labels()[1])
                axes.axhline(
                    float(case.enskog_diffusion),
                    color=line["color"],
                    linestyle=DOTTED,
                    label=hidden + ENSKOG,
                )
        axes.set_ylim(bottom=min(0, axes.get_ylim()[0]))
    time_axis(axes, cases)


def _routes(axes: Axes, case: Dataset) -> None:
    """Draw D(t) of one case by every route; without a temperature, the Green-Kubo integral is not a
    D.
    """
    shown = [
        name
        for name in (*FROM_MSD, *(OTHERS if has(case, "enskog_diffusion") else ()))
        if has(case, name)
    ]
    highest = max(float(case[name].max()) for name in shown if name in FROM_MSD)
    end = HEADROOM * min(max(float(case[name].max()) for name in shown), REACH * highest) or 1.0
    later = case.isel(time=case.time.values > 0)
    for (name, label), (colour, line, _) in zip(ROUTES.items(), SERIES, strict=False):
        if name in shown:
            leaves = ", leaves the panel" * bool((later[name] > end).any())
            band(axes, later, name, colour, linestyle=line, label=label + leaves)
    _bar(axes, case, color=INK, label=f"slope/4: {fitted_diffusion(case)}")
    if "enskog_diffusion" in shown:
        label = f"{ENSKOG}: D = {float(case.enskog_diffusion):.4g}"
        label += ", above the panel" * bool(case.enskog_diffusion > end)
        axes.axhline(float(case.enskog_diffusion), color=GREY, linestyle=DOTTED, label=label)
    axes.set_ylim(min(0.0, *(float(case[name].min()) for name in shown)), end)


def _bar(axes: Axes, case: Dataset, **looks: Any) -> None:
    """Draw slope/4 of the first fit across its window."""
    for fit in fits_of(case)[:1]:
        ends, diffusion = (
            [float(fit.window_start), float(fit.window_end)],
            float(fit.diffusion_coefficient),
        )
        axes.plot(ends, [diffusion] * 2, linewidth=1.2, marker="|", markersize=9, **looks)
