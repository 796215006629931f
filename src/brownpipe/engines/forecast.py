"""What is known before a run: the forecast of collisions, cost and time to settle.

The forecast is rough on purpose, good to a factor of 2: an engine has one measured cost of its
events, an observable one of a disk in a sample (`observables.Observable`). Collision counts hold in
equilibrium, within some percent, those above a packing fraction of 0.7 for crystals.
docs/theory.md, section 3.
"""

import math
import os
from bisect import bisect_right
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from brownpipe import observables as measures
from brownpipe import theory
from brownpipe.engines.confinement import confinement
from brownpipe.engines.friction import DENSEST, bath_of, partners_of
from brownpipe.engines.start.placement import is_grown, placement_caution, tries_to_place
from brownpipe.engines.units import SMALLEST_NORMAL, cell_width, common_radius
from brownpipe.errors import RequestError
from brownpipe.observables.average import over_disks, over_origins
from brownpipe.observables.equilibrium import claims_equilibrium, is_stationary
from brownpipe.scene import Scene, motion
from brownpipe.scene.species import equal_disks, kinds_of
from brownpipe.text import in_bytes

# CPU seconds of a process besides its runs: start Python, import, load kernels, write an empty file
START_UP = 0.5
# CPU seconds to begin and end a run, and again to equilibrate it; half of it for the tracer alone
EACH_RUN = 1.2e-4
# CPU seconds of a collision, or of a disk that moves by the distance of neighbours
SECONDS_PER_EVENT = 1.9e-7
# times longer for a disk whose data are not in the processor's cache: an event, a try to place it
EVENT_FROM_MEMORY, TRY_FROM_MEMORY = 1.2, 2.5
DISKS_IN_CACHE = 20_000
# in a disk's cell and those around it; with more an event takes longer, in proportion
DISKS_PER_EVENT = 30
# CPU seconds for a disk that does not move, but has a part in the total momentum
SECONDS_PER_VELOCITY = 2e-7
SECONDS_PER_TRY = 1.1e-7  # CPU seconds to find out whether a disk fits in a place
SECONDS_PER_DISK_SAMPLE = 1.3e-7  # CPU seconds to record one disk at one sample time
SECONDS_TO_MEASURE = 2e-5  # CPU seconds of an observable in a run, at least
# with averages over time origins: times as long at least, and for each sample
LAGS_ONE_BY_ONE, TRANSFORMS = 40, 50
SECONDS_PER_BYTE = 3e-8  # CPU seconds to compress, write and verify a byte of a file
PROCESS = 140e6  # bytes of memory of a process besides its runs: Python, packages, kernels
BYTES_PER_DISK = 600  # to draw its initial state, and working memory of the engine
# of a disk that is recorded, during its run: its samples, sorted by disk, intermediate arrays
BYTES_PER_SAMPLE = 120
BYTES_PER_EVENT = 40  # of a collision in memory, and some two thirds of that in a file
BYTES_PER_NUMBER = 8
# in units of (1 + m_b/m)/gamma: then a hot tracer's excess kinetic energy has fallen by e^-10
FRICTION_TIMES = 5.0
FEWEST_DISKS = 10  # for kinetic theory to predict collisions
# share of the forecast time to settle, below which `check` cautions: the forecast is rough
TOO_SHORT = 0.5
MOST_RUNS = 10**9  # upper limit for one process
COPIES = 2  # in memory, of whole runs and collisions while they are written


class Cost(NamedTuple):
    """The forecast for one run of a scene."""

    pair_collisions: float
    wall_collisions: float
    seconds: float  # CPU time, with that to write what is recorded
    bytes_in_file: float
    # in memory, besides the file, which is built in memory, too
    bytes_until_written: float
    working_bytes: float  # further memory, used by one run at a time
    # CPU time before the first run of each process, besides START_UP
    seconds_per_process: float = 0.0


def run_cost(
    scene: Scene,
    record: Collection[str] = frozenset({"tracer"}),
    observables: Collection[str] = (),
    average: str = "runs",
    tracer_only: bool = False,
) -> Cost:
    """Return the forecast for one run of the exact engine that records `record` and measures
    `observables`.

    `record` and `average` as in `engines.ensemble.new_batch`. `tracer_only`: it alone moves,
    without collisions.
    """
    time = 0.0 if tracer_only else scene.duration + scene.equilibrate.time
    pair_collisions = time * pair_rate(scene)
    wall_collisions = time * wall_rate(scene)
    collisions = pair_collisions + wall_collisions
    needs_every_disk = "all" in record or measures.needs_every_disk(observables, average)
    sampled_disks = 1 + scene.particles if needs_every_disk else 1
    disk_samples = len(scene.times) * sampled_disks
    measuring = [measures.observable_named(name).working_memory(scene) for name in observables]
    working_bytes = max(measuring, default=0.0) + BYTES_PER_SAMPLE * disk_samples
    if measures.needs_events(observables):
        working_bytes += COPIES * BYTES_PER_EVENT * collisions
    working_bytes += BYTES_PER_DISK * (1 if tracer_only else scene.particles)
    in_file, until_written = _bytes_of_record(scene, record, observables, collisions)
    seconds = EACH_RUN * (0.5 if tracer_only else 1 + (scene.equilibrate.time > 0))
    seconds += SECONDS_PER_DISK_SAMPLE * disk_samples + SECONDS_PER_BYTE * in_file
    seconds += seconds_to_measure(scene, observables, average)
    if tracer_only and motion.starts_with_zero_momentum(scene):
        seconds += SECONDS_PER_VELOCITY * scene.particles
    if not tracer_only:
        seconds += seconds_of_events(scene, time, pair_collisions, wall_collisions)
        from_memory = 1 + TRY_FROM_MEMORY * share_in_memory(scene)
        seconds += SECONDS_PER_TRY * from_memory * tries_to_place(scene)
    return Cost(pair_collisions, wall_collisions, seconds, in_file, until_written, working_bytes)


def seconds_of_events(scene: Scene, time: float, pairs: float, walls: float) -> float:
    """Return the CPU seconds of so many collisions and of the crossings in a time.

    A collision with a wall, of one disk, takes half as long as that of two. At the beginning each
    disk is entered into the queue.
    """
    crowded = max(1.0, disks_in_cells(scene) / DISKS_PER_EVENT)
    from_memory = 1 + EVENT_FROM_MEMORY * share_in_memory(scene)
    events = pairs + walls / 2 + time * crossing_rate(scene) + 5 * scene.particles
    return SECONDS_PER_EVENT * crowded * from_memory * events


def share_in_memory(scene: Scene) -> float:
    """Return the share of disks whose data are not in the processor's cache."""
    return max(0.0, 1 - DISKS_IN_CACHE / max(scene.particles, 1))


def _bytes_of_record(
    scene: Scene, record: Collection[str], observables: Collection[str], events: float
) -> tuple[float, float]:
    """Return the bytes recorded and measured of a run with `events` collisions: in the file, and in
    memory.
    """
    coordinates = 2 * BYTES_PER_NUMBER
    images = 8 if scene.box.has_images else 0  # which take next to nothing in a file
    samples = len(scene.times)
    tracer_samples = samples * len({"tracer", "velocity"}.intersection(record))
    disk_samples = samples * scene.particles if "all" in record else 0
    log = BYTES_PER_EVENT * events if "events" in record else 0.0
    measured = BYTES_PER_NUMBER * measures.numbers_in(scene, observables)
    # those between two collisions of a disk are the same
    different_velocities = min(2 * events, disk_samples)
    stored_samples = tracer_samples + disk_samples + different_velocities
    in_file = coordinates * stored_samples + log * 2 / 3 + measured
    whole_runs = (2 * coordinates + images) * disk_samples + log
    until_written = (coordinates + images) * tracer_samples + COPIES * whole_runs + measured
    return in_file, until_written


def memory(cost: Cost, runs: int) -> float:
    """Return the peak memory [bytes] of a process that makes and writes `runs` runs."""
    return PROCESS + cost.working_bytes + runs * (cost.bytes_until_written + cost.bytes_in_file)


def seconds_to_measure(scene: Scene, names: Collection[str], average: str) -> float:
    """Return the CPU seconds to measure observables in a run."""
    seconds = 0.0
    for name in names:
        seconds += _seconds_of_observable(scene, name, average)
    return seconds


def _seconds_of_observable(scene: Scene, name: str, average: str) -> float:
    """Return the CPU seconds to measure an observable in a run.

    An average over time origins has some lags one by one, others by Fourier transforms whose number
    grows so slowly with that of the samples that it is taken to be constant
    (`observables.averages`).
    """
    observable = measures.observable_named(name)
    samples = len(scene.times)
    disks = scene.particles * observable.relative_cost(scene)
    if observable.tracks_needed == "tracer":
        disks = len(equal_disks(scene)) if over_disks(average) else 1
    elif observable.tracks_needed == "path":
        disks = 1
    elif observable.is_over_samples and not is_stationary(scene):
        samples = 1
    seconds = samples * disks * observable.seconds_per_disk_sample
    if over_origins(average) and observable.tracks_needed in ("tracer", "bath"):
        return min(samples, LAGS_ONE_BY_ONE) * SECONDS_TO_MEASURE + TRANSFORMS * seconds
    return max(SECONDS_TO_MEASURE, seconds)


def most_runs(cost: Cost, available: float) -> int:
    """Return how many runs of this cost one process can make and write in `available` memory
    [bytes], or 0.
    """
    return bisect_right(range(1, MOST_RUNS + 1), available, key=lambda runs: memory(cost, runs))


def refuse_too_large(scene: Scene, runs: int, cost: Cost) -> None:
    """Raise RequestError if so many runs of a scene, each of this cost, in one process exceed this
    machine's memory.
    """
    needed = memory(cost, runs)
    available = machine_memory()
    if not needed > available:
        return
    cure = (
        f"this machine has {in_bytes(available)}: take fewer seeds a call, fewer samples, "
        "or record less"
    )
    need = "1 run needs" if runs == 1 else f"{runs:,} runs need"
    raise RequestError(f"{scene.name}: {need} some {in_bytes(needed)} of memory, and {cure}")


def machine_memory() -> float:
    """Return this machine's memory [bytes]; inf where the system does not tell, as with some builds
    of Python for macOS.
    """
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGESIZE")
    except (ValueError, OSError):
        return math.inf


# -- collision rates -------------------------------------------------------------------------------


def speeds(scene: Scene) -> np.ndarray:
    """Return the standard deviation [length/time] of a velocity component of disks of each kind
    (K,).

    Where velocities are given, that of the tracer or all, the disks are taken to be in equilibrium
    at their mean kinetic energy.
    """
    mass = kinds_of(scene).mass
    temperature = motion.temperature(scene)
    if temperature is not None:
        return np.sqrt(temperature / mass)
    if scene.velocities is None or scene.tracer_velocity is not None:
        return np.sqrt(motion.mean_energy(scene)) / np.sqrt(mass)
    return _speeds_towards_equipartition(scene)


def _speeds_towards_equipartition(scene: Scene) -> np.ndarray:
    """Return the rms of a velocity component [length/time] of each kind (K,) over a run in which
    all begin with one standard deviation s, whatever their mass.

    They come to equal energies, in which light disks are faster. At the end <v_j^2> = s^2 e_j, with
    e_j = sum_i N_i m_i (1 - m_i/M)/(N m_j) by conservation of energy, where -m_i/M is the motion of
    the centre of mass, of mass M, if that is subtracted. The difference of two disks' energies
    decays by the share 4 m_i m_j/(m_i + m_j)^2 in a collision. If these sum up to x in the run, all
    differences are taken to have decayed to 1/(1 + x) in the mean: <v_j^2> = s^2 (1 + x e_j)/(1 +
    x).
    """
    number = kinds_of(scene).number
    mass = kinds_of(scene).mass
    start = motion.common_deviation(scene)
    time = scene.duration + scene.equilibrate.time
    ratio = mass[:, None] / mass  # m_i/m_j
    energy_kept = np.ones(len(mass))
    if motion.starts_with_zero_momentum(scene):
        energy_kept -= 1 / (number @ ratio)
    last = np.sqrt((number * energy_kept) @ ratio / number.sum())
    share = np.where(ratio == 1.0, 0.0, 4 / (2 + ratio + ratio.T))
    speed = np.full(len(mass), start)
    for _ in range(8):  # until speeds and collisions fit each other
        rates = np.array([*_pair_rates(scene, speed)])
        decay = (share * rates).sum() * time
        speed = start * np.sqrt((1 + decay * last**2) / (1 + decay))
    return speed


def pair_rate(scene: Scene) -> float:
    """Return the expected collisions between disks per time [1/time], summed over all pairs of
    species.

    Above DENSEST disks collide more often than in the fluid of that packing fraction: by the free
    volume of a crystal of equal disks, Z = 1 + 2 phi chi = s/(s - 2 R) for neighbours at the
    distance s (Z. W. Salsburg & W. W. Wood, J. Chem. Phys. 37, 798 (1962)). Rows that the box
    compresses collide more often.
    """
    numbers = kinds_of(scene).number
    rates_of_species = _pair_rates(scene, speeds(scene))
    collisions = (
        number * rates.sum() for number, rates in zip(numbers, rates_of_species, strict=True)
    )
    rate = float(sum(collisions)) / 2  # each has two partners
    if scene.packing_fraction <= DENSEST:
        between_walls = rate > 0 and scene.box.has_walls
        return rate * confinement(scene).pairs if between_walls else rate
    crystal = theory.contact_value_crystal(scene.packing_fraction)
    return rate * float(crystal / theory.contact_value(DENSEST))


def _pair_rates(scene: Scene, speed: np.ndarray) -> Iterator[np.ndarray]:
    """Yield for each kind the collisions per time [1/time] of a disk with those of each kind (K,),
    in a fluid.

    `theory.collision_rate` with sqrt(kT/mu) = hypot(speed_i, speed_j), the standard deviation of a
    component of the relative velocity. This also holds for kinds of different temperatures.
    """
    kinds = kinds_of(scene)
    area = scene.box.area
    fluid = min(1.0, DENSEST / max(scene.packing_fraction, 1e-300))
    diameter = 2 * kinds.radius
    density = fluid * kinds.number / area
    for i, radius in enumerate(kinds.radius):
        is_own = np.arange(len(speed)) == i
        partners = (kinds.number - is_own) / area
        contact = theory.contact_value_mixture(diameter[i], diameter, density, diameter)
        rate = theory.collision_rate(partners, radius + kinds.radius, contact, 1.0, 1.0)
        yield rate * np.hypot(speed[i], speed)


def wall_rate(scene: Scene) -> float:
    """Return the expected collisions with walls per time [1/time]: of each disk Z speed
    sqrt(2/pi)/side, summed over those sides of the rectangle accessible to its centre that end at
    walls; Z is the density of centres at the walls, relative to the mean. Disks that touch two
    opposite walls do not move across.
    """
    if not scene.box.has_walls or not scene.particles:
        return 0.0
    kinds = kinds_of(scene)
    is_filled = scene.box.is_filled_by(kinds.radius[:, None]).T
    side = np.where(is_filled, np.inf, scene.box.size[:, None] - 2 * kinds.radius)
    at_walls = np.where(scene.box.periodic_axes, 0.0, confinement(scene).walls)
    hits = at_walls[:, None] * kinds.number * speeds(scene) / side
    return math.sqrt(2 / math.pi) * float(hits.sum())


def path_rate(scene: Scene) -> float:
    """Return the length of all disks' paths per time [length/time]; the mean speed is sqrt(pi/2)
    times `speeds`.
    """
    return float(np.sqrt(np.pi / 2) * (kinds_of(scene).number * speeds(scene)).sum())


def crossing_rate(scene: Scene) -> float:
    """Return how often per time [1/time] disks move by the distance of neighbours, sqrt(area per
    disk).
    """
    return path_rate(scene) / math.sqrt(scene.box.area / max(scene.particles, 1))


def disks_in_cells(scene: Scene) -> float:
    """Return how many disks are in the 3 x 3 cells in which an event looks for partners.

    Larger disks, but for a few (`units.common_radius`), set the width of cells, which then have
    many small disks.
    """
    if not scene.particles:
        return 0.0
    width = cell_width(common_radius(scene.radius), scene.packing_fraction)
    return 9 * width**2 / scene.box.area * scene.particles


def caution(scene: Scene) -> str | None:
    """Return one line of caution on runs of all disks of a scene; otherwise None.

    If random placement is expected to fail, or if the mean free path between collisions with disks,
    mean speed over mean collision rate of all disks, is longer than the shorter side of the box, or
    than a channel.
    """
    if line := placement_caution(scene):
        return line
    rate = 2 * pair_rate(scene)
    if scene.has_one_state or scene.particles < 2 or not rate > 0:
        return None
    sides = scene.box.size
    if scene.box.is_channel:  # across it a path may end at the other wall
        sides = sides[scene.box.periodic_axes]
    path = path_rate(scene) / rate
    if path <= sides.min():
        return None
    side = "its length" if scene.box.is_channel else "its shorter side"
    too_long = f"the mean free path, {path:.2g}, is longer than {side}, {sides.min():.2g}"
    return (
        f"{scene.name}: {scene.particles} disks are too few for Brownian motion in this box: "
        f"{too_long}"
    )


# -- time to settle --------------------------------------------------------------------------------


def settling_time(scene: Scene) -> float:
    """Return the time [time] in which the fluid of a scene forgets its start; NaN beyond Enskog's
    theory. docs/theory.md, section 5.
    """
    return max(_settling_times(scene).values(), default=math.nan)


def _settling_times(scene: Scene) -> dict[str, float]:
    """Return the times [time] that a scene needs to settle, by what happens in them; {} beyond
    Enskog's theory.

    The slowest species of several disks, of speed v (standard deviation of a component), moves by
    the distance of neighbours a: a/v in flight and, to forget a lattice, also a^2/D, with D =
    v^2/gamma and gamma about the collision rate. Large disks diffuse to each other
    (`_meeting_time`). A tracer cools in FRICTION_TIMES, unless velocities are drawn at a
    temperature.
    """
    rate = 2 * pair_rate(scene) / scene.particles if scene.particles >= FEWEST_DISKS else 0.0
    if not rate > 0 or scene.packing_fraction > DENSEST:
        return {}
    number = kinds_of(scene).number
    several = number >= min(2, number.max())  # single disks if there is no other species
    flight = math.sqrt(scene.box.area / scene.particles) / speeds(scene)[several].min()
    times = {"to move to a neighbour's place": flight}
    if _is_ordered(scene):
        times = {"to move to a neighbour's place by diffusion": flight + flight * flight * rate}
    times["for large disks to diffuse to each other"] = _meeting_time(scene)
    if not motion.is_thermal(scene):
        bath_mass = bath_of(scene).mass / scene.mass[0]
        # a light tracer forgets its velocity long before its energy
        cooling = (partners_of(scene).friction / (1 + bath_mass)).sum()
        decays = f"for {FRICTION_TIMES:g} (1 + m_b/m)/gamma of the tracer"
        times[decays] = float(FRICTION_TIMES / max(cooling, SMALLEST_NORMAL))
    return times


def _meeting_time(scene: Scene) -> float:
    """Return the time [time] in which large disks diffuse to each other among small ones; 0 where
    no two disks are larger than others.

    Disks are placed from large to small: the large ones lack the depletion by small ones, which
    holds pairs of them together in the fluid. It reaches as far as the small diameter 2r around a
    disk of diameter 2R, and the missing pairs come in the time 2R 2r/D, with Enskog's D = kT/zeta
    of the large disks, and r the radius of the smallest. docs/theory.md, section 5.
    """
    kinds = kinds_of(scene)
    several = kinds.number >= min(2, kinds.number.max())
    smallest = kinds.radius[several].min()
    speed = speeds(scene)
    longest = 0.0
    for k, rates in enumerate(_pair_rates(scene, speed)):
        radius = kinds.radius[k]
        as_large = kinds.number[kinds.radius >= radius].sum()
        if radius > smallest and as_large > 1:
            share = 2 * theory.reduced_mass(1.0, kinds.mass / kinds.mass[k])
            friction = (share * rates).sum()
            diffusion = speed[k] * speed[k] / max(friction, SMALLEST_NORMAL)
            longest = max(longest, 4 * radius * smallest / diffusion)
    return float(longest)


def _is_ordered(scene: Scene) -> bool:
    """Return whether a scene may start far from the places of a fluid: on a lattice, of disks that
    have grown, or at given places.
    """
    return scene.placement in ("lattice", "") or is_grown(scene)


def settling_in_words(scene: Scene) -> str | None:
    """Return how long to equilibrate and what decides it; None for a scene that does not claim
    equilibrium.
    """
    if not claims_equilibrium(scene):
        return None
    times = _settling_times(scene)
    if not times:
        return (
            f"no forecast for few disks, or above a packing fraction of {DENSEST:g}, where disks "
            "freeze"
        )
    slowest = max(times, key=lambda process: times[process])
    return (
        f"some {times[slowest]:.2g} should be enough {slowest} (Enskog's theory of the fluid, not "
        "of crystals)"
    )


def settling_caution(scene: Scene) -> str | None:
    """Return one line of caution if a scene with a temperature does not equilibrate, or one that
    does for far less than it is expected to need; otherwise None.
    """
    time = scene.equilibrate.time
    case = scene.title
    thermal = motion.is_thermal(scene) and motion.moves(scene)
    if thermal and time == 0 and scene.particles > 1:
        if scene.configuration is not None:  # it may be from equilibrium
            return None
        return None if is_grown(scene) else f"{case}: {_start_without_equilibrium(scene)}"
    words = settling_in_words(scene)
    if words is None or not time < TOO_SHORT * settling_time(scene):
        return None
    return f"{case}: equilibrate.time {time:g} is short: {words}"


def _start_without_equilibrium(scene: Scene) -> str:
    """Return where the disks start that do not equilibrate, and the cure."""
    start = "lattice" if scene.placement == "lattice" else "random insertion"
    needed = settling_time(scene)
    enough = "" if math.isnan(needed) else f": some {needed:.2g} should be enough"
    return f"places from {start} are not those of equilibrium; add `equilibrate`{enough}"
