"""The parts of a dataset that figures and tables show.

A case is one scene with one particle count and one engine: the dataset without these three dimensions.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, SupportsFloat

import numpy as np

from brownpipe.analysis.drift import LEVEL
from brownpipe.analysis.varied import labels_of_cases
from brownpipe.engines.friction import window_caution

if TYPE_CHECKING:
    from collections.abc import Callable

    from xarray import Dataset


def cases_of(dataset: Dataset) -> list[Dataset]:
    """Return every case that has runs, ordered by scene, varied keys, particle count and engine."""
    dims = labels_of_cases(dataset)
    cases = [dataset.sel(dict(zip(dims, one, strict=True))) for one in product(*(dataset[dim].values for dim in dims))]
    return [case for case in cases if int(case.runs) + int(case.failed_runs) > 0]


def has(case: Dataset, *names: str) -> bool:
    """Return whether the case has a finite value of every one of these variables."""
    return all(name in case and bool(np.isfinite(case[name].values).any()) for name in names)


def own_names(case: Dataset) -> list[str]:
    """Return the names of the averages of the user's own observables that the case has."""
    return [str(name) for name in case.data_vars if "observable" in case[name].attrs and has(case, str(name))]


def one_count(cases: list[Dataset], particles: int | None = None) -> list[Dataset]:
    """Return the cases with one particle count per scene: the requested one, or else the largest.

    A scene that lacks the requested count is left out.
    """
    selected = []
    for in_scene in _grouped(cases, lambda case: scene_of(case)).values():
        count = particles or max(int(case.particles) for case in in_scene)
        selected += [case for case in in_scene if case.particles == count]
    return selected


def axis_of(cases: list[Dataset]) -> str:
    """Return the axis of a scan: the first varied key with several numbers, or else the number of disks."""
    keys = labels_of_cases(cases[0])[1:-2]
    return next((key for key in keys if differs(cases, key) and cases[0][key].dtype.kind in "iuf"), "particles")


def differs(cases: list[Dataset], name: str) -> bool:
    """Return whether cases have several values of a label."""
    return len({case[name].item() for case in cases}) > 1


def by_series(cases: list[Dataset]) -> dict[str, list[Dataset]]:
    """Group the cases that differ in particle count alone, under scene, engine and whether their runs drift."""
    return _grouped(cases, lambda case: scene_of(case) + _suffix(case))


def _grouped(cases: list[Dataset], name: Callable[[Dataset], str]) -> dict[str, list[Dataset]]:
    """Group the cases by name; names and cases keep their order."""
    groups: dict[str, list[Dataset]] = {}
    for case in cases:
        groups.setdefault(name(case), []).append(case)
    return groups


def over_time(case: Dataset, name: str = "msd") -> Dataset:
    """Return the case at the times where it has a value of `name`: scenes of other durations leave gaps."""
    return defined(case, name, "time")


def defined(case: Dataset, name: str, dim: str) -> Dataset:
    """Return the case restricted along `dim` to the points where `name` has a value."""
    return case.dropna(dim, how="all", subset=[name])


def parts_of(case: Dataset, dim: str, name: str) -> list[Dataset]:
    """Return the case at each point along `dim`, such as each species, where it has a finite value of `name`."""
    parts = [case.isel({dim: k}) for k in range(case.sizes[dim])]
    return [part for part in parts if has(part, name)]


def distributions_of(case: Dataset) -> list[Dataset]:
    """Return the case at each time of its displacement distribution, with the rings used at that time."""
    at_times = parts_of(case, "displacement_time", "displacement_overflow")
    return [defined(at_time, "displacement_counts", "r") for at_time in at_times]


def at_last_distribution(case: Dataset) -> Dataset:
    """Return the case at the last time of its displacement distribution, or without one at the dataset's last."""
    return (distributions_of(case) or [case.isel(displacement_time=-1)])[-1]


def fits_of(case: Dataset) -> list[Dataset]:
    """Return the case at each fit window in which a line could be fitted to the MSD."""
    return parts_of(case, "window", "slope")


def scene_of(case: Dataset) -> str:
    """Return the scene of a case, with its values of varied keys."""
    return ", ".join([case.scene.item(), *(f"{name} = {value}" for name, value in varied_values(case).items())])


def varied_values(case: Dataset) -> dict[str, str]:
    """Return the values of varied keys of a case, in words."""
    values = {name: case[name].item() for name in labels_of_cases(case)[1:-2]}
    return {name: f"{value:.4g}" if isinstance(value, float) else f"{value}" for name, value in values.items()}


def title_of(case: Dataset) -> str:
    """Return scene, particle count, the label of the engine unless it is the exact one, and whether its runs drift."""
    return f"{scene_of(case)}, N = {case.particles.item()}{_suffix(case)}"


def _suffix(case: Dataset) -> str:
    engine = "" if case.engine == "exact" else f", {case.engine.item()}"
    return engine + (", not equilibrated" if drifts(case) else "")


def early_mark(fit: Dataset) -> str:
    """Return a ring for a fit whose window begins before the tracer's motion is diffusive; "" for others."""
    window = (fit.window_start.item(), fit.window_end.item())
    return " °" if window_caution(window, {"": fit.diffusive_from.item()}) else ""


def drifts(case: Dataset) -> bool:
    """Return whether the runs of a case that claims equilibrium are found to drift (`analysis.drift`)."""
    return has(case, "drift_p_value") and bool(np.nanmin(case.drift_p_value.values) < LEVEL)


def plus_minus(value: SupportsFloat, error: SupportsFloat) -> str:
    """Return `0.974 ± 0.022`: the value rounded to the two leading digits of its standard error.

    Without a positive error return the value alone, and `-` if it is not finite.
    """
    value, error = float(value), float(error)
    if not np.isfinite(error) or error <= 0.0:
        return f"{value:.4g}" if np.isfinite(value) else "-"
    decimals = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"
