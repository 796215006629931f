"""Figure `particle_counts`: what the number of disks does to MSD(t) and to D over its window."""

import numpy as np

from brownpipe.figures.cases import by_series, fits_of, over_time
from brownpipe.figures.style import DATA, FIT, START, band, bars, grid, heads, say, shades
from brownpipe.figures.tables import Table

LOOKS = ((FIT, "o"), (DATA, "s"), (START, "^"))  # of the windows
ROOM, APART = 1.05, 0.065  # of a vertical axis, times the largest value; least distance of labels, of the axis
NEEDS = ("msd",)
LACKING = "there are not two particle counts or more"


def chosen(cases):
    """Which of the cases that have what it needs are shown: every one, if there are several particle counts."""
    return cases if len({int(case.particles) for case in cases}) > 1 else []


def draw(cases):
    """One row per scene and engine: MSD(t) for every particle count, and D over each window against the count."""
    series = by_series(cases)
    figure, axes = grid(len(series), 2, 4.8, 3.6, sharex="col", sharey="col")
    top = ROOM * max(float(case.msd_high.fillna(case.msd).max()) for case in cases) or 1.0
    for (name, mine), (left, right) in zip(series.items(), axes, strict=True):
        _curves(left, [over_time(case) for case in mine], top)
        _diffusion(right, mine)
        heads((left, right), (name, "D over a window of time, 95 % intervals"))
        left.set_ylabel("$\\langle r^2 \\rangle$ (reduced units)")
        right.set_ylabel("D, slope/4 (reduced units)")
    axes[-1, 0].set_xlabel("time $t$ (reduced units)")
    axes[-1, 1].set_xlabel("number of disks N")
    axes[0, 0].set_xlim(0, max(case.duration.item() for case in cases))
    axes[0, 0].set_ylim(0, top)
    axes[0, 1].set_ylim(bottom=0)
    return figure


def _curves(axes, cases, top):
    """MSD(t) with its band, from dark (fewest disks) to light, named at its end."""
    ends = _apart([float(case.msd[-1]) for case in cases], APART * top)
    for case, colour, end in zip(cases, shades(len(cases)), ends, strict=True):
        band(axes, case.time.values, case, "msd", colour)
        say(axes, f"N = {case.particles.item()}", (case.time.values[-1], end), (5, 0), va="center", color=colour)


def _apart(heights, least):
    """The heights, each at least so far above the next lower one that labels there do not touch."""
    apart, last = np.array(heights), -np.inf
    for k in np.argsort(heights):
        last = apart[k] = max(heights[k], last + least)
    return apart


def _diffusion(axes, cases):
    counts = [case.particles.item() for case in cases]
    shift = 0.012 * (max(counts) - min(counts))
    for k, (window, (colour, marker)) in enumerate(zip(cases[0].window.values, LOOKS, strict=False)):
        fits = [fit for case in cases for fit in fits_of(case) if fit.window == window]
        n = [fit.particles.item() + (2 * k - 1) * shift for fit in fits]
        d = [float(fit.diffusion_coefficient) for fit in fits]
        looks = {"fmt": marker, "color": colour, "markersize": 5, "elinewidth": 1.3}
        axes.errorbar(n, d, bars(fits, "diffusion_coefficient"), label=f"window {window}", **looks)
    far = _apart(counts, APART * max(counts)) == counts
    axes.set_xticks(counts, [f"{n}" if named else "" for n, named in zip(counts, far, strict=True)])


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
