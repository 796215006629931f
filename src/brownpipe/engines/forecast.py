"""Forecast of the cost of a run: Enskog's collision rates, and from them CPU time, memory and file size.

CPU time is a sum of terms in proportion to the numbers of collisions and cell crossings, of samples, and of disks that
an observable measures in a sample; the costs of an observable are in its record (`observables.Observable`).

The forecast is rough on purpose, good to a factor of 2. Collision counts hold in equilibrium, within some percent,
those above a packing fraction of 0.7 for crystals. In a scene that gives disks of all masses the same standard
deviation of the velocity, they hold for the first collisions only. docs/theory.md, section 3.
"""

import math
import os
from bisect import bisect_right
from collections.abc import Collection, Iterable
from typing import NamedTuple

import numpy as np

from brownpipe import observables as measures
from brownpipe import theory
from brownpipe.engines.friction import DENSEST
from brownpipe.engines.lattice import lattice_gaps
from brownpipe.engines.saturation import is_grown, share_stuck
from brownpipe.errors import RequestError
from brownpipe.observables import Observable
from brownpipe.observables.species import bath_disks, equal_disks, species_table
from brownpipe.observables.time_origins import is_stationary
from brownpipe.scene import Scene

START_UP = 0.5  # CPU seconds of a process besides its runs: start Python, import, load kernels, write an empty file
EACH_RUN = 1.2e-4  # CPU seconds to begin and end a run, and again to equilibrate it
SECONDS_TO_FAIL = 0.09  # CPU seconds of the tries of a disk that finds no place by random insertion
SECONDS_TO_GROW = 4e-5  # CPU seconds for each disk that grows, some hundred sweeps
SECONDS_PER_DISK = 1e-6  # CPU seconds to draw the initial state of one disk, list it, and predict its first event
SECONDS_PER_EVENT = 1.9e-7  # CPU seconds of a collision, or of a disk that moves by the distance of neighbours
FITS_CACHE, SLOWER = 1e3, 0.1  # number of disks whose data fit the cache, and a power of more: events cost more there
SECONDS_PER_DISK_SAMPLE = 1.3e-7  # CPU seconds to record one disk at one sample time
SECONDS_TO_MEASURE = 2e-5  # CPU seconds of an observable in a run, and
SECONDS_PER_LAG = 8e-6  # for each lag, averaged over time origins
SECONDS_PER_BYTE = 4e-8  # CPU seconds to compress, write and verify a byte of a file
PROCESS = 140e6  # bytes of memory of a process besides its runs: Python, packages, kernels
BYTES_PER_DISK = 400  # to draw its initial state, and working memory of the engine
BYTES_PER_SAMPLE = 120  # of a disk that is recorded, during its run: its samples, sorted by disk, intermediate arrays
BYTES_PER_EVENT = 32  # of a collision in memory
EVENT_IN_FILE = 22  # bytes of a collision, compressed
COMPRESSED = 0.95  # size of compressed random coordinates, relative to the bytes of the numbers
BYTES_PER_NUMBER = 8
CLOSE_PACKING = math.pi / math.sqrt(12)  # packing fraction of equal disks
SMALLEST_GAP = 1e-6  # relative to the distance of neighbours
MOST_RUNS = 10**9  # of one process
COPIES = 2  # of what is recorded, as arrays and as a file, while it is written


class Cost(NamedTuple):
    """The forecast for one run of a scene."""

    pair_collisions: float
    wall_collisions: float
    seconds: float  # CPU time
    recorded: float  # bytes in the file
    kept: float  # bytes in memory until they are written
    working: float  # bytes of memory besides, used by one run at a time
    storing: float = 0.0  # CPU seconds besides, to sample the tracer and to write what is recorded
    once: float = 0.0  # CPU seconds in each process before its first run, besides START_UP


class Mixture(NamedTuple):
    """The disks of a scene as K components, each of one radius and mass; arrays of shape (K,)."""

    number: np.ndarray  # of disks
    radius: np.ndarray  # [length]
    mass: np.ndarray  # [mass]
    speed: np.ndarray  # standard deviation of one velocity component [length/time]


def of_run(
    scene: Scene,
    record: Collection[str] = frozenset({"tracer"}),
    observables: Collection[str] = (),
    average: str = "runs",
) -> Cost:
    """Return the forecast for one run of the exact engine that records `record` and measures `observables`.

    `record` and `average` as in `engines.ensemble.new_batch`.
    """
    time = scene.duration + scene.equilibrate.time
    mixture = mixture_of(scene)
    pair_collisions = time * pair_rate(scene, mixture)
    wall_collisions = time * wall_rate(scene, mixture)
    collisions = pair_collisions + wall_collisions
    recorded, kept = _bytes_of_record(scene, record, observables, collisions)
    every_disk = "all" in record or measures.needs_every_disk(observables, average)
    disks_recorded = 1 + (scene.particles if every_disk else 0)
    working = BYTES_PER_DISK * scene.particles + BYTES_PER_SAMPLE * len(scene.times) * disks_recorded
    slower = max(scene.particles / FITS_CACHE, 1.0) ** SLOWER
    seconds = EACH_RUN * (1 + (scene.equilibrate.time > 0)) + _seconds_to_place(scene)
    seconds += slower * SECONDS_PER_EVENT * (collisions + time * crossing_rate(scene, mixture))
    seconds += SECONDS_PER_DISK_SAMPLE * len(scene.times) * scene.particles * every_disk
    seconds += sum(_seconds_to_measure(scene, measures.OBSERVABLES[name], average) for name in observables)
    storing = SECONDS_PER_DISK_SAMPLE * len(scene.times) + SECONDS_PER_BYTE * recorded
    return Cost(pair_collisions, wall_collisions, seconds, recorded, kept, working, storing)


def _seconds_to_place(scene: Scene) -> float:
    """Return the CPU seconds to place the disks, with the tries of those that find no place, and of those that grow."""
    share = share_stuck(scene)
    tried = 0.0 if is_grown(scene) else SECONDS_TO_FAIL * share
    grown = SECONDS_TO_GROW * share if scene.placement == "auto" else 0.0
    return tried + (SECONDS_PER_DISK + grown) * scene.particles


def _bytes_of_record(
    scene: Scene, record: Collection[str], observables: Collection[str], events: float
) -> tuple[float, float]:
    """Return the bytes of what is recorded and measured of a run with so many events: in the file, and in memory."""
    coordinates = 2 * BYTES_PER_NUMBER
    images = 8 if scene.box.periodic else 0  # which take next to nothing in a file
    tracer = len(scene.times) * len({"tracer", "velocity"}.intersection(record))
    every_disk = len(scene.times) * scene.particles if "all" in record else 0
    logged = events if "events" in record else 0.0
    measured = BYTES_PER_NUMBER * measures.numbers_in(scene, observables)
    changed = min(2 * events, every_disk)  # velocities, as those between two collisions of a disk are the same
    recorded = COMPRESSED * coordinates * (tracer + every_disk + changed) + EVENT_IN_FILE * logged + measured
    kept = (coordinates + images) * tracer + (2 * coordinates + images) * every_disk
    return recorded, kept + BYTES_PER_EVENT * logged + measured


def memory(cost: Cost, runs: int) -> float:
    """Return the peak memory [bytes] of a process that makes and writes so many runs."""
    return PROCESS + max(cost.working + runs * cost.kept, COPIES * runs * (cost.kept + cost.recorded))


def seconds_to_measure_tracer(scene: Scene, observables: Iterable[str], average: str) -> float:
    """Return the CPU seconds to measure the tracer's part of `observables`, for an engine of the tracer alone."""
    names, average = measures.of_tracer(observables, average)
    return sum(_seconds_to_measure(scene, measures.OBSERVABLES[name], average) for name in names)


def _seconds_to_measure(scene: Scene, observable: Observable, average: str) -> float:
    """Return the CPU seconds to measure an observable in a run."""
    samples, disks = len(scene.times), scene.particles
    if observable.of == "tracer":
        disks = len(equal_disks(scene)) if average == "disks" else 1
    elif observable.of == "bath":
        disks = len(bath_disks(scene))
    elif observable.is_over_samples and not is_stationary(scene):
        samples = 1
    of_sample = disks * observable.seconds_per_disk_sample
    if average == "origins" and observable.of != "all":
        of_sample = SECONDS_PER_LAG + disks * observable.seconds_per_product * samples / 2
    return SECONDS_TO_MEASURE + samples * of_sample


def machine_memory() -> int:
    """Return the memory [bytes] of this machine."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def most_runs(cost: Cost, available: float) -> int:
    """Return how many runs of this cost one process can make and write in so much memory [bytes]; 0 for none."""
    return bisect_right(range(1, MOST_RUNS + 1), available, key=lambda runs: memory(cost, runs))


def refuse_too_large(scene: Scene, runs: int, cost: Cost) -> None:
    """Raise RequestError if so many runs of a scene, each of this cost, in one process exceed this machine's memory."""
    needed, available = memory(cost, runs), machine_memory()
    if needed > available:
        cure = f"this machine has {available / 1e9:.3g} GB: take fewer seeds a call, fewer samples, or record less"
        raise RequestError(f"{scene.name}: {runs} runs need some {needed / 1e9:.3g} GB of memory, and {cure}")


def mixture_of(scene: Scene) -> Mixture:
    """Return the disks of a scene by species."""
    table = species_table(scene)
    return Mixture(table.number, table.radius, table.mass, _speeds(scene, table.mass))


def _speeds(scene: Scene, mass: np.ndarray) -> np.ndarray:
    """Return the standard deviation [length/time] of a velocity component of disks of each mass (K,).

    A list of disks is taken to be in equilibrium at its mean kinetic energy per disk.
    """
    if scene.particles == 0:
        return np.zeros(len(mass))
    if scene.velocities is None:
        velocity = np.array([disk.velocity for disk in scene.listed])
        unit = float(np.abs(velocity).max()) or 1.0  # so that no square overflows
        return unit * np.sqrt(np.mean(scene.mass * np.sum((velocity / unit) ** 2, axis=1)) / 2 / mass)
    if scene.velocities.temperature is not None:
        return np.sqrt(scene.velocities.temperature / mass)
    return np.full(len(mass), scene.velocities.standard_deviation)


def pair_rate(scene: Scene, mixture: Mixture) -> float:
    """Return the expected collisions between disks per time [1/time], summed over all pairs of components.

    `theory.collision_rate` with sqrt(kT/mu) = hypot(speed_i, speed_j), the standard deviation of a component of the
    relative velocity. This also holds for components of different temperatures.
    """
    density = mixture.number / scene.box.area
    fluid, rate = min(1.0, DENSEST / max(scene.packing_fraction, 1e-300)), 0.0
    for i, radius in enumerate(mixture.radius):
        partners = mixture.number - (np.arange(len(mixture.number)) == i)
        sigma = radius + mixture.radius
        contact = theory.contact_value_mixture(2 * radius, 2 * mixture.radius, fluid * density, 2 * mixture.radius)
        relative_speed = np.hypot(mixture.speed[i], mixture.speed)
        rates = theory.collision_rate(partners / scene.box.area, sigma, contact, 1.0, 1.0) * relative_speed
        rate += mixture.number[i] * rates.sum() / 2
    return float(rate) * _crowding(scene)


def _crowding(scene: Scene) -> float:
    """Return how many times as often disks collide above DENSEST as in the fluid of that packing fraction.

    By the free volume of a crystal of equal disks, Z = 1 + 2 phi chi = s/(s - 2 R) for neighbours at the distance s (Z.
    W. Salsburg & W. W. Wood, J. Chem. Phys. 37, 798 (1962)); its mean over the three directions of a stretched lattice.
    """
    phi = scene.packing_fraction
    if phi <= DENSEST:
        return 1.0
    gaps = np.full(3, 1 - math.sqrt(min(phi / CLOSE_PACKING, 1.0)))  # relative to the distance
    if scene.placement == "lattice" and scene.species[0].position is None:
        in_row, to_next = lattice_gaps(scene)
        gaps = np.array([in_row, to_next, to_next])
        gaps /= gaps + 2 * float(scene.radius.max())
    z = float(np.mean(1 / np.maximum(gaps, SMALLEST_GAP)))
    crystal = (z - 1) / (2 * phi)
    return crystal / theory.contact_value(DENSEST)


def wall_rate(scene: Scene, mixture: Mixture) -> float:
    """Return the expected collisions with walls per time [1/time]: n Z speed/sqrt(2 pi) per length of the perimeter."""
    if scene.box.periodic or scene.particles == 0:
        return 0.0
    phi = min(scene.packing_fraction, DENSEST)
    density = mixture.number / scene.box.area * theory.compressibility(phi, theory.contact_value_henderson(phi))
    flux = density * mixture.speed / np.sqrt(2 * np.pi)
    return float(2 * (scene.box.width + scene.box.height) * flux.sum())


def crossing_rate(scene: Scene, mixture: Mixture) -> float:
    """Return how often per time [1/time] disks move by the distance of neighbours, sqrt(area per disk)."""
    return _path_rate(mixture) / float(np.sqrt(scene.box.area / max(scene.particles, 1)))


def mean_free_path(scene: Scene) -> float:
    """Return the mean free path [length] between collisions with disks: mean speed over mean collision rate.

    An average over all disks; inf if none collide.
    """
    mixture = mixture_of(scene)
    rate = 2 * pair_rate(scene, mixture)
    return _path_rate(mixture) / rate if rate > 0 else np.inf


def _path_rate(mixture: Mixture) -> float:
    """Return the length of all disks' paths per time [length/time]; the mean speed is sqrt(pi/2) times `speed`."""
    return float(np.sqrt(np.pi / 2) * (mixture.number * mixture.speed).sum())


def few_collisions(scene: Scene) -> str | None:
    """Return one line of caution if the mean free path is longer than the shorter side of the box; otherwise None."""
    side = min(scene.box.width, scene.box.height)
    path = mean_free_path(scene)
    if not scene.species or scene.particles < 2 or not side < path < np.inf:
        return None
    too_long = f"the mean free path, {path:.2g}, is longer than its shorter side, {side:.2g}"
    return f"{scene.name}: {scene.particles} disks are too few for Brownian motion in this box: {too_long}"
