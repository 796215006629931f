"""The parts of a dataset that figures and tables show, their names, and tables of their numbers.

A case is one scene with one value of each varied key, one particle count and one engine: the
dataset without these dimensions. A part of it, such as a species or a pair of species, lacks that
dimension, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, SupportsFloat, TypeVar

import numpy as np

from brownpipe.analysis.diffusive import COMPONENT_FITS, fits_along_channels
from brownpipe.analysis.drift import LEVEL
from brownpipe.analysis.variables import labels_of_cases
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.errors import FigureError

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import DataArray, Dataset

T = TypeVar("T")
MOST_CURVES = 6  # cases in one panel, or curves of one case
LONGEST = 10.0  # duration of the cases in one panel over the shortest
SPECIES = ("species", "species_pair")  # dimensions of parts of a case
COMPONENT = "component"  # along x or y, the dimension of further parts
Label = str | int | float  # of a case or a part of it, or one of its numbers
SUFFIXES = ("", "_standard_error", "_low", "_high")  # a mean and its uncertainties
# Variables of motion along x and y together
TOTALS = (
    "msd",
    "non_gaussian_parameter",
    "diffusion_running",
    "green_kubo",
    "velocity_autocorrelation",
    "vacf_initial_slope",
    "vacf_initial_slope_expected",
)
TOTALS_WITH_ERRORS = [f"{name}{suffix}" for name, suffix in product(TOTALS, SUFFIXES)]
# Variables that a case has only if its motion along x and y differs
ANISOTROPIC_VARIABLES = ("component_diffusion", "component_velocity_autocorrelation")
# Variable of all motion: the variable of the motion along x and along y
COMPONENT_VARIABLES = (
    COMPONENT_FITS
    | {name: f"component_{name}" for name in TOTALS_WITH_ERRORS}
    | {"run_msd": "run_component_msd"}
)


def cases_of(dataset: Dataset) -> list[Dataset]:
    """Return every case that has runs, ordered by scene, varied keys, particle count and engine.

    In a channel D and all numbers of its fits are those along it. With g(r) a case has
    `contact_theory`, the contact value of equal disks, or of a tracer and its only species; of
    other pairs, whose value is not in a dataset, NaN.
    """
    dataset = fits_along_channels(dataset)
    dims = [name for name in labels_of_cases(dataset) if name in dataset.dims]
    cases = []
    for labels in product(*(dataset[dim].values for dim in dims)):
        case = dataset.sel(dict(zip(dims, labels, strict=True)))
        if int(case.runs) + int(case.failed_runs) == 0:
            continue
        if has(case, "pair_distribution", "enskog_contact_value"):
            case = case.assign(contact_theory=_contact_theory(case))
        cases.append(case)
    return cases


def _contact_theory(case: Dataset) -> DataArray:
    """Return the contact value of each pair of species in theory, NaN where it is not known."""
    pairs = parts_of(case, "species_pair", "pair_distribution")
    known = case.species_pair == pairs[0].species_pair.item() if len(pairs) <= 2 else False
    return case.enskog_contact_value.where(known)


def has(case: Dataset, *names: str) -> bool:
    """Return whether the case has a finite value of every one of these variables."""
    return all(
        name in case and bool(np.isfinite(case.variables[name].values).any()) for name in names
    )


def at_equal_steps(items: Sequence[T], most: int) -> list[T]:
    """Return at most so many of the items, at equal steps, the first and the last among them.

    >>> at_equal_steps("abcde", 3)
    ['a', 'c', 'e']
    """
    number = min(most, len(items))
    places = np.linspace(0, len(items) - 1, number, dtype=int)
    return [items[place] for place in places]


def with_value(cases: Iterable[Dataset], name: str) -> list[Dataset]:
    """Return the cases that have a value of this variable."""
    return [case for case in cases if has(case, name)]


def quantities_of(names: Iterable[str], cases: list[Dataset]) -> list[str]:
    """Return those of the variables that any of the cases has a value of, in their order."""
    return [name for name in names if with_value(cases, name)]


def own_names(cases: list[Dataset]) -> list[str]:
    """Return the names of the averages of the user's own observables that any of the cases has."""
    names = []
    for name in map(str, cases[0].data_vars):
        is_own = "observable" in cases[0].variables[name].attrs
        if is_own and any(has(case, name) for case in cases):
            names.append(name)
    return names


def one_count(cases: list[Dataset], particles: int | None = None) -> list[Dataset]:
    """Return the cases with one particle count per scene: the requested one, or else the largest.

    A scene that lacks the requested count is left out.
    """
    ascending = sorted(cases, key=lambda case: case.particles.item())
    largest = {scene_of(case): case.particles.item() for case in ascending}
    return [case for case in cases if case.particles == (particles or largest[scene_of(case)])]


def differing(cases: list[Dataset]) -> list[str]:
    """Return the labels that tell cases or their parts apart: scene, varied keys, particle count,
    engine, species, component. Other labels than the component, which is that of all motion where
    a part has none, must be of all of them.
    """
    names = []
    for name in _labels(cases[0]):
        if name == COMPONENT or not all(name in _labels(case) for case in cases):
            continue
        values = {case.variables[name].values.item() for case in cases}
        if len(values) > 1:
            names.append(name)
    components = {component_of(case) for case in cases}
    return [*names, COMPONENT] if len(components) > 1 else names


def _labels(case: Dataset) -> list[str]:
    """Return the names of the labels of a case or a part of it."""
    return [
        name
        for name in (*labels_of_cases(case), *SPECIES, COMPONENT)
        if name in case and not case.variables[name].dims
    ]


def axis_of(cases: list[Dataset], otherwise: str = "particles") -> str:
    """Return the axis of a scan: the first varied key with several numbers, or else the number of
    disks.
    """
    keys = [name for name in differing(cases) if name in labels_of_cases(cases[0])[1:-2]]
    return next((key for key in keys if cases[0][key].dtype.kind in "iuf"), otherwise)


def varied_with(cases: list[Dataset], axis: str) -> list[str]:
    """Return what else changes along the axis of a scan, and has one value at each point of it:
    keys varied together with it, the number of disks, the packing fraction.
    """
    labels = [name for name in differing(cases) if name not in ("scene", "engine", axis)]
    names = []
    for name in dict.fromkeys([*labels, "packing_fraction"]):
        values = {case[name].item() for case in cases}
        points = {(case[axis].item(), case[name].item()) for case in cases}
        places = {case[axis].item() for case in cases}
        if name != axis and len(values) > 1 and len(points) == len(places):
            names.append(name)
    return names


def panels_of(
    cases: list[Dataset], keys: Sequence[str] = (), part: str = "", variable: str = ""
) -> list[list[Dataset]]:
    """Group the cases that share a panel: those with equal values of the labels `keys`.

    A panel holds at most MOST_CURVES, with durations within a factor of LONGEST. If there are more,
    cases are also divided by one further label, by that which gives the fewest panels, or if none
    suffices by all. With a `part`, the dimension of species or pairs of species, group those parts
    of the cases that have this variable: species of a single case share a panel; each pair has one
    of its own, and so has each species of several cases.

    Raises FigureError for a key that the cases do not have.
    """
    for name in keys:
        if name not in _labels(cases[0]):
            allowed = ", ".join(labels_of_cases(cases[0]))
            raise FigureError(f"panel: must be of {allowed}, not {name!r}")
    groups = _groups_that_fit(cases, keys)
    if not part:
        return groups
    panels: list[list[Dataset]] = []
    for group in groups:
        parts: list[Dataset] = []
        for case in group:
            parts += parts_of(case, part, variable)
        if part == "species" and len(group) == 1:
            panels.append(parts)
        else:
            panels += panels_of(parts, [part])
    return panels


def _groups_that_fit(cases: list[Dataset], keys: Sequence[str]) -> list[list[Dataset]]:
    """Group the cases by the labels `keys`, and by further ones where panels would be too full."""
    further = differing(cases)
    choices = [keys, *([*keys, name] for name in further)]
    groupings = []
    for names in choices:
        groups = [*_grouped(cases, partial(labels_in_words, names=names)).values()]
        if all(map(_fits, groups)):
            groupings.append(groups)
    if groupings:
        return min(groupings, key=len)
    return [*_grouped(cases, partial(labels_in_words, names=[*keys, *further])).values()]


def _fits(group: list[Dataset]) -> bool:
    durations = [float(case.duration) for case in group]
    return len(group) <= MOST_CURVES and max(durations) <= LONGEST * min(durations)


def series_of(cases: list[Dataset], *axes: str, drift: bool = False) -> dict[str, list[Dataset]]:
    """Group the cases that differ in `axes` alone, ascending along the first, under what else tells
    them apart.

    drift: those that are found not to be in equilibrium are a series of their own.
    """
    names = [name for name in differing(cases) if name not in axes]
    for name in labels_of_cases(cases[0])[1:-1]:
        others = [other for other in names if other != name]
        places = {_values(case, (*axes, *others)) for case in cases}
        if len(places) == len(cases):
            # it follows from them: a key varied together with the axis, N if a species' count is
            # varied
            names = others
    ascending = sorted(cases, key=lambda case: case[axes[0]].item())
    if drift:
        return _grouped(ascending, lambda case: labels_in_words(case, names) + drift_remark(case))
    return _grouped(ascending, lambda case: labels_in_words(case, names))


def _values(case: Dataset, labels: Iterable[str]) -> tuple[Label, ...]:
    """Return the values of labels of a case."""
    return tuple(case[label].item() for label in labels)


def _grouped(cases: list[Dataset], name: Callable[[Dataset], str]) -> dict[str, list[Dataset]]:
    """Group the cases by name; names and cases keep their order."""
    groups: dict[str, list[Dataset]] = {}
    for case in cases:
        groups.setdefault(name(case), []).append(case)
    return groups


def defined(case: Dataset, name: str) -> Dataset:
    """Return the case at the points where a variable has a value, along its last dimension if it
    has one.

    Scenes of other durations, sizes or pairs leave gaps.
    """
    values = case.variables[name]
    if not values.dims or not values.isnull().any():
        return case
    return case.dropna(values.dims[-1], how="all", subset=[name])


def parts_of(case: Dataset, dim: str, name: str) -> list[Dataset]:
    """Return the case at each point along `dim`, such as each species, where it has a finite value
    of `name`.

    Without a dimension it is the case itself.
    """
    parts = [case.isel({dim: k}) for k in range(case.sizes[dim])] if dim else [case]
    return [part for part in parts if has(part, name)]


def distributions_of(cases: list[Dataset]) -> list[Dataset]:
    """Return the cases at each time of their displacement distributions, with the rings used at
    that time.
    """
    at_times: list[Dataset] = []
    for case in cases:
        at_times += parts_of(case, "displacement_time", "displacement_overflow")
    return [defined(at_time, "displacement_counts") for at_time in at_times]


def at_last_distribution(case: Dataset) -> Dataset:
    """Return the case at the last time of its displacement distribution, or without one at the
    dataset's last.
    """
    at_times = parts_of(case, "displacement_time", "displacement_overflow")
    return at_times[-1] if at_times else case.isel(displacement_time=-1)


def components_of(cases: list[Dataset]) -> list[Dataset]:
    """Return the motion along x and along y of cases in which they differ, with MSD, fits and
    autocorrelation of each in place of those of all motion; other cases as they are.
    """
    parts: list[Dataset] = []
    for case in cases:
        if any(has(case, name) for name in ANISOTROPIC_VARIABLES):
            by_component = _by_component(case)
            parts += [by_component.sel(component=axis) for axis in case[COMPONENT].values]
        else:
            parts.append(case)
    return parts


def _by_component(case: Dataset) -> Dataset:
    """Return a case with the variables of `COMPONENT_VARIABLES`, which have a dimension
    `component`, in place of those of all motion; totals of which it has no components are left out.
    """
    components = {}
    for name, component_name in COMPONENT_VARIABLES.items():
        if component_name in case:
            components[name] = case[component_name]
    totals = [name for name in TOTALS_WITH_ERRORS if name in case]
    return case.drop_vars(totals).assign(components)


def with_components(case: Dataset, names: Iterable[str]) -> Dataset:
    """Return a case with variables of its motion along x and along y, such as `msd along x`, where
    this differs.
    """
    variables = {}
    for part in components_of([case]):
        axis = component_of(part)
        for name, suffix in product(names, SUFFIXES):
            if axis and f"{name}{suffix}" in part:
                variables[f"{name} along {axis}{suffix}"] = part[f"{name}{suffix}"]
    return case.assign(variables)


def motions_of(case: Dataset) -> list[Dataset]:
    """Return the motion of a case whose D is stated: all motion; in a channel that along it; in a
    box of walls with unequal sides that along x and that along y.
    """
    parts = components_of([case])
    axis = channel_axis(case)
    along_channel = [part for part in parts if component_of(part) == axis]
    return along_channel or parts


def fits_of(case: Dataset) -> list[Dataset]:
    """Return the case at each fit window in which a line could be fitted to the MSD."""
    return parts_of(case, "window", "slope")


# -- names and numbers in words --------------------------------------------------------------------


def text_of(case: Dataset, name: str) -> str:
    """Return the value of a label in words."""
    value = case.variables[name].values.item()
    return f"{value:.6g}" if isinstance(value, float) else f"{value}"


def labels_in_words(case: Dataset, names: Iterable[str]) -> str:
    """Return labels of a case: scene, engine (but for the exact one) and species by name, the
    component as `along x`, "" of all motion, others as `N = 150`.
    """
    labels = [*dict.fromkeys(names)]
    words = []
    for name in labels:
        value = component_of(case) if name == COMPONENT else text_of(case, name)
        if name in ("scene", "engine", *SPECIES):
            words.append(value)
        elif name == COMPONENT:
            words.append(f"along {value}" if value else "")
        else:
            words.append(f"{'N' if name == 'particles' else name} = {value}")
    named = [word for word in words if word not in ("", REFERENCE_NAME)]
    if not named and "engine" in labels:
        return REFERENCE_NAME
    return ", ".join(named)


def scene_of(case: Dataset) -> str:
    """Return the scene of a case, with its values of varied keys."""
    return labels_in_words(case, labels_of_cases(case)[:-2])


def title_of(*cases: Dataset) -> str:
    """Return what cases have in common: scene, varied keys, particle count, the engine unless it is
    exact, species.

    Of a single case also whether its runs drift.
    """
    varied = differing([*cases])
    shared = [name for name in _labels(cases[0]) if name not in varied]
    title = labels_in_words(cases[0], shared)
    return title + drift_remark(cases[0]) if len(cases) == 1 else title


def axis_label(case: Dataset, name: str) -> str:
    """Return the label of an axis: what is varied, with its unit."""
    unit = case[name].attrs.get("units", "1")
    symbols = {"particles": "number of disks $N$", "packing_fraction": "packing fraction $\\phi$"}
    label = symbols.get(name, name.replace("_", " "))
    return label if unit == "1" else f"{label} [{unit}]"


def drift_remark(case: Dataset) -> str:
    return ", not equilibrated" if drifts(case) else ""


def drifts(case: Dataset) -> bool:
    """Return whether the runs of a case that claims equilibrium are found to drift
    (`analysis.drift`).
    """
    return has(case, "drift_p_value") and bool(np.nanmin(case.drift_p_value.values) < LEVEL)


def diffusion_ring(case: Dataset) -> str:
    """Return a ring for a D that something speaks against (`analysis.diffusive`); else ""."""
    return " °" if case.diffusion_mark.item() else ""


def channel_axis(case: Dataset) -> str:
    """Return the axis, x or y, along which a case is a channel; "" for other boxes."""
    return str(case.channel_axis.item()) if "channel_axis" in case else ""


def component_of(part: Dataset) -> str:
    """Return of which component, x or y, a part of a case is; "" for all motion."""
    is_part = COMPONENT in part.coords and not part[COMPONENT].dims
    return str(part[COMPONENT].item()) if is_part else ""


def axis_of_diffusion(case: Dataset) -> str:
    """Return the axis, x or y, along which D is, in a channel and of motion along one axis alone;
    "" for D of all motion.
    """
    return component_of(case) or channel_axis(case)


def diffusion_name(case: Dataset) -> str:
    """Return D, or of motion along one axis D_x or D_y."""
    axis = axis_of_diffusion(case)
    return f"D_{axis}" if axis else "D"


def diffusion_symbol(case: Dataset) -> str:
    """Return the name of D as legends have it."""
    name = diffusion_name(case)
    return name if name == "D" else f"${name}$"


def square_symbol(part: Dataset) -> str:
    """Return the symbol of the MSD of a part of a case, of motion along an axis that along it."""
    return f"$\\langle {component_of(part) or 'r'}^2 \\rangle$"


def square_symbols(parts: Iterable[Dataset]) -> str:
    """Return the symbols of the MSD of parts of cases, each once."""
    return ", ".join(dict.fromkeys(map(square_symbol, parts)))


def fitted_diffusion(case: Dataset) -> str:
    """Return D in the first fit window in words, with the ring of `diffusion_ring`; "" without a
    fit.
    """
    fits = fits_of(case)
    if not fits:
        return ""
    first = fits[0]
    estimate = estimate_of(first, "diffusion_coefficient")
    symbol = diffusion_symbol(case)
    return f"{symbol} over {first.window.item()} = {estimate}{diffusion_ring(first)}"


def estimate_of(case: Dataset, name: str) -> str:
    """Return a variable that is one number in this case with its standard error, as `plus_minus`
    does, or if it has none with its 95 % interval.
    """
    error = f"{name}_standard_error"
    if error in case:
        return plus_minus(case.variables[name], case.variables[error])
    return with_interval(case[name], case[f"{name}_low"], case[f"{name}_high"])


def with_interval(value: SupportsFloat, low: SupportsFloat, high: SupportsFloat) -> str:
    """Return `0.312 [0.27, 0.351]`: the value with the ends of its interval. An upper end that is
    not known is infinite; without the lower one return the value alone.

    >>> with_interval(0.312, 0.27, np.nan)
    '0.312 [0.27, inf)'
    """
    if not np.isfinite(float(low)):
        return f"{float(value):.3g}"
    end = f"{float(high):.3g}]" if np.isfinite(float(high)) else "inf)"
    return f"{float(value):.3g} [{float(low):.3g}, {end}"


def plus_minus(value: SupportsFloat, error: SupportsFloat) -> str:
    """Return `0.974 ± 0.022`: the value rounded to the two leading digits of its standard error, or
    to an integer.

    Without an error beyond round-off return the value alone, and `-` if it is not finite.
    """
    value = float(value)
    error = float(error)
    if not np.isfinite(error) or error <= 1e-12 * abs(value):
        return f"{value:.4g}" if np.isfinite(value) else "-"
    decimals = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"


# -- tables: numbers (pandas, written as CSV), and words in aligned columns ------------------------


def frame_of(cases: Sequence[Dataset], dims: Sequence[str], names: Iterable[str]) -> DataFrame:
    """Return one row per case and point along `dims` with the variables `names` there, each with
    its uncertainties.

    Variables and uncertainties that no case has are left out, and so are empty rows.
    """
    import pandas

    labels = labels_of_cases(cases[0])
    variables = {name for case in cases for name in case.variables}
    shown = []
    for name in names:
        if name not in labels and any(has(case, name) for case in cases):
            estimates = [f"{name}{suffix}" for suffix in SUFFIXES]
            shown += [estimate for estimate in estimates if estimate in variables]
    frames = []
    for case in cases:
        present = [name for name in shown if name in case]
        frame = case[present].expand_dims(labels).to_dataframe([*labels, *dims])
        frames.append(frame.reindex(columns=shown).dropna(how="all"))
    return pandas.concat(frames).reset_index()


def label_of(case: Dataset, *numbers: str) -> dict[str, Label]:
    """Return scene, particle count and engine, by which the rows of a case begin, and some of its
    numbers.
    """
    return {name: case[name].item() for name in (*labels_of_cases(case), *numbers)}


def aligned(columns: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a text table, given its columns; every column is as wide as its widest
    cell.
    """
    widths = [max(map(len, column)) for column in columns]
    lines = []
    for row in zip(*columns, strict=True):
        cells = map(str.ljust, row, widths)
        lines.append("  ".join(cells).rstrip())
    return lines
