"""What engines that move all disks return of a run: trajectories, conservation of energy and momentum, the report.

Engines compute in units and in an order of the disks of their own (`units.Frame`); results are in the scene's.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.engines.batch import RunResult
from brownpipe.engines.state import Events, Track
from brownpipe.engines.units import SMALLEST_NORMAL, Frame
from brownpipe.scene import Scene

SAMPLES = ("position", "velocity", "image", "whole_position", "whole_velocity", "whole_image")  # of a Recorder
NO_TOTALS = np.zeros((0, 2))  # of a run that is not counted in quarters
MOST_IMAGES = 2.0**31  # periodic images that an int32 can count


class Ending(NamedTuple):
    """What the report of a run is made from, in the engine's units and order."""

    first: np.ndarray  # (N, 2) velocities at the beginning
    motion: np.ndarray  # (N, 4) float64, positions and velocities at the end
    elapsed: float  # time
    count: np.ndarray  # type: ignore[assignment]  # int64, as in the workspace at the end; hides tuple.count
    tally: np.ndarray  # float64, as in the workspace at the end
    totals: np.ndarray = NO_TOTALS  # float64, as in the recorder at the end


class EndedRun(NamedTuple):
    """A run at its end, before its report is made."""

    tracer: Track  # its samples as they are in the recorder, in the engine's units
    whole: Track | None  # like the next as of a RunResult
    events: Events | None
    ending: Ending


class Conservation(NamedTuple):
    """Energy and momentum at the end of each of K runs compared with its beginning, in the engine's units."""

    twice_energy: np.ndarray  # (K,) sum m v^2 at the beginning
    energy_drift: np.ndarray  # (K,) relative change of the energy
    momentum_residual: np.ndarray  # (K,) largest component of sum m (v' - v) - J over sum m |v| + sum |J|; J: walls
    fastest: np.ndarray  # (K,) speed of the lightest disk if it had all the energy


def sample_arrays(samples: int, disks: int) -> dict[str, np.ndarray]:
    """Return the arrays SAMPLES of an empty Recorder: of the tracer, (samples, 1, 2), and of `disks` disks."""
    return {
        name: np.zeros((samples, disks if "whole" in name else 1, 2), np.int32 if "image" in name else float)
        for name in SAMPLES
    }


def tracer_samples(recorder: Any) -> Track:
    """Return the samples of the tracer as they are in a recorder, in the engine's units."""
    return Track(recorder.position, recorder.velocity, recorder.image)


def kept(run: EndedRun) -> EndedRun:
    """Return a run that has ended with arrays of its own, which the next run does not overwrite."""
    first, motion, elapsed, count, tally, totals = run.ending
    ending = Ending(first, motion.copy(), elapsed, count.copy(), tally.copy(), totals.copy())
    return run._replace(tracer=Track(*(values.copy() for values in run.tracer)), ending=ending)


def tracer_tracks(scene: Scene, frame: Frame, samples: Sequence[Track]) -> list[Track]:
    """Return the trajectory of the tracer, M = 1, in each of several runs from its samples."""
    position, velocity, image = _converted(scene, frame, *(np.array(each) for each in zip(*samples, strict=True)))
    images = [None] * len(samples) if image is None else image
    return [Track(*each) for each in zip(position, velocity, images, strict=True)]


def whole_track(scene: Scene, frame: Frame, recorder: Any) -> Track | None:
    """Return the trajectories of all disks, M = N; None if they were not recorded."""
    if len(frame.back) == 0 or recorder.whole_position.shape[1] == 0:
        return None
    samples = (recorder.whole_position, recorder.whole_velocity, recorder.whole_image)
    return _converted(scene, frame, *(values.take(frame.back, axis=1) for values in samples))


def _converted(scene: Scene, frame: Frame, position: np.ndarray, velocity: np.ndarray, image: np.ndarray) -> Track:
    """Return samples (..., 2) in the scene's units, to which the arrays themselves are converted."""
    position *= frame.length
    for axis in (0, 1):  # five times as fast as both at once
        position[..., axis] += frame.origin[axis]
    velocity *= frame.length / frame.time
    return Track(position, velocity, image if scene.box.periodic else None)


def conservation(mass: np.ndarray, first: np.ndarray, last: np.ndarray, wall_impulses: np.ndarray) -> Conservation:
    """Compare velocities (K, N, 2) at the beginning and at the end of K runs of disks of the given masses (N,).

    `wall_impulses` (K, 4) are the total impulses >= 0 given by the walls left, right, bottom and top.
    """
    square, square_after = (v[:, :, 0] * v[:, :, 0] + v[:, :, 1] * v[:, :, 1] for v in (first, last))
    energy, energy_after = (mass * square).sum(axis=1), (mass * square_after).sum(axis=1)
    left, right, bottom, top = wall_impulses.T
    missing = (mass[:, None] * (last - first)).sum(axis=1) - np.stack([left - right, bottom - top], axis=1)
    scale = (mass * np.sqrt(square)).sum(axis=1) + left + right + bottom + top
    return Conservation(
        twice_energy=energy,
        energy_drift=_relative(energy_after - energy, energy),
        momentum_residual=_relative(np.abs(missing).max(axis=1), scale),
        fastest=np.sqrt(np.where(energy > 0, energy / mass.min(initial=np.inf), 0.0)),
    )


def _relative(change: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the quotients, 0 where the scale is not positive."""
    return np.divide(change, scale, out=np.zeros(len(scale)), where=scale > 0)


def report(
    scene: Scene,
    frame: Frame,
    conserved: Conservation,
    collisions: np.ndarray,
    impulses: np.ndarray,
    worst_overlap: np.ndarray,
    sound: np.ndarray,
    further: dict[str, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return the observables (K,) that every engine of all disks reports of K runs, in the scene's units.

    `kinetic_energy` is the total energy at t = 0. `collisions` (K, 3) are the numbers of collisions of pairs, with
    walls, and of the tracer; `impulses` (K, 5) the virial and the total impulses given by the four walls, in the
    engine's units; `worst_overlap` (K,) is in contact distances. Files list the observables in the order of the report.
    """
    speed = frame.length / frame.time
    values = {
        "pair_collisions": collisions[:, 0],
        "wall_collisions": collisions[:, 1],
        "tracer_collisions": collisions[:, 2],
        "energy_drift": conserved.energy_drift,
        "worst_overlap": worst_overlap,
        "momentum_residual": conserved.momentum_residual,
        "failed": (~sound).astype(np.uint8),
        "kinetic_energy": represented(0.5 * conserved.twice_energy, frame.mass, speed, speed),
        "virial": represented(impulses[:, 0], frame.mass, speed, frame.length),
        **(further or {}),
    }
    if not scene.box.periodic:
        values["wall_impulse"] = represented(impulses[:, 1:].sum(axis=1), frame.mass, speed)
    return values


def results_of(
    scene: Scene, frame: Frame, ended: Sequence[EndedRun], reports: Mapping[str, np.ndarray]
) -> list[RunResult]:
    """Return the results of K runs from their reports, name -> (K,)."""
    of_runs = (dict(zip(reports, numbers, strict=True)) for numbers in zip(*reports.values(), strict=True))
    each = zip(tracer_tracks(scene, frame, [run.tracer for run in ended]), ended, of_runs, strict=True)
    return [RunResult(tracer, run.whole, run.events, report) for tracer, run, report in each]


def represented(values: ArrayLike, *units: float) -> np.ndarray:
    """Return values * product(units), rounded once; NaN where the result overflows or underflows (0 stays 0).

    Intermediate products may be beyond the range of floating-point numbers.
    """
    mantissa, exponent = np.frexp(values)
    for unit in units:
        part, power = math.frexp(unit)
        mantissa, exponent = mantissa * part, exponent + power
    with np.errstate(over="ignore", under="ignore"):
        product = np.ldexp(mantissa, exponent)
    lost = ~np.isfinite(product) | ((np.abs(product) < SMALLEST_NORMAL) & (mantissa != 0.0))
    return np.where(lost, np.nan, product)


def images_fit(scene: Scene, frame: Frame, crossings: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Whether an int32 can count the periodic images that a disk crosses in each of K runs.

    Their number is bounded by the `crossings` (K,) of all disks, and by the longest `path` (K,) of a disk [engine's
    units].
    """
    side = min(scene.box.width, scene.box.height) / frame.length
    return (crossings < MOST_IMAGES) | (path < MOST_IMAGES * side) | (not scene.box.periodic)
