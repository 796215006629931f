"""Scene files: strict reading, every refusal in one line, and writing. config/README.md describes the keys."""

import math
from pathlib import Path

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.quoting import shell_path
from brownpipe.scene import reading, sample_times
from brownpipe.scene.packing import ROUND_OFF, most_disks, overlap
from brownpipe.scene.reading import Entry, must_be, refuse
from brownpipe.scene.scene import Box, Disk, Scene, Species, Velocities, as_mapping
from brownpipe.scene.yaml_file import read_yaml, yaml_text

MOST_BYTES = 64 * 2**20  # of a scene file: some 500,000 explicit disks
MOST_DISKS = 10_000_000
LARGEST_MASS_RATIO = 1e200  # with it, products of masses and squared speeds neither overflow nor underflow
LONGEST = 1e140  # side of a box, its inverse the shortest: squared displacements down to 1e-14 of it do not underflow
SMALLEST_RADIUS = 1e-10  # in units of the longer side of the box: round-off of a position is then 1e-6 of the radius
HEAVIEST = 1e302  # mass; its inverse the lightest
FASTEST = 1e300  # velocity component
SLOWEST_SQUARE = 1e-300  # smallest kT/m except 0
BOUNDARIES = ("reflecting", "periodic")
PLACEMENTS = ("random", "lattice")
WHILE_EQUILIBRATING = ("pinned", "free")  # the tracer
REQUIRED = ("box", "disks", "duration")  # keys
STUDY_KEYS = {"scenes", "seeds", "tolerance", "engines", "batch", "figures"}  # that no scene has
ONLY_WITH_SPECIES = ("particles", "velocities", "equilibrate")  # keys


# -- reading --------------------------------------------------------------------------------------------------------


def read_scene(path: str | Path, particles: int | None = None) -> Scene:
    """Return the scene of a YAML file, with `particles` disks in total if that is given.

    Raises RequestError, one line, for anything wrong with the file or the scene.
    """
    return parse_scene(read_yaml(path, MOST_BYTES), str(path), particles)


def scene_yaml(scene: Scene) -> str:
    """Return the text of a scene file, with every default written out; `read_scene` returns an equal scene from it."""
    return yaml_text(as_mapping(scene))


def parse_scene(mapping: object, where: str, particles: int | None = None, name: str | None = None) -> Scene:
    """Return the scene of a mapping as read from a scene file.

    where: the file that messages name; its stem is the name of the scene, unless `name` is given.
    particles: total number of disks instead of the file's; for an explicit list it must be the length of the list.

    Raises RequestError for anything wrong.
    """
    if isinstance(mapping, dict) and "box" not in mapping and is_study(mapping):
        raise RequestError(f"{where}: is a study, not a scene; run it with brownpipe run {shell_path(where)}")
    optional = dict.fromkeys(("particles", "velocities", "sample_interval", "samples", "equilibrate"))
    entries = reading.fields(reading.whole(mapping, where), REQUIRED, optional)
    disks = entries["disks"].value
    listed = len(disks) if isinstance(disks, list | tuple) else None  # number of explicit disks
    if particles is not None:
        total = Entry(particles, where, ("particles asked for",))
        if listed is None:
            entries["particles"] = total
        elif particles != listed:
            must_be(total, f"{listed}, the number of disks listed")
    duration = reading.number(entries["duration"], above=0)
    given = Entry(Path(where).stem, where, ("name of the file",)) if name is None else Entry(name, where, ("name",))
    common = {
        "name": reading.name(given),
        "box": _box(entries["box"]),
        "duration": duration,
        "sample_interval": sample_times.read_interval(entries["sample_interval"], duration),
        "samples": sample_times.read_samples(entries["samples"], entries["sample_interval"], duration),
    }
    return _of_species(entries, common) if listed is None else _explicit(entries, common)


def is_study(mapping: dict) -> bool:
    """Whether a mapping is meant as a study, by its keys; a scene with a misplaced study key is none."""
    return "scenes" in mapping or ("box" not in mapping and bool(mapping.keys() & STUDY_KEYS))


def _box(entry: Entry) -> Box:
    """Return the box of a scene; its default boundary is reflecting."""
    entries = reading.fields(entry, ("x", "y"), {"boundary": "reflecting"})
    boundary = reading.choice(entries["boundary"], BOUNDARIES)
    return Box(_side(entries["x"]), _side(entries["y"]), boundary)


def _side(entry: Entry) -> tuple[float, float]:
    """Return the ends of a side of the box [length], low < high."""
    low, high = (reading.number(end) for end in reading.items(entry, 2, "two numbers [low, high]"))
    if not 0 < high - low < math.inf:
        must_be(entry, "two numbers [low, high] with low < high")
    if not 1 / LONGEST <= high - low <= LONGEST:
        must_be(entry, f"two numbers that differ by {1 / LONGEST:g} to {LONGEST:g}; choose another unit of length,")
    return low, high


# -- explicit disks -------------------------------------------------------------------------------------------------


def _explicit(entries: dict[str, Entry], common: dict) -> Scene:
    """Return the scene of a list of disks; `common` are the fields that every scene has."""
    for key in ONLY_WITH_SPECIES:
        if entries[key].value is not None:
            refuse(entries[key], "must not be given with an explicit list of disks, which says it all")
    listed = reading.items(entries["disks"])
    if len(listed) > MOST_DISKS:
        must_be(entries["disks"], f"at most {MOST_DISKS} disks")
    disks = tuple(_disk(entry, common["box"]) for entry in listed)
    _refuse_ratio(entries["disks"], disks)
    _refuse_narrow(entries["box"], common["box"], disks)
    _refuse_overlap(entries["disks"], common["box"], disks)
    return Scene(species=(), disks=disks, placement="random", velocities=None, **common)


def _disk(entry: Entry, box: Box) -> Disk:
    """Return a disk of an explicit list, inside the box."""
    entries = reading.fields(entry, ("position", "velocity", "radius", "mass"))
    radius, mass = _radius(entries["radius"], box), _mass(entries["mass"])
    velocity = reading.pair(entries["velocity"])
    if max(map(abs, velocity)) > FASTEST:
        must_be(entries["velocity"], f"two numbers up to {FASTEST:g}, either sign")
    return Disk(_inside(entries["position"], box, radius), velocity, radius, mass)


def _radius(entry: Entry, box: Box) -> float:
    """Return a radius [length]: the disk fits into the box, and round-off of its position is far below its size."""
    radius, most = reading.number(entry, above=0), min(box.width, box.height) / 2
    if radius > most:
        must_be(entry, f"at most half the shorter side of the box, {most!r}")
    least = SMALLEST_RADIUS * max(box.width, box.height)
    if radius < least:
        must_be(entry, f"at least {SMALLEST_RADIUS:g} of the longer side of the box, {least:.4g}")
    return radius


def _mass(entry: Entry) -> float:
    """Return a mass from 1/HEAVIEST to HEAVIEST."""
    mass = reading.number(entry, above=0)
    return mass if 1 / HEAVIEST <= mass <= HEAVIEST else must_be(entry, f"from {1 / HEAVIEST:g} to {HEAVIEST:g}")


def _refuse_ratio(entry: Entry, disks: tuple[Disk | Species, ...]) -> None:
    """Refuse masses so different that numbers of an engine would overflow."""
    masses = [disk.mass for disk in disks if getattr(disk, "count", 1)]
    if masses and max(masses) / LARGEST_MASS_RATIO > min(masses):
        pair = f"masses {min(masses)!r} and {max(masses)!r} are too far apart"
        refuse(entry, f"{pair}; must be within a factor of {LARGEST_MASS_RATIO:g}")


def _inside(entry: Entry, box: Box, radius: float) -> tuple[float, float]:
    """Return the centre of a disk: inside a periodic box, or inside walls by at least its radius."""
    position = reading.pair(entry)
    for axis, value, (low, high) in zip("xy", position, (box.x, box.y), strict=True):
        slack = ROUND_OFF * radius + 2 * math.ulp(max(-low, high))
        if box.periodic and not low <= value < high:
            must_be(entry, f"inside the periodic box, {low!r} <= {axis} < {high!r}")
        if not box.periodic and not low - slack <= value - radius <= value + radius <= high + slack:
            must_be(entry, f"inside the walls, {low!r} <= {axis} <= {high!r}, by the radius {radius!r} or more")
    return position


def _refuse_narrow(entry: Entry, box: Box, disks: tuple[Disk | Species, ...]) -> None:
    """Refuse a periodic box in which a disk could touch two images of one neighbour."""
    least = 4 * max((disk.radius for disk in disks), default=0.0)
    if box.periodic and min(box.width, box.height) < least:
        size = f"a periodic box of {box.width!r} by {box.height!r}"
        refuse(entry, f"{size} is too narrow; must be at least {least!r} both ways, four times the largest radius")


def _refuse_overlap(entry: Entry, box: Box, disks: tuple[Disk, ...]) -> None:
    """Refuse a list with two overlapping disks; disks in contact are allowed."""
    position, radius = np.array([disk.position for disk in disks]), np.array([disk.radius for disk in disks])
    pair = overlap(position, radius, (box.x, box.y) if box.periodic else None)
    if pair is None:
        return
    a, b, gap = pair
    at = f"disk {a} at {list(disks[a].position)} and disk {b} at {list(disks[b].position)}"
    refuse(entry, f"{at} overlap: the gap between their edges is {gap:.6g}; must be >= 0")


# -- species --------------------------------------------------------------------------------------------------------


def _of_species(entries: dict[str, Entry], common: dict) -> Scene:
    """Return the scene of a tracer and species; `common` are the fields that every scene has."""
    box, disks = common["box"], entries["disks"]
    if not isinstance(disks.value, dict) or not disks.value.keys() & {"tracer", "species"}:
        must_be(disks, "a list of disks, or a mapping with tracer, species or both")
    inside = reading.fields(disks, (), {"tracer": None, "species": [], "placement": "random"})
    species = _species(inside, entries["particles"], box)
    _refuse_ratio(disks, species)
    _refuse_narrow(entries["box"], box, species)
    _refuse_crowd(disks, box, species)
    equilibrate, tracer = _equilibrate(entries["equilibrate"], inside["tracer"].value is not None)
    return Scene(
        species=species,
        disks=(),
        placement=reading.choice(inside["placement"], PLACEMENTS),
        velocities=_velocities(entries["velocities"], species),
        equilibrate=equilibrate,
        tracer_while_equilibrating=tracer,
        **common,
    )


def _species(inside: dict[str, Entry], particles: Entry, box: Box) -> tuple[Species, ...]:
    """Return the tracer, if there is one, and the species; `inside` are the entries of `disks`."""
    species = [] if inside["tracer"].value is None else [_tracer(inside["tracer"], box)]
    listed = [reading.fields(entry, ("name", "count", "radius", "mass")) for entry in reading.items(inside["species"])]
    counts = _counts([entries["count"] for entries in listed], particles, len(species))
    for entries, count in zip(listed, counts, strict=True):
        name = reading.name(entries["name"])
        if name in ("tracer", *(other.name for other in species)):
            must_be(entries["name"], "a name of its own (tracer is reserved)")
        species.append(Species(name, count, _radius(entries["radius"], box), _mass(entries["mass"])))
    return tuple(species)


def _tracer(entry: Entry, box: Box) -> Species:
    """Return the tracer as a species of one disk."""
    entries = reading.fields(entry, ("radius", "mass"), {"position": None})
    radius = _radius(entries["radius"], box)
    position = None if entries["position"].value is None else _inside(entries["position"], box, radius)
    return Species("tracer", 1, radius, _mass(entries["mass"]), position)


def _counts(entries: list[Entry], particles: Entry, tracers: int) -> list[int]:
    """Return the number of disks of each species; `rest` is the total less all others."""
    rest = [entry for entry in entries if entry.value == "rest"]
    if len(rest) > 1:
        must_be(rest[1], "a number, as only one species can be the rest")
    counts = [0 if entry in rest else reading.integer(entry, 0, MOST_DISKS, " or rest") for entry in entries]
    known = tracers + sum(counts)
    if particles.value is None:
        if rest:
            refuse(particles, "missing; must be given with `count: rest`")
        particles = particles._replace(value=known)
    total = reading.integer(particles, 0, MOST_DISKS)
    if total < known or (total > known and not rest):
        least = "at least " if rest else ""
        must_be(particles, f"{least}{known}, which is what the tracer and the species with numbers add up to")
    return [total - known if entry in rest else count for entry, count in zip(entries, counts, strict=True)]


def _refuse_crowd(entry: Entry, box: Box, species: tuple[Species, ...]) -> None:
    """Refuse more disks of a species, or of all together, than can fit; those accepted may still be hard to place."""
    for s in species:
        most = most_disks(box.width, box.height, 2 * s.radius, box.periodic)
        if s.count > most:
            crowd = f"{s.count} disks of radius {s.radius!r} ({s.name})"
            refuse(entry, f"{crowd} cannot fit; must be at most {most}")
    phi = math.fsum(math.pi * s.count * (s.radius / box.width) * (s.radius / box.height) for s in species)
    if phi > 1:
        refuse(entry, f"the disks cover {phi:.4g} times the area of the box; must be at most 1")


def _velocities(entry: Entry, species: tuple[Species, ...]) -> Velocities:
    """Return the distribution of the initial velocities: a standard deviation or a temperature must be given."""
    if entry.value is None:
        refuse(entry, "missing; must be given with species")
    entries = reading.fields(entry, (), {"standard_deviation": None, "temperature": None, "zero_momentum": False})
    widths = [entries[key] for key in ("standard_deviation", "temperature")]
    if sum(width.value is not None for width in widths) != 1:
        refuse(entry, "must have either standard_deviation or temperature")
    deviation, temperature = (None if width.value is None else reading.number(width, least=0) for width in widths)
    if deviation is not None and deviation > FASTEST:
        must_be(entries["standard_deviation"], f"at most {FASTEST:g}")
    for s in species:
        if temperature and s.count and not SLOWEST_SQUARE <= temperature / s.mass < math.inf:
            allowed = f"0, or {SLOWEST_SQUARE:g} to 1.8e308 times the mass {s.mass!r} ({s.name})"
            must_be(entries["temperature"], allowed)
    return Velocities(deviation, temperature, reading.flag(entries["zero_momentum"]))


def _equilibrate(entry: Entry, has_tracer: bool) -> tuple[float, str]:
    """Return the time simulated before t = 0, and whether the tracer is then pinned (the default) or free."""
    default = "pinned" if has_tracer else "free"
    if not isinstance(entry.value, dict):
        return (0.0 if entry.value is None else reading.number(entry, least=0)), default
    entries = reading.fields(entry, ("time",), {"tracer": default})
    time, tracer = reading.number(entries["time"], least=0), reading.choice(entries["tracer"], WHILE_EQUILIBRATING)
    if tracer == "pinned" and not has_tracer:
        must_be(entries["tracer"], "free, as there is no tracer")
    return time, tracer if time > 0 else default
