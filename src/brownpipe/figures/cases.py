"""The parts of a dataset that figures and tables show: a case is one scene with one particle count and one engine."""

import numpy as np

from brownpipe.errors import FigureError

NOTE_PARTICLES = 150  # of the 2020 note


def cases_of(dataset):
    """Every case that has runs, as a dataset without those three dimensions: by scene, then particle count."""
    labels = [(s, n, e) for s in dataset.scene.values for n in dataset.particles.values for e in dataset.engine.values]
    cases = [dataset.sel(scene=s, particles=n, engine=e) for s, n, e in labels]
    return [case for case in cases if case.runs + case.failed_runs > 0]


def has(case, *names):
    """Has it a value of every one of these variables?"""
    return all(name in case and bool(np.isfinite(case[name]).any()) for name in names)


def has_msd(case):
    return has(case, "msd")


def check_count(cases, particles):
    """Raise FigureError if a particle count is asked for that no case has."""
    available = sorted({int(case.particles) for case in cases})
    if particles is not None and particles not in available:
        raise FigureError(f"particles: {particles} is not in the dataset; choose one of {available}")


def one_count(cases, particles=None):
    """The cases that figures of one particle count show: of each scene the one asked for, the note's, or the most."""
    return [case for mine in by_scene(cases).values() for case in mine if case.particles == _shown(mine, particles)]


def _shown(cases, particles):
    """The count asked for, which a scene may lack, or the one shown of a scene with these cases."""
    counts = [int(case.particles) for case in cases]
    return particles or (NOTE_PARTICLES if NOTE_PARTICLES in counts else max(counts))


def by_scene(cases):
    """The cases of each scene, scenes and cases in their order: name -> list."""
    grouped = {}
    for case in cases:
        grouped.setdefault(case.scene.item(), []).append(case)
    return grouped


def by_series(cases):
    """The cases that differ in their particle counts alone, by scene and, where it is not the exact one, engine."""
    grouped = {}
    for case in cases:
        grouped.setdefault(case.scene.item() + _engine(case), []).append(case)
    return grouped


def over_time(case, name="msd"):
    """The case at the times at which it has a value of `name`: scenes of other durations leave gaps."""
    return defined(case, name, "time")


def defined(case, name, dim):
    """The case where `name` has a value, along `dim`."""
    values = np.isfinite(case[name])
    return case.isel({dim: values.any([other for other in values.dims if other != dim]).values})


def distributions_of(case):
    """The case at each time that its displacement distribution is taken at, with the rings of that time."""
    at = [case.isel(displacement_time=k) for k in np.flatnonzero(np.isfinite(case.displacement_overflow))]
    return [defined(one, "displacement_counts", "r") for one in at]


def at_last_distribution(case):
    """The case at the last of these times; where there is none, at the last of the dataset."""
    return (distributions_of(case) or [case.isel(displacement_time=-1)])[-1]


def fits_of(case):
    """The windows whose line is defined, each as a dataset without the window dimension."""
    windows = [case.isel(window=k) for k in range(case.sizes["window"])]
    return [fit for fit in windows if np.isfinite(fit.slope)]


def title_of(case):
    """Scene, particle count and, if it is not the exact one, engine."""
    return f"{case.scene.item()}, N = {case.particles.item()}{_engine(case)}"


def _engine(case):
    return "" if case.engine == "exact" else f", {case.engine.item()}"


def plus_minus(value, error):
    """`0.974 ± 0.022`: the value to the two leading digits of its standard error."""
    value, error = float(value), float(error)
    if not np.isfinite(error) or error <= 0.0:
        return f"{value:.4g}" if np.isfinite(value) else "-"
    decimals = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"
