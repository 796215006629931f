"""Observables: what is measured in a run while all its disks are in memory, so that trajectories need not be stored.

Each observable is a pure function of the tracks of one run that returns arrays. The arrays of all runs of a batch are
stacked and stored under their names, shape (S, ...). ARRAYS describes each array, `axes` gives the coordinates along
its dimensions: T sample times, K species (the tracer is a species of its own), P pairs of species.

A new observable is a function and its record (`observable.Observable`) in a module of this package, and its name in
OBSERVABLES. The command line, files, checkpoints, studies and forecasts take it from there. A user's own functions need
neither (`own`).
"""

import math
from collections.abc import Collection, Iterable

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables import displacement, orientation, own, pairs, profile, quarters, time_origins, velocity
from brownpipe.observables.observable import Axis, Observable, RunArray
from brownpipe.observables.species import equal_disks, species_table
from brownpipe.observables.time_origins import why_not_stationary
from brownpipe.observables.tracks import Run
from brownpipe.scene import Scene

AVERAGES = ("runs", "origins", "disks")  # over runs alone, and within each run over time origins or equal disks


class Observables(dict[str, Observable]):
    """Records by name; those of a user's own functions are not listed (`own`)."""

    def __missing__(self, name: str) -> Observable:
        if not own.is_own(name):
            raise KeyError(name)
        return own.observable_of(name)


OBSERVABLES = Observables(
    {
        "square_displacement": displacement.SQUARE_DISPLACEMENT,
        "velocity_autocorrelation": velocity.AUTOCORRELATION,
        "bath_velocity_autocorrelation": velocity.BATH_AUTOCORRELATION,
        "species_energy": velocity.ENERGY,
        "velocity_distribution": velocity.DISTRIBUTION,
        "pair_distribution": pairs.DISTRIBUTION,
        "density_profile": profile.DENSITY_PROFILE,
        "quartic_displacement": displacement.QUARTIC_DISPLACEMENT,
        "orientational_order": orientation.ORDER,
    }
)
ARRAYS: dict[str, RunArray] = quarters.ARRAYS | {
    name: array for observable in OBSERVABLES.values() for name, array in observable.arrays.items()
}
AXES: dict[str, Axis] = {
    "time": Axis("time", "time since the start of the run, or since a time origin", lambda scene: scene.times),
    "species": Axis("1", "species of the disk", lambda scene: list(species_table(scene).name)),
    **quarters.AXES,
    **{name: axis for observable in OBSERVABLES.values() for name, axis in observable.axes.items()},
}


def observe(scene: Scene, run: Run, names: Iterable[str], average: str = "runs") -> dict[str, np.ndarray | int]:
    """Return the arrays of the named observables of one run (`tracks.Run`)."""
    arrays: dict[str, np.ndarray | int] = {}
    for name in names:  # of one's own functions, see `own.measure`
        arrays |= OBSERVABLES[name].measure(scene, run, average)
    return arrays


def needs_every_disk(names: Collection[str], average: str = "runs") -> bool:
    """Return whether these observables need the tracks of all disks; otherwise the tracer's is enough."""
    return bool(names) and (average == "disks" or any(OBSERVABLES[name].of != "tracer" for name in names))


def of_tracer(names: Iterable[str], average: str = "runs") -> tuple[tuple[str, ...], str]:
    """Return which of these observables an engine of the tracer alone can measure, and with which average."""
    names = tuple(name for name in names if OBSERVABLES[name].of == "tracer")
    return names, average if names else "runs"


def observables_making(arrays: Collection[str]) -> tuple[str, ...]:
    """Return the names of the observables that yield these arrays."""
    return tuple(name for name, observable in OBSERVABLES.items() if next(iter(observable.arrays)) in arrays)


def axes(scene: Scene, array: str) -> dict[str, np.ndarray | list[str]]:
    """Return the coordinates along each dimension of an array: numbers, or names of species."""
    return {dim: AXES[dim].coordinates(scene) for dim in ARRAYS[array].dims}


def numbers_in(scene: Scene, names: Iterable[str]) -> int:
    """Return how many numbers these observables yield in one run at most, all arrays together."""
    arrays = (array for name in names for array in OBSERVABLES[name].arrays)
    return sum(math.prod(map(len, axes(scene, array).values())) for array in arrays)


# -- refusals -------------------------------------------------------------------------------------------------------


def refuse_unfit(scene: Scene, names: tuple[str, ...], average: str = "runs") -> None:
    """Raise RequestError if an observable is unknown, or observables or average make no sense in the scene."""
    if key_and_reason := problem(scene, names, average):
        raise RequestError(f"{scene.name}: {': '.join(key_and_reason)}")


def problem(scene: Scene, names: tuple[str, ...], average: str = "runs") -> tuple[str, str] | None:
    """Return which is wrong, "observables" or "average", and why; None if they fit the scene."""
    for name in names:
        if name not in OBSERVABLES and not own.is_own(name):
            return "observables", f"{name!r} is unknown; must be of {', '.join(OBSERVABLES)}, or my_module:my_function"
    if len(set(map(own.title_of, names))) < len(names):
        return "observables", "must differ"
    if names and scene.particles == 0:
        return "observables", "there is no disk to measure"
    for name in names:
        if why := OBSERVABLES[name].unfit(scene):
            return "observables", f"{name} {why}"
    if average == "runs":
        return None
    why = _unfit_average(scene, names, average)
    return ("average", why) if why else None


def _unfit_average(scene: Scene, names: tuple[str, ...], average: str) -> str | None:
    """Return why an average within runs does not fit the scene or the observables, None if it does."""
    if average not in AVERAGES:
        return f"{average!r} is unknown; must be {' or '.join(AVERAGES)}"
    averageable = [name for name, observable in OBSERVABLES.items() if observable.of == "tracer"]
    if not set(averageable) & set(names):
        return f"{average} needs {' or '.join(averageable)} among the observables"
    if why := why_not_stationary(scene):
        return f"{average} needs runs that are stationary from t = 0, but {why}"
    if average == "disks" and len(equal_disks(scene)) < 2:
        return "disks needs disks of the tracer's radius and mass, and there is no other"
    return time_origins.unfit(scene) if average == "origins" else None
