"""Trajectory files of a study in, one labelled dataset out: every measure of every (scene, particle count, engine)."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.displacement import (
    chi_square,
    expected_ring_counts,
    fit_line,
    per_run_lines,
    ring_counts,
    ring_edges,
    squared_displacement,
)
from brownpipe.analysis.resampling import Estimate, resample_each, wilson_interval
from brownpipe.analysis.variables import ATTRIBUTES, COORDINATES, FAILED, KEPT, VARIABLES

COLLISIONS = ("pair_collisions", "wall_collisions", "tracer_collisions")
HEALTH = ("energy_drift", "worst_overlap", "momentum_residual")
WINDOWS = ((0.1, 1.0), (0.5, 1.0))  # of the fits, where none are asked for
SAME_TIME = 1e-9  # relative difference of sample times that are one: k dt depends on dt by round-off
WIDEST = 1000.0  # ring, in units of the longer side of the box


class AnalysisError(ValueError):
    """The trajectory files given do not make one study. One line."""


class Runs(NamedTuple):
    """All runs of one scene, particle count and engine, in the order of their seeds."""

    scene: object  # brownpipe.scene.Scene
    engine: str  # with its settings: a label
    times: np.ndarray  # (T,)
    seeds: np.ndarray  # (S,)
    squared: np.ndarray | None  # (S, T) squared displacement of the tracer; None without a tracer
    observables: dict  # name -> (S,)
    source: str  # digest of the source that made them

    @property
    def key(self):
        return self.scene.name, self.scene.particles, self.engine


def aggregate(paths, windows=None, dr=0.04, rings=24):
    """All measures of the trajectory files `paths` as one `xarray.Dataset`.

    The files may hold any scenes, particle counts, engines and batches of seeds, in any order: the result depends on
    the runs alone, to the bit. Runs that failed are counted and left out of every average. `windows` are the times
    (start, end) of the straight-line fits, WINDOWS by default; `dr` and `rings` the displacement histogram's. What a
    scene does not have (a shorter duration, fewer seeds) is NaN. Raises `AnalysisError` for files that do not belong
    together (the same seed twice, one name for two scenes, two sources), for windows that are the same or that no run
    reaches, for rings far wider than any box, and what `storage.read_trajectories` raises for broken files.
    """
    from brownpipe.storage import read_trajectories

    asked, windows = windows or (), windows or WINDOWS
    if len(set(_labels(windows))) < len(windows):
        raise AnalysisError(f"fit windows {', '.join(_labels(windows))}: must differ in their first six digits")
    batches = [(str(path), _batch(read_trajectories(path))) for path in paths]
    if not batches:
        raise AnalysisError("no trajectory files: nothing to aggregate")
    groups = [_join(batches, key) for key in sorted({batch.key for _, batch in batches})]
    _refuse_namesakes(groups)
    _refuse_out_of_reach(groups, asked, dr)
    edges = ring_edges(dr, rings)
    return _assemble([(runs, _measure(runs, windows, edges)) for runs in groups], windows, edges)


# --- files to runs


def _batch(trajectories):
    """The part of a trajectory file that the measures need."""
    scene, ensemble, squared = trajectories.scene, trajectories.ensemble, None
    if ensemble.tracer is not None:
        track = ensemble.tracer
        squared = squared_displacement(track.position, track.image, (scene.box.width, scene.box.height))
    engine = _label(trajectories.engine, trajectories.settings)
    return Runs(scene, engine, ensemble.times, ensemble.seeds, squared, ensemble.observables, trajectories.source)


def _label(engine, settings):
    """One name for an engine and its settings: `exact`, `timestep time_step=0.001`."""
    return " ".join([engine, *(f"{key}={settings[key]}" for key in sorted(settings))])


def _join(batches, key):
    """All batches of one key as one record, seeds in ascending order."""
    mine = [(path, batch) for path, batch in batches if batch.key == key]
    first = mine[0][1]
    _refuse_differing(mine)
    seeds = np.concatenate([batch.seeds for _, batch in mine])
    order = np.argsort(seeds, kind="stable")
    _refuse_duplicates(mine, seeds[order])
    squared = None if first.squared is None else np.concatenate([batch.squared for _, batch in mine])[order]
    names = first.observables
    observables = {name: np.concatenate([batch.observables[name] for _, batch in mine])[order] for name in names}
    return first._replace(seeds=seeds[order], squared=squared, observables=observables)


def _refuse_differing(mine):
    path, first = mine[0]
    for other, batch in mine[1:]:
        if batch.scene.digest != first.scene.digest or (batch.squared is None) != (first.squared is None):
            raise AnalysisError(
                f"{other}: its scene {batch.scene.name!r} is not the one in {path}; aggregate one of the two"
            )
        if batch.source != first.source:
            raise AnalysisError(f"{other}: made by another source code than {path}; make one of the two again")


def _refuse_duplicates(mine, ordered):
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if twice.size:
        holders = [path for path, batch in mine if twice[0] in batch.seeds]
        raise AnalysisError(f"{holders[-1]}: seed {twice[0]} is already in {holders[0]}; each run may count only once")
    if mine[0][1].scene.disks and len(ordered) > 1:
        raise AnalysisError(f"{mine[-1][0]}: its disks are listed one by one: all its runs are the same; give one seed")


def _refuse_namesakes(groups):
    """One name, one physics: scenes of the same name may differ in their particle counts alone."""
    known = {}
    for scene in (runs.scene for runs in groups):
        uncounted = replace(scene, species=tuple(replace(species, count=0) for species in scene.species))
        if known.setdefault(scene.name, uncounted) != uncounted:
            raise AnalysisError(f"two different scenes are called {scene.name!r}; give one of them another name")


def _refuse_out_of_reach(groups, windows, dr):
    """Windows that end after every run, and rings that would hold all of a box and much more."""
    last = max(runs.times[-1] for runs in groups)
    for label in (label for label, (_, end) in zip(_labels(windows), windows, strict=True) if end * (1 - 1e-9) > last):
        raise AnalysisError(f"fit window {label}: must end by {last:g}, when the longest run does")
    most = WIDEST * max(max(runs.scene.box.width, runs.scene.box.height) for runs in groups)
    if dr > most:
        raise AnalysisError(f"ring width {dr:g}: must be at most {most:g}, {WIDEST:g} times the longest box")


# --- runs to measures


def _measure(runs, windows, edges):
    """Every variable of the dataset for one group of runs: name -> value of the shape its dimensions say."""
    failed = np.asarray(runs.observables["failed"], bool)
    box, kept = runs.scene.box, ~failed
    values = {
        "box_width": box.width,
        "box_height": box.height,
        "duration": runs.times[-1],
        "packing_fraction": runs.scene.packing_fraction,
        "initial_square_speed": initial_square_speed(runs.scene),
        "runs": np.count_nonzero(kept),
        "failed_runs": np.count_nonzero(failed),
        "run_status": np.where(failed, FAILED, KEPT),
        **{name: runs.observables[name] for name in HEALTH if name in runs.observables},
    }
    samples = {name: runs.observables[name][kept] for name in COLLISIONS if name in runs.observables}
    if runs.squared is not None and kept.any():
        samples |= {"msd": runs.squared[kept], "lines": per_run_lines(runs.squared[kept], runs.times, windows)}
    estimates = resample_each(samples) if samples else {}
    for name in estimates.keys() & set(COLLISIONS):
        values |= _with_error(name, estimates[name])
    if "msd" in samples:
        values |= _displacement(estimates["msd"], estimates["lines"], runs.times, windows)
        diffusion = [values["msd_over_4t"][-1], *values["diffusion_coefficient"]]
        values |= _distribution(np.sqrt(samples["msd"][:, -1]), runs.times[-1], edges, diffusion)
    return values


def _displacement(msd, lines, times, windows):
    """The variables of the MSD, estimated at `times` (T,), and of its lines (2, W) over `windows`."""
    slope, intercept = (Estimate(*(values[k] for values in lines)) for k in range(2))
    return {
        **_with_interval("msd", msd),
        "msd_over_4t": np.divide(msd.mean, 4 * times, out=np.full(len(times), np.nan), where=times > 0),
        **_with_interval("slope", slope),
        **_with_error("intercept", intercept),
        "naive_slope_error": [fit_line(times, msd.mean, window).naive_slope_error for window in windows],
        **_with_interval("diffusion_coefficient", Estimate(*(values / 4 for values in slope))),
    }


def _with_error(name, estimate):
    return {name: estimate.mean, f"{name}_standard_error": estimate.standard_error}


def _with_interval(name, estimate):
    return _with_error(name, estimate) | {f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def _distribution(distance, t, edges, diffusion):
    """Ring counts of the displacements `distance` (S,) at time `t` against eq. (18) for each D of `diffusion`."""
    counts = ring_counts(distance, edges)
    low, high = wilson_interval(counts, len(distance))
    usable = [d if d > 0.0 and t > 0.0 else np.nan for d in diffusion]
    expected = np.stack([expected_ring_counts(len(distance), edges, t or 1.0, d) for d in usable])
    tests = [chi_square(counts, row) for row in expected]
    return {
        "displacement_counts": counts[:-1],
        "displacement_counts_low": low[:-1],
        "displacement_counts_high": high[:-1],
        "displacement_overflow": counts[-1],
        "model_diffusion_coefficient": usable,
        "expected_counts": expected[:, :-1],
        "expected_overflow": expected[:, -1],
        "chi_square": [test.statistic for test in tests],
        "degrees_of_freedom": [test.degrees_of_freedom for test in tests],
        "p_value": [test.p for test in tests],
    }


def initial_square_speed(scene):
    """<v0^2> [length^2/time^2] of the tracer as the scene prescribes it: the coefficient of ballistic flight.

    2 s^2 for components of standard deviation s, 2 kT/m for a temperature, the speed itself for explicit disks. Without
    total momentum the tracer shares in the common velocity that is taken away. NaN if it is not known beforehand: a
    tracer that exchanges energy before t = 0 in a bath of another temperature.
    """
    if scene.velocities is None:
        return float(np.square(scene.disks[0].velocity).sum()) if scene.disks else np.nan
    if scene.equilibrate and scene.tracer_while_equilibrating == "free" and scene.velocities.temperature is None:
        return np.nan
    share = scene.mass / scene.mass.sum()
    if scene.velocities.temperature is None:
        still = 1 - 2 * share[0] + (share**2).sum() if scene.velocities.zero_momentum else 1.0
        return 2.0 * scene.velocities.standard_deviation**2 * still
    still = 1 - share[0] if scene.velocities.zero_momentum else 1.0
    return 2.0 * scene.velocities.temperature / scene.mass[0] * still


# --- measures to a dataset


def _assemble(measured, windows, edges):
    """Outer join of all groups over the union of their scenes, particle counts, engines, times and seeds."""
    import xarray

    axes = _axes([runs for runs, _ in measured], windows, edges)
    data = {}
    for runs, values in measured:
        values["missing_seeds"] = len(axes["seed"]) - len(runs.seeds)
    for name, variable in VARIABLES.items():
        full = np.full([len(axes[dim]) for dim in variable.dims], variable.absent, variable.dtype)
        for runs, values in measured:
            if name in values:
                full[_place(runs, variable.dims, axes)] = values[name]
        data[name] = (variable.dims, full, variable.attributes)
    along = _coordinates(axes, windows, edges)
    coordinates = {name: (dim, values, COORDINATES[name]) for name, (dim, values) in along.items()}
    return xarray.Dataset(data, coordinates, ATTRIBUTES)


def _axes(groups, windows, edges):
    """The values along every dimension."""
    return {
        "scene": sorted({runs.scene.name for runs in groups}),
        "particles": sorted({runs.scene.particles for runs in groups}),
        "engine": sorted({runs.engine for runs in groups}),
        "time": _time_axis([runs.times for runs in groups]),
        "window": _labels(windows),
        "r": (edges[1:] + edges[:-1]) / 2,
        "model": ["msd", *(f"slope {label}" for label in _labels(windows))],
        "seed": np.unique(np.concatenate([runs.seeds for runs in groups])),
    }


def _labels(windows):
    return [f"[{start:g}, {end:g}]" for start, end in windows]


def _time_axis(times):
    """The union of sample times, one value for those that differ by round-off only: the smallest."""
    axis = np.unique(np.concatenate(times))
    return axis[np.append(True, np.diff(axis) > SAME_TIME * axis[1:])]


def _coordinates(axes, windows, edges):
    """The axes, and what belongs to a window or a ring."""
    starts, ends = zip(*windows, strict=True)
    along = {
        "window_start": ("window", list(starts)),
        "window_end": ("window", list(ends)),
        "r_inner": ("r", edges[:-1]),
        "r_outer": ("r", edges[1:]),
    }
    return {name: (name, values) for name, values in axes.items()} | along


def _place(runs, dims, axes):
    """Where the values of one group go: one index per leading dimension, positions along times and seeds."""
    own = {"time": runs.times * (1 - SAME_TIME), "seed": runs.seeds}
    at = [axes[dim].index(value) for dim, value in zip(("scene", "particles", "engine"), runs.key, strict=True)]
    return (*at, *(np.searchsorted(axes[dim], own[dim]) if dim in own else slice(None) for dim in dims[3:]))
