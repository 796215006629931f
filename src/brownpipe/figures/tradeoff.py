"""Figures `tradeoff_SCENE`: expected error of the MSD against CPU time, one line per setting; the trade-off as text."""

import re
import textwrap
from pathlib import Path

import numpy as np

from brownpipe.figures.cases import plus_minus
from brownpipe.figures.style import DATA, DOTTED, FIT, FREE, INK, START, apart, drawing, grid, image_bytes, log_axis
from brownpipe.figures.tables import Table, to_csv
from brownpipe.storage import write_file
from brownpipe.tradeoff.front import FEWEST_RUNS, pareto_front, settings_of, total_error

FINEST = 2e-3  # total error down to which the lines are drawn at least
COLOURS = (DATA, FIT, FREE, "#CC79A7", "#56B4E9", "#E69F00")  # of what is on the front
WIDTH, HEIGHT, FRAME = 8.6, 5.4, 1.3  # of the figure, and its height beyond that of the panel [inch]
LABEL = 13.5  # least distance of two labels [point]
LEADER = 0.04  # length of the line from the end of a curve to its label, of the width
REMARK_LINE = 105  # characters
POINTS = 400


def draw(dataset, scene):
    """Expected error of the MSD at the end against CPU time in one scene; the Pareto front is bold and coloured."""
    settings, stretches = settings_of(dataset, scene), pareto_front(settings_of(dataset, scene, careful=True))
    times = np.geomspace(FEWEST_RUNS * min(one.seconds for one in settings), _last_time(settings, stretches), POINTS)
    figure, axes = grid(1, 1, WIDTH, max(HEIGHT, FRAME + LABEL / 72 * len(settings)))
    axes = axes[0, 0]
    front = dict.fromkeys(["exact", *(one.label for one in stretches)])
    colours = dict(zip(front, COLOURS * 9, strict=False))
    for one in settings:
        _line(axes, times, one, _unresolved_below(_of(dataset, scene, one.label)), colours.get(one.label, START))
    for stretch in stretches:
        _bold(axes, times, stretch, settings, colours[stretch.label])
    last = {one.label: float(total_error(one, times[-1])) for one in settings}
    shown = {label: error for label, error in last.items() if error <= 1.0}
    log_axis(axes, "x", times[0], times[-1])
    log_axis(axes, "y", min(shown.values(), default=0.1) / 1.5, 1.0)
    axes.set_xlabel("CPU time on this machine (s)")
    axes.set_ylabel("expected relative error of $\\langle r^2 \\rangle$ at the end of a run")
    remark = _remark([name_of(label) for label in last if label not in shown])
    axes.set_title(f"{scene}: cost-accuracy trade-off", pad=11 + LABEL * len(remark))
    axes.annotate(
        "\n".join(remark), (0, 1), (0, 6), "axes fraction", "offset points", color=START, fontsize=8.8, va="bottom"
    )
    _direct_labels(axes, shown, colours, LABEL / 72 / (figure.get_figheight() - FRAME))
    return figure


def _remark(beyond):
    """Lines that explain the figure; `beyond` names the settings without a line that ends inside it."""
    remark = "Bold: Pareto front, with unresolved biases at their 95 % upper bound. Dotted: below that bound."
    beyond = f"Error above 100 % or fewer than {FEWEST_RUNS} runs: {'; '.join(beyond)}." if beyond else ""
    return textwrap.wrap(remark, REMARK_LINE) + textwrap.wrap(beyond, REMARK_LINE)


def _last_time(settings, stretches):
    """Until the exact engine reaches the finest error, and beyond the last change of the front."""
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
    start, end = np.clip([stretch.start, stretch.end], times[0], times[-1])
    inside = np.array([start, *times[(times > start) & (times < end)], end])
    axes.plot(inside, total_error(best, inside), color=colour, linewidth=4.0, solid_capstyle="round")


def _direct_labels(axes, errors, colours, least):
    """The name of every line beside its end, moved apart where names would touch; `errors` are those at the end."""
    low, high = np.log(axes.get_ylim())
    ends = [(np.log(error) - low) / (high - low) for error in errors.values()]
    for label, end, place in zip(errors, ends, apart(ends, least, 0.0, 1.0), strict=True):
        colour = colours.get(label, INK)
        axes.annotate(
            name_of(label),
            (1.0, end),
            (1.0 + LEADER, place),
            xycoords="axes fraction",
            va="center",
            fontsize=8.5,
            color=colour,
            weight="bold" if label in colours else "normal",
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.6,
                "relpos": (0, 0.5),
                "shrinkA": 1,
                "shrinkB": 0,
            },
            annotation_clip=False,
        )


def name_of(label):
    """A setting in words: timestep-0.001-single-late is `dt = 0.001, single, late`."""
    engine, _, settings = label.partition("-")
    words = re.sub("-(?=[a-z])", ", ", settings)  # not the sign in 1e-05
    if engine == "langevin":
        return f"Langevin, {words.replace('boltzmann', 'Boltzmann').replace('enskog', 'Enskog')}"
    return f"dt = {words}" if engine == "timestep" else label


# --- the trade-off in numbers

COST_RATIO = ("cost_ratio", "cost_ratio_low", "cost_ratio_high")

NUMBERS = ("runs", "failed_runs", "paired_runs", "seconds", *COST_RATIO, "study_seconds", "msd_spread", "d_spread")
ERRORS = tuple(f"{name}_bias{part}" for name in ("msd", "d") for part in ("", "_standard_error", "_low", "_high"))
DISTANCE = tuple(f"displacement_bias{part}" for part in ("", "_low", "_high", "_noise"))
CONTACT = tuple(f"contact_bias{part}" for part in ("", "_standard_error", "_low", "_high"))
HEALTH = ("worst_energy_drift", "worst_overlap", "departure_time", "pays_from", "pays_to", "may_pay_from", "may_pay_to")


def table(dataset):
    """One row per scene and setting: cost, biases with intervals, health, and CPU times on the Pareto front."""
    header = (*NUMBERS, *ERRORS, *DISTANCE, *CONTACT, *HEALTH)
    rows = []
    for scene in _scenes(dataset):
        for one in settings_of(dataset, scene):
            values = dataset.sel(scene=scene, setting=one.label)
            numbers = (values[name].item() if name in values else np.nan for name in header)
            rows.append((scene, int(values.particles), one.label, *numbers))
    return Table(("scene", "particles", "setting", *header), rows)


def summary(dataset):
    """The trade-off as plain text: for every scene a table, and the settings that are not on the Pareto front."""
    return "\n".join("\n".join(_of_scene(dataset, scene)) for scene in _scenes(dataset)) + "\n" + REMARK


REMARK = (
    "cost: CPU time of a run in units of an exact one, median and range of pairs measured in turn on this machine.\n"
    "bias: relative to exact, ± one standard error; `< 2 %`: not resolved, below 2 % with 95 % confidence.\n"
    "distance: total variation distance of the displacement distributions at the end.\n"
    "departs: median time at which the tracer leaves the exact trajectory.\n"
    "front: CPU times at which the setting is on the Pareto front, where none has a smaller expected error of the\n"
    "MSD; unresolved biases count with their 95 % upper bound.\n"
)


def _of_scene(dataset, scene):
    settings = settings_of(dataset, scene)
    head = (
        "setting",
        "runs",
        "ms/run",
        "cost",
        "MSD bias",
        "D bias",
        "distance",
        "g(contact)",
        "overlap",
        "departs",
        "front, s",
    )
    rows = [head, *(_row(dataset.sel(scene=scene, setting=one.label), settings[0].seconds) for one in settings)]
    columns = [one for one in zip(*rows, strict=True) if one[0] != "g(contact)" or set(one[1:]) != {"-"}]
    rows, widths = list(zip(*columns, strict=True)), [max(map(len, column)) for column in columns]
    yield f"{scene}, N = {int(dataset.sel(scene=scene).particles)}"
    yield from ("  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    front, possible = (
        {one.label: _of(dataset, scene, one.label)[f"{kind}_from"] for one in settings} for kind in ("pays", "may_pay")
    )
    missing = [label for label in front if np.isnan(front[label])]
    never = [name_of(label) for label in missing if np.isnan(possible[label])]
    unsure = [name_of(label) for label in missing if not np.isnan(possible[label])]
    yield f"  not on the Pareto front: {'; '.join(never) or 'none of them'}"
    yield f"  on it only if an unresolved bias is small or its cost low: {'; '.join(unsure)}\n" if unsure else ""


def _of(dataset, scene, label):
    return dataset.sel(scene=scene, setting=label)


def _row(one, exact_seconds):
    setting = one.setting.item()
    return (
        name_of(setting),
        f"{int(one.runs)}",
        f"{1e3 * float(one.seconds):.3g}",
        _cost(one, exact_seconds),
        "-" if setting == "exact" else _bias(one, "msd_bias"),
        "-" if setting == "exact" else _bias(one, "d_bias"),
        "-" if setting == "exact" else _distance(one),
        "-" if setting == "exact" else _bias(one, "contact_bias"),
        "-" if np.isnan(one.worst_overlap) else f"{float(one.worst_overlap):.1g}",
        _time(float(one.departure_time)),
        _stretch(float(one.pays_from), float(one.pays_to)),
    )


def _cost(one, exact_seconds):
    """`1.23 (1.1-1.4)`; datasets made before have no range."""
    if "cost_ratio_low" not in one or one.setting == "exact":
        return f"{float(one.seconds) / exact_seconds:.3g}"
    low, high = (f"{float(one[f'cost_ratio_{end}']):.2g}" for end in ("low", "high"))
    return f"{float(one.cost_ratio):.3g} ({low}-{high})"


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


def _stretch(start, end):
    if np.isnan(start):
        return "-"
    return f"{start:.2g} on" if end == np.inf else f"{start:.2g} to {end:.2g}"


def _scenes(dataset):
    """Scenes with something to compare."""
    return [scene for scene in dataset.scene.values if np.count_nonzero(dataset.runs.sel(scene=scene)) > 1]


def render(dataset, folder):
    """Write tradeoff_SCENE.png, .svg for every scene, and tradeoff.csv, tradeoff.txt; return the paths."""

    files = {}
    with drawing():
        for scene in _scenes(dataset):
            drawn = draw(dataset, scene)
            files |= {f"tradeoff_{scene}.{kind}": image_bytes(drawn, kind) for kind in ("png", "svg")}
    files |= {"tradeoff.csv": to_csv(table(dataset)), "tradeoff.txt": summary(dataset).encode()}
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]
