"""Figure `particle_counts`: what the number of disks does to MSD(t) and to D over its window."""

from brownpipe.figures.cases import by_scene, fits_of, over_time
from brownpipe.figures.style import DATA, FILL, FIT, START, grid, shades
from brownpipe.figures.tables import Table

LOOKS = ((FIT, "o"), (DATA, "s"), (START, "^"))  # of the windows
NEEDS = ("msd",)
LACKING = "there are not two particle counts or more"


def chosen(cases):
    """Which of the cases that have what it needs are shown: every one, if there are several particle counts."""
    return cases if len({int(case.particles) for case in cases}) > 1 else []


def draw(cases):
    """One row per scene: MSD(t) for every particle count, and D over each window against the count."""
    scenes = by_scene(cases)
    figure, axes = grid(len(scenes), 2, 4.8, 3.3, sharex="col", sharey="col")
    for (name, mine), (left, right) in zip(scenes.items(), axes, strict=True):
        _curves(left, mine)
        _diffusion(right, mine)
        left.set_title(name)
        left.set_ylabel("$\\langle r^2 \\rangle$ (reduced units)")
        right.set_ylabel("D, slope/4 (reduced units)")
    axes[-1, 0].set_xlabel("time $t$ (reduced units)")
    axes[-1, 1].set_xlabel("number of disks N")
    axes[0, 0].set_xlim(0, max(case.duration.item() for case in cases))
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 1].set_ylim(bottom=0)
    return figure


def _curves(axes, cases):
    for case, colour in zip(map(over_time, cases), shades(len(cases)), strict=True):
        t = case.time.values
        axes.fill_between(t, case.msd_low, case.msd_high, color=colour, alpha=FILL, linewidth=0)
        axes.plot(t, case.msd, color=colour)
        label = f"N = {case.particles.item()}"
        axes.annotate(
            label,
            (t[-1], float(case.msd[-1])),
            (5, 0),
            textcoords="offset points",
            va="center",
            color=colour,
            annotation_clip=False,
        )


def _diffusion(axes, cases):
    from matplotlib.ticker import FixedLocator

    window_labels = [str(window) for window in cases[0].window.values]
    counts = [case.particles.item() for case in cases]
    shift = 0.012 * (max(counts) - min(counts))
    for k, (window, (colour, marker)) in enumerate(zip(window_labels, LOOKS, strict=False)):
        points = [(case.particles.item(), fit) for case in cases for fit in fits_of(case) if fit.window == window]
        n = [count + (2 * k - 1) * shift for count, _ in points]
        d = [float(fit.diffusion_coefficient) for _, fit in points]
        ends = [
            [abs(float(fit.diffusion_coefficient - fit[f"diffusion_coefficient_{end}"])) for _, fit in points]
            for end in ("low", "high")
        ]
        axes.errorbar(n, d, ends, fmt=marker, color=colour, markersize=5, elinewidth=1.3, label=f"window {window}")
    axes.xaxis.set_major_locator(FixedLocator(counts))
    axes.legend(
        loc="upper right",
        title="D over a window, 95 % intervals",
        alignment="left",
        frameon=True,
        facecolor="white",
        edgecolor="white",
        framealpha=1,
    )


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
