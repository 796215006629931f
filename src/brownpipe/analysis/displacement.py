"""Mean squared displacement of the tracer: its curve, its straight-line fits, its slope at each time.

S runs, T sample times, W windows. Lengths and times in the scene's own units.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.analysis import resampling
from brownpipe.analysis.conditions import initial_square_speed
from brownpipe.analysis.measure import Columns, Measure, scaled, with_error, with_interval
from brownpipe.analysis.variables import AREA, EACH, RATE, Variable, error_of, estimate_of, kept_always
from brownpipe.observables import displacement as of_a_run

SAME_TIME = 1e-9  # relative difference of sample times that are one: k dt depends on dt by round-off


class Line(NamedTuple):
    """A least-squares line through points (t, y) inside a window."""

    slope: float
    intercept: float
    naive_slope_error: float  # by least squares for independent points; not valid for an MSD, see `fit_line`


def squared_displacement(position, image=None, size=(0.0, 0.0)):
    """Squared distance from the start, (S, T), of tracks `position` (T, S, 2), as measured in a run."""
    return np.ascontiguousarray(of_a_run.square_from_start(position, image, size).T)


def line_weights(times, window):
    """Weights (2, T) such that slope, intercept = weights @ y is the least-squares line through y(t) in `window`.

    Points count from the window's start to its end, both included. NaN where the line is not defined: the times end
    before the window does, or fewer than three fall into it.
    """
    inside = _inside(times, window)
    if np.count_nonzero(inside) < 3:
        return np.full((2, len(times)), np.nan)
    middle = times[inside].mean()
    centred = np.where(inside, times - middle, 0.0)
    slope = centred / (centred**2).sum()
    return np.stack([slope, inside / np.count_nonzero(inside) - middle * slope])


def _inside(times, window):
    """Which times (T,) lie in the window, but for round-off; none if they do not reach its end."""
    start, end = window
    slack = 1e-9 * max(abs(start), abs(end))
    return (times >= start - slack) & (times <= end + slack) & (times[-1] >= end - slack)


def fit_line(times, values, window):
    """Least-squares line through `values` (T,) at `times` (T,) inside `window`.

    The points of an MSD curve come from the same runs, so the standard error of least squares, which is for independent
    points, is not valid (13 times too small in the note's scene). For the slope's true error `resample` the slopes of
    the single runs, `per_run_lines`.
    """
    slope, intercept = (line_weights(times, window) * values).sum(axis=-1)
    inside = _inside(times, window)
    if np.isnan(slope):
        return Line(np.nan, np.nan, np.nan)
    residual = (values - intercept - slope * times)[inside]
    spread = ((times[inside] - times[inside].mean()) ** 2).sum()
    return Line(slope, intercept, np.sqrt((residual**2).sum() / (residual.size - 2) / spread))


def per_run_lines(squared, times, windows):
    """Slope and intercept of every single run over each window, (S, 2, W). Their means are those of the MSD's line."""
    lines = [(squared[:, None, :] * line_weights(times, window)).sum(axis=-1) for window in windows]
    return np.stack(lines, axis=-1)


def labels(windows):
    """Names of windows, from their first six digits."""
    return [f"[{start:g}, {end:g}]" for start, end in windows]


# --- the measure


def squared_of(case, runs):
    """Squared displacement (n, T) of every run, None if there is none: as observed, else of the tracer's track."""
    if "square_displacement" in runs.observables:
        return runs.observables["square_displacement"]
    return from_start(case, runs)


def from_start(case, runs):
    """Squared distance (n, T) of the tracer from where it started, None if it was not recorded."""
    if runs.tracer is None:
        return runs.observables.get("square_displacement") if case.average == "runs" else None
    return squared_displacement(runs.tracer.position, runs.tracer.image, (case.scene.box.width, case.scene.box.height))


def with_velocity(case, runs, name):
    """The observable `displacement_velocity` or `velocity_displacement` (n, T) of every run.

    v(t).(r(t) - r(0)) or v(0).(r(t) - r(0)): as observed, else of the tracer's track; None if that has no velocities.
    """
    if name in runs.observables or runs.tracer is None or runs.tracer.velocity is None:
        return runs.observables.get(name)
    position, velocity, image = runs.tracer
    moved = of_a_run.displacement(position, image, (case.scene.box.width, case.scene.box.height))
    return of_a_run.dot(moved, velocity if name == "displacement_velocity" else velocity[:1]).T


def _sample(case, runs):
    squared = squared_of(case, runs)
    if squared is None:
        return Columns()
    means = {"msd": squared, "lines": per_run_lines(squared, case.times, case.asked.windows)}
    growth = with_velocity(case, runs, "displacement_velocity")
    if growth is not None:
        means["diffusion_running"] = growth / 2
    v2 = runs.observables.get("initial_square_speed")
    if v2 is None or np.isnan(initial_square_speed(case.scene)):
        return Columns(means)
    return Columns(means | {"v2": v2}, {"r2_v2": squared * v2[:, None]})


def _estimate(case, found):
    if "msd" not in found:
        return {}
    msd, lines, times = found.estimate("msd"), found.estimate("lines"), case.times
    slope, intercept = (resampling.Estimate(*(values[k] for values in lines)) for k in range(2))
    over_4t = np.divide(0.25, times, out=np.full(len(times), np.nan), where=times > 0)
    values = {
        **with_interval("msd", msd),
        **with_interval("msd_over_4t", scaled(msd, over_4t)),
        **with_interval("slope", slope),
        **with_error("intercept", intercept),
        "naive_slope_error": [fit_line(times, msd.mean, window).naive_slope_error for window in case.asked.windows],
        **with_interval("diffusion_coefficient", scaled(slope, 0.25)),
    }
    if "diffusion_running" in found:
        values |= with_interval("diffusion_running", found.estimate("diffusion_running"))
    return values | _controlled(case, found)


def _controlled(case, found):
    """MSD with the initial square speed as control variate, and the ratio of its variance to that of the plain mean.

    <r^2> - b (<v0^2> - its exact mean), b the regression of r^2 on v0^2 over runs (R. Y. Rubinstein and R. Marcus,
    Oper. Res. 33, 661 (1985)). In the replicates the mean over all runs is the exact one. {} where v0 is always the
    same.
    """
    if "r2_v2" not in found or not found.variance("v2") > 0.0 or found.runs < 3:
        return {}
    r2, v2, drawn_r2, drawn_v2 = found.mean("msd"), found.mean("v2"), found.drawn("msd"), found.drawn("v2")[:, None]
    b, left = _regression(found.mean("r2_v2") - r2 * v2, found.variance("msd"), found.variance("v2"))
    of_r2, of_v2 = found.drawn_variance("msd"), found.drawn_variance("v2")[:, None]
    drawn_b, drawn_left = _regression(found.drawn("r2_v2") - drawn_r2 * drawn_v2, of_r2, of_v2)
    value = r2 - b * (v2 - initial_square_speed(case.scene))
    error = np.sqrt(left / (found.runs - 2))
    shift = drawn_r2 - drawn_b * (drawn_v2 - v2) - r2
    estimate = resampling.studentized(found.runs, value, error, shift, drawn_left / resampling.degrees(found.sums))
    whole = found.variance("msd")
    ratio = np.divide(left, whole, out=np.full_like(whole, np.nan), where=whole > 0.0)
    return with_interval("msd_controlled", estimate) | {"control_variance_ratio": ratio}


def _regression(covariance, of_r2, of_v2):
    """Coefficient of the regression of r^2 on v0^2, and the variance of r^2 that it leaves."""
    b = np.divide(covariance, of_v2, out=np.zeros_like(covariance), where=of_v2 > 0.0)
    return b, np.maximum(of_r2 - b * covariance, 0.0)


def _axes(case, found):
    windows = case.asked.windows
    return {
        "window": ("window", labels(windows)),
        "window_start": ("window", [start for start, _ in windows]),
        "window_end": ("window", [end for _, end in windows]),
    }


TIME, WINDOW = (*EACH, "time"), (*EACH, "window")

MEASURE = Measure(
    _sample,
    _estimate,
    kept_always(
        {
            **estimate_of("msd", TIME, AREA, "mean squared displacement of the tracer"),
            **estimate_of("msd_over_4t", TIME, RATE, "mean squared displacement over 4 t"),
            **estimate_of(
                "slope", WINDOW, RATE, "least-squares slope of the mean squared displacement over the window"
            ),
            **error_of("intercept", WINDOW, AREA, "intercept of the least-squares line over the window"),
            "naive_slope_error": Variable(
                WINDOW,
                RATE,
                "the standard error that least squares would state for independent points; an MSD's points are the "
                "same runs, so it is not valid",
            ),
            **estimate_of("diffusion_coefficient", WINDOW, RATE, "diffusion coefficient, slope/4, over the window"),
        }
    )
    | estimate_of(
        "diffusion_running",
        TIME,
        RATE,
        "half of <v(t).(r(t) - r(0))> of the tracer, which is d<r^2>/dt / 4 at the time",
    )
    | estimate_of("msd_controlled", TIME, AREA, "mean squared displacement with the known <v0^2> as control variate")
    | {"control_variance_ratio": Variable(TIME, "1", "variance of msd_controlled over that of msd")},
    _axes,
    {
        "window": {"long_name": "window of time of the straight-line fit"},
        "window_start": {"units": "time", "long_name": "start of the window"},
        "window_end": {"units": "time", "long_name": "end of the window"},
    },
)
