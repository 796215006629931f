"""Figures `tradeoff_SCENE_N150`: expected error of the MSD against CPU time, one line per engine;
the same as text.

An engine with its settings is named by its label, as in studies and result folders
(`timestep-0.001-collisions=late`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.figures.cases import aligned, plus_minus
from brownpipe.figures.render import Drawing, drawing_of
from brownpipe.figures.style import DOTTED, GREY, INK, SERIES, drawing, grid, log_axis
from brownpipe.progress import tracked
from brownpipe.text import in_lines
from brownpipe.tradeoff.front import (
    FEWEST_RUNS,
    Interval,
    MeasuredSetting,
    pareto_front,
    settings_of,
    total_error,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

LEAST_ERROR = 2e-3  # error down to which the exact engine is drawn at least
WIDTH = 8.6  # of the figure [inch]
HEIGHT = 5.4  # least height of the figure [inch]
FRAME = 1.3  # height of the figure outside the panel [inch]
LABEL_DISTANCE = 13.5  # least distance of two labels [point]
LABELS: dict[str, Any] = {
    "xycoords": "axes fraction",
    "va": "center",
    "fontsize": 8.5,
    "annotation_clip": False,
}
# From a curve to its label
LEADER = {"arrowstyle": "-", "linewidth": 0.6, "relpos": (0, 0.5), "shrinkA": 1, "shrinkB": 0}
KEY = (
    "Bold: Pareto front, with unresolved biases at their 95 % upper bound. Dotted: error below "
    "that bound."
)
POINTS = 2000  # of a curve


def draw(dataset: Dataset, scene: str) -> Figure:
    """Draw the expected error of the MSD at the end of a run against CPU time, with the Pareto
    front in bold.
    """
    settings = settings_of(dataset, scene)
    front = pareto_front(settings_of(dataset, scene, careful=True))
    times = _cpu_times(settings, front)
    height = max(HEIGHT, FRAME + LABEL_DISTANCE / 72 * len(settings))
    figure, ((axes,),) = grid(1, 1, WIDTH, height)
    coloured = dict.fromkeys([REFERENCE_NAME, *(interval.label for interval in front)])
    colours = dict(zip(coloured, cycle(colour for colour, _, _ in SERIES), strict=False))
    for setting in settings:
        bias = dataset.sel(scene=scene, setting=setting.label)
        error = total_error(setting, times)
        unresolved = error < _unresolved_bound(bias, "msd_bias")
        on_front = _are_on_front(times, setting.label, front)
        thin: dict[str, Any] = {
            "color": colours.get(setting.label, GREY),
            "linewidth": 1.0,
            "label": setting.label,
        }
        bold = thin | {"linewidth": 4.0, "solid_capstyle": "round"}
        axes.plot(times, np.where(~unresolved, error, np.nan), **thin, alpha=0.8)
        axes.plot(times, np.where(unresolved, error, np.nan), **thin, linestyle=DOTTED)
        axes.plot(times, np.where(on_front, error, np.nan), **bold)
    last = {setting.label: float(total_error(setting, times[-1])) for setting in settings}
    inside = {label: error for label, error in last.items() if error <= 1.0}
    log_axis(axes, "x", times[0], times[-1])
    log_axis(axes, "y", min(inside.values(), default=0.1) / 1.5, 1.0)
    axes.set_xlabel("CPU time on this machine (s)")
    axes.set_ylabel("expected relative error of $\\langle r^2 \\rangle$ at the end of a run")
    axes.set_title(f"{scene}: cost-accuracy trade-off", pad=11 + LABEL_DISTANCE)
    place = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "bottom"}
    axes.annotate(KEY, (0, 1), (0, 6), color=GREY, fontsize=8.8, **place)
    panel_height = figure.get_figheight() - FRAME
    _direct_labels(axes, inside, colours, LABEL_DISTANCE / 72 / panel_height)
    return figure


def _cpu_times(settings: Sequence[MeasuredSetting], front: Sequence[Interval]) -> np.ndarray:
    """Return the CPU times (POINTS,) of the curves: until exact runs, the first setting, reach the
    finest error, or beyond the last change of the front.
    """
    exact = settings[0]
    fastest = min(setting.seconds for setting in settings)
    finest = (exact.spread / LEAST_ERROR) ** 2 * exact.seconds
    end = max(finest, *(3 * interval.start for interval in front))
    return np.geomspace(FEWEST_RUNS * fastest, end, POINTS)


def _are_on_front(times: np.ndarray, label: str, front: Sequence[Interval]) -> np.ndarray:
    """Return at which CPU times a setting is on the Pareto front."""
    are_on_front = np.zeros(len(times), bool)
    for interval in front:
        if interval.label == label:
            are_on_front |= (times >= interval.start) & (times <= interval.end)
    return are_on_front


def _unresolved_bound(setting: Dataset, name: str) -> float:
    """The 95 % upper bound of the size of a bias if that is not resolved from 0; 0 if it is."""
    low = float(setting[f"{name}_low"])
    high = float(setting[f"{name}_high"])
    return max(-low, high) if low <= 0.0 <= high else 0.0


def _direct_labels(
    axes: Axes, errors: dict[str, float], colours: dict[str, str], least: float
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


# --- the trade-off in numbers


def table(dataset: Dataset) -> DataFrame:
    """Return one row per scene and setting with all numbers of the dataset: cost, biases, health,
    the Pareto front.
    """
    numbers = [
        name
        for name, variable in dataset.items()
        if variable.dims == ("scene", "setting") and variable.dtype.kind in "fi"
    ]
    rows: list[tuple[str, str]] = []
    for scene in scenes_of(dataset):
        rows += [(scene, setting.label) for setting in settings_of(dataset, scene)]
    frame = dataset[["particles", *numbers]].to_dataframe(["scene", "setting"])
    frame = frame.loc[rows].reset_index()
    return frame[["scene", "particles", "setting", *numbers]]


def summary(dataset: Dataset) -> str:
    """Return the trade-off as text: a table for every scene."""
    lines = []
    for scene in scenes_of(dataset):
        lines += [scene, *(f"  {line}" for line in aligned(columns_of(dataset, scene))), ""]
    return in_lines(lines) + "\n" + REMARK


REMARK = (
    "cost: CPU time of a run relative to an exact one, timed in turn on this machine.\n"
    "bias: relative to exact, ± one standard error; `< 2 %`: not resolved, below 2 % with 95 % "
    "confidence.\n"
    "distance: total variation distance of the displacement distributions at the end.\n"
    "departs: median time at which the tracer leaves the exact trajectory.\n"
    "front: CPU times at which no other setting has a smaller expected error of the MSD (Pareto "
    "front);\n"
    "unresolved biases are at their 95 % upper bound; `perhaps`: if these are small, or its cost "
    "low.\n"
)


def columns_of(dataset: Dataset, scene: str) -> list[tuple[str, ...]]:
    """Return the table of a scene in words, by columns; those without any number are left out."""
    settings = [
        dataset.sel(scene=scene, setting=setting.label) for setting in settings_of(dataset, scene)
    ]
    rows = [_row(setting, float(settings[0].seconds)) for setting in settings]
    columns = [(name, *(row[name] for row in rows)) for name in rows[0]]
    return [column for column in columns if {*column[1:]} != {"-"}]


def _row(setting: Dataset, exact_seconds: float) -> dict[str, str]:
    """One line of the table, cell by cell."""
    seconds = float(setting.seconds)
    overlap = f"{float(setting.worst_overlap):.1g}".replace("nan", "-")
    departure = f"{float(setting.departure_time):.3g}".replace("nan", "-")
    row = {
        "setting": setting.setting.item(),
        "runs": f"{int(setting.runs)}",
        "ms/run": f"{1e3 * seconds:.3g}",
        "cost": f"{seconds / exact_seconds:.3g}",
    }
    row["MSD bias"] = _bias(setting, "msd_bias")
    row["D bias"] = _bias(setting, "d_bias")
    row["distance"] = _bias(setting, "displacement_bias")
    row["g(contact)"] = _bias(setting, "contact_bias")
    row["overlap"] = overlap
    row["departs"] = departure.replace("inf", "never")
    row["front, s"] = _interval(setting)
    return row


def _bias(setting: Dataset, name: str) -> str:
    """`+2.1 ± 1.0 %`, or `< 1.1 %` for a bias that is not resolved; a distance has no sign and no
    standard error.
    """
    value = float(setting[name])
    if np.isnan(value) or setting.setting == REFERENCE_NAME:
        return "-"
    if bound := _unresolved_bound(setting, name):
        return f"< {float(f'{100 * bound:.2g}'):g} %"  # 150 %, not 1.5e+02 %
    if f"{name}_standard_error" not in setting:
        return f"{float(f'{100 * value:.2g}'):g} %"
    error = float(setting[f"{name}_standard_error"])
    return f"{'+' if value > 0 else ''}{plus_minus(100 * value, 100 * error)} %"


def _interval(setting: Dataset) -> str:
    """The CPU times at which a setting is on the Pareto front; `-` if it never is."""
    start = float(setting.pays_from)
    end = float(setting.pays_to)
    if np.isnan(start):
        return "-" if np.isnan(setting.may_pay_from) else "perhaps"
    return f"{start:.2g} on" if end == np.inf else f"{start:.2g} to {end:.2g}"


def scenes_of(dataset: Dataset) -> list[str]:
    """Return the scenes that have runs of more than one setting."""
    settings_with_runs = (dataset.runs > 0).sum("setting")
    return dataset.scene.values[settings_with_runs.values > 1].tolist()


def drawn(dataset: Dataset, metadata: Mapping[str, str]) -> list[Drawing]:
    """Draw the trade-off of every scene with these metadata; the table of each drawing has that
    scene alone.
    """
    tables = [*table(dataset).groupby("scene", sort=False)]
    with drawing():
        return [
            drawing_of(f"tradeoff_{scene}", draw(dataset, scene), rows, metadata)
            for scene, rows in tracked(tables, "figures")
        ]
