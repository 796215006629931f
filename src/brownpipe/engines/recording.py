"""What engines that move all disks return of a run: trajectories, conservation of energy and
momentum, the report.

Engines compute in units and in an order of the disks of their own (`units.Frame`); results are in
the scene's.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from brownpipe.engines.compiled.kernels import entry_point
from brownpipe.engines.compiled.records import SampleArrays
from brownpipe.engines.units import Frame
from brownpipe.observables.trajectory import Track
from brownpipe.scene import Scene

# a run with a larger energy drift, overlap or momentum residual has failed; round-off is far below
HEALTH_BOUND = 1e-9
MOST_IMAGES = 2.0**31  # periodic images that an int32 can count


class Conservation(NamedTuple):
    """Energy and momentum at the end of a run compared with its beginning, without pinned disks."""

    energy: float  # sum m v^2 / 2 at the beginning
    energy_drift: float  # relative change of the energy
    # largest component of sum m (v' - v) - J over sum m |v| + sum |J|; J: walls
    momentum_residual: float
    fastest: float  # speed of the lightest disk if it had all the energy
    finite: bool  # whether all positions and velocities at the end are finite numbers


class Recorder(Protocol):
    """What the recorders of both engines have: samples of the tracer, M = 1, and of all disks,
    M = N, or M = 0 if not recorded.
    """

    @property
    def track(self) -> SampleArrays: ...

    @property
    def whole(self) -> SampleArrays: ...


def blank_samples(times: int, disks: int) -> SampleArrays:
    """Return memory for samples at `times` times of `disks` disks."""
    shape = (times, disks, 2)
    return SampleArrays(np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int32))


def tracks_of(scene: Scene, frame: Frame, recorder: Recorder) -> tuple[Track, Track | None, bool]:
    """Return the trajectory of the tracer, M = 1, converted in place; of all disks, M = N, or None
    if not recorded (that of no disks always is).

    And whether all positions and velocities are finite numbers in the scene's units.
    """
    finite = _convert_samples(recorder.track, frame)
    tracer = Track(*recorder.track)
    whole = None
    if recorder.whole.position.shape[1] or not scene.particles:
        samples = SampleArrays(*(values.take(frame.back, axis=1) for values in recorder.whole))
        finite &= _convert_samples(samples, frame)
        whole = Track(*samples)
    if not scene.box.has_images:
        tracer = tracer._replace(image=None)
        whole = whole and whole._replace(image=None)
    return tracer, whole, finite


def _convert_samples(samples: SampleArrays, frame: Frame) -> bool:
    """Convert samples in place to the scene's units; return whether they are finite numbers."""
    return convert(samples.position, samples.velocity, frame.origin, frame.length, frame.speed)


@entry_point
def convert(
    position: np.ndarray, velocity: np.ndarray, origin: np.ndarray, length: float, speed: float
) -> bool:
    """Convert samples (T, M, 2) from the engine's units; return whether they are finite numbers."""
    finite = True
    for t in range(position.shape[0]):
        for i in range(position.shape[1]):
            for c in range(2):
                position[t, i, c] = position[t, i, c] * length + origin[c]
                velocity[t, i, c] *= speed
                finite &= math.isfinite(position[t, i, c]) and math.isfinite(velocity[t, i, c])
    return finite


@entry_point
def conservation(
    mass: np.ndarray, first: np.ndarray, last: np.ndarray, walls: np.ndarray
) -> Conservation:
    """Compare positions and velocities (N, 4) at the beginning and at the end of a run of disks of
    masses (N,).

    `walls` (4,) are the total impulses >= 0 given by the walls left, right, bottom and top. Disks
    of infinite mass are left out of the sums.
    """
    left, right, bottom, top = walls[0], walls[1], walls[2], walls[3]
    energy, energy_after, x, y, scale, lightest, finite = 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, True
    for i in range(len(mass)):
        u, v, u_after, v_after = first[i, 2], first[i, 3], last[i, 2], last[i, 3]
        finite &= math.isfinite(last[i, 0] + last[i, 1] + u_after + v_after)
        if mass[i] < math.inf:
            energy += mass[i] * (u * u + v * v)
            energy_after += mass[i] * (u_after * u_after + v_after * v_after)
            x += mass[i] * (u_after - u)
            y += mass[i] * (v_after - v)
            scale += mass[i] * math.sqrt(u * u + v * v)
            lightest = min(lightest, mass[i])
    missing, scale = (
        max(abs(x - (left - right)), abs(y - (bottom - top))),
        scale + left + right + bottom + top,
    )
    drift = (energy_after - energy) / energy if energy > 0.0 else 0.0
    fastest = math.sqrt(energy / lightest) if energy > 0.0 else 0.0
    return Conservation(
        0.5 * energy, drift, missing / scale if scale > 0.0 else 0.0, fastest, finite
    )


def report_in_scene_units(
    scene: Scene,
    frame: Frame,
    conserved: Conservation,
    collisions: list[int],
    impulses: np.ndarray,
    worst_overlap: float,
    sound: bool,
) -> dict[str, np.typing.ArrayLike]:
    """Return the observables that every engine of all disks reports of a run, in the scene's units.

    `kinetic_energy` is the total energy at t = 0. `collisions` are the numbers of collisions of
    pairs, with walls, and of the tracer; `impulses` the virial and the total impulses given by the
    four walls, in the engine's units; `worst_overlap` is in contact distances. A run fails if it is
    not `sound`, if its energy drift exceeds HEALTH_BOUND or if it has numbers that are not finite.
    Files list the observables in the order of the report.
    """
    virial, *walls = impulses.tolist()  # Python's floats: NumPy's warn of an overflow
    sound = sound and conserved.finite and abs(conserved.energy_drift) <= HEALTH_BOUND
    sound = sound and math.isfinite(conserved.energy) and math.isfinite(virial + sum(walls))
    pair_collisions, wall_collisions, tracer_collisions = collisions
    values: dict[str, np.typing.ArrayLike] = {
        "pair_collisions": pair_collisions,
        "wall_collisions": wall_collisions,
        "tracer_collisions": tracer_collisions,
    }
    values["energy_drift"] = conserved.energy_drift
    values["worst_overlap"] = worst_overlap
    values["momentum_residual"] = conserved.momentum_residual
    values["failed"] = np.uint8(not sound)
    values["kinetic_energy"] = conserved.energy * frame.mass * frame.speed * frame.speed
    values["virial"] = virial * frame.mass * frame.speed * frame.length
    if scene.box.has_walls:
        values["wall_impulse"] = sum(walls) * frame.mass * frame.speed
    return values


def report_nothing() -> None:
    """Compile the kernels of a report."""
    conservation(np.zeros(0), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(4))
    convert(np.zeros((0, 1, 2)), np.zeros((0, 1, 2)), np.zeros(2), 1.0, 1.0)


def can_count_images(
    scene: Scene, frame: Frame, most_crossings: float, longest_path: float
) -> bool:
    """Whether an int32 can count the periodic images that a disk crosses.

    Their number is bounded by `most_crossings`, those of all disks, and by the longest path of a
    disk [engine's units].
    """
    side = min(scene.box.width, scene.box.height) / frame.length
    few_images = most_crossings < MOST_IMAGES or longest_path < MOST_IMAGES * side
    return few_images or not scene.box.has_images
