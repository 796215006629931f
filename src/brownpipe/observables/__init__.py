"""Observables: what is measured in a run while all its disks are in memory, so that trajectories need not be stored.

Each observable is a pure function of the tracks of one run that returns arrays. The arrays of all runs of a batch are
stacked and stored under their names, shape (S, ...). ARRAYS describes each array, `axes` gives the coordinates along
its dimensions: T sample times, K species (the tracer is a species of its own), P pairs of species.

A new observable is a function in a module of this package, its record in OBSERVABLES, its arrays in ARRAYS and new
dimensions in AXES. The command line, files, checkpoints, studies and forecasts take it from there.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables import displacement, orientation, pairs, profile, time_origins, velocity
from brownpipe.observables.quarters import QUARTERS, has_quarters
from brownpipe.observables.species import bath_disks, equal_disks, species_table
from brownpipe.observables.time_origins import is_stationary, why_not_stationary
from brownpipe.observables.tracks import Run
from brownpipe.scene import Scene

AVERAGES = ("runs", "origins", "disks")  # over runs alone, and within each run over time origins or equal disks


class Axis(NamedTuple):
    """Description of a dimension of such arrays."""

    units: str
    long_name: str
    coordinates: Callable[[Scene], np.ndarray | list[str]]  # along it in a scene: numbers, or names of species


class RunArray(NamedTuple):
    """Description of an array that is measured in every run."""

    dims: tuple[str, ...]  # names in AXES; in files the dimension of the runs, `seed`, comes first
    units: str
    long_name: str
    is_there: Callable[[Scene], bool] = lambda scene: True  # whether runs of the scene have it


class Observable(NamedTuple):
    """An observable: how it is measured, its arrays, the scenes that it fits, the CPU time that it takes.

    Forecasts (`engines.forecast`) add up the CPU seconds.
    """

    measure: Callable[[Scene, Run, str], Mapping[str, np.ndarray | int]]  # (scene, run, average) -> values by array
    arrays: tuple[str, ...]  # names in ARRAYS; the first is measured in every scene
    seconds_per_run: float  # CPU seconds in every run, and
    seconds_per_disk_sample: float  # for each disk in each sample
    of_single_disks: bool = False  # made from tracks of single disks: all AVERAGES apply, the tracer's track is enough
    seconds_per_lag: float = math.nan  # averages over time origins (`of_single_disks`): for each lag, and
    seconds_per_product: float = math.nan  # for each disk and time origin at that lag
    seconds_per_sample: Callable[[Scene], float] = lambda scene: 0.0  # besides, for each sample
    is_also_of_bath: bool = False  # (`of_single_disks`) in a scene with a bath, made from its disks, too
    is_over_samples: bool = False  # counted or averaged over the samples of a stationary scene, otherwise the last one
    unfit: Callable[[Scene], str | None] = lambda scene: None  # why the scene cannot have it, None if it can


AXES = {
    "time": Axis("time", "time since the start of the run, or since a time origin", lambda scene: scene.times),
    "species": Axis("1", "species of the disk", lambda scene: list(species_table(scene).name)),
    "quarter": Axis("1", "quarter of the run, between the samples next to its ends", lambda scene: QUARTERS),
    "species_pair": Axis("1", "species of the two disks", pairs.pair_names),
    "velocity_bin": Axis(
        "sqrt(kT/mass)",
        "velocity component, centre of its bin; the outermost bins include all beyond",
        lambda scene: velocity.bin_centres("velocity"),
    ),
    "speed_bin": Axis(
        "sqrt(kT/mass)",
        "speed, centre of its bin; the last bin includes all beyond",
        lambda scene: velocity.bin_centres("speed"),
    ),
    "distance": Axis("length", "distance between the centres, centre of its bin", pairs.bin_centres),
    "wall_distance": Axis("length", "distance of the disk's edge from a wall, centre of its bin", profile.bin_centres),
}
ARRAYS = {
    "square_displacement": RunArray(
        ("time",),
        "length^2",
        "squared displacement of the tracer; for averages within the run see the attribute `average`",
    ),
    "displacement_velocity": RunArray(
        ("time",),
        "length^2/time",
        "v(t).(r(t) - r(0)) of the tracer, half of d(r^2)/dt; averaged like square_displacement",
    ),
    "velocity_autocorrelation": RunArray(
        ("time",), "length^2/time^2", "v(0).v(t) of the tracer; averaged like square_displacement"
    ),
    "velocity_displacement": RunArray(
        ("time",),
        "length^2/time",
        "v(0).(r(t) - r(0)) of the tracer, the integral of v(0).v(s); averaged like square_displacement",
    ),
    "bath_velocity_autocorrelation": RunArray(
        ("time",),
        "length^2/time^2",
        "v(0).v(t), mean over the disks of the most numerous species except the tracer's",
        lambda scene: len(bath_disks(scene)) > 0,
    ),
    "species_energy": RunArray(("time", "species"), "energy", "kinetic energy per disk"),
    "velocity_counts": RunArray(("species", "velocity_bin"), "1", "histogram of the velocity components"),
    "speed_counts": RunArray(("species", "speed_bin"), "1", "histogram of the speeds"),
    "pair_counts": RunArray(("species_pair", "distance"), "1", "histogram of the distances of pairs of disks"),
    "pair_snapshots": RunArray((), "1", "number of samples that pair_counts is summed over"),
    "pair_expected": RunArray(
        ("species_pair", "distance"),
        "1",
        "pair_counts of an ideal gas around a lone disk at its positions; else NaN",
        lambda scene: bool(pairs.lone_pairs(scene, species_table(scene))),
    ),
    "density_profile": RunArray(
        ("species", "wall_distance"), "1/length^2", "number density by distance from the walls, mean along all of them"
    ),
    "quartic_displacement": RunArray(
        ("time",), "length^4", "fourth power of the tracer's displacement; averaged like square_displacement"
    ),
    "orientational_order": RunArray((), "1", "bond-orientational order abs(psi_6) of all disks, mean over samples"),
    "orientational_order_squared": RunArray((), "1", "abs(psi_6)^2 of all disks, mean over samples"),
    "quarter_order": RunArray(
        ("quarter",),
        "1",
        "abs(psi_6) of all disks, mean over the samples of each quarter of the run",
        lambda scene: is_stationary(scene) and has_quarters(scene),
    ),
    "quarter_collisions": RunArray(("quarter",), "1", "collisions between disks in each quarter of the run"),
    "quarter_virial": RunArray(("quarter",), "energy*time", "virial in each quarter of the run"),
    "quarter_energy": RunArray(
        ("quarter", "species"), "energy", "kinetic energy per disk, mean of those at both ends of each quarter"
    ),
}
OBSERVABLES = {
    "square_displacement": Observable(
        displacement.square_displacement,
        ("square_displacement", "displacement_velocity"),
        of_single_disks=True,
        seconds_per_run=1e-5,
        seconds_per_disk_sample=3.6e-8,
        seconds_per_lag=9e-6,
        seconds_per_product=2.2e-8,
    ),
    "velocity_autocorrelation": Observable(
        velocity.autocorrelation,
        ("velocity_autocorrelation", "velocity_displacement", "bath_velocity_autocorrelation"),
        of_single_disks=True,
        seconds_per_run=3e-5,
        seconds_per_disk_sample=7e-9,
        seconds_per_lag=6e-6,
        seconds_per_product=1e-9,
        is_also_of_bath=True,
    ),
    "species_energy": Observable(
        velocity.species_energy,
        ("species_energy",),
        seconds_per_run=2e-5,
        seconds_per_disk_sample=1.7e-8,
    ),
    "velocity_distribution": Observable(
        velocity.distribution,
        ("velocity_counts", "speed_counts"),
        seconds_per_run=5e-5,
        seconds_per_disk_sample=2.8e-8,
        is_over_samples=True,
    ),
    "pair_distribution": Observable(
        pairs.distribution,
        ("pair_counts", "pair_snapshots", "pair_expected"),
        seconds_per_run=1e-4,
        seconds_per_disk_sample=6e-7,
        seconds_per_sample=pairs.seconds_per_sample,
        is_over_samples=True,
        unfit=pairs.unfit,
    ),
    "density_profile": Observable(
        profile.density_profile,
        ("density_profile",),
        seconds_per_run=3e-5,
        seconds_per_disk_sample=4e-8,
        seconds_per_sample=profile.seconds_per_sample,
        is_over_samples=True,
        unfit=profile.unfit,
    ),
    "quartic_displacement": Observable(
        displacement.quartic_displacement,
        ("quartic_displacement",),
        of_single_disks=True,
        seconds_per_run=1e-5,
        seconds_per_disk_sample=3.6e-8,
        seconds_per_lag=9e-6,
        seconds_per_product=2.2e-8,
    ),
    "orientational_order": Observable(
        orientation.order,
        ("orientational_order", "orientational_order_squared", "quarter_order"),
        seconds_per_run=1e-4,
        seconds_per_disk_sample=4.9e-6,
        seconds_per_sample=lambda scene: 5.5e-4,
        is_over_samples=True,
    ),
}


def observe(scene: Scene, run: Run, names: Iterable[str], average: str = "runs") -> dict[str, np.ndarray | int]:
    """Return the arrays of the named observables of one run (`tracks.Run`)."""
    arrays: dict[str, np.ndarray | int] = {}
    for name in names:
        arrays |= OBSERVABLES[name].measure(scene, run, average)
    return arrays


def needs_every_disk(scene: Scene, names: Iterable[str], average: str = "runs") -> bool:
    """Return whether these observables need the tracks of all disks; otherwise the tracer's is enough."""
    asked = [OBSERVABLES[name] for name in names]
    if average == "disks" or not all(observable.of_single_disks for observable in asked):
        return bool(asked)
    return any(observable.is_also_of_bath for observable in asked) and len(bath_disks(scene)) > 0


def of_tracer(names: Iterable[str], average: str = "runs") -> tuple[tuple[str, ...], str]:
    """Return which of these observables an engine of the tracer alone can measure, and with which average."""
    names = tuple(name for name in names if OBSERVABLES[name].of_single_disks)
    return names, average if names else "runs"


def arrays_of(scene: Scene, names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the arrays that these observables yield in a scene."""
    return tuple(array for name in names for array in OBSERVABLES[name].arrays if ARRAYS[array].is_there(scene))


def observables_making(arrays: Collection[str]) -> tuple[str, ...]:
    """Return the names of the observables that yield these arrays."""
    return tuple(name for name, observable in OBSERVABLES.items() if observable.arrays[0] in arrays)


def axes(scene: Scene, array: str) -> dict[str, np.ndarray | list[str]]:
    """Return the coordinates along each dimension of an array: numbers, or names of species."""
    return {dim: AXES[dim].coordinates(scene) for dim in ARRAYS[array].dims}


def numbers_in(scene: Scene, names: Iterable[str]) -> int:
    """Return how many numbers these observables yield in one run, all arrays together."""
    return sum(math.prod(map(len, axes(scene, array).values())) for array in arrays_of(scene, names))


# -- refusals -------------------------------------------------------------------------------------------------------


def refuse_unfit(scene: Scene, names: tuple[str, ...], average: str = "runs") -> None:
    """Raise RequestError if an observable is unknown, or observables or average make no sense in the scene."""
    key_and_reason = problem(scene, names, average)
    if key_and_reason is not None:
        raise RequestError(f"{scene.name}: {': '.join(key_and_reason)}")


def problem(scene: Scene, names: tuple[str, ...], average: str = "runs") -> tuple[str, str] | None:
    """Return which is wrong, "observables" or "average", and why; None if they fit the scene."""
    for key, why in (("observables", _unfit(scene, names)), ("average", _unfit_average(scene, names, average))):
        if why is not None:
            return key, why
    return None


def _unfit(scene: Scene, names: tuple[str, ...]) -> str | None:
    """Return why the observables do not fit the scene, None if they do."""
    unknown = [name for name in names if name not in OBSERVABLES]
    if unknown:
        return f"{unknown[0]!r} is unknown; must be of {', '.join(OBSERVABLES)}"
    if len(set(names)) < len(names):
        return "must differ"
    if names and scene.particles == 0:
        return "there is no disk to measure"
    reasons = ((name, OBSERVABLES[name].unfit(scene)) for name in names)
    return next((f"{name} {why}" for name, why in reasons if why is not None), None)


def _unfit_average(scene: Scene, names: tuple[str, ...], average: str) -> str | None:
    """Return why the average does not fit the scene or the observables, None if it does."""
    if average not in AVERAGES:
        return f"{average!r} is unknown; must be {' or '.join(AVERAGES)}"
    if average == "runs":
        return None
    averageable = [name for name, observable in OBSERVABLES.items() if observable.of_single_disks]
    if not set(averageable) & set(names):
        return f"{average} needs {' or '.join(averageable)} among the observables"
    why = why_not_stationary(scene)
    if why is not None:
        return f"{average} needs runs that are stationary from t = 0, but {why}"
    if average == "disks" and len(equal_disks(scene)) < 2:
        return "disks needs disks of the tracer's radius and mass, and there is no other"
    if average == "origins":
        return time_origins.unfit(scene)
    return None
