"""Observables: what is measured in a run while all its disks are in memory, so that trajectories
need not be stored.

Each observable is a pure function of the tracks of one run that returns arrays. The arrays of all
runs of a batch are stacked and stored under their names, shape (S, ...). ARRAYS describes each
array, AXES its dimensions: T sample times, K species (the tracer is a species of its own), P pairs
of species.

A new observable is a function and its record (`observable.Observable`) in a module of this package,
and its name in OBSERVABLES. The command line, files, checkpoints, studies and forecasts take it
from there. A user's own functions need no record (`own`).
"""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.observables import (
    displacement,
    equilibrium,
    first_passage,
    orientation,
    own,
    pairs,
    profile,
    velocity,
)
from brownpipe.observables.average import AVERAGES, over_disks, over_origins
from brownpipe.observables.equilibrium import is_stationary, why_not_stationary
from brownpipe.observables.observable import Axis, Observable, RunArray
from brownpipe.observables.trajectory import Run, Track
from brownpipe.scene import Scene
from brownpipe.scene.species import equal_disks, species_table

OBSERVABLES: dict[str, Observable] = {
    "square_displacement": displacement.SQUARE_DISPLACEMENT,
    "velocity_autocorrelation": velocity.AUTOCORRELATION,
    "bath_velocity_autocorrelation": velocity.BATH_AUTOCORRELATION,
    "species_energy": velocity.ENERGY,
    "velocity_distribution": velocity.DISTRIBUTION,
    "pair_distribution": pairs.DISTRIBUTION,
    "density_profile": profile.DENSITY_PROFILE,
    "quartic_displacement": displacement.QUARTIC_DISPLACEMENT,
    "orientational_order": orientation.ORDER,
    "first_passage": first_passage.FIRST_PASSAGE,
}
ARRAYS: dict[str, RunArray] = {**equilibrium.ARRAYS}
AXES: dict[str, Axis] = {
    "time": Axis(
        "time", "time since the start of the run, or since a time origin", lambda scene: scene.times
    ),
    "species": Axis("1", "species of the disk", lambda scene: list(species_table(scene).name)),
    **equilibrium.AXES,
}
for _observable in OBSERVABLES.values():
    ARRAYS |= _observable.arrays
    AXES |= _observable.axes


def observable_named(name: str) -> Observable:
    """Return the record of an observable, listed here or the user's own."""
    return own.own_observable(name) if own.is_own(name) else OBSERVABLES[name]


def observe(
    scene: Scene, run: Run, names: Iterable[str], average: str = "runs"
) -> dict[str, np.ndarray]:
    """Return the arrays of the named observables of one run. The user's own are left to
    `own.measure`.
    """
    arrays: dict[str, np.ndarray] = {}
    for name in names:
        if own.is_own(name):
            continue
        observable = OBSERVABLES[name]
        if observable.measure_path is not None:
            if run.events is None:
                raise RequestError(f"{name} needs collisions, which the engine does not return")
            arrays |= observable.measure_path(scene, run.path(scene))
        else:
            track = _track_for(observable, scene, run, average)
            arrays |= observable.measure(scene, track, average)
    return arrays


def _track_for(observable: Observable, scene: Scene, run: Run, average: str) -> Track:
    """Return the track that an observable is measured from."""
    if observable.tracks_needed == "tracer":
        return run.every_disk.select(equal_disks(scene)) if over_disks(average) else run.tracer
    if observable.is_over_samples and not is_stationary(scene):
        return run.every_disk.last_sample()
    return run.every_disk


def needs_every_disk(names: Collection[str], average: str = "runs") -> bool:
    """Return whether these observables need the tracks of all disks; otherwise the tracer's is
    enough.
    """
    if over_disks(average):
        return bool(names)
    return any(observable_named(name).tracks_needed in ("bath", "all") for name in names)


def needs_events(names: Iterable[str]) -> bool:
    """Return whether some of these observables need the collisions of a run."""
    return any(observable_named(name).tracks_needed == "path" for name in names)


def tracer_observables(names: Iterable[str]) -> tuple[str, ...]:
    """Return which of these observables an engine of the tracer alone can measure."""
    return tuple(name for name in names if observable_named(name).tracks_needed == "tracer")


def numbers_in(scene: Scene, names: Iterable[str]) -> int:
    """Return how many numbers these observables yield in one run at most, all arrays together."""
    total = 0
    for name in names:
        observable = observable_named(name)
        for array in observable.arrays.keys() - observable.absent(scene):
            dims = observable.arrays[array].dims
            total += math.prod(len(AXES[dim].coordinates(scene)) for dim in dims)
    return total


# -- refusals --------------------------------------------------------------------------------------


def refuse_unfit_observables(scene: Scene, names: Sequence[str], average: str = "runs") -> None:
    """Raise RequestError if an observable is unknown, or observables or average make no sense in
    the scene.
    """
    for key, why in problems(scene, names, average):
        raise RequestError(f"{scene.name}: {key}: {why}")


def problems(
    scene: Scene, names: Sequence[str], average: str = "runs"
) -> Iterator[tuple[str, str]]:
    """Yield which is wrong, "observables" or "average", and why; nothing if they fit the scene.

    Only the first need be reported: the others may have the same cause.
    """
    for name in names:
        if name not in OBSERVABLES and not own.is_own(name):
            yield (
                "observables",
                f"{name!r} is unknown; must be of {', '.join(OBSERVABLES)}, or "
                "my_module:my_function",
            )
    if len(set(map(own.title_of, names))) < len(names):
        yield "observables", "must have names that differ"
    if names and scene.particles == 0:
        yield "observables", "there is no disk to measure"
    for name in names:
        if why := observable_named(name).why_unfit(scene):
            yield "observables", f"{name} {why}"
    if average == "runs":
        return
    if average not in AVERAGES:
        yield "average", f"{average!r} is unknown; must be {' or '.join(AVERAGES)}"
        return
    if not tracer_observables(names):
        averaged = " or ".join(tracer_observables(OBSERVABLES))
        yield "average", f"{average} needs {averaged} among the observables"
    if why := why_not_stationary(scene):
        yield "average", f"{average} needs runs that are stationary from t = 0, but {why}"
    if over_disks(average) and len(equal_disks(scene)) < 2:
        yield "average", "disks needs disks of the tracer's radius and mass, and there is no other"
    if over_origins(average) and scene.samples is not None:
        yield (
            "average",
            "origins needs sample_interval, not samples: lags are differences of sample times",
        )
