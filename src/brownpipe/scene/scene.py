"""The scene: box, disks and times of a run, everything that decides its physics but the seed. Frozen and hashable.

Its fields are the keys of scene files, with their bounds. A scene is valid by construction: listed disks lie inside the
box and do not overlap, and no species has more disks than can fit.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, StrictBool, Tag, model_validator

from brownpipe.errors import RequestError
from brownpipe.quoting import shell_path
from brownpipe.scene import sample_times
from brownpipe.scene.packing import ROUND_OFF, overlap
from brownpipe.scene.reading import (
    NAME,
    Count,
    Name,
    NotNegative,
    Pair,
    Positive,
    Record,
    alone,
    key,
    plain,
    refuse,
    validated,
)
from brownpipe.scene.yaml_file import Document, read_yaml, yaml_text

MOST_SAMPLES = 10_000_000
LONGEST = 1e140  # side of a box, its inverse the shortest: squared displacements down to 1e-14 of it do not underflow
HEAVIEST = 1e302  # mass; its inverse the lightest
LARGEST_MASS_RATIO = 1e200  # with it, products of masses and squared speeds neither overflow nor underflow
SMALLEST_RADIUS = 1e-10  # in units of the longer side of the box: round-off of a position is then 1e-6 of the radius
HEXAGONAL = (1 + 1e-9) / math.sqrt(12)  # disks in a square of side R in the densest packing, and round-off
SLOWEST_SQUARE = 1e-300  # smallest kT/m except 0
ONLY_WITH_SPECIES = ("particles", "velocities", "equilibrate")  # keys
STUDY_KEYS = {"scenes", "seeds", "tolerance", "engines", "batch", "figures"}  # that no scene has

# With the values of varied keys (`variation`): `fluid,tracer_mass=10`.
SceneName = Annotated[str, Field(pattern=rf"^{NAME.pattern}(,\w+=[\w.-]{{1,64}})*$")]
Mass = Annotated[Positive, Field(ge=1 / HEAVIEST, le=HEAVIEST)]
PerDecade = Annotated[int, Field(strict=True, ge=1, le=10_000)]


class Box(Record):
    """A rectangle [length]. Reflecting walls are hard and touch a disk at its edge."""

    x: Pair = key("its sides, [low, high] [length]")
    y: Pair = key("its sides, [low, high] [length]")
    boundary: Literal["reflecting", "periodic"] = key("hard walls, hit by a disk's edge, or periodic", "reflecting")

    @model_validator(mode="after")
    def _check(self) -> "Box":
        for side, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 / LONGEST <= high - low <= LONGEST:
                allowed = f"[low, high] with low < high, {1 / LONGEST:g} to {LONGEST:g} long"
                refuse(f"must be {allowed}, not {[low, high]}", side)
        return self

    @property
    def width(self) -> float:
        return self.x[1] - self.x[0]

    @property
    def height(self) -> float:
        return self.y[1] - self.y[0]

    @property
    def area(self) -> float:
        return self.width * self.height

    @property
    def origin(self) -> tuple[float, float]:
        """The lower left corner."""
        return self.x[0], self.y[0]

    @property
    def periodic(self) -> bool:
        return self.boundary == "periodic"

    def accessible(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lower corner (2,) and size (2,) [length] of the rectangle accessible to the centre of a disk.

        It is smaller than the box by the radius at each wall; a periodic box is accessible as it is.
        """
        margin = 0.0 if self.periodic else radius
        return np.array(self.origin) + margin, np.array((self.width, self.height)) - 2 * margin


class Disk(Record):
    """A disk of an explicit list."""

    position: Pair = key("initial centre, [x, y] [length]")
    velocity: Pair = key("[x, y] [length/time]")
    radius: Positive = key("[length]")
    mass: Mass = key("[mass]")
    count: ClassVar = 1


class Tracer(Record):
    """Disk 0, whose motion is recorded and analysed. It is a species of its own."""

    radius: Positive = key("[length]")
    mass: Mass = key("[mass]")
    position: Pair | None = key("its initial centre [length]; by default it is placed like the others", None)
    name: ClassVar = "tracer"
    count: ClassVar = 1


CountOrRest = Annotated[
    Annotated[Count, Tag("{number}")] | Annotated[Literal["rest"], Tag("{word}")],
    Discriminator(lambda value: "{word}" if isinstance(value, str) else "{number}"),
]


class Species(Record):
    """Equal disks, which `engines.initial_state.draw` places."""

    name: Name = key("differs from the others and from `tracer`")
    count: CountOrRest = key("a number; one species at most is the `rest` of `particles`")
    radius: Positive = key("of each disk [length]")
    mass: Mass = key("of each disk [mass]")
    position: ClassVar = None


class Mixture(Record):
    """Disks that are placed by the program. Without a tracer, disk 0 is the first disk of the first species."""

    tracer: Tracer | None = key("disk 0, whose motion is recorded and analysed", None)
    species: tuple[Species, ...] = key("all other disks", ())
    placement: Literal["auto", "random", "lattice"] = key(
        "random insertion (`auto`: of smaller disks that grow, where it fails), or a lattice", "auto"
    )

    @model_validator(mode="after")
    def _check(self) -> "Mixture":
        if not self.model_fields_set & {"tracer", "species"}:
            refuse("must have tracer, species or both")
        names = ["tracer", *(species.name for species in self.species)]
        rest = [k for k, species in enumerate(self.species) if species.count == "rest"]
        for k, name in enumerate(names[1:]):
            if name in names[: k + 1]:
                refuse(f"must be a name of its own (tracer is reserved), not {name!r}", "species", k, "name")
        if len(rest) > 1:
            refuse("must be a number, as only one species can be the rest", "species", rest[1], "count")
        return self


class Velocities(Record):
    """Normal distribution of the initial velocity components: one of the two widths is given.

    Theory relies on it, wherever `scene.velocities` is read.
    """

    standard_deviation: NotNegative | None = key("of every velocity component of every disk [length/time]", None)
    temperature: NotNegative | None = key("kT: velocity components have variance kT/m [energy]", None)
    zero_momentum: StrictBool | None = key(
        "subtract the velocity of the centre of mass (default: in a periodic box with several disks)", None
    )

    @model_validator(mode="after")
    def _check(self) -> "Velocities":
        if (self.standard_deviation is None) == (self.temperature is None):
            refuse("must have either standard_deviation or temperature")
        return self


class Samples(Record):
    """Logarithmic sample times: 0, first * 10^(k/per_decade) for k = 0, 1, ..., and the duration."""

    per_decade: PerDecade = key("sample times per factor of ten in time")
    first: Positive | None = key("the first sample time after 0 [time] (default: 1e-4 of the duration)", None)


class Equilibration(Record):
    """What is simulated before t = 0."""

    time: NotNegative = key("[time]")
    tracer: Literal["pinned", "free"] | None = key("whether the tracer is held (default, if there is one)", None)


Disks = Annotated[
    Annotated[Mixture, Tag("{species}")] | Annotated[tuple[Disk, ...], Tag("{list}")],
    Discriminator(lambda value: "{list}" if isinstance(value, list | tuple) else "{species}"),
]


Before = Annotated[Equilibration, alone("time", NotNegative | Equilibration)]


class Scene(Record):
    """The physics of one run. Disk 0 is the tracer."""

    box: Box = key("the rectangle, and what happens at its sides")
    disks: Disks = key("species, whose disks are placed by the program, or a list of disks")
    duration: Positive = key("a run goes from t = 0 to t = duration [time]")
    particles: Count | None = key("total number of disks, tracer included (default: sum of the counts)", None)
    velocities: Velocities | None = key("initial velocities; must be given with species", None)
    sample_interval: Positive | None = key("sample times: its multiples and the duration [time]", None)
    samples: Samples | None = key("logarithmic sample times, in place of `sample_interval`", None)
    equilibrate: Before = key("simulated time before t = 0 [time], or a mapping with it", Equilibration(time=0.0))
    if TYPE_CHECKING:
        name: str  # in results, that of the file; no key

    @model_validator(mode="after")
    def _check(self) -> "Scene":
        self._resolve_times()
        if isinstance(self.disks, Mixture):
            self._count(self.disks)
            self._check_mixture(self.disks)
            self._check_motion(self.disks.tracer is not None)
        else:
            self._check_list(self.disks)
        light, heavy = self.mass.min(initial=HEAVIEST), self.mass.max(initial=1 / HEAVIEST)
        if heavy / LARGEST_MASS_RATIO > light:
            pair = f"masses {light:g} and {heavy:g} are too far apart"
            refuse(f"{pair}; must be within a factor of {LARGEST_MASS_RATIO:g}", "disks")
        return self

    def _resolve_times(self) -> None:
        if self.samples is not None:
            if self.sample_interval is not None:
                refuse("must not be given with sample_interval; give one of the two", "samples")
            first = self.duration * 1e-4 if self.samples.first is None else self.samples.first
            self._resolve(samples=self.samples.model_copy(update={"first": first}))
            if first >= self.duration:
                refuse(f"must be below the duration, {self.duration!r}, not {first!r}", "samples", "first")
        interval = self.duration if self.sample_interval is None else self.sample_interval
        if not interval <= self.duration <= MOST_SAMPLES * interval:
            allowed = f"at most the duration, {self.duration!r}, and at least {self.duration / MOST_SAMPLES:g}"
            refuse(f"must be {allowed}, for {MOST_SAMPLES} samples, not {interval!r}", "sample_interval")
        self._resolve(sample_interval=interval)

    def _check_list(self, disks: tuple[Disk, ...]) -> None:
        """Refuse keys that only species have, and disks that are not in the box or overlap."""
        if self.velocities is not None or self.equilibrate.time > 0:
            given = "equilibrate" if self.velocities is None else "velocities"
            refuse("must not be given with an explicit list of disks, which says it all", given)
        if self.particles not in (None, len(disks)):
            refuse(f"must be {len(disks)}, the number of disks listed, not {self.particles}", "particles")
        self._resolve(particles=len(disks), equilibrate=Equilibration(time=0.0, tracer="free"))
        for k, disk in enumerate(disks):
            self._check_disk(disk, "disks", k)
        box = (self.box.x, self.box.y) if self.box.periodic else None
        if pair := overlap(np.array([disk.position for disk in disks]), self.radius, box):
            a, b, gap = pair
            at = f"disk {a} at {list(disks[a].position)} and disk {b} at {list(disks[b].position)}"
            refuse(f"{at} overlap: the gap between their edges is {gap:.6g}; must be >= 0", "disks")

    def _check_mixture(self, disks: Mixture) -> None:
        """Refuse disks that cannot fit; those accepted may still be hard to place."""
        if disks.tracer is not None:
            self._check_disk(disks.tracer, "disks", "tracer")
        for k, species in enumerate(disks.species):
            self._check_disk(species, "disks", "species", k)
        for s in self.species:
            most = HEXAGONAL * (self.box.width / s.radius) * (self.box.height / s.radius)
            if s.count > most:
                crowd = f"{s.count} disks of radius {s.radius!r} ({s.name})"
                refuse(f"{crowd} cannot fit; must be at most {math.floor(most)}", "disks")
        if self.packing_fraction > 1:
            refuse(f"the disks cover {self.packing_fraction:.4g} times the area of the box; must be at most 1", "disks")

    def _count(self, disks: Mixture) -> None:
        """Resolve the total number of disks."""
        numbers = [species.count for species in disks.species]
        known = (disks.tracer is not None) + sum(n for n in numbers if n != "rest")
        if self.particles is None and "rest" in numbers:
            refuse("missing; must be given with `count: rest`", "particles")
        total = known if self.particles is None else self.particles
        if total < known or (total > known and "rest" not in numbers):
            least = "at least " if "rest" in numbers else ""
            what = "which is what the tracer and the species with numbers add up to"
            refuse(f"must be {least}{known}, {what}, not {total}", "particles")
        self._resolve(particles=total)

    def _check_motion(self, has_tracer: bool) -> None:
        """Check velocities and equilibration of species."""
        if self.velocities is None:
            refuse("missing; must be given with species", "velocities")
        kt = self.velocities.temperature
        for s in self.species:
            if kt and s.count and not SLOWEST_SQUARE <= kt / s.mass < math.inf:
                allowed = f"0, or {SLOWEST_SQUARE:g} to 1.8e308 times the mass {s.mass!r} ({s.name})"
                refuse(f"must be {allowed}, not {kt!r}", "velocities", "temperature")
        time, tracer = self.equilibrate.time, self.equilibrate.tracer
        if tracer == "pinned" and not has_tracer:
            refuse("must be free, as there is no tracer", "equilibrate", "tracer")
        default: Literal["pinned", "free"] = "pinned" if has_tracer else "free"
        self._resolve(equilibrate=Equilibration(time=time, tracer=tracer if tracer and time > 0 else default))
        if self.velocities.zero_momentum is None:
            drifts = self.box.periodic and self.particles != 1  # as a whole; a single disk would stand still
            self._resolve(velocities=self.velocities.model_copy(update={"zero_momentum": drifts}))

    def _check_disk(self, disk: Disk | Tracer | Species, *path: str | int) -> None:
        """Refuse a radius that does not fit or vanishes in round-off, and a centre outside the box or in a wall.

        In a periodic box of less than four radii a disk could touch two images of one neighbour.
        """
        box, radius = self.box, disk.radius
        most = min(box.width, box.height) / (4 if box.periodic else 2)
        least = SMALLEST_RADIUS * max(box.width, box.height)
        if radius > most:
            share = "a quarter of the shorter side of a periodic" if box.periodic else "half the shorter side of the"
            refuse(f"must be at most {share} box, {most!r}, not {radius!r}", *path, "radius")
        if radius < least:
            share = f"{SMALLEST_RADIUS:g} of the longer side of the box"
            refuse(f"must be at least {share}, {least:.4g}, not {radius!r}", *path, "radius")
        for axis, value, (low, high) in zip("xy", disk.position or (), (box.x, box.y), strict=False):
            slack, found = ROUND_OFF * radius + 2 * math.ulp(max(-low, high)), f"not {list(disk.position or ())}"
            if box.periodic and not low <= value < high:
                refuse(f"must be inside the periodic box, {low!r} <= {axis} < {high!r}, {found}", *path, "position")
            if not box.periodic and not low - slack <= value - radius <= value + radius <= high + slack:
                inside = f"inside the walls, {low!r} <= {axis} <= {high!r}, by the radius {radius!r} or more"
                refuse(f"must be {inside}, {found}", *path, "position")

    def __repr__(self) -> str:
        box = f"{self.box.boundary} box {self.box.width:g} x {self.box.height:g}"
        packing = f"packing fraction {self.packing_fraction:.4g}"
        return f"<Scene {self.name}: {self.particles} disks in a {box}, {packing}, duration {self.duration:g}>"

    __str__ = __repr__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and (self.name, self.text) == (other.name, other.text)

    def __hash__(self) -> int:
        return hash((self.name, self.digest))

    @property
    def label(self) -> str:
        """Name and number of disks, by which a trade-off names it."""
        return f"{self.name}_N{self.particles}"

    @property
    def listed(self) -> tuple[Disk, ...]:
        """The disks of an explicit list; () for species."""
        return () if isinstance(self.disks, Mixture) else self.disks

    @cached_property
    def species(self) -> tuple[Any, ...]:
        """The tracer, if any, and the species, each with its name, count, radius, mass; () for a list of disks."""
        if not isinstance(self.disks, Mixture):
            return ()
        tracer = () if self.disks.tracer is None else (self.disks.tracer,)
        known = len(tracer) + sum(s.count for s in self.disks.species if s.count != "rest")
        rest = {"count": (self.particles or 0) - known}
        return (*tracer, *(s.model_copy(update=rest) if s.count == "rest" else s for s in self.disks.species))

    @property
    def placement(self) -> str:
        """How species are placed: "auto", "random" or "lattice"; "" for a list of disks."""
        return self.disks.placement if isinstance(self.disks, Mixture) else ""

    @cached_property
    def radius(self) -> np.ndarray:
        """Radii (N,) [length], read-only."""
        return self._of_each_disk("radius")

    @cached_property
    def mass(self) -> np.ndarray:
        """Masses (N,), read-only."""
        return self._of_each_disk("mass")

    def _of_each_disk(self, field: str) -> np.ndarray:
        groups = self.listed or self.species
        counts = np.array([group.count for group in groups], dtype=int)
        return _read_only(np.repeat(np.array([getattr(group, field) for group in groups], dtype=float), counts))

    @cached_property
    def packing_fraction(self) -> float:
        """Packing fraction, phi = sum(pi R^2)/A."""
        return float(math.pi * np.sum((self.radius / self.box.width) * (self.radius / self.box.height)))

    @cached_property
    def times(self) -> np.ndarray:
        """Sample times (T,) [time] from 0 to the duration, both exactly, read-only.

        Multiples of the interval, or logarithmic.
        """
        if self.samples is not None:
            first = self.samples.first or 0.0
            return _read_only(sample_times.logarithmic_times(self.samples.per_decade, first, self.duration))
        return _read_only(sample_times.linear_times(self.sample_interval or self.duration, self.duration))

    def replace(self, **keys: object) -> "Scene":
        """Return a scene of the same name with other values of some keys, which may be paths like disks.tracer.mass."""
        given = self.model_dump(exclude_unset=True)
        for path, value in plain(keys).items():
            given = with_value(given, path.split("."), value, path)
        scene = validated(Scene, given)
        scene._resolve(name=self.name)
        return scene

    def as_mapping(self) -> dict:
        """Return the scene as a mapping like that of a scene file, with every default written out."""
        mapping = self.model_dump(exclude=set(ONLY_WITH_SPECIES) if self.velocities is None else None)
        del mapping["samples" if self.samples is None else "sample_interval"]
        if isinstance(self.disks, Mixture):
            for written, species in zip(mapping["disks"]["species"][::-1], self.species[::-1], strict=False):
                written["count"] = species.count
        return mapping

    @cached_property
    def text(self) -> str:
        """The physics as canonical JSON: `parse_scene(json.loads(scene.text), ...)` gives an equal scene."""
        return json.dumps(self.as_mapping(), sort_keys=True, allow_nan=False)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the text, whatever the name of the scene.

        It covers the canonical scene as it is stored, names of species included, as they are in the results, and
        species of which there are no disks. Another way to write the same (defaults, `rest`) has the same digest.
        """
        return hashlib.sha256(self.text.encode()).hexdigest()


def with_value(part: Any, path: Sequence[str], value: Any, where: str) -> Any:
    """Return a copy of a mapping, or of a list of species, with another value at a path."""
    if not path:
        return value
    if not isinstance(part, list | tuple):
        part = part if isinstance(part, Mapping) else {}
        return {**part, path[0]: with_value(part.get(path[0]), path[1:], value, where)}
    names = [item.get("name") if isinstance(item, Mapping) else None for item in part]
    if path[0] not in names or len(path) < 2:
        known = " or ".join(str(name) for name in names if name)
        raise RequestError(f"{where}: must name a species ({known}) and one of its keys")
    index = names.index(path[0])
    return [*part[:index], with_value(part[index], path[1:], value, where), *part[index + 1 :]]


def _read_only(values: np.ndarray) -> np.ndarray:
    """Return an array, from now on read-only."""
    values.flags.writeable = False
    return values


def read_scene(path: str | Path, particles: int | None = None) -> Scene:
    """Return the scene of a YAML file, with `particles` disks in total if that is given.

    Raises RequestError, one line, for anything wrong with the file or the scene.
    """
    return parse_scene(read_yaml(path), str(path), particles)


def scene_yaml(scene: Scene) -> str:
    """Return the text of a scene file, with every default written out; `read_scene` returns an equal scene from it."""
    return yaml_text(scene.as_mapping())


def parse_scene(mapping: Any, where: str, particles: int | None = None, name: str | None = None) -> Scene:
    """Return the scene of a mapping as read from a scene file.

    where: the file that messages name; its stem is the name of the scene, unless `name` is given.
    particles: total number of disks instead of the file's; for an explicit list it must be the length of the list.

    Raises RequestError for anything wrong.
    """
    if isinstance(mapping, dict) and "box" not in mapping and is_study(mapping):
        raise RequestError(f"{where}: is a study, not a scene; run it with brownpipe run {shell_path(where)}")
    if particles is not None and isinstance(mapping, dict):
        document = mapping if isinstance(mapping, Document) else Document(mapping)
        mapping = document.with_values({"particles": particles})
    scene = validated(Scene, mapping, where)
    stem, key = (Path(where).stem, "name of the file") if name is None else (name, "name")
    scene._resolve(name=validated(SceneName, stem, where, key))
    return scene


def is_study(mapping: dict) -> bool:
    """Whether a mapping is meant as a study, by its keys; a scene with a misplaced study key is none."""
    return "scenes" in mapping or ("box" not in mapping and bool(mapping.keys() & STUDY_KEYS))
