"""Figure `particle_counts`: what the number of disks does to MSD(t) and to D over its window."""

from itertools import cycle

import numpy as np

from brownpipe.figures.cases import by_series, fits_of, over_time
from brownpipe.figures.style import KINDS, START, apart, band, bars, grid, heads, say, shades
from brownpipe.figures.tables import Table

ROOM, APART = 1.05, 0.065  # of a vertical axis, times the largest value; least distance of labels, of the axis
SIDE = 0.025  # between the markers of two windows, of the range of particle counts
DIGIT = 0.024  # width of a digit below the horizontal axis, of the axis
VARIABLES = ("msd",)
LACKING = "there are not two particle counts or more"


def draw(cases):
    """One row per scene and engine: MSD(t) for every particle count, and D over each window against the count."""
    series = by_series(cases)
    figure, axes = grid(len(series), 2, 4.8, 3.6, sharex="col", sharey="col")
    top = ROOM * max(float(case.msd_high.fillna(case.msd).max()) for case in cases) or 1.0
    for (name, mine), (left, right) in zip(series.items(), axes, strict=True):
        _curves(left, [over_time(case) for case in mine], top)
        _diffusion(right, mine)
        heads((left, right), (name, "D over a window of time, 95 % intervals"))
        left.set_ylabel("$\\langle r^2 \\rangle$")
        right.set_ylabel("$D$ = slope/4")
    axes[-1, 0].set_xlabel("time $t$")
    axes[-1, 1].set_xlabel(
        "number of disks $N$ (windows side by side)" if cases[0].sizes["window"] > 1 else "number of disks $N$"
    )
    axes[0, 0].set_xlim(0, max(float(over_time(case).time[-1]) for case in cases))
    axes[0, 0].set_ylim(0, top)
    axes[0, 1].set_ylim(*_extent(cases))
    _name_counts(axes[0, 1], sorted({case.particles.item() for case in cases}))
    return figure


def _curves(axes, cases, top):
    """MSD(t) with its band, from dark (fewest disks) to light, named at its end."""
    ends = apart([float(case.msd[-1]) for case in cases], APART * top, 0, top)
    for case, colour, end in zip(cases, shades(len(cases)), ends, strict=True):
        band(axes, case.time.values, case, "msd", colour)
        say(axes, f"N = {case.particles.item()}", (case.time.values[-1], end), (5, 0), va="center", color=colour)


def _diffusion(axes, cases):
    """D of every window; the windows of a count stand side by side, centred on it."""
    axes.axhline(0, color=START, linewidth=0.8)
    counts, windows = sorted({case.particles.item() for case in cases}), list(cases[0].window.values)
    nearest = min(np.diff(counts), default=1)
    step = min(SIDE * (counts[-1] - counts[0]), 0.6 * nearest / len(windows))
    for k, (window, (colour, _, marker)) in enumerate(zip(windows, cycle(KINDS), strict=False)):
        fits = [fit for case in cases for fit in fits_of(case) if fit.window == window]
        n = [fit.particles.item() + (k - (len(windows) - 1) / 2) * step for fit in fits]
        d = [float(fit.diffusion_coefficient) for fit in fits]
        looks = {"fmt": marker, "color": colour, "markersize": 5, "markerfacecolor": "white", "elinewidth": 1.3}
        axes.errorbar(n, d, bars(fits, "diffusion_coefficient"), label=f"window {window}", **looks)


def _extent(cases):
    """Ends of the axis of D: beyond 0 and the 95 % intervals of all windows."""
    fits = [fit for case in cases for fit in fits_of(case)]
    d = [float(fit[f"diffusion_coefficient{part}"]) for fit in fits for part in ("", "_low", "_high")]
    low, high = np.nanmin([0.0, *d]), np.nanmax([0.0, *d])
    room = (ROOM - 1) * (high - low) or 1.0
    return low - room * (low < 0), high + room


def _name_counts(axes, counts):
    """A tick at every count, a label where there is room for it."""
    low, high = axes.get_xlim()
    labels, free = [], -np.inf
    for count in counts:
        half = DIGIT * (len(f"{count}") + 1) / 2 * (high - low)
        labels.append(f"{count}" if count - half >= free else "")
        free = count + half if labels[-1] else free
    axes.set_xticks(counts, labels)


def table(cases):
    """One row per case and window, and with it the MSD at the end."""
    header = ("scene", "particles", "engine", "packing_fraction", "window_start", "window_end")
    diffusion = [f"diffusion_coefficient{part}" for part in ("", "_standard_error", "_low", "_high")]
    final = [f"msd{part}" for part in ("", "_standard_error", "_low", "_high")]
    rows = []
    for case in map(over_time, cases):
        last = [case[name].values[-1] for name in final]
        label = [case[name].item() for name in header[:4]]
        rows += [
            (*label, *(fit[name].item() for name in (*header[4:], *diffusion)), case.time.values[-1], *last)
            for fit in fits_of(case)
        ]
    return Table((*header, *diffusion, "time", *final), rows)
