"""Motion of the tracer along x and along y: mean squared displacement of each component and, where
the box makes them differ, its straight-line fits and the diffusion coefficient along each axis.

n runs of a block, T sample times, W windows. See docs/theory.md, section 5.
"""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import displacement
from brownpipe.analysis.diffusive import COMPONENT_MARK
from brownpipe.analysis.distribution import kurtosis
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.variables import (
    AREA,
    CASE_DIMS,
    ERROR,
    FOLLOWED,
    RATE,
    SEED,
    SPEED2,
    Mean,
    Variable,
)
from brownpipe.engines.ensemble import Ensemble

# Variable: the array of runs whose mean it is; there where the axes differ
VELOCITY_ARRAYS = {
    "component_velocity_autocorrelation": "component_velocity_autocorrelation",
    "component_green_kubo": "component_velocity_displacement",
    "component_diffusion_running": "component_displacement_velocity",
}
# of x^2 and x^4 of each run, and their product
MOMENTS = ("component_msd", "component_quartic_displacement", "component_square_times_quartic")


def component_columns(case: Case, runs: Ensemble) -> Columns:
    """Return x^2 and y^2 at all times; where the axes differ the lines in all windows, what follows
    from velocities, and the moments for the non-Gaussian parameters.
    """
    means = {}
    for name, measured in VELOCITY_ARRAYS.items():
        if measured in runs.observables:
            means[name] = runs.observables[measured]
    square = displacement.component_squares(case, runs)
    if square is None:
        return Columns(means)
    means["component_msd"] = square
    quartic = runs.observables.get("component_quartic_displacement")
    if quartic is not None:
        means["component_quartic_displacement"] = quartic
        means["component_square_times_quartic"] = square * quartic
    if not case.scene.box.axes_differ:
        return Columns(means)
    along = [displacement.per_run_fits(square[:, axis], case) for axis in (0, 1)]
    for name in along[0]:
        means[f"component_{name}"] = np.stack([fits[name] for fits in along], axis=1)
    run_values = {
        "run_component_msd": square[..., -1],
        "run_component_diffusion": means["component_slope"] / 2,
    }
    return Columns(means, run_values=run_values)


def component_results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return D along each axis and what tells whether it is one, and the non-Gaussian
    parameters.
    """
    values: dict[str, ArrayLike] = {}
    if case.scene.box.is_channel:
        values["channel_axis"] = "x" if case.scene.box.periodic_x else "y"
    if "component_quartic_displacement" in averages.places:
        values["component_non_gaussian_parameter"] = _non_gaussian_parameter(averages)
    if "component_slope" not in averages.places:
        return values
    slope = averages.estimate("component_slope")
    change = averages.estimate("component_slope_change")
    msd = averages.estimate("component_msd")
    ends = np.array([end for _, end in case.windows])
    msd_at_ends = np.stack([np.interp(ends, case.times, along) for along in msd.mean])
    exponent = displacement.growth_exponent(slope, ends, msd_at_ends)
    reductions = [
        [displacement.wall_reduction_along(axis, case.scene, case.average, value) for value in row]
        for axis, row in enumerate(msd_at_ends)
    ]
    return values | {
        "component_slope": slope,
        "component_diffusion": slope.scaled(0.5),
        "component_slope_change": change.mean,
        "component_slope_change_standard_error": change.standard_error,
        "component_slope_change_p_value": displacement.p_value(change, slope.mean, averages.runs),
        "component_growth_exponent": exponent.mean,
        "component_growth_exponent_standard_error": exponent.standard_error,
        "component_wall_reduction": reductions,
        "component_msd_limit": displacement.msd_limits(case.scene, case.average),
        "component_drift_diffusion": _drift_diffusion(case),
    }


def _drift_diffusion(case: Case) -> np.ndarray:
    """Return what the drift of all disks adds to D along each axis (2, W) [length^2/time].

    The drift is along the periodic axis of a channel alone, and D there half of a slope: it adds
    twice as much as to a quarter of the slope of the MSD. NaN across walls, which stop it.
    """
    drifts = [displacement.window_drift_diffusion(case, window) for window in case.windows]
    is_periodic = case.scene.box.periodic_axes[:, None]
    return np.where(is_periodic, 2 * np.array(drifts), np.nan)


def _non_gaussian_parameter(averages: Averages) -> Estimate:
    """Return <x^4>/(3 <x^2>^2) - 1 along x and y (2, T): 0 for a normal displacement."""
    shape = averages.places["component_msd"].shape
    parts = []
    for values in kurtosis(averages, MOMENTS).scaled(2 / 3):
        parts.append(values.reshape(shape))
    mean, error, low, high = parts
    return Estimate(mean - 1, error, low - 1, high - 1)


TIME = (*CASE_DIMS, "component", "time")
WINDOW = (*CASE_DIMS, "component", "window")

VARIABLES = {
    "component_msd": Mean(TIME, AREA, f"mean squared displacement along x and y {FOLLOWED}"),
    "component_velocity_autocorrelation": Mean(
        TIME, SPEED2, f"velocity autocorrelation v_x(0) v_x(t) along x and y {FOLLOWED}"
    ),
    "component_green_kubo": Mean(
        TIME, RATE, f"integral of the velocity autocorrelation along x and y {FOLLOWED}"
    ),
    "component_diffusion_running": Mean(
        TIME, RATE, f"half of the rate of change of the MSD along x and y {FOLLOWED}"
    ),
    "component_slope": Mean(
        WINDOW, RATE, "least-squares slope of the MSD along x and y in the window"
    ),
    "component_intercept": Variable(
        WINDOW, AREA, "intercept of the least-squares line along x and y in the window", ERROR
    ),
    "component_diffusion": Mean(
        WINDOW, RATE, "diffusion coefficient along x and y, slope/2, in the window"
    ),
    "run_component_msd": Variable(
        (*SEED, "component"), AREA, "squared displacement of a run along x and y at its end"
    ),
    "run_component_diffusion": Variable(
        (*SEED, "component", "window"),
        RATE,
        "slope/2 of a run's squared displacement along x and y in the window",
    ),
    "component_slope_change": Variable(
        WINDOW, RATE, "slope along x and y in the second half of the window minus the first", ERROR
    ),
    "component_slope_change_p_value": Variable(
        WINDOW,
        "1",
        "p-value of the change along x and y if it is small, adjusted for the dataset (Holm)",
    ),
    "component_growth_exponent": Variable(
        WINDOW,
        "1",
        "exponent of the MSD along x and y at the end of the window; 1: diffusion",
        ERROR,
    ),
    "component_wall_reduction": Variable(
        WINDOW,
        "1",
        "share by which walls reduce the slope along x and y at the end of the window",
    ),
    "component_msd_limit": Variable(
        (*CASE_DIMS, "component"),
        AREA,
        "mean squared displacement along x and y of a tracer that has filled the box",
    ),
    "component_drift_diffusion": Variable(
        WINDOW, RATE, "what the drift of all disks adds to D along x and y in the window"
    ),
    "component_diffusion_mark": COMPONENT_MARK,
    "channel_axis": Variable(
        CASE_DIMS,
        None,
        "axis along which a channel is periodic; empty for other boxes",
        dtype=object,
        absent="",
    ),
    "component_non_gaussian_parameter": Mean(
        TIME,
        "1",
        "non-Gaussian parameter along x and y, <d^4>/(3 <d^2>^2) - 1 of displacements d; 0 for a "
        "normal distribution",
    ),
}

ESTIMATOR = Estimator(
    name="components",
    variables=VARIABLES,
    columns=component_columns,
    results=component_results,
)
