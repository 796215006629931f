"""Figure `scan`: MSD at the end, D, pressure and collision rate against a varied key, or the number
of disks.
"""

from collections.abc import Mapping
from itertools import chain, cycle

import numpy as np
from matplotlib import figure as matplotlib_figure
from matplotlib.axes import Axes
from pandas import DataFrame, concat
from xarray import Dataset

from brownpipe.analysis import diffusive
from brownpipe.analysis.resampling import resample
from brownpipe.figures.cases import (
    COMPONENT,
    SUFFIXES,
    axis_label,
    axis_of,
    component_of,
    differing,
    diffusion_ring,
    diffusion_symbol,
    frame_of,
    motions_of,
    quantities_of,
    series_of,
    square_symbols,
    varied_with,
    with_value,
)
from brownpipe.figures.figure import ALL_CASES, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import (
    DASHED,
    MARKS,
    WIDTH,
    columns_that_fit,
    grid,
    log_axis,
    points,
    put_titles_and_legends,
)
from brownpipe.scene.variation import is_number

# ratio of the largest value to the smallest, beyond which an axis is logarithmic
LOGARITHMIC = 30.0
MARGIN = 1.25  # factor by which a logarithmic axis extends beyond the values
END = "msd"
D = "diffusion_coefficient"
RUN_VARIABLES = {END: "run_msd", D: "run_diffusion_coefficient"}  # the same of each run
PANELS = {  # title, label of the axis, Enskog's theory
    END: ("MSD at the end of the runs", "$\\langle r^2 \\rangle$", ""),
    D: ("diffusion coefficient", "$D$ = slope/4", "enskog_diffusion"),
    "compressibility": ("compressibility factor", "$Z$", "enskog_compressibility"),
    "collision_rate": (
        "collision rate",
        "collisions per disk and unit time",
        "enskog_collision_rate",
    ),
}


def draw_scan(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw a panel per quantity: its values along the axis of the scan, a series for each value of
    what else differs; of MSD and D also for each axis that has a D of its own.

    D is that of the first fit window; the table has all.
    """
    axis = axis_of(cases)
    ends = [case.isel(time=-1, window=0) for case in cases]
    series = series_of(ends, axis, drift=True)
    motions = _motions(ends)
    series_of_motions = series_of(motions, axis, drift=True)
    names = quantities_of(PANELS, cases)
    along = [axis_label(cases[0], axis), *also_varied(cases, axis)]
    height = 3.6 + 0.38 * (len(series_of_motions) - 1) + 0.2 * (len(along) - 1)
    columns = columns_that_fit(len(names), 2)
    figure, axes = grid(-(-len(names) // columns), columns, WIDTH, height)
    for panel in axes.flat[len(names) :]:
        panel.remove()
    for panel, name in zip(axes.flat, names, strict=False):
        series_of_panel = series_of_motions if name in RUN_VARIABLES else series
        shown = {label: with_value(parts, name) for label, parts in series_of_panel.items()}
        _panel(panel, axis, shown, name)
        panel.set_xlabel("\n".join(along))
        panel.set_ylabel(_label(name, motions))
    titles = {name: PANELS[name][0] for name in names}
    if D in titles:
        window = cases[0].window[0].item()
        ring = max(map(diffusion_ring, motions))
        titles[D] += f" over {window}{ring}"
    put_titles_and_legends(axes.flat[: len(names)], titles.values())
    return figure


def _motions(cases: list[Dataset]) -> list[Dataset]:
    """Return the motions of cases whose D is stated (`cases.motions_of`); the component of all
    motion is "".
    """
    motions: list[Dataset] = []
    for case in cases:
        for motion in motions_of(case):
            labelled = motion.drop_dims(COMPONENT, errors="ignore")
            motions.append(labelled.assign_coords(component=component_of(motion)))
    return motions


def _label(name: str, motions: list[Dataset]) -> str:
    """Return the label of the vertical axis of a panel, that of MSD and D for these motions."""
    if name == END:
        return square_symbols(motions)
    return _label_of_diffusion(motions) if name == D else PANELS[name][1]


def _label_of_diffusion(motions: list[Dataset]) -> str:
    """Return the label of D: along an axis it is half of the slope along it."""
    symbols = {diffusion_symbol(motion) for motion in motions}
    along_axes = sorted(symbols - {"D"})
    labels = ["$D$ = slope/4"] if "D" in symbols else []
    if along_axes:
        labels.append(f"{', '.join(along_axes)} = slope/2")
    return "; ".join(labels)


def also_varied(cases: list[Dataset], axis: str) -> list[str]:
    """Return a line for each quantity that changes together with the axis, with its first and last
    value in this order.
    """
    ascending = sorted(cases, key=lambda case: case[axis].item())
    lines = []
    for name in varied_with(cases, axis):
        ends = [case[name].item() for case in (ascending[0], ascending[-1])]
        first, last = (f"{end:.4g}" if is_number(end) else f"{end}" for end in ends)
        lines.append(f"with {axis_label(cases[0], name)} from {first} to {last}")
    return lines


def _panel(axes: Axes, axis: str, series: Mapping[str, list[Dataset]], name: str) -> None:
    """Draw a quantity of each series with 95 % intervals, and theory as a dashed line."""
    _, _, theory = PANELS[name]
    values: list[float] = []
    for (label, cases), mark in zip(series.items(), cycle(MARKS), strict=False):
        x = [case[axis].item() for case in cases]
        looks: Looks = {**mark, "label": label}
        points(axes, x, cases, name, **looks)
        for suffix in ("", "_low", "_high"):
            values += [float(case[f"{name}{suffix}"]) for case in cases]
        expected = [float(case.get(theory, np.nan)) for case in cases]
        if np.isfinite(expected).any():
            _, labels = axes.get_legend_handles_labels()
            label = "_Enskog" if "Enskog" in labels else "Enskog"
            colour = looks["color"]
            axes.plot(x, expected, color=colour, linestyle=DASHED, linewidth=1, label=label)
    varied = [case[axis].item() for case in chain.from_iterable(series.values())]
    for direction, on_axis in (("x", varied), ("y", values)):
        low, high = np.nanmin(on_axis), np.nanmax(on_axis)
        if 0 < LOGARITHMIC * low < high:
            log_axis(axes, direction, low / MARGIN, high * MARGIN)


def table_of_scan(cases: list[Dataset]) -> DataFrame:
    """Return one row per case and fit window: D and the quantities of the case, theory, and
    differences.

    Where the motion of some cases differs along x and y, `component` says along which axis MSD and
    D are; a case with a D for each has a row for each.
    A difference is taken from the case before along the axis, whose runs with the same seeds begin
    alike if they have as many disks; its standard error and interval are those of the mean over
    these pairs of runs. The difference of D is for the first window.
    """
    axis = axis_of(cases)
    differences = [f"{name}_difference" for name in RUN_VARIABLES]
    theory = [expected for _, _, expected in PANELS.values() if expected]
    names = (
        "packing_fraction",
        "not_diffusive_before",
        "window_start",
        "window_end",
        "diffusion_mark",
        *PANELS,
        *theory,
        *differences,
    )
    ends: dict[str, list[Dataset]] = {}
    for series in series_of(_motions(cases), axis).values():
        ends.setdefault(component_of(series[0]), []).extend(_ends_with_differences(series))
    frames = []
    for component, motions in ends.items():
        frames.append(frame_of(motions, ("window",), names).assign(component=component))
    frame = concat(frames, ignore_index=True).drop(columns="window")
    marks = frame.pop("diffusion_mark").astype(int)
    frame = frame.assign(mark=marks.map(diffusive.mark_in_words))
    return frame if any(frame.component) else frame.drop(columns="component")


def _ends_with_differences(series: list[Dataset]) -> list[Dataset]:
    """Return the cases of a series at their ends, with the differences from the case before."""
    ends = []
    cases_before: list[Dataset | None] = [None, *series[:-1]]
    for before, case in zip(cases_before, series, strict=True):
        ends.append(case.isel(time=-1).assign(_differences(before, case)))
    return ends


def _differences(before: Dataset | None, case: Dataset) -> dict[str, float]:
    """Return the differences of means from the case before, over runs with the same seeds, with
    standard errors and 95 % intervals; NaN without such runs.
    """
    differences: dict[str, float] = {}
    for name, name_of_run in RUN_VARIABLES.items():
        if name_of_run not in case:
            continue
        later = case[name_of_run].isel(window=0, missing_dims="ignore")
        no_runs = later.where(False)
        earlier = no_runs if before is None else before[name_of_run]
        earlier = earlier.isel(window=0, missing_dims="ignore")
        pairs = (later - earlier).dropna("seed")
        estimate = resample(pairs.values, pairs.seed.values)
        for suffix, value in zip(SUFFIXES, estimate, strict=True):
            differences[f"{name}_difference{suffix}"] = float(value)
    return differences


def _cases_of_scan(cases: list[Dataset]) -> list[Dataset]:
    """Return the cases if they differ in a number that can be the axis; otherwise none."""
    return cases if axis_of(cases) in differing(cases) else []


FIGURE = Figure(
    draw=draw_scan,
    variables=(END,),
    every_count=True,
    selection=_cases_of_scan,
    most_cases=ALL_CASES,
    table=table_of_scan,
)
