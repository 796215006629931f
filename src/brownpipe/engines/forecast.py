"""What a scene will cost before it is run: collisions by Enskog's theory, and from them CPU time, memory and file size.

Time steps, samples, crossings of cells, and what an observable does with a sample of a disk cost so much each:
`benchmarks/bench_cost.py` compares the forecast with the CPU time taken.

Rough on purpose. The collision counts hold in equilibrium, within some percent up to a packing fraction of 0.65. If the
scene gives every disk the same standard deviation of the velocity, they are those of its beginning.
"""

import os
from typing import NamedTuple

import numpy as np

from brownpipe import observables as measures
from brownpipe import theory
from brownpipe.errors import RequestError
from brownpipe.observables import pairs
from brownpipe.observables.species import bath_disks, equal_disks
from brownpipe.scene import Scene

START_UP = 0.7  # CPU seconds that a process takes to start with its kernels compiled
EACH_RUN = 2.5e-4  # CPU seconds to draw a state and to keep what is recorded
SECONDS_PER_COLLISION = 2.5e-7  # CPU seconds, with a pair or a wall
SECONDS_PER_CROSSING = 2e-7  # CPU seconds for a disk that moves by the distance of neighbours
DISKS = (1e3, 1e4, 1e5, 1e6)  # the more disks, the more often one is out of the processor's cache
SLOWER = (1.0, 1.2, 1.6, 2.1)  # are both with so many disks
PATH_PER_BLOCK = 1024.0  # as in exact.setup: contact distances that a disk moves until all is predicted afresh
SECONDS_PER_BLOCK = 1.5e-7  # CPU seconds for one disk
SECONDS_PER_DISK_SAMPLE = 1.3e-7  # CPU seconds to record a disk at a sample time, where all are recorded
DENSEST = 0.7  # packing fraction up to which the theory is used
BYTES_PER_DISK = 250  # the engine's working memory
BYTES_PER_EVENT = 32
COMPRESSED = 0.95  # of the bytes of random coordinates
BYTES_PER_NUMBER = 8
BYTES_PER_SAMPLE = 120  # of a disk, of which a run is measured: recorded, put in order, and what is computed from it
COPIES = 4  # of what is recorded, while it is written and verified
# CPU seconds to measure an observable in a run: for the run, and for one of the disks it follows in one sample.
SECONDS_TO_MEASURE = {
    "square_displacement": (1e-5, 3.6e-8),
    "velocity_autocorrelation": (3e-5, 7e-9),
    "species_energy": (2e-5, 1.7e-8),
    "velocity_distribution": (5e-5, 2.8e-8),
    "pair_distribution": (1e-4, 6e-7),
}
SECONDS_PER_SNAPSHOT = 4e-5  # of pair_distribution, and in it
SECONDS_PER_PAIR = 9e-8  # of disks that are near enough to be counted
SECONDS_PER_RING = 6e-8  # around a lone disk between walls
# Of averages over time origins: for a lag, and for one disk and one origin at that lag.
SECONDS_PER_LAG = {"square_displacement": (9e-6, 2.2e-8), "velocity_autocorrelation": (6e-6, 1e-9)}


class Cost(NamedTuple):
    """What one run of a scene is expected to take."""

    pair_collisions: float
    wall_collisions: float
    seconds: float  # of CPU
    recorded: float  # bytes, also those of the file
    working: float  # bytes of memory, what is kept of the runs aside: of one run at a time
    once: float = 0.0  # CPU seconds that pass in each process before its first run


class Kinds(NamedTuple):
    """The disks of a scene by kind, shape (K,) each. The speeds are standard deviations of one component."""

    number: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    speed: np.ndarray  # [length/time]


def of_run(scene: Scene, record=frozenset({"tracer"}), observables=(), average: str = "runs") -> Cost:
    """Return what one run of the scene is expected to cost if `record` is kept of it and `observables` are measured."""
    time = scene.duration + scene.equilibrate
    kinds = kinds_of(scene)
    pairs, walls = time * pair_rate(scene, kinds), time * wall_rate(scene, kinds)
    slower = float(np.interp(np.log(max(scene.particles, 1)), np.log(DISKS), SLOWER))
    samples = len(scene.times) * (("tracer" in record) * 16 + ("all" in record) * 32 * scene.particles)
    recorded = COMPRESSED * samples + ("events" in record) * BYTES_PER_EVENT * (pairs + walls)
    recorded += BYTES_PER_NUMBER * measures.numbers_in(scene, observables)
    working = BYTES_PER_DISK * scene.particles
    every = measures.needs_every_disk(scene, observables, average)
    if every:
        working += BYTES_PER_SAMPLE * len(scene.times) * scene.particles
    seconds = EACH_RUN + SECONDS_PER_BLOCK * scene.particles * blocks(time, kinds)
    seconds += slower * SECONDS_PER_COLLISION * (pairs + walls)
    seconds += slower * SECONDS_PER_CROSSING * time * crossing_rate(scene, kinds)
    if every or "all" in record:
        seconds += SECONDS_PER_DISK_SAMPLE * len(scene.times) * scene.particles
    seconds += sum(_measuring(scene, name, average, len(bath_disks(scene))) for name in observables)
    return Cost(pairs, walls, seconds, recorded, working)


def seconds_to_measure_tracer(scene: Scene, observables, average: str) -> float:
    """Return the CPU seconds to measure in a run the observables of an engine that follows the tracer alone."""
    names, average = measures.of_tracer(observables, average)
    return sum(_measuring(scene, name, average, 0) for name in names)


def _measuring(scene: Scene, name: str, average: str, bath: int) -> float:
    """Return the CPU seconds that it takes to measure an observable in a run, with so many disks in the bath."""
    samples, (once, each) = len(scene.times), SECONDS_TO_MEASURE[name]
    if name in SECONDS_PER_LAG:
        disks = len(equal_disks(scene)) if average == "disks" else 1
        disks += bath if name == "velocity_autocorrelation" else 0
        if average != "origins":
            return once + each * samples * disks
        lag, product = SECONDS_PER_LAG[name]
        return once + samples * (lag * (2 if disks > 1 else 1) + product * disks * samples / 2)
    counted = samples if name == "species_energy" or measures.is_stationary(scene) else 1
    seconds = once + each * counted * scene.particles
    return seconds + (counted * _counting_pairs(scene) if name == "pair_distribution" else 0.0)


def _counting_pairs(scene: Scene) -> float:
    """Return the CPU seconds to count the pairs in reach in one sample, and to measure the rings around lone disks."""
    bins, width = pairs.bins(scene)
    near = min(1.0, np.pi * (bins * width) ** 2 / scene.box.area) * scene.particles**2 / 2
    rings = bins * len(pairs.lone_pairs(scene, measures.species_table(scene)))
    return SECONDS_PER_SNAPSHOT + SECONDS_PER_PAIR * near + SECONDS_PER_RING * rings


def refuse_too_large(
    scene: Scene, runs: int, record=frozenset({"tracer"}), observables=(), average: str = "runs"
) -> None:
    """Raise RequestError if memory cannot hold what is kept of so many runs, and one of them whole to measure it."""
    cost = of_run(scene, record, observables, average)
    needed, there = (
        COPIES * runs * cost.recorded + cost.working,
        os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
    )
    if needed > there:
        few = f"this machine has {there / 1e9:.3g} GB: take fewer seeds a call, fewer samples, or record less"
        raise RequestError(f"{scene.name}: {runs} runs need some {needed / 1e9:.3g} GB of memory, and {few}")


def kinds_of(scene: Scene) -> Kinds:
    """Return the disks of a scene by radius and mass."""
    groups = scene.species or scene.disks
    counts = [getattr(one, "count", 1) for one in groups]
    both = np.array([(one.radius, one.mass) for one in groups]).reshape(-1, 2)
    kinds, which = np.unique(both, axis=0, return_inverse=True)
    radius, mass = kinds.T
    return Kinds(np.bincount(which.ravel(), counts, len(kinds)), radius, mass, _speeds(scene, mass))


def _speeds(scene: Scene, mass: np.ndarray) -> np.ndarray:
    """Return the standard deviation of a velocity component of disks of each mass; a list of disks: in equilibrium."""
    if scene.particles == 0:
        return np.zeros(len(mass))
    if scene.velocities is None:
        velocity = np.array([disk.velocity for disk in scene.disks])
        top = float(np.abs(velocity).max()) or 1.0
        return top * np.sqrt(np.mean(scene.mass * np.sum((velocity / top) ** 2, axis=1)) / 2 / mass)
    if scene.velocities.temperature is not None:
        return np.sqrt(scene.velocities.temperature / mass)
    return np.full(len(mass), scene.velocities.standard_deviation)


def blocks(time: float, kinds: Kinds) -> float:
    """Return how often the engine predicts everything afresh: its clock begins again each time."""
    present = kinds.number > 0
    if not present.any():
        return 0.0
    return time * float(kinds.speed[present].max()) / (PATH_PER_BLOCK * 2 * float(kinds.radius[present].min()))


def pair_rate(scene: Scene, kinds: Kinds) -> float:
    """Return the expected collisions between disks per time [1/time], of all kinds with all kinds."""
    density, rate = kinds.number / scene.box.area, 0.0
    crowd = min(1.0, DENSEST / max(scene.packing_fraction, 1e-300))
    for i, radius in enumerate(kinds.radius):
        others = kinds.number - (np.arange(len(kinds.number)) == i)
        sigma = radius + kinds.radius
        contact = theory.contact_value_mixture(2 * radius, 2 * kinds.radius, crowd * density, 2 * kinds.radius)
        relative = np.hypot(kinds.speed[i], kinds.speed)  # for one temperature, sqrt(kT / reduced mass)
        each = theory.collision_rate(others / scene.box.area, sigma, contact, 1.0, 1.0) * relative
        rate += kinds.number[i] * each.sum() / 2
    return float(rate)


def crossing_rate(scene: Scene, kinds: Kinds) -> float:
    """Return how often per time disks move by the distance of neighbours, the root of the area per disk [1/time]."""
    return _path_rate(kinds) / float(np.sqrt(scene.box.area / max(scene.particles, 1)))


def mean_free_path(scene: Scene) -> float:
    """Return the mean free path between collisions with other disks, averaged over all disks [length]; inf without any.

    Mean speed over mean collision rate.
    """
    kinds = kinds_of(scene)
    rate = 2 * pair_rate(scene, kinds)
    return _path_rate(kinds) / rate if rate > 0 else np.inf


def _path_rate(kinds: Kinds) -> float:
    """Return the length of all disks' paths per time [length/time]; the mean speed is sqrt(pi/2) of that in x."""
    return float(np.sqrt(np.pi / 2) * (kinds.number @ kinds.speed))


def few_collisions(scene: Scene) -> str | None:
    """Return one line if the mean free path is longer than the box, so that disks hardly meet; None otherwise."""
    side, path = min(scene.box.width, scene.box.height), mean_free_path(scene)
    if not scene.species or scene.particles < 2 or not side < path < np.inf:
        return None
    too_long = f"the mean free path, {path:.2g}, is longer than its shorter side, {side:.2g}"
    return f"{scene.name}: {scene.particles} disks are too few for Brownian motion in this box: {too_long}"


def wall_rate(scene: Scene, kinds: Kinds) -> float:
    """Return the expected collisions with walls per time: a gas of the disks' pressure hits the perimeter."""
    if scene.box.periodic or scene.particles == 0:
        return 0.0
    phi = min(scene.packing_fraction, DENSEST)
    density = kinds.number / scene.box.area * theory.compressibility(phi, theory.contact_value_henderson(phi))
    flux = density * kinds.speed / np.sqrt(2 * np.pi)
    return float(2 * (scene.box.width + scene.box.height) * flux.sum())
