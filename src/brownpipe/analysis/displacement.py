"""Mean squared displacement of the tracer: the curve, straight-line fits in windows; its limits,
from the scene alone.

S runs, n runs of a block, T sample times, W windows. Lengths and times in the reduced units of the
scene. See docs/theory.md, section 5.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from brownpipe import theory
from brownpipe.analysis.diffusive import FEWEST_RUNS, SMALL_FALL, SMALL_GROWTH, WALLS_FELT
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.runs import Group, first_good_runs
from brownpipe.analysis.variables import (
    AREA,
    CASE_DIMS,
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
from brownpipe.engines.friction import DECAY_TIMES, drift_diffusion, not_diffusive_before
from brownpipe.engines.windows import (
    Window,
    candidate_windows,
    earlier_ends,
    times_in_window,
    window_labels,
)
from brownpipe.observables.displacement import squared
from brownpipe.observables.trajectory import displacement
from brownpipe.scene import Scene, motion

# relative distance from the centre, or difference of the sides, that counts as round-off
CENTRED = 1e-12


def line_weights(times: np.ndarray, window: Window) -> np.ndarray:
    """Return weights (2, T) such that slope, intercept = weights @ y is the least-squares line
    through y(t).

    The line is fitted from the window's start to its end, both included to round-off. NaN where it
    is not defined: the times (T,) end before the window does, or fewer than three lie in it.
    """
    inside = times_in_window(times, window)
    if np.count_nonzero(inside) < 3 or times[-1] < (1 - 1e-9) * window[1]:
        return np.full((2, len(times)), np.nan)
    middle = times[inside].mean()
    centred = np.where(inside, times - middle, 0.0)
    slope = centred / (centred**2).sum()
    mean = inside / np.count_nonzero(inside)
    return np.stack([slope, mean - middle * slope])


def change_weights(times: np.ndarray, window: Window) -> np.ndarray:
    """Return weights (T,) such that weights @ y is by how much the slope of y(t) changes in a
    window.

    It is the slope of the least-squares line through the samples in its second half minus that
    through the first half. The halves meet at the geometric mean of the first and the last sample,
    so that the window [1, 9] is divided at 3; the sample next to it belongs to both. NaN where the
    line over the whole window is not defined, and for fewer than three samples after t = 0.
    """
    inside = np.flatnonzero(times_in_window(times, window) & (times > 0))
    if len(inside) < 3 or np.isnan(line_weights(times, window)).any():
        return np.full(len(times), np.nan)
    geometric_mean = np.sqrt(times[inside[0]] * times[inside[-1]])
    middle = np.searchsorted(times, geometric_mean)
    middle = min(max(middle, inside[1]), inside[-2])
    first_half = inside[inside <= middle]
    second_half = inside[inside >= middle]
    change = np.zeros(len(times))
    change[second_half] += _slope_weights(times[second_half])
    change[first_half] -= _slope_weights(times[first_half])
    return change


def _slope_weights(times: np.ndarray) -> np.ndarray:
    """Return weights (T,) of the slope of the least-squares line through samples at these times."""
    centred = times - times.mean()
    return centred / (centred**2).sum()


def per_run_lines(squared: np.ndarray, times: np.ndarray, windows: Sequence[Window]) -> np.ndarray:
    """Return slope and intercept (S, 2, W) of the line through r^2(t) (S, T) of every run in each
    window.

    Least squares is linear: their means over runs are slope and intercept of the line through the
    MSD.
    """
    lines = [(squared[:, None, :] * line_weights(times, window)).sum(axis=-1) for window in windows]
    return np.stack(lines, axis=-1)


# --- what is known before any run: box, disks, initial state of the tracer


def accessible_half_width(scene: Scene) -> float:
    """Return half the side [length] of the square accessible to the tracer's centre; NaN if it
    starts elsewhere.

    Needed for diffusion in a reflecting square (docs/theory.md, section 2), which is solved for a
    start in its centre.
    """
    box = scene.box
    start = known_start(scene, "runs")
    if box.has_images or start is None or abs(box.width - box.height) > CENTRED * box.width:
        return np.nan
    centre = [sum(box.x) / 2, sum(box.y) / 2]
    off_centre = np.abs(np.array(start) - centre).max()
    half_width = (box.width - 2 * scene.radius[0]) / 2
    return half_width if off_centre <= CENTRED * box.width and half_width > 0 else np.nan


def known_start(scene: Scene, average: str) -> tuple[float, float] | None:
    """Return where the displacements of the tracer begin [length]; None if that may be anywhere.

    A tracer begins at its position of the scene unless it moves before t = 0. With averages over
    time origins or disks displacements begin anywhere.
    """
    is_free = scene.equilibrate.time > 0 and scene.equilibrate.tracer == "free"
    return None if is_free or average != "runs" else scene.tracer_position


def msd_limit(scene: Scene, average: str) -> float:
    """Return the MSD [length^2] of a tracer that has long filled the box; NaN if some of its sides
    are periodic.

    Its centre is then anywhere in the accessible rectangle.
    """
    return float(msd_limits(scene, average).sum())


def msd_limits(scene: Scene, average: str) -> np.ndarray:
    """Return the MSD along x and along y (2,) [length^2] of a tracer that has long filled the box;
    NaN along a periodic axis.
    """
    if not scene.particles:
        return np.full(2, np.nan)
    _, size = scene.box.accessible(scene.radius[0])
    long_after = 10 * size.max() ** 2  # D t
    limits = []
    for axis, is_periodic in enumerate(scene.box.periodic_axes):
        msd, _ = _msd_along_axis(axis, scene, average, long_after)
        limits.append(np.nan if is_periodic else msd)
    return np.array(limits)


def wall_reduction(scene: Scene, average: str, msd: float) -> float:
    """Return the share by which walls reduce the slope of the MSD when it has reached `msd`.

    For diffusion in the accessible rectangle, from where the displacements begin: 0 as long as the
    walls are not felt, 1 when the box is filled. From the middle of a square it is 0.1 at 39 % of
    the limit of the MSD, for starts anywhere at 2 %. In a channel it is 1/2 in the end: only the
    motion along it goes on. NaN in a periodic box, and for an MSD that is not positive.
    """
    if not (scene.particles and scene.box.has_walls and msd > 0):
        return np.nan
    _, size = scene.box.accessible(scene.radius[0])
    if not size.any():
        return np.nan
    largest = 2 * size.max() ** 2  # D t, at which the box is filled to 1e-8
    if scene.box.is_channel:
        largest = msd / 2  # D t, if the tracer moved along it alone
    msd_then, _ = _msd_between_walls(scene, average, largest)
    if msd_then <= msd and not scene.box.is_channel:
        return 1.0
    slope = _slope_at(partial(_msd_between_walls, scene, average), msd, largest)
    return 1 - slope / 4


def wall_reduction_along(axis: int, scene: Scene, average: str, msd: float) -> float:
    """Return the share by which walls reduce the slope of the MSD along x (0) or y (1) when it has
    reached `msd`: as `wall_reduction`, but of this component alone.

    0 along a periodic axis; NaN without room to move, and for an MSD that is not positive.
    """
    if scene.box.periodic_axes[axis]:
        return 0.0
    _, size = scene.box.accessible(scene.radius[0])
    if not (size[axis] > 0 and msd > 0):
        return np.nan
    largest = 2 * size[axis] ** 2  # D t, at which the width is filled to 1e-8
    msd_then, _ = _msd_along_axis(axis, scene, average, largest)
    if msd_then <= msd:
        return 1.0
    slope = _slope_at(partial(_msd_along_axis, axis, scene, average), msd, largest)
    return 1 - slope / 2


def _slope_at(
    motion_at: Callable[[float], tuple[float, float]], msd: float, largest: float
) -> float:
    """Return the derivative of the MSD by D t where it has reached `msd` [length^2].

    motion_at: MSD and this derivative at a value of D t, of which `largest` is beyond `msd`.
    """
    from scipy.optimize import brentq

    def excess(half_variance: float) -> float:
        msd_then, _ = motion_at(half_variance)
        return msd_then - msd

    _, slope = motion_at(brentq(excess, 0.0, largest, rtol=1e-9))
    return slope


def _msd_between_walls(scene: Scene, average: str, half_variance: float) -> tuple[float, float]:
    """Return MSD [length^2] and its derivative by D t, where D t is `half_variance` [length^2]: the
    sums over x and y.
    """
    msd_x, slope_x = _msd_along_axis(0, scene, average, half_variance)
    msd_y, slope_y = _msd_along_axis(1, scene, average, half_variance)
    return msd_x + msd_y, slope_x + slope_y


def _msd_along_axis(
    axis: int, scene: Scene, average: str, half_variance: float
) -> tuple[float, float]:
    """Return MSD [length^2] along x (0) or y (1) and its derivative by D t, where D t is
    `half_variance` [length^2]: along a periodic axis 2 D t and 2, along one without room to move 0.
    """
    if scene.box.periodic_axes[axis]:
        return 2 * half_variance, 2.0
    corner, size = scene.box.accessible(scene.radius[0])
    length = size[axis]
    if not length > 0:
        return 0.0, 0.0
    start = known_start(scene, average)
    from_wall = None if start is None else start[axis] - corner[axis]
    msd = theory.reflecting_interval_msd(half_variance, length, from_wall)
    slope = theory.reflecting_interval_slope(half_variance, length, from_wall)
    return msd, slope


def window_drift_diffusion(case: Case, window: Window) -> float:
    """Return what the drift of all disks adds to D [length^2/time] in a window from t0 to t1.

    The centre of mass moves by V t, which adds V^2 t^2 to the MSD and V^2 (t0 + t1)/4 to a quarter
    of the slope of the straight line. NaN where the engine moves the tracer alone, or walls stop
    the drift, and for a lone disk, which drifts with no other.
    """
    if not case.engine.moves_all_disks or case.scene.particles == 1:
        return np.nan
    start, end = window
    return drift_diffusion(case.scene) * (start + end) / (2 * case.scene.duration)


# --- the estimator


def best_end(cases: Sequence[Case], groups: Sequence[Group]) -> float:
    """Return when default windows end [time]: the latest time before walls are felt in most
    motions whose D is stated; along a channel they never are.

    Judged by the MSD of the first runs of each case, so that walls count from half of WALLS_FELT
    on, or where they do so at all times from WALLS_FELT on. A time at which the first window has
    no line counts as one at which walls are felt.
    """
    scenes = [case.scene for case in cases]
    ends = earlier_ends(scenes, cases[0].average)
    if not any(scene.box.has_walls for scene in scenes):
        return ends[0]
    first_windows = [candidate_windows(scenes, end)[0][0] for end in ends]
    motions = []
    for case, group in zip(cases, groups, strict=True):
        weights = [line_weights(case.times, window) for window in first_windows]
        has_no_line = np.isnan(weights).any(axis=(1, 2))
        for reduction in _wall_reductions(case, first_good_runs(group), ends):
            motions.append(np.where(has_no_line, 1.0, reduction))
    for bound in (WALLS_FELT / 2, WALLS_FELT):
        motions_felt = (np.array(motions).reshape(-1, len(ends)) > bound).sum(axis=0)
        if motions_felt.min() < len(motions):
            return ends[int(np.argmin(motions_felt))]
    return ends[0]


def _wall_reductions(
    case: Case, blocks: Sequence[Ensemble], times: Sequence[float]
) -> list[list[float]]:
    """Return the shares by which walls reduce the slope of each MSD whose D is stated, in these
    blocks of runs at these times: of all motion, or along the axes of the box; [] without
    displacements.
    """
    squares = known_arrays(squared_of(case, runs) for runs in blocks)
    if not squares:
        return []
    axes = case.scene.box.axes_of_diffusion
    components = known_arrays(component_squares(case, runs) for runs in blocks) if axes else []
    if not components:
        msd = np.interp(times, case.times, np.concatenate(squares).mean(axis=0))
        return [[wall_reduction(case.scene, case.average, value) for value in msd]]
    msd_along = np.concatenate(components).mean(axis=0)
    reductions = []
    for axis in axes:
        reduction = partial(wall_reduction_along, axis, case.scene, case.average)
        msd = np.interp(times, case.times, msd_along[axis])
        reductions.append([reduction(value) for value in msd])
    return reductions


def known_arrays(arrays: Iterable[np.ndarray | None]) -> list[np.ndarray]:
    """Return the arrays of those blocks of runs that have them.

    >>> known_arrays([np.array([0.5]), None])
    [array([0.5])]
    """
    return [array for array in arrays if array is not None]


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
    tracks = displacement(runs.tracer.position, runs.tracer.image, size)
    return np.ascontiguousarray(squared(tracks).T)


def component_squares(case: Case, runs: Ensemble) -> np.ndarray | None:
    """Return the squared displacements along x and y (n, 2, T) of every run: as measured, else from
    the tracer's track; else None.
    """
    measured = runs.observables.get("component_square_displacement")
    if measured is not None or "square_displacement" in runs.observables:
        return measured
    if runs.tracer is None:
        return None
    size = (case.scene.box.width, case.scene.box.height)
    moved = displacement(runs.tracer.position, runs.tracer.image, size)  # (T, n, 2)
    return np.ascontiguousarray(np.moveaxis(moved**2, 0, -1))


def displacement_columns(case: Case, runs: Ensemble) -> Columns:
    """Return r^2 at all times, the lines in all windows and the friction of the langevin engine.

    Also keep r^2 at the end and D in all windows of every run.
    """
    square = squared_of(case, runs)
    if square is None:
        return Columns()
    means = {"msd": square, **per_run_fits(square, case)}
    if "friction_rate" in runs.observables:
        means["friction_rate"] = runs.observables["friction_rate"]
    run_values = {"run_msd": square[:, -1], "run_diffusion_coefficient": means["slope"] / 4}
    return Columns(means, run_values=run_values)


def per_run_fits(square: np.ndarray, case: Case) -> dict[str, np.ndarray]:
    """Return slope, intercept and change of the slope (n, W) of the squared displacement (n, T) of
    every run in all windows.
    """
    lines = per_run_lines(square, case.times, case.windows)
    changes = [(square * change_weights(case.times, window)).sum(axis=1) for window in case.windows]
    return {
        "slope": lines[:, 0],
        "intercept": lines[:, 1],
        "slope_change": np.stack(changes, axis=-1),
    }


def displacement_results(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return windows, MSD and fits, and what is known of the scene before any run."""
    values = _scene_values(case, averages)
    if "msd" not in averages.places:
        return values
    msd = averages.estimate("msd")
    slope = averages.estimate("slope")
    is_late = case.times > 0
    per_4t = np.divide(0.25, case.times, out=np.full(len(case.times), np.nan), where=is_late)
    values |= {"msd": msd, "msd_over_4t": msd.scaled(per_4t)}
    values |= {"slope": slope, "diffusion_coefficient": slope.scaled(0.25)}
    change = averages.estimate("slope_change")
    values |= {
        "slope_change": change.mean,
        "slope_change_standard_error": change.standard_error,
        "slope_change_p_value": p_value(change, slope.mean, averages.runs),
    }
    ends = np.array([end for _, end in case.windows])
    msd_at_ends = np.interp(ends, case.times, msd.mean)
    exponent = growth_exponent(slope, ends, msd_at_ends)
    reductions = [wall_reduction(case.scene, case.average, value) for value in msd_at_ends]
    return values | {
        "growth_exponent": exponent.mean,
        "growth_exponent_standard_error": exponent.standard_error,
        "wall_reduction": reductions,
    }


def growth_exponent(slope: Estimate, ends: np.ndarray, msd_at_ends: np.ndarray) -> Estimate:
    """Return slope t/MSD at the ends (W,) of the windows, (..., W) as slope and MSD there; NaN
    where nothing moves.
    """
    has_moved = msd_at_ends > 0
    unknown = np.full(msd_at_ends.shape, np.nan)
    return slope.scaled(np.divide(ends, msd_at_ends, out=unknown, where=has_moved))


def _scene_values(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    """Return windows, and what is known of the scene before any run, or from its friction alone."""
    scene = case.scene
    starts = [start for start, _ in case.windows]
    ends = [end for _, end in case.windows]
    drifts = [window_drift_diffusion(case, window) for window in case.windows]
    friction = averages.mean("friction_rate") if "friction_rate" in averages.places else np.nan
    diffusive_from = DECAY_TIMES / friction if friction > 0 else not_diffusive_before(scene)
    return {
        "window": window_labels(case.windows),
        "window_start": starts,
        "window_end": ends,
        "window_drift_diffusion": drifts,
        "box_width": scene.box.width,
        "duration": case.times[-1],
        "packing_fraction": scene.packing_fraction,
        "initial_square_speed": motion.mean_square_speed_of_tracer(scene),
        "not_diffusive_before": diffusive_from,
        "accessible_half_width": accessible_half_width(scene),
        "msd_limit": msd_limit(scene, case.average),
    }


def p_value(change: Estimate, slope: np.ndarray, runs: int) -> np.ndarray:
    """Return p-values (W,) of changes of slopes over a number of runs, if they are small.

    Small are a fall by up to SMALL_FALL of the slope and a growth by up to SMALL_GROWTH. What goes
    beyond, over its standard error, is at the most Student's t with runs - 1 degrees of freedom.
    NaN for fewer than FEWEST_RUNS, and without scatter.
    """
    from scipy.special import stdtr

    may_tell = (change.standard_error > 0) & (runs >= FEWEST_RUNS)
    error = np.where(may_tell, change.standard_error, np.nan)
    growth = change.mean - SMALL_GROWTH * np.abs(slope)
    fall = -change.mean - SMALL_FALL * np.abs(slope)
    beyond = np.maximum(np.maximum(growth, fall), 0.0)
    return 2 * stdtr(max(runs - 1, 1), -beyond / error)


WINDOW = (*CASE_DIMS, "window")

VARIABLES = {
    "msd": Mean(TIME, AREA, f"mean squared displacement {FOLLOWED}"),
    "msd_over_4t": Mean(TIME, RATE, "mean squared displacement over 4 t"),
    "slope": Mean(
        WINDOW, RATE, "least-squares slope of the mean squared displacement in the window"
    ),
    "intercept": Variable(WINDOW, AREA, "intercept of the least-squares line in the window", ERROR),
    "run_msd": Variable(SEED, AREA, "squared displacement of a run at its end"),
    "run_diffusion_coefficient": Variable(
        (*SEED, "window"), RATE, "slope/4 of a run's squared displacement in the window"
    ),
    "diffusion_coefficient": Mean(WINDOW, RATE, "diffusion coefficient, slope/4, in the window"),
    "slope_change": Variable(
        WINDOW, RATE, "slope in the second half of the window minus that in the first", ERROR
    ),
    "slope_change_p_value": Variable(
        WINDOW,
        "1",
        "p-value of the change if it is small, adjusted for the dataset (Holm)",
    ),
    "growth_exponent": Variable(
        WINDOW,
        "1",
        "exponent of the MSD at the end of the window, slope t/MSD; 1: diffusion",
        ERROR,
    ),
    "wall_reduction": Variable(
        WINDOW, "1", "share by which walls reduce the slope of the MSD at the end of the window"
    ),
    "window_drift_diffusion": Variable(
        WINDOW, RATE, "what the drift of all disks adds to the diffusion coefficient in the window"
    ),
    "box_width": Variable(CASE_DIMS, "length", "width of the box, along x"),
    "duration": Variable(CASE_DIMS, "time", "duration of a run"),
    "packing_fraction": Variable(
        CASE_DIMS, "1", "packing fraction, share of the area covered by disks"
    ),
    "initial_square_speed": Variable(
        CASE_DIMS, SPEED2, "expected <v0^2> of the tracer: the MSD begins as <v0^2> t^2"
    ),
    "not_diffusive_before": Variable(
        CASE_DIMS, "time", "3/gamma of the tracer: before, the MSD depends on its initial velocity"
    ),
    "msd_limit": Variable(
        CASE_DIMS, AREA, "mean squared displacement of a tracer that has filled the box"
    ),
    "accessible_half_width": Variable(
        CASE_DIMS, "length", "half the side of the square in whose centre the tracer starts"
    ),
}
COORDINATES = {
    "window": Variable(("window",), None, "time window of the straight-line fit"),
    "window_start": Variable(("window",), "time", "start of the window"),
    "window_end": Variable(("window",), "time", "end of the window"),
}

ESTIMATOR = Estimator(
    name="displacement",
    variables=VARIABLES,
    columns=displacement_columns,
    results=displacement_results,
    coordinates=COORDINATES,
)
