"""Mean squared displacement of the tracer: the curve, straight-line fits in windows, the slope at each time.

S runs, n runs of a block, T sample times, W windows. Lengths and times in the reduced units of the scene. See
docs/theory.md, section 5.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.variables import AREA, EACH, ERROR, FOLLOWED, RATE, TIME, Mean, Variable
from brownpipe.engines.ensemble import Ensemble
from brownpipe.observables import displacement as of_a_run


def squared_displacement(
    position: np.ndarray, image: np.ndarray | None = None, size: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Return the squared distance from the start, (S, T) [length^2], of tracks `position` (T, S, 2).

    image: (T, S, 2) periodic images in a box of `size`, None between walls.
    """
    return np.ascontiguousarray(of_a_run.square_from_start(position, image, size).T)


def line_weights(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return weights (2, T) such that slope, intercept = weights @ y is the least-squares line through y(t).

    The line is fitted from the window's start to its end, both included to round-off. NaN where it is not defined: the
    times (T,) end before the window does, or fewer than three lie in it.
    """
    start, end = window
    slack = 1e-9 * max(abs(start), abs(end))
    inside = (times >= start - slack) & (times <= end + slack) & (times[-1] >= end - slack)
    if np.count_nonzero(inside) < 3:
        return np.full((2, len(times)), np.nan)
    middle = times[inside].mean()
    centred = np.where(inside, times - middle, 0.0)
    slope = centred / (centred**2).sum()
    return np.stack([slope, inside / np.count_nonzero(inside) - middle * slope])


def per_run_lines(squared: np.ndarray, times: np.ndarray, windows: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return slope and intercept (S, 2, W) of the line through r^2(t) (S, T) of every run in each window.

    Least squares is linear: their means over runs are slope and intercept of the line through the MSD.
    """
    lines = [(squared[:, None, :] * line_weights(times, window)).sum(axis=-1) for window in windows]
    return np.stack(lines, axis=-1)


def labels(windows: Sequence[tuple[float, float]]) -> list[str]:
    """Return labels of windows, from the first six digits of their ends."""
    return [f"[{start:g}, {end:g}]" for start, end in windows]


# --- the estimator


def squared_of(case: Case, runs: Ensemble) -> np.ndarray | None:
    """Return the squared displacement (n, T) of every run: the observable, else from the tracer's track; else None."""
    if "square_displacement" in runs.observables:
        return runs.observables["square_displacement"]
    return tracer_square_displacement(case, runs)


def tracer_square_displacement(case: Case, runs: Ensemble) -> np.ndarray | None:
    """Return the squared distance (n, T) of the tracer from its start, None if it was not recorded.

    Unlike `squared_of` it is never an average over time origins or disks.
    """
    if runs.tracer is None:
        return runs.observables.get("square_displacement") if case.average == "runs" else None
    return squared_displacement(runs.tracer.position, runs.tracer.image, (case.scene.box.width, case.scene.box.height))


def _columns(case: Case, runs: Ensemble) -> Columns:
    squared = squared_of(case, runs)
    if squared is None:
        return Columns()
    return Columns({"msd": squared, "lines": per_run_lines(squared, case.times, case.windows)})


def of_each_run(columns: Columns) -> dict[str, np.ndarray]:
    """Return the square displacement of each run at its end, and its slope/4 in the first window, (n,)."""
    if "msd" not in columns.means:
        return {}
    return {"run_msd": columns.means["msd"][:, -1], "run_diffusion_coefficient": columns.means["lines"][:, 0, 0] / 4}


def _derived(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    windows, times = case.windows, case.times
    values: dict[str, ArrayLike] = {
        "window": labels(windows),
        "window_start": [start for start, _ in windows],
        "window_end": [end for _, end in windows],
    }
    if "msd" not in averages:
        return values
    msd, lines = averages.estimate("msd"), averages.estimate("lines")
    slope, intercept = lines.at(0), lines.at(1)
    over_4t = np.divide(0.25, times, out=np.full(len(times), np.nan), where=times > 0)
    return {
        **values,
        "msd": msd,
        "msd_over_4t": msd.scaled(over_4t),
        "slope": slope,
        "intercept": intercept,
        "diffusion_coefficient": slope.scaled(0.25),
    }


WINDOW, SEED = (*EACH, "window"), (*EACH, "seed")

VARIABLES = {
    "msd": Mean(TIME, AREA, f"mean squared displacement {FOLLOWED}"),
    "msd_over_4t": Mean(TIME, RATE, "mean squared displacement over 4 t"),
    "slope": Mean(WINDOW, RATE, "least-squares slope of the mean squared displacement in the window"),
    "intercept": Variable(WINDOW, AREA, "intercept of the least-squares line in the window", ERROR),
    "run_msd": Variable(SEED, AREA, "squared displacement of a run at its end"),
    "run_diffusion_coefficient": Variable(SEED, RATE, "slope/4 of a run's squared displacement in the first window"),
    "diffusion_coefficient": Mean(WINDOW, RATE, "diffusion coefficient, slope/4, in the window"),
}
COORDINATES = {
    "window": Variable(("window",), None, "time window of the straight-line fit"),
    "window_start": Variable(("window",), "time", "start of the window"),
    "window_end": Variable(("window",), "time", "end of the window"),
}
ESTIMATOR = Estimator(_columns, VARIABLES, _derived, COORDINATES)
