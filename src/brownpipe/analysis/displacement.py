"""Mean squared displacement of the tracer: the curve, straight-line fits in windows; its limits,
from the scene alone.

S runs, n runs of a block, T sample times, W windows. Lengths and times in the reduced units of the
scene. See docs/theory.md, section 5.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Averages, Case, Columns
from brownpipe.analysis.variables import (
    AREA,
    EACH,
    ERROR,
    FOLLOWED,
    RATE,
    SEED,
    SPEED2,
    TIME,
    Mean,
    Variable,
)
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.friction import DECAY_TIMES, are_inside, diffusive_from
from brownpipe.observables.displacement import displacement, squared
from brownpipe.scene import Scene, motion

# relative distance from the centre, or difference of the sides, that counts as round-off
CENTRED = 1e-12


def line_weights(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return weights (2, T) such that slope, intercept = weights @ y is the least-squares line
    through y(t).

    The line is fitted from the window's start to its end, both included to round-off. NaN where it
    is not defined: the times (T,) end before the window does, or fewer than three lie in it.
    """
    inside = are_inside(times, window)
    if np.count_nonzero(inside) < 3 or times[-1] < (1 - 1e-9) * window[1]:
        return np.full((2, len(times)), np.nan)
    middle = times[inside].mean()
    centred = np.where(inside, times - middle, 0.0)
    slope = centred / (centred**2).sum()
    return np.stack([slope, inside / np.count_nonzero(inside) - middle * slope])


def per_run_lines(
    squared: np.ndarray, times: np.ndarray, windows: Sequence[tuple[float, float]]
) -> np.ndarray:
    """Return slope and intercept (S, 2, W) of the line through r^2(t) (S, T) of every run in each
    window.

    Least squares is linear: their means over runs are slope and intercept of the line through the
    MSD.
    """
    return np.stack(
        [(squared[:, None, :] * line_weights(times, one)).sum(axis=-1) for one in windows], axis=-1
    )


def labels(windows: Sequence[tuple[float, float]]) -> list[str]:
    """Return labels of windows, from the first six digits of their ends."""
    return [f"[{start:g}, {end:g}]" for start, end in windows]


# --- what is known before any run: box, disks, initial state of the tracer


def accessible_half_width(scene: Scene) -> float:
    """Return half the side [length] of the square accessible to the tracer's centre; NaN if it
    starts elsewhere.

    Needed for diffusion in a reflecting square (docs/theory.md, section 2), which is solved for a
    start in its centre.
    """
    box, start = scene.box, next((disk.position for disk in scene.listed or scene.species), None)
    moved = scene.equilibrate.time > 0 and scene.equilibrate.tracer == "free"
    if box.periodic or moved or start is None or abs(box.width - box.height) > CENTRED * box.width:
        return np.nan
    off_centre = np.abs(np.array(start) - [sum(box.x) / 2, sum(box.y) / 2]).max()
    half_width = (box.width - 2 * scene.radius[0]) / 2
    return half_width if off_centre <= CENTRED * box.width and half_width > 0 else np.nan


# --- the estimator


def squared_of(case: Case, runs: Ensemble) -> np.ndarray | None:
    """Return the squared displacement (n, T) of every run: the observable, else from the tracer's
    track; else None.
    """
    measured = runs.observables.get("square_displacement")
    return tracer_square_displacement(case, runs) if measured is None else measured


def tracer_square_displacement(case: Case, runs: Ensemble) -> np.ndarray | None:
    """Return the squared distance (n, T) of the tracer from its start, None if it was not recorded.

    Unlike `squared_of` it is never an average over time origins or disks.
    """
    if runs.tracer is None:
        return runs.observables.get("square_displacement") if case.average == "runs" else None
    size = (case.scene.box.width, case.scene.box.height)
    return np.ascontiguousarray(
        squared(displacement(runs.tracer.position, runs.tracer.image, size)).T
    )


def columns(case: Case, runs: Ensemble) -> Columns:
    """Return r^2 at all times, the lines in all windows and the friction of the langevin engine.

    Also keep r^2 at the end and D in the first window of every run.
    """
    square = squared_of(case, runs)
    if square is None:
        return Columns()
    lines = per_run_lines(square, case.times, case.windows)
    kept = {"run_msd": square[:, -1], "run_diffusion_coefficient": lines[:, 0, 0] / 4}
    friction = {name: one for name, one in runs.observables.items() if name == "friction_rate"}
    return Columns(
        {"msd": square, "slope": lines[:, 0], "intercept": lines[:, 1]} | friction, kept=kept
    )


def results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return windows, MSD and fits, and what is known of the scene before any run."""
    windows, times, scene = case.windows, case.times, case.scene
    friction = averages.mean("friction_rate") if "friction_rate" in averages.places else np.nan
    values: dict[str, ArrayLike] = {
        "window": labels(windows),
        "window_start": [start for start, _ in windows],
        "window_end": [end for _, end in windows],
        "box_width": scene.box.width,
        "duration": times[-1],
        "packing_fraction": scene.packing_fraction,
        "initial_square_speed": motion.mean_square_speed_of_tracer(scene),
        "diffusive_from": DECAY_TIMES / friction if friction > 0 else diffusive_from(scene),
        "accessible_half_width": accessible_half_width(scene),
    }
    if "msd" not in averages.places:
        return values
    msd, slope = averages.estimate("msd"), averages.estimate("slope")
    over_4t = np.divide(0.25, times, out=np.full(len(times), np.nan), where=times > 0)
    values |= {"msd": msd, "msd_over_4t": msd.scaled(over_4t)}
    return values | {"slope": slope, "diffusion_coefficient": slope.scaled(0.25)}


WINDOW = (*EACH, "window")

VARIABLES = {
    "msd": Mean(TIME, AREA, f"mean squared displacement {FOLLOWED}"),
    "msd_over_4t": Mean(TIME, RATE, "mean squared displacement over 4 t"),
    "slope": Mean(
        WINDOW, RATE, "least-squares slope of the mean squared displacement in the window"
    ),
    "intercept": Variable(WINDOW, AREA, "intercept of the least-squares line in the window", ERROR),
    "run_msd": Variable(SEED, AREA, "squared displacement of a run at its end"),
    "run_diffusion_coefficient": Variable(
        SEED, RATE, "slope/4 of a run's squared displacement in the first window"
    ),
    "diffusion_coefficient": Mean(WINDOW, RATE, "diffusion coefficient, slope/4, in the window"),
    "box_width": Variable(EACH, "length", "width of the box"),
    "duration": Variable(EACH, "time", "duration of a run"),
    "packing_fraction": Variable(EACH, "1", "packing fraction, share of the area covered by disks"),
    "initial_square_speed": Variable(
        EACH, SPEED2, "expected <v0^2> of the tracer: the MSD begins as <v0^2> t^2"
    ),
    "diffusive_from": Variable(
        EACH, "time", "3/gamma of the tracer: lines may be fitted to the MSD after it"
    ),
    "accessible_half_width": Variable(
        EACH, "length", "half the side of the square in whose centre the tracer starts"
    ),
}
COORDINATES = {
    "window": Variable(("window",), None, "time window of the straight-line fit"),
    "window_start": Variable(("window",), "time", "start of the window"),
    "window_end": Variable(("window",), "time", "end of the window"),
}
