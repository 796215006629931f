"""Figure `diffusion`: the diffusion coefficient D(t) against time, by three routes, and that of kinetic theory.

The routes (docs/theory.md): the running slope of the MSD over 4, MSD/4t, and the Green-Kubo integral. In two dimensions
D(t) has no limit, as the velocity autocorrelation decays as 1/t.
"""

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import fits_of, has, over_time, plus_minus, title_of
from brownpipe.figures.style import DOTTED, GREY, INK, SERIES, band, columns, heads, time_axis
from brownpipe.figures.tables import frame_of

ROUTES = {
    "diffusion_running": "d$\\langle r^2 \\rangle$/d$t$ / 4",
    "msd_over_4t": "$\\langle r^2 \\rangle$ / 4$t$",
    "green_kubo": "Green-Kubo: $\\langle v(0) \\cdot [r(t) - r(0)] \\rangle$ / 2",
}  # variable: label
FROM_MSD = ("diffusion_running", "msd_over_4t")  # shown in every case; they set the limits of the axis
OTHERS = ("green_kubo", "enskog_diffusion")  # shown in equilibrium; they extend the axis up to a point
HEADROOM = 1.25  # the axis ends at least at this times the largest mean,
BAND = 2.0  # at most at this times it,
MARGIN = 1.03  # and between the two at this times the upper end of the band of MSD/4t;
REACH = 3.0  # other curves are contained if they are within this times the largest mean, otherwise the legend says so


def draw(cases: list[Dataset]) -> Figure:
    """Draw one column per case: D(t) by each route with its 95 % band, Enskog's D, and slope/4 across its window."""
    figure, axes = columns(["diffusion coefficient $D(t)$, 95 % bands"], len(cases), [4.6], sharey=False)
    for case, panel in zip(map(over_time, cases), axes[0], strict=True):
        shown = _shown(case)
        low, high = _extent(case, shown)
        later = case.isel(time=case.time.values > 0)
        for (name, label), (colour, line, _) in zip(ROUTES.items(), SERIES, strict=False):
            if name in shown:
                leaves = ", leaves the panel" if ((later[name] < low) | (later[name] > high)).any() else ""
                band(panel, later, name, colour, linestyle=line, label=label + leaves)
        for fit in fits_of(case)[:1]:
            ends, diffusion = [float(fit.window_start), float(fit.window_end)], float(fit.diffusion_coefficient)
            value = plus_minus(diffusion, fit.diffusion_coefficient_standard_error)
            label = f"slope/4 over {fit.window.item()}: {value}"
            panel.plot(ends, [diffusion] * 2, color=INK, linewidth=1.2, marker="|", markersize=9, label=label)
        if "enskog_diffusion" in shown:
            label = _enskog(case) + (", above the panel" if case.enskog_diffusion > high else "")
            panel.axhline(float(case.enskog_diffusion), color=GREY, linestyle=DOTTED, label=label)
        time_axis(panel, case.time.values)
        panel.set_ylim(low, high)
    heads(axes[0], map(title_of, cases))
    return figure


def _shown(case: Dataset) -> list[str]:
    """Return the variables that are drawn: without a temperature, the Green-Kubo integral is not a D."""
    return [name for name in (*FROM_MSD, *(OTHERS if has(case, "enskog_diffusion") else ())) if has(case, name)]


def _extent(case: Dataset, shown: list[str]) -> tuple[float, float]:
    """Limits of the vertical axis.

    They contain the means from the MSD, the band of MSD/4t up to BAND of them, and of the Green-Kubo integral and
    Enskog's D what does not exceed REACH of them, on either side of 0.
    """
    ends = {name: (np.nanmin(case[name]), np.nanmax(case[name])) for name in shown}
    lowest, highest = (pick(ends[name][k] for name in FROM_MSD if name in ends) for k, pick in enumerate((min, max)))
    band_end = float(case.msd_over_4t_high.max()) if has(case, "msd_over_4t_high") else 0.0
    low, high = min(0.0, lowest), max(HEADROOM * highest, min(MARGIN * band_end, BAND * highest))
    for end in (end for name in OTHERS if name in ends for end in ends[name] if abs(end) <= REACH * highest):
        low, high = min(low, MARGIN * end), max(high, MARGIN * end)
    return low, high or 1.0


def _enskog(case: Dataset) -> str:
    """Legend of D by Enskog's theory, with chi, the contact value of g between tracer and bath."""
    contact = f" ($\\chi$ = {float(case.enskog_contact_value):.4g})" if has(case, "enskog_contact_value") else ""
    return f"Enskog's theory: D = {float(case.enskog_diffusion):.4g}{contact}"


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and time with D by each route."""
    return frame_of(cases, ("time",), ROUTES)
