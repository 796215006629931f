"""Figure `tradeoff`: expected error of the MSD against CPU time, a panel for each scene and number
of disks, a line for each engine; and the columns of the summary of a trade-off.

An engine with its settings is named by its label, as in studies and result folders
(`timestep-0.01-collisions=late`).
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.figures.cases import at_equal_steps, labels_in_words, plus_minus
from brownpipe.figures.figure import ALL_CASES, Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import (
    DOTTED,
    GREY,
    INK,
    SERIES,
    broken_into_lines,
    grid,
    log_axis,
    say_shown,
    text_size,
)
from brownpipe.tradeoff import is_tradeoff
from brownpipe.tradeoff.front import (
    FEWEST_RUNS,
    Interval,
    MeasuredSetting,
    measured_setting,
    pareto_front,
    total_error,
)

if TYPE_CHECKING:
    from matplotlib import figure as matplotlib_figure
    from matplotlib.axes import Axes
    from xarray import Dataset

LINE = 100  # characters of a line of words
MOST_PANELS = 36  # of more scenes so many are drawn
LEAST_ERROR = 2e-3  # error down to which the exact engine is drawn at least
WIDTH = 8.6  # of the figure [inch]
HEIGHT = 5.4  # least height of a panel with its frame [inch]
FRAME = 1.3  # height of the title and the axis of a panel [inch]
LABEL_DISTANCE = 1.35  # least distance of two labels, in sizes of all text
LABELS: dict[str, Any] = {
    "xycoords": "axes fraction",
    "va": "center",
    "fontsize": "small",
    "annotation_clip": False,
}
# From a curve to its label
LEADER = {"arrowstyle": "-", "linewidth": 0.6, "relpos": (0, 0.5), "shrinkA": 1, "shrinkB": 0}
ERROR = "expected relative error of $\\langle r^2 \\rangle$ at the end of a run"
KEY = (
    "Bold: Pareto front, with unresolved biases at their 95 % upper bound. Dotted: error below "
    "that bound."
)
ABOVE: dict[str, Any] = {
    "xycoords": "axes fraction",
    "textcoords": "offset points",
    "va": "bottom",
    "fontsize": "small",
}
POINTS = 2000  # of a curve


def draw_tradeoff(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw a panel for the engines of each scene and number of disks."""
    comparisons: dict[str, list[Dataset]] = {}
    for case in cases:
        title = labels_in_words(case, ("scene", "particles"))
        comparisons.setdefault(title, []).append(case)
    most_lines = max(map(len, comparisons.values()))
    label_distance = LABEL_DISTANCE * text_size()  # [point]
    titles = at_equal_steps([*comparisons], MOST_PANELS)
    least_height = FRAME + label_distance / 72 * most_lines
    figure, axes = grid(len(titles), 1, WIDTH, max(HEIGHT, least_height))
    height = figure.get_figheight() / len(titles) - FRAME
    for panel, title in zip(axes[:, 0], titles, strict=True):
        draw_errors(panel, comparisons[title], label_distance / 72 / height)
        panel.set_ylabel(broken_into_lines(ERROR, height, "axes.labelsize"))
        panel.set_title(f"{title}: cost-accuracy trade-off", pad=11 + label_distance)
        panel.annotate(KEY, (0, 1), (0, 6), color=GREY, **ABOVE)
    if len(titles) < len(comparisons):
        say_shown(figure, len(titles), len(comparisons))
    return figure


def draw_errors(axes: Axes, cases: list[Dataset], label_distance: float) -> None:
    """Draw the expected error of the MSD at the end of a run against CPU time, with the Pareto
    front in bold; of all engines of a scene, the exact one first.
    """
    settings = [setting_of(case) for case in cases]
    front = pareto_front([setting_of(case, careful=True) for case in cases])
    times = _cpu_times(settings, front)
    coloured = dict.fromkeys([REFERENCE_NAME, *(interval.label for interval in front)])
    colours = dict(zip(coloured, cycle(colour for colour, _, _ in SERIES), strict=False))
    last_errors = {}
    for case, setting in zip(cases, settings, strict=True):
        error = total_error(setting, times)
        is_unresolved = error < _unresolved_bound(case, "msd_bias")
        is_on_front = _are_on_front(times, setting.label, front)
        colour = colours.get(setting.label, GREY)
        thin: Looks = {"color": colour, "linewidth": 1.0, "alpha": 0.8, "label": setting.label}
        dotted: Looks = {"color": colour, "linewidth": 1.0, "linestyle": DOTTED}
        bold: Looks = {"color": colour, "linewidth": 4.0}
        axes.plot(times, np.where(~is_unresolved, error, np.nan), **thin)
        axes.plot(times, np.where(is_unresolved, error, np.nan), **dotted)
        axes.plot(times, np.where(is_on_front, error, np.nan), **bold, solid_capstyle="round")
        if error[-1] <= 1.0:
            last_errors[setting.label] = float(error[-1])
    log_axis(axes, "x", times[0], times[-1])
    log_axis(axes, "y", min(last_errors.values(), default=0.1) / 1.5, 1.0)
    axes.set_xlabel("CPU time on this machine (s)")
    _label_ends(axes, last_errors, colours, label_distance)


def setting_of(case: Dataset, careful: bool = False) -> MeasuredSetting:
    """Return the engine of a case with bias, spread and cost, as `measured_setting` has them."""
    return measured_setting(case.engine.item(), case, careful)


def _cpu_times(settings: Sequence[MeasuredSetting], front: Sequence[Interval]) -> np.ndarray:
    """Return the CPU times (POINTS,) of the curves: until exact runs, the first setting, reach the
    finest error, or beyond the last change of the front.
    """
    exact = settings[0]
    fastest = min(setting.seconds for setting in settings)
    finest = (exact.spread / LEAST_ERROR) ** 2 * exact.seconds
    end = max([finest, *(3 * interval.start for interval in front)])
    return np.geomspace(FEWEST_RUNS * fastest, end, POINTS)


def _are_on_front(times: np.ndarray, label: str, front: Sequence[Interval]) -> np.ndarray:
    """Return at which CPU times a setting is on the Pareto front."""
    are_on_front = np.zeros(len(times), bool)
    for interval in front:
        if interval.label == label:
            are_on_front |= (times >= interval.start) & (times <= interval.end)
    return are_on_front


def _unresolved_bound(case: Dataset, name: str) -> float:
    """Return the 95 % upper bound of the size of a bias that is not resolved from 0, else 0."""
    low = case[f"{name}_low"].item()
    high = case[f"{name}_high"].item()
    return max(-low, high) if low <= 0.0 <= high else 0.0


def _label_ends(
    axes: Axes, errors: Mapping[str, float], colours: Mapping[str, str], least: float
) -> None:
    """Write the label of every curve beside its end, at the last of its `errors`; keep labels
    `least` apart.
    """
    low, high = np.log(axes.get_ylim())
    ends = [(np.log(error) - low) / (high - low) for error in errors.values()]
    places = apart(ends, least, 0.0, 1.0)
    for label, end, place in zip(errors, ends, places, strict=True):
        colour = colours.get(label, INK)
        looks: dict[str, Any] = {
            "color": colour,
            "weight": "bold" if label in colours else "normal",
            "arrowprops": LEADER | {"color": colour},
        }
        axes.annotate(label, (1, end), (1.04, place), **looks, **LABELS)


def apart(
    places: Sequence[float] | np.ndarray, least: float, low: float, high: float
) -> np.ndarray:
    """Return the places of labels, moved up and where there is no room above down, so that they lie
    `least` apart.

    Their order stays, and they stay in [low, high]. If the interval is too short for that, they
    divide it evenly.
    """
    order = np.argsort(places, kind="stable")
    least = min(least, (high - low) / max(1, len(order) - 1))
    offsets = least * np.arange(len(order))
    ascending = np.clip(np.asarray(places, float)[order], low, high)
    moved_up = np.maximum.accumulate(ascending - offsets) + offsets
    moved = np.minimum(moved_up, high - offsets[::-1])
    return moved[np.argsort(order)]


# --- the columns of the summary


class Column(NamedTuple):
    """A column of the summary of a trade-off."""

    heading: str
    meaning: str
    cell: Callable[[Dataset], str]  # `-` without a number


def _rounded(name: str, digits: int, case: Dataset) -> str:
    """Return a variable of a case with so many digits; `-` for NaN."""
    return f"{case[name].item():.{digits}g}".replace("nan", "-")


def _milliseconds(case: Dataset) -> str:
    """Return the CPU time of a run in milliseconds."""
    return f"{1e3 * case.seconds.item():.3g}"


def _departure(case: Dataset) -> str:
    """Return the time at which the tracer leaves the exact trajectory, or `never`."""
    return _rounded("departure_time", 3, case).replace("inf", "never")


def bias_in_words(name: str, case: Dataset) -> str:
    """Return `+2.1 ± 1.0 %`, or `< 1.1 %` for a bias that is not resolved; a distance has no sign
    and no standard error.
    """
    value = case[name].item() if name in case else np.nan
    if np.isnan(value) or case.engine == REFERENCE_NAME:
        return "-"
    if bound := _unresolved_bound(case, name):
        return f"< {float(f'{100 * bound:.2g}'):g} %"  # 150 %, not 1.5e+02 %
    if f"{name}_standard_error" not in case:
        return f"{float(f'{100 * value:.2g}'):g} %"
    error = case[f"{name}_standard_error"].item()
    sign = "+" if value > 0 else ""
    return f"{sign}{plus_minus(100 * value, 100 * error)} %"


def front_in_words(case: Dataset) -> str:
    """Return the CPU times at which an engine is on the Pareto front; `-` if it never is."""
    start = case.pays_from.item()
    end = case.pays_to.item()
    if np.isnan(start):
        return "-" if np.isnan(case.may_pay_from.item()) else "perhaps"
    return f"{start:.2g} on" if end == np.inf else f"{start:.2g} to {end:.2g}"


COLUMNS = (
    Column("ms/run", "CPU time of a run on this machine", _milliseconds),
    Column(
        "cost",
        "CPU time of a run relative to an exact one, timed in turn on this machine",
        partial(_rounded, "cost_ratio", 3),
    ),
    Column(
        "MSD bias",
        "of the MSD <r^2> at the end, relative to exact runs; `< 2 %`: not resolved, below 2 % "
        "with 95 % confidence",
        partial(bias_in_words, "msd_bias"),
    ),
    Column(
        "front, s",
        "CPU times, of ten runs of two engines or more, at which no other has a smaller expected "
        "error of the MSD (Pareto front); unresolved biases are at their 95 % upper bound; "
        "`perhaps`: if these are small, or its cost low",
        front_in_words,
    ),
    Column("D bias", "of D in the fit window, likewise", partial(bias_in_words, "d_bias")),
    Column("D_x bias", "of D along x, likewise", partial(bias_in_words, "d_x_bias")),
    Column("D_y bias", "of D along y, likewise", partial(bias_in_words, "d_y_bias")),
    Column(
        "distance",
        "total variation distance of the displacement distributions at the end",
        partial(bias_in_words, "displacement_bias"),
    ),
    Column(
        "g(contact)",
        "most significant relative deviation of g(r) near contact",
        partial(bias_in_words, "contact_bias"),
    ),
    Column(
        "overlap",
        "deepest overlap in a run, in contact distances",
        partial(_rounded, "worst_overlap", 1),
    ),
    Column("departs", "median time at which the tracer leaves the exact trajectory", _departure),
)


def columns_of(cases: Sequence[Dataset]) -> list[tuple[Column, list[str]]]:
    """Return the columns of a trade-off with their cells, but for columns without any number; none
    for cases of an analysis.
    """
    if not all(map(is_tradeoff, cases)):
        return []
    columns = []
    for column in COLUMNS:
        cells = [column.cell(case) for case in cases]
        if {*cells} != {"-"}:
            columns.append((column, cells))
    return columns


def meanings_of(columns: Iterable[tuple[Column, list[str]]]) -> Iterator[str]:
    """Yield lines that explain columns."""
    for column, _ in columns:
        yield from textwrap.wrap(f"{column.heading}: {column.meaning}.", LINE)


FIGURE = Figure(
    draw=draw_tradeoff,
    variables=("cost_ratio",),
    every_count=True,
    most_cases=ALL_CASES,
    table=Columns(
        (),
        ("seconds", "msd_bias", "msd_spread", "pays_from", "pays_to", "may_pay_from", "may_pay_to"),
    ),
)
