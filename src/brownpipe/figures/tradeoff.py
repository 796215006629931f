"""Figures `tradeoff_SCENE`: total error of the MSD against CPU time, one line per setting; the price list as text."""

import numpy as np

from brownpipe.figures.cases import plus_minus
from brownpipe.figures.style import DATA, DOTTED, FIT, FREE, INK, START, grid
from brownpipe.figures.tables import Table
from brownpipe.tradeoff.front import FEWEST_RUNS, pareto_front, settings_of, total_error

FINEST = 2e-3  # total error down to which the lines are drawn at least
COLOURS = (DATA, FIT, FREE, "#CC79A7", "#56B4E9", "#E69F00")  # of what is on the front
MOST_LABELS_APART = 0.032  # of the height, between two labels
POINTS = 400


def draw(dataset, scene):
    """Total error of the MSD at the end against CPU time in one scene; the best buy is bold and coloured."""
    settings, stretches = settings_of(dataset, scene), pareto_front(settings_of(dataset, scene, careful=True))
    times = np.geomspace(FEWEST_RUNS * min(one.seconds for one in settings), _last_time(settings, stretches), POINTS)
    figure, axes = grid(1, 1, 8.2, 5.4)
    axes = axes[0, 0]
    paying = dict.fromkeys(["exact", *(one.label for one in stretches)])
    colours = dict(zip(paying, COLOURS * 9, strict=False))
    for one in settings:
        _line(axes, times, one, _unresolved_below(_of(dataset, scene, one.label)), colours.get(one.label, START))
    for stretch in stretches:
        _bold(axes, times, stretch, settings, colours[stretch.label])
    axes.set(xscale="log", yscale="log", xlim=(times[0], times[-1]))
    axes.set_ylim(top=1.0)
    axes.set_xlabel("CPU time of a study on this machine (s)")
    axes.set_ylabel("expected relative error of $\\langle r^2 \\rangle$ at the end")
    axes.set_title(f"{scene}: what a CPU time buys", pad=24)
    remark = "bold: the best buy, for all that is known of the biases; dotted: less than what the bias may be (95 %)"
    axes.text(0.0, 1.025, remark, transform=axes.transAxes, color=START, fontsize=8.8)
    _direct_labels(axes, times[-1], settings, colours)
    return figure


def _last_time(settings, stretches):
    """Until the exact engine reaches the finest error, and beyond the last change of what pays."""
    exact = settings[0]
    return max((exact.spread / FINEST) ** 2 * exact.seconds, *(3 * one.start for one in stretches))


def _unresolved_below(one):
    """The size that a bias may have (95 %) that was not told from 0; 0 if it was."""
    return (
        max(-float(one.msd_bias_low), float(one.msd_bias_high)) if one.msd_bias_low < 0.0 < one.msd_bias_high else 0.0
    )


def _line(axes, times, setting, unresolved, colour):
    """The error; dotted where it is below the size that the bias may have."""
    error = total_error(setting, times)
    axes.plot(times, np.where(error >= unresolved, error, np.nan), color=colour, linewidth=1.0, alpha=0.8)
    axes.plot(times, np.where(error < unresolved, error, np.nan), color=colour, linewidth=1.0, linestyle=DOTTED)


def _bold(axes, times, stretch, settings, colour):
    best = next(one for one in settings if one.label == stretch.label)
    inside = (times >= stretch.start) & (times <= stretch.end)
    axes.plot(times[inside], total_error(best, times)[inside], color=colour, linewidth=4.0, solid_capstyle="round")


def _direct_labels(axes, end, settings, colours):
    """The name of every line at its end, moved apart where they would cover each other; those off the scale by name."""
    low, high = np.log(axes.get_ylim())
    known = [(float(np.log(total_error(one, end))), one.label) for one in settings if one.seconds < end / FEWEST_RUNS]
    place = -np.inf
    for at, label in sorted(one for one in known if one[0] <= high):
        end_of_line = (at - low) / (high - low)
        place = max(end_of_line, place + MOST_LABELS_APART)
        colour = colours.get(label, INK)
        axes.annotate(
            name_of(label),
            (1.0, end_of_line),
            (1.03, place),
            xycoords="axes fraction",
            va="center",
            fontsize=8.5,
            color=colour,
            weight="bold" if label in colours else "normal",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0},
            annotation_clip=False,
        )
    beyond = [name_of(label) for at, label in sorted(known) if at > high]
    if beyond:
        text = "off by more than 100 %:\n" + "\n".join(beyond)
        axes.text(0.98, 0.98, text, transform=axes.transAxes, ha="right", va="top", fontsize=8.5, color=START)


def name_of(label):
    """A setting in words: timestep-0.001-single is `dt = 0.001, single`."""
    engine, _, settings = label.partition("-")
    names = {"timestep": "dt = ", "langevin": "Langevin, "}
    return f"{names[engine]}{settings.replace('-s', ', s')}" if engine in names else label


# --- the price list


NUMBERS = ("runs", "failed_runs", "paired_runs", "seconds", "study_seconds", "msd_spread", "d_spread")
ERRORS = tuple(f"{name}_bias{part}" for name in ("msd", "d") for part in ("", "_standard_error", "_low", "_high"))
DISTANCE = tuple(f"displacement_bias{part}" for part in ("", "_low", "_high", "_noise"))
CONTACT = tuple(f"contact_bias{part}" for part in ("", "_standard_error", "_low", "_high"))
HEALTH = ("worst_energy_drift", "worst_overlap", "departure_time", "pays_from", "pays_to", "may_pay_from", "may_pay_to")


def table(dataset):
    """One row per scene and setting: price, biases with intervals, health, and when it pays."""
    header = (*NUMBERS, *ERRORS, *DISTANCE, *CONTACT, *HEALTH)
    rows = []
    for scene in _scenes(dataset):
        for one in settings_of(dataset, scene):
            values = dataset.sel(scene=scene, setting=one.label)
            rows.append((scene, int(values.particles), one.label, *(values[name].item() for name in header)))
    return Table(("scene", "particles", "setting", *header), rows)


def summary(dataset):
    """The price list as plain text: a table for every scene, what pays when, and what never does."""
    return "\n".join("\n".join(_of_scene(dataset, scene)) for scene in _scenes(dataset)) + "\n" + REMARK


REMARK = (
    "Bias: relative to exact, ± one standard error; `< 2 %`: not resolved, below 2 % with 95 % confidence.\n"
    "Distance: of the displacement distributions at the end. Parts: median time at which the tracer leaves the exact\n"
    "trajectory. Pays: CPU times of a study between which nothing has a smaller error of the MSD, on this machine.\n"
)


def _of_scene(dataset, scene):
    settings = settings_of(dataset, scene)
    head = (
        "setting",
        "runs",
        "ms a run",
        "price",
        "MSD bias",
        "D bias",
        "distance",
        "g(contact)",
        "overlap",
        "parts",
        "pays, s",
    )
    rows = [head, *(_row(dataset.sel(scene=scene, setting=one.label), settings[0].seconds) for one in settings)]
    columns = [one for one in zip(*rows, strict=True) if one[0] != "g(contact)" or set(one[1:]) != {"-"}]
    rows, widths = list(zip(*columns, strict=True)), [max(map(len, column)) for column in columns]
    yield f"{scene}, N = {int(dataset.sel(scene=scene).particles)}"
    yield from ("  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    pays, may = (
        {one.label: _of(dataset, scene, one.label)[f"{kind}_from"] for one in settings} for kind in ("pays", "may_pay")
    )
    never = [name_of(label) for label in pays if np.isnan(pays[label]) and np.isnan(may[label])]
    unsure = [name_of(label) for label in pays if np.isnan(pays[label]) and not np.isnan(may[label])]
    yield f"  never pays: {'; '.join(never) or 'none of them'}"
    yield f"  may pay if its bias is smaller than could be seen: {'; '.join(unsure)}\n" if unsure else ""


def _of(dataset, scene, label):
    return dataset.sel(scene=scene, setting=label)


def _row(one, exact_seconds):
    setting = one.setting.item()
    return (
        name_of(setting),
        f"{int(one.runs)}",
        f"{1e3 * float(one.seconds):.3g}",
        f"x {float(one.seconds) / exact_seconds:.3g}",
        "-" if setting == "exact" else _bias(one, "msd_bias"),
        "-" if setting == "exact" else _bias(one, "d_bias"),
        "-" if setting == "exact" else _distance(one),
        "-" if setting == "exact" else _bias(one, "contact_bias"),
        "-" if np.isnan(one.worst_overlap) else f"{float(one.worst_overlap):.1g}",
        _time(float(one.departure_time)),
        _pays(float(one.pays_from), float(one.pays_to)),
    )


def _bias(one, name):
    value, error, low, high = (float(one[f"{name}{part}"]) for part in ("", "_standard_error", "_low", "_high"))
    if np.isnan(value):
        return "-"
    if low <= 0.0 <= high:
        return f"< {_percent(max(-low, high))}"
    return f"{'+' if value > 0 else ''}{plus_minus(100 * value, 100 * error)} %"


def _distance(one):
    low, high = float(one.displacement_bias_low), float(one.displacement_bias_high)
    return _percent(float(one.displacement_bias)) if low > 0.0 else f"< {_percent(high)}"


def _percent(share):
    """Two digits, and all before the point."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _time(value):
    return "-" if np.isnan(value) else f"{value:.3g}" if value < np.inf else "never"


def _pays(start, end):
    if np.isnan(start):
        return "never"
    return f"{start:.2g} on" if end == np.inf else f"{start:.2g} to {end:.2g}"


def _scenes(dataset):
    """Scenes with something to compare."""
    return [scene for scene in dataset.scene.values if np.count_nonzero(dataset.runs.sel(scene=scene)) > 1]


def render(dataset, folder):
    """Write tradeoff_SCENE.png, .svg for every scene, and tradeoff.csv, tradeoff.txt; return the paths."""
    from pathlib import Path

    from brownpipe.figures.style import drawing, image_bytes
    from brownpipe.figures.tables import to_csv
    from brownpipe.storage import write_file

    files = {}
    with drawing():
        for scene in _scenes(dataset):
            drawn = draw(dataset, scene)
            files |= {f"tradeoff_{scene}.{kind}": image_bytes(drawn, kind) for kind in ("png", "svg")}
    files |= {"tradeoff.csv": to_csv(table(dataset)), "tradeoff.txt": summary(dataset).encode()}
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]
