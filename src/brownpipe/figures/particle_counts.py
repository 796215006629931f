"""Figure `particle_counts`: MSD(t) and the diffusion coefficient D for every number of disks."""

from itertools import cycle

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import by_series, early_mark, fits_of, over_time
from brownpipe.figures.style import GREY, SERIES, apart, band, grid, heads, highest, points, shades
from brownpipe.figures.tables import frame_of

APART = 0.065  # least distance of two labels beside a panel, as a fraction of the axis


def draw(cases: list[Dataset]) -> Figure:
    """Draw one row per scene and engine: MSD(t) for every particle count, and D by fit window against the count."""
    series = by_series(cases)
    figure, axes = grid(len(series), 2, 4.8, 3.6, sharex="col", sharey="col")
    top = 1.05 * highest(cases, "msd") or 1.0
    for (name, of_series), (left, right) in zip(series.items(), axes, strict=True):
        _curves(left, [over_time(case) for case in of_series], top)
        _diffusion(right, of_series)
        heads((left, right), (name, "D by fit window, 95 % intervals"))
        left.set_ylabel("MSD $\\langle r^2 \\rangle$, 95 % bands")
        right.set_ylabel("$D$ = slope/4")
    axes[-1, 0].set_xlabel("time $t$")
    axes[-1, 1].set_xlabel("number of disks $N$")
    axes[0, 0].set_xlim(0, max(float(over_time(case).time[-1]) for case in cases))
    axes[0, 0].set_ylim(0, top)
    axes[0, 1].set_xlim(0, 1.05 * max(case.particles.item() for case in cases))
    return figure


def _curves(axes: Axes, cases: list[Dataset], top: float) -> None:
    """Draw MSD(t) with its band for each count, from dark (fewest disks) to light, labelled at its end."""
    ends = apart([float(case.msd[-1]) for case in cases], APART * top, 0, top)
    for case, colour, end in zip(cases, shades(len(cases)), ends, strict=True):
        band(axes, case, "msd", colour, label=f"_N = {case.particles.item()}")  # not in a legend
        outside = {"textcoords": "offset points", "annotation_clip": False, "va": "center", "color": colour}
        axes.annotate(f"N = {case.particles.item()}", (case.time.values[-1], end), (5, 0), **outside)


def _diffusion(axes: Axes, cases: list[Dataset]) -> None:
    """Draw D of every fit window at each count; markers are hollow, so that equal points show each other."""
    axes.axhline(0, color=GREY, linewidth=0.8)
    all_fits = [fit for case in cases for fit in fits_of(case)]
    for window, (colour, _, marker) in zip(cases[0].window.values, cycle(SERIES), strict=False):
        fits = [fit for fit in all_fits if fit.window == window]
        counts, mark = [fit.particles.item() for fit in fits], max(map(early_mark, fits), default="")
        points(axes, counts, fits, "diffusion_coefficient", color=colour, fmt=marker, label=f"window {window}{mark}")


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and fit window: the MSD at the end and, unless no line could be fitted anywhere, D."""
    names = ("packing_fraction", "window_start", "window_end", "diffusion_coefficient", "time", "msd")
    return frame_of([over_time(case).isel(time=-1) for case in cases], ("window",), names).drop(columns="window")
