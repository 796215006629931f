"""What engines that move all disks return of a run: trajectories, conservation of energy and momentum, the report.

Engines compute in units and in an order of the disks of their own (`units.Frame`); results are in the scene's.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.engines.state import Track
from brownpipe.engines.units import SMALLEST_NORMAL, Frame
from brownpipe.scene import Scene

SAMPLES = ("position", "velocity", "image", "whole_position", "whole_velocity", "whole_image")  # of a Recorder
MOST_IMAGES = 2.0**31  # periodic images that an int32 can count


class Conservation(NamedTuple):
    """Energy and momentum at the end of a run compared with its beginning, in the engine's units."""

    twice_energy: float  # sum m v^2 at the beginning
    energy_drift: float  # relative change of the energy
    momentum_residual: float  # largest component of sum m (v' - v) - J over sum m |v| + sum |J|; J: wall impulses
    fastest: float  # speed of the lightest disk if it had all the energy


def sample_arrays(samples: int, disks: int) -> dict[str, np.ndarray]:
    """Return the arrays SAMPLES of an empty Recorder: of the tracer, (samples, 1, 2), and of `disks` disks."""
    return {
        name: np.zeros((samples, disks if "whole" in name else 1, 2), np.int32 if "image" in name else float)
        for name in SAMPLES
    }


def tracks(scene: Scene, frame: Frame, recorder: Any) -> tuple[Track, Track | None]:
    """Return the trajectory of the tracer, M = 1, and those of all disks, M = N; None if they were not recorded."""
    tracer = _track(scene, frame, recorder.position, recorder.velocity, recorder.image)
    if len(frame.back) == 0 or recorder.whole_position.shape[1] == 0:
        return tracer, None
    samples = (recorder.whole_position, recorder.whole_velocity, recorder.whole_image)
    return tracer, _track(scene, frame, *(values[:, frame.back] for values in samples))


def _track(scene: Scene, frame: Frame, position: np.ndarray, velocity: np.ndarray, image: np.ndarray) -> Track:
    position = position * frame.length + frame.origin
    return Track(position, velocity * (frame.length / frame.time), image if scene.box.periodic else None)


def conservation(mass: np.ndarray, first: np.ndarray, last: np.ndarray, wall_impulses: np.ndarray) -> Conservation:
    """Compare velocities (N, 2) at the beginning and at the end of a run of disks of the given masses (N,).

    `wall_impulses` (4,) are the total impulses >= 0 given by the walls left, right, bottom and top.
    """
    return each_conservation(mass, first[None], last[None], wall_impulses[None])[0]


def each_conservation(
    mass: np.ndarray, first: np.ndarray, last: np.ndarray, wall_impulses: np.ndarray
) -> list[Conservation]:
    """Return `conservation` of each of K runs, from velocities (K, N, 2) and wall impulses (K, 4)."""
    square, square_after = (v[:, :, 0] * v[:, :, 0] + v[:, :, 1] * v[:, :, 1] for v in (first, last))
    before, after = (mass * square).sum(axis=1), (mass * square_after).sum(axis=1)
    left, right, bottom, top = wall_impulses.T
    missing = (mass[:, None] * (last - first)).sum(axis=1) - np.stack([left - right, bottom - top], axis=1)
    scale = (mass * np.sqrt(square)).sum(axis=1) + left + right + bottom + top
    lightest = float(mass.min(initial=np.inf))
    return [
        Conservation(
            twice_energy=energy,
            energy_drift=(energy_after - energy) / energy if energy > 0 else 0.0,
            momentum_residual=momentum / most if most > 0 else 0.0,
            fastest=math.sqrt(energy / lightest) if energy > 0 else 0.0,
        )
        for energy, energy_after, momentum, most in zip(
            *(values.tolist() for values in (before, after, np.abs(missing).max(axis=1), scale)), strict=True
        )
    ]


def report(
    scene: Scene,
    frame: Frame,
    conserved: Conservation,
    collisions: np.ndarray,
    impulses: np.ndarray,
    worst_overlap: float,
    sound: bool,
    further: dict[str, int] | None = None,
) -> dict[str, float | int]:
    """Return the observables that every engine of all disks reports of a run, in the scene's units.

    `kinetic_energy` is the total energy at t = 0. `collisions` (3,) are the numbers of collisions of pairs, with walls,
    and of the tracer; `impulses` (5,) the virial and the total impulses given by the four walls, in the engine's units;
    `worst_overlap` is in contact distances. Files list the observables in the order of the report.
    """
    speed = frame.length / frame.time
    pairs, walls, tracer = collisions.tolist()
    values = {
        "pair_collisions": pairs,
        "wall_collisions": walls,
        "tracer_collisions": tracer,
        "energy_drift": conserved.energy_drift,
        "worst_overlap": worst_overlap,
        "momentum_residual": conserved.momentum_residual,
        "failed": np.uint8(not sound),
        "kinetic_energy": represented(0.5 * conserved.twice_energy, frame.mass, speed, speed),
        "virial": represented(float(impulses[0]), frame.mass, speed, frame.length),
        **(further or {}),
    }
    if not scene.box.periodic:
        values["wall_impulse"] = represented(float(impulses[1:].sum()), frame.mass, speed)
    return values


def represented(value: float, *units: float) -> float:
    """Return value * product(units), rounded once; NaN if the result overflows or underflows (0 stays 0).

    Intermediate products may be beyond the range of floating-point numbers.
    """
    mantissa, exponent = math.frexp(value)
    for unit in units:
        part, power = math.frexp(unit)
        mantissa, exponent = mantissa * part, exponent + power
    try:
        product = math.ldexp(mantissa, exponent)
    except OverflowError:
        return math.nan
    lost = not math.isfinite(product) or (abs(product) < SMALLEST_NORMAL and value != 0.0)
    return math.nan if lost else product


def each_represented(values: np.ndarray, *units: float) -> np.ndarray:
    """Return `represented` of each number of an array."""
    mantissa, exponent = np.frexp(values)
    for unit in units:
        part, power = math.frexp(unit)
        mantissa, exponent = mantissa * part, exponent + power
    with np.errstate(over="ignore", under="ignore"):
        product = np.ldexp(mantissa, exponent)
    lost = ~np.isfinite(product) | ((np.abs(product) < SMALLEST_NORMAL) & (values != 0.0))
    return np.where(lost, np.nan, product)


def images_fit(scene: Scene, frame: Frame, crossings: int, path: float) -> bool:
    """Whether an int32 can count the periodic images that a disk crosses.

    Their number is bounded by the `crossings` of all disks, and by the longest `path` of a disk [engine's units].
    """
    side = min(scene.box.width, scene.box.height) / frame.length
    return not scene.box.periodic or bool(crossings < MOST_IMAGES or path < MOST_IMAGES * side)


def all_finite(*arrays: ArrayLike) -> bool:
    """Whether no number is inf or NaN."""
    return all(np.isfinite(array).all() for array in arrays)
