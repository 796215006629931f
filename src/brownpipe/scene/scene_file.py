"""Scene files: strict reading, and every refusal in one line (config/README.md describes every key)."""

import math
from pathlib import Path

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.scene import reading, sample_times
from brownpipe.scene.packing import ROUND_OFF, most_disks, overlap
from brownpipe.scene.reading import Entry, must_be, refuse
from brownpipe.scene.scene import Box, Disk, Scene, Species, Velocities

MOST_BYTES = 64 * 2**20  # of a scene file: some 500,000 explicit disks
MOST_DISKS = 10_000_000
LARGEST_MASS_RATIO = 1e200  # products of masses and squares of speeds are then floating-point numbers
LONGEST = 1e140  # of a box, and the inverse: squares of displacements are then floating-point numbers, to 1e-14 of it
SMALLEST_RADIUS = 1e-10  # in units of the longer side of the box: round-off of a place is then 1e-6 of it
HEAVIEST = 1e302  # and the inverse
FASTEST = 1e300  # of a velocity component
SLOWEST_SQUARE = 1e-300  # kT/m, if it is not 0


# -- reading --------------------------------------------------------------------------------------------------------


def read_scene(path: str | Path, particles: int | None = None) -> Scene:
    """Return the scene of a YAML file; `particles` replaces its total number of disks.

    Raises RequestError, one line, for whatever is wrong with the file or the scene.
    """
    return parse_scene(reading.read_yaml(path, MOST_BYTES), str(path), particles)


def parse_scene(mapping: object, where: str, particles: int | None = None) -> Scene:
    """Return the scene that a mapping, as read from a scene file, describes.

    `where` is the file that messages name; its stem becomes the name of the scene. `particles` replaces the total
    number of disks; of an explicit list it must be the length.
    """
    if isinstance(mapping, dict) and "scenes" in mapping and "box" not in mapping:
        raise RequestError(f"{where}: is a study, not a scene; run snakemake --configfile {where}")
    optional = dict.fromkeys(("particles", "velocities", "sample_interval", "samples", "equilibrate"))
    given = reading.fields(Entry(mapping, where), ("box", "disks", "duration"), optional)
    explicit = isinstance(given["disks"].value, list | tuple)
    if particles is not None:
        asked = Entry(particles, where, ("particles asked for",))
        if explicit and particles != len(given["disks"].value):
            must_be(asked, f"{len(given['disks'].value)}, the number of disks listed")
        given |= {} if explicit else {"particles": asked}
    duration = reading.number(given["duration"], above=0)
    common = {
        "name": reading.name(Entry(Path(where).stem, where, ("name of the file",))),
        "box": _box(given["box"]),
        "duration": duration,
        "sample_interval": sample_times.read_interval(given["sample_interval"], duration),
        "samples": sample_times.read_samples(given["samples"], given["sample_interval"], duration),
    }
    return _explicit(given, common) if explicit else _of_species(given, common)


def _box(entry: Entry) -> Box:
    given = reading.fields(entry, ("x", "y"), {"boundary": "reflecting"})
    return Box(_side(given["x"]), _side(given["y"]), reading.choice(given["boundary"], ("reflecting", "periodic")))


def _side(entry: Entry) -> tuple[float, float]:
    low, high = (reading.number(end) for end in reading.items(entry, 2, "two numbers [low, high]"))
    if not 0 < high - low < math.inf:
        must_be(entry, "two numbers [low, high] with low < high")
    if not 1 / LONGEST <= high - low <= LONGEST:
        must_be(entry, f"two numbers that differ by {1 / LONGEST:g} to {LONGEST:g}; choose another unit of length,")
    return low, high


# -- explicit disks -------------------------------------------------------------------------------------------------


def _explicit(given: dict[str, Entry], common: dict) -> Scene:
    for key in ("particles", "velocities", "equilibrate"):
        if given[key].value is not None:
            refuse(given[key], "must not be given with an explicit list of disks, which says it all")
    entries = reading.items(given["disks"])
    if len(entries) > MOST_DISKS:
        must_be(given["disks"], f"at most {MOST_DISKS} disks")
    disks = tuple(_disk(entry, common["box"]) for entry in entries)
    _refuse_ratio(given["disks"], disks)
    _refuse_narrow(given["box"], common["box"], disks)
    _refuse_overlap(given["disks"], common["box"], disks)
    return Scene(species=(), disks=disks, placement="random", velocities=None, **common)


def _disk(entry: Entry, box: Box) -> Disk:
    given = reading.fields(entry, ("position", "velocity", "radius", "mass"))
    radius, mass, velocity = _radius(given["radius"], box), _mass(given["mass"]), reading.pair(given["velocity"])
    if max(map(abs, velocity)) > FASTEST:
        must_be(given["velocity"], f"two numbers up to {FASTEST:g}, either sign")
    return Disk(_inside(given["position"], box, radius), velocity, radius, mass)


def _radius(entry: Entry, box: Box) -> float:
    radius, most = reading.number(entry, above=0), min(box.width, box.height) / 2
    if radius > most:
        must_be(entry, f"at most half the shorter side of the box, {most!r}")
    least = SMALLEST_RADIUS * max(box.width, box.height)
    if radius < least:
        must_be(entry, f"at least {SMALLEST_RADIUS:g} of the longer side of the box, {least:.4g}")
    return radius


def _mass(entry: Entry) -> float:
    mass = reading.number(entry, above=0)
    return mass if 1 / HEAVIEST <= mass <= HEAVIEST else must_be(entry, f"from {1 / HEAVIEST:g} to {HEAVIEST:g}")


def _refuse_ratio(entry: Entry, disks: tuple[Disk | Species, ...]) -> None:
    """Refuse masses so far apart that an engine's numbers would overflow."""
    masses = [disk.mass for disk in disks if getattr(disk, "count", 1)]
    if masses and max(masses) / LARGEST_MASS_RATIO > min(masses):
        pair = f"masses {min(masses)!r} and {max(masses)!r} are too far apart"
        refuse(entry, f"{pair}; must be within a factor of {LARGEST_MASS_RATIO:g}")


def _inside(entry: Entry, box: Box, radius: float) -> tuple[float, float]:
    """Return a centre inside the box; with walls, the edge of the disk is inside as well, or in contact."""
    position = reading.pair(entry)
    for axis, value, (low, high) in zip("xy", position, (box.x, box.y), strict=True):
        slack = ROUND_OFF * radius + 2 * math.ulp(max(-low, high))
        if box.periodic and not low <= value < high:
            must_be(entry, f"inside the periodic box, {low!r} <= {axis} < {high!r}")
        if not box.periodic and not low - slack <= value - radius <= value + radius <= high + slack:
            must_be(entry, f"inside the walls, {low!r} <= {axis} <= {high!r}, by the radius {radius!r} or more")
    return position


def _refuse_narrow(entry: Entry, box: Box, disks: tuple[Disk | Species, ...]) -> None:
    """In a narrow periodic box a disk can touch two images of the same neighbour."""
    least = 4 * max((disk.radius for disk in disks), default=0.0)
    if box.periodic and min(box.width, box.height) < least:
        size = f"a periodic box of {box.width!r} by {box.height!r}"
        refuse(entry, f"{size} is too narrow; must be at least {least!r} both ways, four times the largest radius")


def _refuse_overlap(entry: Entry, box: Box, disks: tuple[Disk, ...]) -> None:
    position, radius = np.array([disk.position for disk in disks]), np.array([disk.radius for disk in disks])
    found = overlap(position, radius, (box.x, box.y) if box.periodic else None)
    if found is None:
        return
    a, b, gap = found
    at = f"disk {a} at {list(disks[a].position)} and disk {b} at {list(disks[b].position)}"
    refuse(entry, f"{at} overlap: the gap between their edges is {gap:.6g}; must be >= 0")


# -- species --------------------------------------------------------------------------------------------------------


def _of_species(given: dict[str, Entry], common: dict) -> Scene:
    box, disks = common["box"], given["disks"]
    if not isinstance(disks.value, dict) or not disks.value.keys() & {"tracer", "species"}:
        must_be(disks, "a list of disks, or a mapping with tracer, species or both")
    inside = reading.fields(disks, (), {"tracer": None, "species": [], "placement": "random"})
    species = _species(inside, given["particles"], box)
    _refuse_ratio(disks, species)
    _refuse_narrow(given["box"], box, species)
    _refuse_crowd(disks, box, species)
    equilibrate, tracer = _equilibrate(given["equilibrate"], inside["tracer"].value is not None)
    return Scene(
        species=species,
        disks=(),
        placement=reading.choice(inside["placement"], ("random", "lattice")),
        velocities=_velocities(given["velocities"], species),
        equilibrate=equilibrate,
        tracer_while_equilibrating=tracer,
        **common,
    )


def _species(inside: dict[str, Entry], particles: Entry, box: Box) -> tuple[Species, ...]:
    species = [] if inside["tracer"].value is None else [_tracer(inside["tracer"], box)]
    kinds = [reading.fields(one, ("name", "count", "radius", "mass")) for one in reading.items(inside["species"])]
    counts = _counts([kind["count"] for kind in kinds], particles, len(species))
    for kind, count in zip(kinds, counts, strict=True):
        own = reading.name(kind["name"])
        if own in ("tracer", *(one.name for one in species)):
            must_be(kind["name"], "a name of its own (tracer is reserved)")
        species.append(Species(own, count, _radius(kind["radius"], box), _mass(kind["mass"])))
    return tuple(species)


def _tracer(entry: Entry, box: Box) -> Species:
    given = reading.fields(entry, ("radius", "mass"), {"position": None})
    radius = _radius(given["radius"], box)
    position = None if given["position"].value is None else _inside(given["position"], box, radius)
    return Species("tracer", 1, radius, _mass(given["mass"]), position)


def _counts(entries: list[Entry], particles: Entry, tracers: int) -> list[int]:
    """Return the number of disks of each species, with `rest` worked out from the total."""
    rest = [entry for entry in entries if entry.value == "rest"]
    if len(rest) > 1:
        must_be(rest[1], "a number, as only one species can be the rest")
    counts = [0 if entry in rest else reading.integer(entry, 0, MOST_DISKS, " or rest") for entry in entries]
    known = tracers + sum(counts)
    if particles.value is None:
        if rest:
            refuse(particles, "missing; must be given with `count: rest`")
        particles = Entry(known, particles.file, particles.path)
    total = reading.integer(particles, 0, MOST_DISKS)
    if total < known or (total > known and not rest):
        least = "at least " if rest else ""
        must_be(particles, f"{least}{known}, which is what the tracer and the species with numbers add up to")
    return [total - known if entry in rest else count for entry, count in zip(entries, counts, strict=True)]


def _refuse_crowd(entry: Entry, box: Box, species: tuple[Species, ...]) -> None:
    """Refuse more disks than can fit, each species alone or all together; what passes may still be hard to place."""
    for one in species:
        most = most_disks(box.width, box.height, 2 * one.radius, box.periodic)
        if one.count > most:
            refuse(entry, f"{one.count} disks of radius {one.radius!r} ({one.name}) cannot fit; must be at most {most}")
    phi = math.fsum(math.pi * one.count * (one.radius / box.width) * (one.radius / box.height) for one in species)
    if phi > 1:
        refuse(entry, f"the disks cover {phi:.4g} times the area of the box; must be at most 1")


def _velocities(entry: Entry, species: tuple[Species, ...]) -> Velocities:
    if entry.value is None:
        refuse(entry, "missing; must be given with species")
    given = reading.fields(entry, (), {"standard_deviation": None, "temperature": None, "zero_momentum": False})
    spreads = [given[key] for key in ("standard_deviation", "temperature")]
    if sum(spread.value is not None for spread in spreads) != 1:
        refuse(entry, "must have either standard_deviation or temperature")
    deviation, temperature = (None if one.value is None else reading.number(one, least=0) for one in spreads)
    if deviation is not None and deviation > FASTEST:
        must_be(given["standard_deviation"], f"at most {FASTEST:g}")
    for one in species:
        if temperature and one.count and not SLOWEST_SQUARE <= temperature / one.mass < math.inf:
            allowed = f"0, or {SLOWEST_SQUARE:g} to 1.8e308 times the mass {one.mass!r} ({one.name})"
            must_be(given["temperature"], allowed)
    return Velocities(deviation, temperature, reading.flag(given["zero_momentum"]))


def _equilibrate(entry: Entry, has_tracer: bool) -> tuple[float, str]:
    """Return the time before t = 0 and whether the tracer is then pinned (the default) or free."""
    usual = "pinned" if has_tracer else "free"
    if not isinstance(entry.value, dict):
        return (0.0 if entry.value is None else reading.number(entry, least=0)), usual
    given = reading.fields(entry, ("time",), {"tracer": usual})
    time, tracer = reading.number(given["time"], least=0), reading.choice(given["tracer"], ("pinned", "free"))
    if tracer == "pinned" and not has_tracer:
        must_be(given["tracer"], "free, as there is no tracer")
    return time, tracer if time > 0 else usual
