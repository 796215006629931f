"""What is measured in a run itself, so that its tracks need not be kept: pure functions of one run's tracks.

`observe` makes arrays of a run; those of all runs are stacked and stored as /observables/run/NAME, (S, ...). ARRAYS
says what each array is, `axes` the values along its dimensions: T sample times, K kinds of disks (the species, the
tracer one of its own), P pairs of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables import displacement, pairs, time_origins, velocity
from brownpipe.observables.species import bath_disks, equal_disks, species_table
from brownpipe.observables.time_origins import is_stationary, why_not_stationary
from brownpipe.scene import Scene

__all__ = [
    "ARRAYS",
    "AVERAGES",
    "AXES",
    "OBSERVABLES",
    "RENAMED",
    "arrays_of",
    "axes",
    "is_stationary",
    "needs_every_disk",
    "numbers_in",
    "observables_making",
    "observe",
    "of_tracer",
    "problem",
    "refuse_unfit",
]

AVERAGES = ("runs", "origins", "disks")
AVERAGED = ("square_displacement", "velocity_autocorrelation")  # observables that they apply to
MOST_PAIR_COUNTS = 1_000_000  # numbers in a histogram


class RunArray(NamedTuple):
    """One array of a run."""

    dims: tuple[str, ...]  # names in AXES; that of the runs, seed, comes before them
    units: str
    long_name: str


class Observable(NamedTuple):
    """What can be asked for, and the arrays it makes."""

    measure: Callable  # (scene, run, average) -> {variable: array}
    variables: tuple[str, ...]


AXES = {  # dimension: units, meaning
    "time": ("time", "time since the start of the run, or since a time origin"),
    "species": ("1", "kind of the disk"),
    "species_pair": ("1", "kinds of the two disks"),
    "velocity": ("sqrt(kT/mass)", "velocity component, middle of its bin; the outermost hold what lies beyond"),
    "speed": ("sqrt(kT/mass)", "speed, middle of its bin; the last holds what lies beyond"),
    "distance": ("length", "distance of the centres, middle of its bin"),
}
ARRAYS = {
    "square_displacement": RunArray(
        ("time",), "length^2", "squared displacement of the tracer; /parameters says over what it is averaged"
    ),
    "displacement_velocity": RunArray(
        ("time",), "length^2/time", "v(t).(r(t) - r(0)) of the tracer, half of d(r^2)/dt; averaged likewise"
    ),
    "velocity_autocorrelation": RunArray(("time",), "length^2/time^2", "v(0).v(t) of the tracer; averaged likewise"),
    "velocity_displacement": RunArray(
        ("time",), "length^2/time", "v(0).(r(t) - r(0)) of the tracer, the integral of v(0).v(s); averaged likewise"
    ),
    "bath_velocity_autocorrelation": RunArray(
        ("time",), "length^2/time^2", "v(0).v(t), mean over the disks of the most numerous species but the tracer's"
    ),
    "species_energy": RunArray(("time", "species"), "energy", "kinetic energy per disk"),
    "velocity_counts": RunArray(("species", "velocity"), "1", "velocity components of the disks, counted"),
    "speed_counts": RunArray(("species", "speed"), "1", "speeds of the disks, counted"),
    "pair_counts": RunArray(("species_pair", "distance"), "1", "pairs of disks, counted by their distance"),
    "pair_snapshots": RunArray((), "1", "samples that pair_counts is summed over"),
    "pair_expected": RunArray(
        ("species_pair", "distance"), "1", "pairs that an ideal gas shows around a lone disk where it was; else NaN"
    ),
}
OBSERVABLES = {
    "square_displacement": Observable(
        displacement.square_displacement, ("square_displacement", "displacement_velocity")
    ),
    "velocity_autocorrelation": Observable(
        velocity.autocorrelation,
        ("velocity_autocorrelation", "velocity_displacement", "bath_velocity_autocorrelation"),
    ),
    "species_energy": Observable(velocity.species_energy, ("species_energy",)),
    "velocity_distribution": Observable(velocity.distribution, ("velocity_counts", "speed_counts")),
    "pair_distribution": Observable(pairs.distribution, ("pair_counts", "pair_snapshots", "pair_expected")),
}

RENAMED = {"displacement": "square_displacement", "kinetic_energy": "species_energy"}  # names of an earlier version


def observe(scene: Scene, run, names: tuple[str, ...], average: str = "runs") -> dict[str, np.ndarray | int]:
    """Return the arrays of one run (`batch.Run`) that the names ask for."""
    found = {}
    for name in names:
        found |= OBSERVABLES[name].measure(scene, run, average)
    return found


def needs_every_disk(scene: Scene, names: tuple[str, ...], average: str = "runs") -> bool:
    """Do the names need the tracks of all disks, or that of the tracer alone?"""
    if average == "disks" or set(names) - set(AVERAGED):
        return bool(names)
    return "velocity_autocorrelation" in names and len(bath_disks(scene)) > 0


def of_tracer(names: tuple[str, ...], average: str = "runs") -> tuple[tuple[str, ...], str]:
    """Return the observables, and their average, that an engine has which follows the tracer alone."""
    names = tuple(name for name in names if name in AVERAGED)
    return names, average if names else "runs"


def arrays_of(scene: Scene, names: tuple[str, ...]) -> tuple[str, ...]:
    """The arrays that are made of a scene when the names are asked for."""
    made = tuple(name for asked in names for name in OBSERVABLES[asked].variables)
    lacking = set() if len(bath_disks(scene)) else {"bath_velocity_autocorrelation"}
    lacking |= set() if pairs.lone_pairs(scene, species_table(scene)) else {"pair_expected"}
    return tuple(name for name in made if name not in lacking)


def observables_making(variables) -> tuple[str, ...]:
    """The names to ask for so that these arrays are made."""
    return tuple(name for name, one in OBSERVABLES.items() if one.variables[0] in variables)


def axes(scene: Scene, variable: str) -> dict[str, np.ndarray | list[str]]:
    """The values along each dimension of an array."""
    return {dim: _axis(scene, dim) for dim in ARRAYS[variable].dims}


def numbers_in(scene: Scene, names: tuple[str, ...]) -> int:
    """How many numbers the arrays of one run hold."""
    shapes = [[len(values) for values in axes(scene, one).values()] for one in arrays_of(scene, names)]
    return int(sum(np.prod(shape) for shape in shapes))


def _axis(scene: Scene, dim: str) -> np.ndarray | list[str]:
    if dim == "time":
        return scene.times
    if dim in ("velocity", "speed"):
        number = velocity.BINS[dim]
        return (np.arange(number) + 0.5 - (number / 2 if dim == "velocity" else 0.0)) * velocity.BIN
    if dim == "distance":
        number, width = pairs.bins(scene)
        return (np.arange(number) + 0.5) * width
    kinds = species_table(scene)
    if dim == "species":
        return list(kinds.name)
    return [f"{kinds.name[a]}:{kinds.name[b]}" for a, b in pairs.species_pairs(kinds)]


# -- what a scene does not have -------------------------------------------------------------------------------------


def refuse_unfit(scene: Scene, names: tuple[str, ...], average: str = "runs") -> None:
    """Raise RequestError for observables that are unknown, or that the scene does not have."""
    found = problem(scene, names, average)
    if found is not None:
        raise RequestError(f"{scene.name}: {': '.join(found)}")


def problem(scene: Scene, names: tuple[str, ...], average: str = "runs") -> tuple[str, str] | None:
    """Return what is wrong, `observables` or `average`, and why; None if nothing is."""
    for key, found in (("observables", _unfit(scene, names)), ("average", _unfit_average(scene, names, average))):
        if found is not None:
            return key, found
    return None


def _unfit(scene: Scene, names: tuple[str, ...]) -> str | None:
    unknown = [name for name in names if name not in OBSERVABLES]
    if unknown:
        return f"{unknown[0]!r} is unknown; must be of {', '.join(OBSERVABLES)}"
    if len(set(names)) < len(names):
        return "must differ"
    if names and scene.particles == 0:
        return "there is no disk to measure"
    if "pair_distribution" in names:
        bins, _ = pairs.bins(scene)
        if bins < 1:
            return "pair_distribution needs two disks, and room for them to be apart"
        if bins * len(pairs.species_pairs(species_table(scene))) > MOST_PAIR_COUNTS:
            return f"pair_distribution would have more than {MOST_PAIR_COUNTS} bins for so many kinds or sizes of disks"
    return None


def _unfit_average(scene: Scene, names: tuple[str, ...], average: str) -> str | None:
    if average not in AVERAGES:
        return f"{average!r} is unknown; must be {' or '.join(AVERAGES)}"
    if average == "runs":
        return None
    if not set(AVERAGED) & set(names):
        return f"{average} needs {' or '.join(AVERAGED)} among the observables"
    why = why_not_stationary(scene)
    if why is not None:
        return f"{average} needs runs that are stationary from t = 0, but {why}"
    if average == "disks" and len(equal_disks(scene)) < 2:
        return "disks needs disks of the tracer's radius and mass, and there is no other"
    if average == "origins":
        return time_origins.unfit(scene)
    return None
