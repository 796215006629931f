"""Whether slope/4 of the MSD in a window is a diffusion coefficient: what speaks against it.

A quarter of a slope is a number in any case. It is the D of diffusion if the MSD grows by a
straight line for reasons of the motion: not where it is still ballistic, where cages, walls or
neighbours in a file hold the tracer back, or where all disks drift together. Each reason is a bit
of the variable `diffusion_mark`; a D without a mark is one that nothing speaks against, at the
level and with the power of docs/theory.md, section 5. Half of the slope along x or y has a mark of
its own, `component_diffusion_mark`, for the same reasons (`analysis.components`).
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.goodness import holm
from brownpipe.analysis.variables import CASE_DIMS, Variable
from brownpipe.engines.windows import ROUNDED, Window, window_labels

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

LEVEL = 0.01  # family-wise error rate of the tests for a change of the slope
FEWEST_RUNS = 8  # for a test over runs
# Changes of the slope, over the slope, that do not count. In two dimensions D grows in any fluid:
# the velocity autocorrelation decays as 1/t.
SMALL_FALL = 0.1
SMALL_GROWTH = 0.25
# Share by which walls reduce the slope of the MSD at the end of a window, beyond which they count.
WALLS_FELT = 0.1
# Exponent of the MSD at the end of a window, d ln MSD/d ln t, below which the tracer is held in its
# place; 1 in diffusion.
HELD = 0.65

# Bits of a mark.
CHANGES = 1
PLATEAU = 2
WALLS = 4
EARLY = 8
DRIFT = 16
UNTESTED = 32
REASONS = {
    CHANGES: "slope_changes",
    PLATEAU: "plateau",
    WALLS: "walls",
    EARLY: "early",
    DRIFT: "drift",
    UNTESTED: "untested",
}

WINDOW = (*CASE_DIMS, "window")
FLAGS = {
    "flag_masks": np.array([*REASONS], np.int8),
    "flag_meanings": " ".join(REASONS.values()),
}
VARIABLES = {
    "diffusion_mark": Variable(
        WINDOW,
        "1",
        "why slope/4 in the window is no diffusion coefficient; 0: nothing speaks against it",
        dtype=np.int8,
        absent=0,
        extra=FLAGS,
    )
}
# of the fits along x and y
COMPONENT_MARK = Variable(
    (*CASE_DIMS, "component", "window"),
    "1",
    "why slope/2 along x and y is no diffusion coefficient; 0: nothing speaks against it",
    dtype=np.int8,
    absent=0,
    extra=FLAGS,
)


# For each variable of the straight-line fits that of the fits along x and y.
COMPONENT_FITS = {
    "slope": "component_slope",
    "slope_standard_error": "component_slope_standard_error",
    "intercept": "component_intercept",
    "intercept_standard_error": "component_intercept_standard_error",
    "diffusion_coefficient": "component_diffusion",
    "diffusion_coefficient_standard_error": "component_diffusion_standard_error",
    "diffusion_coefficient_low": "component_diffusion_low",
    "diffusion_coefficient_high": "component_diffusion_high",
    "run_diffusion_coefficient": "run_component_diffusion",
    "slope_change": "component_slope_change",
    "slope_change_standard_error": "component_slope_change_standard_error",
    "slope_change_p_value": "component_slope_change_p_value",
    "growth_exponent": "component_growth_exponent",
    "growth_exponent_standard_error": "component_growth_exponent_standard_error",
    "wall_reduction": "component_wall_reduction",
    "msd_limit": "component_msd_limit",
    "window_drift_diffusion": "component_drift_diffusion",
    "diffusion_mark": "component_diffusion_mark",
}


def has_fits_by_component(dataset: "Dataset") -> bool:
    """Return whether a dataset has cases whose motion differs along x and y."""
    return "component_diffusion" in dataset


def fits_by_component(dataset: "Dataset") -> "Dataset":
    """Return the dataset with the fits along x and y, which have a dimension `component`, in place
    of those of all motion.
    """
    fits = {}
    for name, component_name in COMPONENT_FITS.items():
        if component_name in dataset:
            fits[name] = dataset[component_name]
    return dataset.assign(fits)


def fits_along_channels(dataset: "Dataset") -> "Dataset":
    """Return the dataset with the fits along channels in place of those of all motion: of cases in
    channels D is half of the slope of the MSD along it.
    """
    if "channel_axis" not in dataset or not has_fits_by_component(dataset):
        return dataset
    by_component = fits_by_component(dataset)
    for axis in dataset.component.values:
        is_along = dataset.channel_axis == axis
        along = by_component.sel(component=axis)
        fits = {}
        for name in COMPONENT_FITS:
            if name in dataset:
                fits[name] = along[name].drop_vars("component").where(is_along, dataset[name])
        dataset = dataset.assign(fits)
    return dataset


def marked(dataset: "Dataset") -> "Dataset":
    """Return a dataset with `diffusion_mark`, its tests for a change of the slope one family; those
    along x and y are another.

    The p-values of `slope_change_p_value` are adjusted by Holm's procedure over all cases and
    windows.
    """
    all_motion = _marked(dataset)
    if not has_fits_by_component(dataset):
        return all_motion
    along = _marked(fits_by_component(dataset))
    return _with_marks_of(along, all_motion)


def _marked(dataset: "Dataset") -> "Dataset":
    p = dataset.slope_change_p_value
    adjusted = p.copy(data=holm(p.values.ravel()).reshape(p.shape))
    dataset = dataset.assign(slope_change_p_value=adjusted)
    marks = dataset.runs.astype(np.int8) * 0
    for bit, holds in _reasons(dataset).items():
        marks = marks + bit * holds.astype(np.int8)
    marks = marks.where(dataset.diffusion_coefficient.notnull(), 0).astype(np.int8)
    described = VARIABLES["diffusion_mark"].attributes
    return dataset.assign(diffusion_mark=marks.transpose(*p.dims).assign_attrs(described))


def _with_marks_of(along: "Dataset", dataset: "Dataset") -> "Dataset":
    """Return a dataset with marks and p-values of the fits along x and y."""
    return dataset.assign(
        component_slope_change_p_value=along.slope_change_p_value,
        component_diffusion_mark=along.diffusion_mark.assign_attrs(COMPONENT_MARK.attributes),
    )


def _reasons(dataset: "Dataset") -> dict[int, "DataArray"]:
    """Return for each reason where it holds; unknown numbers, NaN, do not speak against a D.

    A slope that is not above its standard error is not told from zero, and so untested, unless a
    plateau or walls are found to hold the tracer. A slope that changes, or an MSD that no longer
    grows, is put down to walls where these are felt.
    """
    uncertainty = _quantile(dataset.runs) * dataset.growth_exponent_standard_error
    drift_error = dataset.diffusion_coefficient_standard_error.fillna(0.0)
    negligible = np.fmax(drift_error, 1e-9 * abs(dataset.diffusion_coefficient))
    slope_changes = dataset.slope_change_p_value < LEVEL
    is_held = dataset.growth_exponent + uncertainty < HELD
    walls = dataset.wall_reduction > WALLS_FELT
    is_noise = dataset.slope < dataset.slope_standard_error
    earliest_start = ROUNDED * dataset.not_diffusive_before
    return {
        CHANGES: slope_changes & ~walls,
        PLATEAU: is_held & ~walls,
        WALLS: walls,
        EARLY: dataset.window_start < earliest_start,
        DRIFT: dataset.window_drift_diffusion > negligible,
        UNTESTED: dataset.slope_change_p_value.isnull() | (is_noise & ~is_held & ~walls),
    }


def _quantile(runs: "DataArray") -> "DataArray":
    """Return the t that Student's t exceeds with probability LEVEL, for these numbers of runs."""
    from scipy.special import stdtrit

    freedom = np.maximum(runs.values - 1, 1)
    return runs.copy(data=stdtrit(freedom, 1 - LEVEL))


def mark_in_words(mark: int) -> str:
    """Return the reasons of a mark in words; "" without a mark.

    >>> mark_in_words(WALLS | EARLY)
    'walls, early'
    """
    return ", ".join(name.replace("_", " ") for bit, name in REASONS.items() if mark & bit)


def best_windows(dataset: "Dataset", candidates: Iterable[tuple[Window, Window]]) -> "Dataset":
    """Return the dataset with the pair of windows in whose first most D that are stated have no
    mark.

    Of several such pairs it is the first. Where the first window of the first pair has the mark
    CHANGES or PLATEAU, a later window lacks it only if it shows the contrary by two standard
    errors: a change that is smaller than the earlier one, both over the length of the window on a
    logarithmic axis; an exponent above HELD. Large errors alone do not make a D.

    The dataset has the windows of all `candidates`.
    """
    pairs = [marked(_with_windows(dataset, window_labels(pair))) for pair in candidates]
    earliest = pairs[0].isel(window=0).reset_coords().drop_vars("window")
    return max((_changes_like(earliest, pair) for pair in pairs), key=number_of_plain)


def _changes_like(earliest: "Dataset", dataset: "Dataset") -> "Dataset":
    """Return a dataset with the marks CHANGES and PLATEAU of the earliest window also in windows
    that do not show the contrary.
    """
    marks = _lasting_marks(earliest, dataset)
    all_motion = dataset.assign(diffusion_mark=marks)
    if not has_fits_by_component(dataset):
        return all_motion
    along = fits_by_component(dataset)
    marks_along = _lasting_marks(fits_by_component(earliest), along)
    return _with_marks_of(along.assign(diffusion_mark=marks_along), all_motion)


def _lasting_marks(earliest: "Dataset", dataset: "Dataset") -> "DataArray":
    largest_change = abs(dataset.slope_change) + 2 * dataset.slope_change_standard_error
    change_before = abs(earliest.slope_change) / _length(earliest)
    smallest_exponent = dataset.growth_exponent - 2 * dataset.growth_exponent_standard_error
    shown = {
        CHANGES: largest_change / _length(dataset) < change_before,
        PLATEAU: smallest_exponent > HELD,
    }
    marks = dataset.diffusion_mark
    for bit, has_ended in shown.items():
        goes_on = (earliest.diffusion_mark & bit > 0) & ~has_ended & dataset.slope.notnull()
        marks = marks + bit * (goes_on & (marks & bit == 0))
    marks = marks.astype(np.int8).transpose(*dataset.diffusion_mark.dims)
    return marks.assign_attrs(dataset.diffusion_mark.attrs)


def _length(dataset: "Dataset") -> "DataArray":
    """Return the lengths of windows on a logarithmic axis of time; NaN from t = 0 on."""
    return np.log(dataset.window_end) - np.log(dataset.window_start.where(dataset.window_start > 0))


def _with_windows(dataset: "Dataset", names: Sequence[str]) -> "Dataset":
    """Return a dataset with these windows alone, and the models of eq. (18) that have their D."""
    others = {f"slope {name}" for name in dataset.window.values if name not in names}
    models = [model for model in dataset.model.values if model not in others]
    return dataset.sel(window=names, model=models)


def number_of_plain(dataset: "Dataset") -> int:
    """Return how many of the D that are stated have no mark in the first window: of all motion, in
    channels along them, in boxes of walls whose sides differ along both axes.
    """
    first = dataset.isel(window=0)
    is_plain = _is_plain(first)
    if not has_fits_by_component(first):
        return int(is_plain.sum())
    has_components = first.component_diffusion.notnull().any("component")
    is_stated = has_components
    if "channel_axis" in first:
        is_channel = first.channel_axis != ""
        is_stated = has_components & (~is_channel | (first.channel_axis == first.component))
    is_plain_along = _is_plain(fits_by_component(first)) & is_stated
    return int((is_plain & ~has_components).sum()) + int(is_plain_along.sum())


def _is_plain(fit: "Dataset") -> "DataArray":
    """Return where there is a D without a mark."""
    return (fit.diffusion_mark == 0) & fit.diffusion_coefficient.notnull()
