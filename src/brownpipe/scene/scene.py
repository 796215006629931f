"""The scene: box, disks and times of a run, everything that decides its physics but the seed.
Frozen and hashable.

Its fields are the keys of scene files, with their bounds. A scene is valid by construction: listed
disks lie inside the box and do not overlap, and species cover no more of it than hexagonal packing
does.
"""

import hashlib
import json
import math
from collections.abc import Collection
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NoReturn

import numpy as np
from pydantic import Field, PrivateAttr, StrictBool, ValidationInfo, model_validator

from brownpipe.errors import RequestError
from brownpipe.scene import reading
from brownpipe.scene.reading import (
    As,
    Count,
    Name,
    NotNegative,
    Pair,
    Positive,
    Resolved,
    Section,
    alone,
    key,
    refuse,
)
from brownpipe.scene.times import decimal_of, logarithmic, multiples
from brownpipe.text import shell_path
from brownpipe.theory import HEXAGONAL_PACKING

MOST_SAMPLES = 10_000_000
ROUND_OFF = 1e-12  # in contact distances: disks that overlap by no more than this are in contact
SAME = 1e-6  # in steps: a sample time this close to the duration is the duration
# side of a box; the shortest is 1/LONGEST: squared displacements of 1e-14 of it do not underflow
LONGEST = 1e140
REST = "rest"  # the count of a species that fills up the particles of a scene
# with it, products of masses and squared speeds neither overflow nor underflow
LARGEST_MASS_RATIO = 1e200
# in units of the longer side of the box: round-off of a position is then 1e-6 of the radius
SMALLEST_RADIUS = 1e-10

# The name of a scene with varied keys (`variation`) has their values: `fluid,tracer_mass=10`.
SceneName = Annotated[str, Field(pattern=rf"^{reading.NAME.pattern}(,[\w-]+=[\w.-]{{1,64}})*$")]


class Box(Section):
    """A rectangle [length]. Reflecting walls are hard and touch a disk at its edge."""

    x: Pair = key("its sides, [low, high] [length]")
    y: Pair = key("its sides, [low, high] [length]")
    boundary: Literal["reflecting", "periodic"] = key(
        "hard walls, hit by a disk's edge, or periodic", "reflecting"
    )

    @model_validator(mode="after")
    def _check(self) -> "Box":
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 / LONGEST <= high - low <= LONGEST:
                allowed = f"[low, high] with low < high, {1 / LONGEST:g} to {LONGEST:g} long"
                refuse(f"must be {allowed}, not {[low, high]}", name)
        return self

    @cached_property
    def width(self) -> float:
        left, right = self.x
        return right - left

    @cached_property
    def height(self) -> float:
        bottom, top = self.y
        return top - bottom

    @cached_property
    def area(self) -> float:
        return self.width * self.height

    @cached_property
    def origin(self) -> tuple[float, float]:
        """The lower left corner."""
        return self.x[0], self.y[0]

    @cached_property
    def periodic(self) -> bool:
        return self.boundary == "periodic"

    def accessible(self, radius: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lower corner (2,) and size (2,) [length] of the rectangle accessible to the centre
        of a disk.

        It is smaller than the box by the radius at each wall; a periodic box is accessible as it
        is.
        """
        margin = 0.0 if self.periodic else radius
        corner = np.array(self.origin) + margin
        size = np.array((self.width, self.height)) - 2 * margin
        return corner, size


class Disk(Section):
    """A disk of an explicit list."""

    position: Pair = key("initial centre, [x, y] [length]")
    velocity: Pair = key("[x, y] [length/time]")
    radius: Positive = key("[length]")
    mass: Positive = key("[mass]")
    count: ClassVar[int] = 1


class Tracer(Section):
    """Disk 0, whose motion is recorded and analysed. It is a species of its own."""

    radius: Positive = key("[length]")
    mass: Positive = key("[mass]")
    position: Pair | None = key(
        "its initial centre [length]; by default it is placed like the others", None
    )
    name: ClassVar[str] = "tracer"
    count: ClassVar[int] = 1


class Species(Section):
    """Equal disks, which `engines.start.initial_state.draw_state` places."""

    name: Name = key("differs from the others and from `tracer`")
    count: Annotated[int, As(Count | Literal[REST])] = key(
        "a number; one species at most is the `rest` of `particles`"
    )
    radius: Positive = key("of each disk [length]")
    mass: Positive = key("of each disk [mass]")
    position: ClassVar[None] = None


class Mixture(Section):
    """Disks that are placed by the program. Without a tracer, disk 0 is the first disk of the first
    species.
    """

    tracer: Tracer | None = key("disk 0, whose motion is recorded and analysed", None)
    species: tuple[Species, ...] = key("all other disks", ())
    placement: Literal["auto", "random", "lattice"] = key(
        "random insertion (`auto`: of smaller disks that grow, where it fails), or a lattice",
        "auto",
    )


Group = Disk | Tracer | Species  # equal disks, `count` of them


class Velocities(Section):
    """Normal distribution of the initial velocity components: one of the two widths is given."""

    # Theory that reads `scene.velocities` relies on this distribution.
    standard_deviation: NotNegative | None = key(
        "of every velocity component of every disk [length/time]", None
    )
    temperature: NotNegative | None = key(
        "kT: velocity components have variance kT/m [energy]", None
    )
    zero_momentum: Resolved[StrictBool] = key(
        "subtract the velocity of the centre of mass (default: in a periodic box with several "
        "disks)",
        None,
    )


class Samples(Section):
    """Logarithmic sample times: 0, first * 10^(k/per_decade) for k = 0, 1, ..., and the
    duration.
    """

    per_decade: Annotated[reading.AtLeastOne, Field(le=10_000)] = key(
        "sample times per factor of ten in time"
    )
    first: Resolved[Positive] = key(
        "the first sample time after 0 [time] (default: 1e-4 of the duration)", None
    )


class Equilibration(Section):
    """What is simulated before t = 0."""

    time: NotNegative = key("[time]")
    tracer: Resolved[Literal["pinned", "free"]] = key(
        "whether the tracer is held (default, if there is one)", None
    )


Before = Annotated[Equilibration, alone("time", NotNegative | Equilibration)]


class Scene(Section):
    """The physics of one run. Disk 0 is the tracer."""

    box: Box = key("the rectangle, and what happens at its sides")
    disks: Mixture | tuple[Disk, ...] = key(
        "species, whose disks are placed by the program, or a list of disks"
    )
    duration: Positive = key("a run goes from t = 0 to t = duration [time]")
    particles: Resolved[Count] = key(
        "total number of disks, tracer included (default: sum of the counts)", None
    )
    velocities: Velocities | None = key("initial velocities; must be given with species", None)
    sample_interval: Resolved[Positive] = key(
        "sample times: its multiples and the duration [time]", None
    )
    samples: Samples | None = key("logarithmic sample times, in place of `sample_interval`", None)
    equilibrate: Before = key(
        "simulated time before t = 0 [time], or a mapping with it", 0.0, validate_default=True
    )
    _given: dict[str, Any] = PrivateAttr()
    _name: str = PrivateAttr()

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> "Scene":
        """Resolve defaults that depend on other keys, and refuse what contradicts them.

        A validation context says that the box is still to be scaled; then the disks need not fit
        into it.
        """
        self._given = self.model_dump(exclude_unset=True)
        self._resolve_times()
        if isinstance(self.disks, Mixture):
            self._check_names(self.disks)
        groups = self._groups()
        self._resolve_numbers(groups.values())
        self._check_masses()
        self._resolve_start()
        if info.context is None:
            for path, group in groups.items():
                self._check_disk(group, *path)
            self._check_packing()
        return self

    def _resolve_times(self) -> None:
        interval = self.sample_interval or self.duration
        if not interval <= self.duration <= MOST_SAMPLES * interval:
            refuse(
                f"must be {1 / MOST_SAMPLES:g} to 1 times the duration, not {interval!r}",
                "sample_interval",
            )
        if self.samples is not None:
            if "sample_interval" in self.model_fields_set:
                refuse("must not be given with sample_interval; give one of the two", "samples")
            first = self.samples.first or float(decimal_of(self.duration) / 10_000)
            if first >= self.duration:
                problem = f"must be below the duration, {self.duration!r}, not {first!r}"
                refuse(problem, "samples", "first")
            self.samples._resolve(first=first)
        self._resolve(sample_interval=interval)

    def _check_names(self, disks: Mixture) -> None:
        """Refuse a scene without any species, and two of one name; only one may be the rest."""
        if disks.tracer is None and not disks.species:
            refuse("must have a tracer or species, or be a list of disks", "disks")
        names = [species.name for species in disks.species]
        counts = [species.count for species in disks.species]
        are_rest = [count == REST for count in counts]
        if len({"tracer", *names}) <= len(names) or sum(are_rest) > 1:
            allowed = "names of their own, none tracer, and one rest at most"
            refuse(f"must have {allowed}, not {names}, {counts}", "disks", "species")

    def _groups(self) -> dict[tuple[str | int, ...], Group]:
        """Return the listed disks, or the species, tracer included, by their paths of keys."""
        if not isinstance(self.disks, Mixture):
            return {("disks", k): disk for k, disk in enumerate(self.disks)}
        groups: dict[tuple[str | int, ...], Group] = {}
        if self.disks.tracer is not None:
            groups["disks", "tracer"] = self.disks.tracer
        for k, species in enumerate(self.disks.species):
            groups["disks", "species", k] = species
        return groups

    def _resolve_numbers(self, groups: Collection[Group]) -> None:
        """Resolve the number of disks in all, and of those that are its rest."""
        rest = [group for group in groups if group.count == REST]
        counted = sum(group.count for group in groups if group.count != REST)
        is_given = "particles" in self.model_fields_set
        if rest and not is_given:
            refuse("missing; must be given with `count: rest`", "particles")
        total = self.particles if is_given else counted
        if total < counted or (total > counted and not rest):
            least = "at least " if rest else ""
            refuse(
                f"must be {least}{counted}, the number of disks in `disks`, not {total}",
                "particles",
            )
        for species in rest:
            species._resolve(count=total - counted)
        self._resolve(particles=total)

    def _check_masses(self) -> None:
        """Refuse masses too different for one run."""
        light = self.mass.min(initial=math.inf)
        heavy = self.mass.max(initial=0.0)
        if heavy / LARGEST_MASS_RATIO > light:
            refuse(
                f"must be masses within a factor of {LARGEST_MASS_RATIO:g}, not {light:g} and "
                f"{heavy:g}",
                "disks",
            )

    def _resolve_start(self) -> None:
        """Resolve the motion of the tracer before t = 0 and the total momentum."""
        start = self.equilibrate
        velocities = self.velocities
        has_tracer = isinstance(self.disks, Mixture) and self.disks.tracer is not None
        if self.placement and velocities is None:
            refuse(
                "missing; must be given with species: {temperature: kT} or "
                "{standard_deviation: speed}",
                "velocities",
            )
        if velocities is not None and not self.placement:
            refuse("must not be given with an explicit list of disks", "velocities")
        if start.time > 0 and not self.placement:
            refuse("must not be given with an explicit list of disks", "equilibrate")
        if "tracer" not in start.model_fields_set or start.time == 0:
            start._resolve(tracer="pinned" if has_tracer else "free")
        elif start.tracer == "pinned" and not has_tracer:
            refuse("must be free, as there is no tracer", "equilibrate", "tracer")
        if velocities is None:
            return
        if (velocities.standard_deviation is None) == (velocities.temperature is None):
            refuse("must have either standard_deviation or temperature", "velocities")
        if "zero_momentum" not in velocities.model_fields_set:
            # Periodic disks drift as a whole; a single one would stand still.
            velocities._resolve(zero_momentum=self.box.periodic and self.particles != 1)

    def _check_packing(self) -> None:
        """Refuse listed disks that overlap and species that cannot fit; those accepted may still be
        hard to place.
        """
        sides = (self.box.x, self.box.y) if self.box.periodic else None
        position = np.array([disk.position for disk in self.listed])
        deepest = overlap(position, self.radius, sides) if len(position) > 1 else None
        if deepest is not None:
            *pair, gap = deepest
            disks = " and ".join(f"disk {k} at {list(self.listed[k].position)}" for k in pair)
            refuse(
                f"{disks} overlap: the gap between their edges is {gap:.6g}; must be >= 0", "disks"
            )
        if self.species and self.packing_fraction > HEXAGONAL_PACKING * (1 + 1e-9):
            crowd = (
                f"{self.particles} disks cover {self.packing_fraction:.4g} times the area of the "
                "box"
            )
            refuse(f"{crowd}; must be at most {HEXAGONAL_PACKING:.4g} (hexagonal packing)", "disks")

    def _check_disk(self, disk: Group, *path: str | int) -> None:
        """Refuse a radius that does not fit or vanishes in round-off, and a centre outside the box
        or in a wall.

        In a periodic box of less than four radii a disk could touch two images of one neighbour.
        """
        box = self.box
        radius = disk.radius
        smallest = SMALLEST_RADIUS * max(box.width, box.height)
        largest = min(box.width, box.height) / (4 if box.periodic else 2)
        if not smallest <= radius <= largest:
            allowed = f"{smallest:g} to {largest!r} in this {box.boundary} box"
            refuse(f"must be {allowed}, not {radius!r}", *path, "radius")
        if disk.position is None:
            return
        x, y = disk.position
        for axis, value, side in (("x", x, box.x), ("y", y, box.y)):
            inside = _range_if_outside(axis, value, side, 0.0 if box.periodic else radius)
            if inside:
                problem = f"must have the disk inside the box, {inside}, not {list(disk.position)}"
                refuse(problem, *path, "position")

    def __repr__(self) -> str:
        box = f"{self.box.boundary} box {self.box.width:g} x {self.box.height:g}"
        packing = f"packing fraction {self.packing_fraction:.4g}"
        return (
            f"<Scene {self.name}: {self.particles} disks in a {box}, {packing}, duration "
            f"{self.duration:g}>"
        )

    __str__ = __repr__

    def _refuse_new_value(self, name: str, value: object) -> NoReturn:
        other = f"scene.replace({name}={value!r:.40}) returns another scene"
        raise RequestError(f"{name}: cannot be changed; {other}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and (self.name, self.text) == (other.name, other.text)

    def __hash__(self) -> int:
        return hash(self.text)

    @property
    def name(self) -> str:
        """The name of the scene in results; by default the stem of its file."""
        return self._name

    @property
    def given(self) -> dict[str, Any]:
        """The keys that were given, without what follows from them."""
        return self._given

    @cached_property
    def listed(self) -> tuple[Disk, ...]:
        """The disks of an explicit list; () for species."""
        return () if isinstance(self.disks, Mixture) else self.disks

    @cached_property
    def species(self) -> tuple[Tracer | Species, ...]:
        """The tracer, if there is one, and the species; () for a list of disks."""
        if not isinstance(self.disks, Mixture):
            return ()
        if self.disks.tracer is None:
            return self.disks.species
        return (self.disks.tracer, *self.disks.species)

    @property
    def placement(self) -> str:
        """How the program places the disks: "auto", "random" or "lattice"; "" for a list of
        disks.
        """
        return self.disks.placement if isinstance(self.disks, Mixture) else ""

    @cached_property
    def radius(self) -> np.ndarray:
        """The radius of each disk (N,) [length], read-only."""
        return self._of_each_disk([group.radius for group in self.listed or self.species])

    @cached_property
    def mass(self) -> np.ndarray:
        """The mass of each disk (N,), read-only."""
        return self._of_each_disk([group.mass for group in self.listed or self.species])

    def _of_each_disk(self, values: list[float]) -> np.ndarray:
        """Return the values of listed disks or species for each disk (N,), read-only."""
        counts = [group.count for group in self.listed or self.species]
        repeated = np.repeat(np.array(values, float), np.array(counts, int))
        repeated.flags.writeable = False
        return repeated

    @cached_property
    def packing_fraction(self) -> float:
        """The share of the box that the disks cover, phi = sum(pi R^2)/A."""
        square = (self.radius / self.box.width) * (self.radius / self.box.height)
        return math.pi * float(np.sum(square))

    @property
    def label(self) -> str:
        """Name and number of disks: the scene's label in a trade-off."""
        return f"{self.name}_N{self.particles}"

    @cached_property
    def times(self) -> np.ndarray:
        """Sample times (T,) [time] from 0 to the duration, both exactly, read-only: multiples of
        the interval, or logarithmic, 0, first * 10**(k / per_decade) for k = 0, 1, ..., and the
        duration.
        """
        samples = self.samples
        if samples is None:
            steps = math.ceil(self.duration / self.sample_interval - SAME)
            times = multiples(self.sample_interval, steps)
        else:
            decades = math.log10(self.duration) - math.log10(samples.first)
            steps = math.ceil(samples.per_decade * decades - SAME)
            times = np.append(0.0, logarithmic(samples.first, samples.per_decade, steps))
        times = np.append(times, self.duration)
        times.flags.writeable = False
        return times

    def replace(self, name: str | None = None, **keys: object) -> "Scene":
        """Return a scene with other values of some keys, which may be paths like disks.tracer.mass,
        or another name.
        """
        return parse_scene(
            reading.with_values(self.given, reading.plain(keys)), "", name=name or self.name
        )

    def save(self, path: str | Path) -> None:
        """Write the keys that were given to a scene file (YAML), of which `read_scene` makes an
        equal scene; its name is that of the file.

        path: must end in .yaml or .yml. Raises RequestError, also for a file that is there and has
        other contents.

            scene.save("heavy_disk.yaml")
        """
        file: Path = reading.validated(Path, path, key="path")
        if file.suffix not in (".yaml", ".yml"):
            raise RequestError(f"path: {file}: must end in .yaml or .yml")
        reading.validated(SceneName, file.stem, key="path")
        reading.write_yaml(file, reading.plain(self.given))

    def as_mapping(self) -> dict:
        """Return the scene as a mapping like that of a scene file, with every default written
        out.
        """
        left_out = {"samples" if self.samples is None else "sample_interval"}
        if not self.placement:
            left_out |= {"particles", "velocities", "equilibrate"}
        return self.model_dump(exclude=left_out)

    @cached_property
    def text(self) -> str:
        """The physics as canonical JSON: `parse_scene(json.loads(scene.text), ...)` gives an equal
        scene.
        """
        return json.dumps(self.as_mapping(), sort_keys=True, allow_nan=False)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the text, whatever the name of the scene.

        It covers the canonical scene as it is stored, names of species included, as they are in the
        results, and species of which there are no disks. Another way to write the same (defaults,
        `rest`) has the same digest.
        """
        return hashlib.sha256(self.text.encode()).hexdigest()


def read_scene(path: str | Path, particles: int | None = None) -> Scene:
    """Return the scene of a YAML file, with `particles` disks in total if that is given.

    Raises RequestError, one line, for anything wrong with the file or the scene.
    """
    return parse_scene(reading.read_yaml(path), str(path), particles)


def parse_scene(
    mapping: Any, where: str, particles: int | None = None, name: str | None = None
) -> Scene:
    """Return the scene of a mapping as read from a scene file.

    where: the file that messages name; its stem is the name of the scene, unless `name` is given.
    particles: total number of disks instead of the file's; for an explicit list it must be the
    length of the list.

    Raises RequestError for anything wrong.
    """
    if "scenes" in mapping:
        raise RequestError(
            f"{where}: is a study, not a scene; run it with brownpipe run {shell_path(where)}"
        )
    if particles is not None:
        mapping = reading.with_values(mapping, {"particles": particles})
    scene = reading.validated(Scene, mapping, where)
    if name is None:
        name = Path(where).stem
    scene._name = reading.validated(SceneName, name, where, "name")
    return scene


def _range_if_outside(axis: str, value: float, side: tuple[float, float], margin: float) -> str:
    """Return the range of a coordinate, "1 <= x <= 9", in which a disk is `margin` from the walls;
    nothing if `value` is in it. A margin of 0 stands for a periodic box.
    """
    low, high = side
    slack = ROUND_OFF * margin + 2 * math.ulp(max(-low, high)) if margin else 0.0
    is_inside = low - slack <= value - margin <= value + margin <= high + slack
    if is_inside and (margin or value < high):
        return ""
    return f"{low + margin:.10g} <= {axis} {'<=' if margin else '<'} {high - margin:.10g}"


def overlap(
    position: np.ndarray, radius: np.ndarray, box: tuple | None = None
) -> tuple[int, int, float] | None:
    """Return the two disks that overlap most and the (negative) gap between their edges, None if no
    two overlap.

    position: (N, 2), radius: (N,) [length], N > 0. box: (low, high) of x and of y if it is
    periodic, at least twice the largest diameter, else None. Overlaps within round-off do not
    count.

    Two overlapping disks, the larger one of radius R, are closer than 2 R: a k-d tree finds them.
    """
    from scipy.spatial import KDTree  # takes 0.2 s

    margin = 2 * radius.max()  # of a box around all disks: in it none is near an image of another
    if box is None:
        low = position.min(axis=0) - margin
        high = position.max(axis=0) + margin
    else:
        low, high = np.array(box, float).T
    sides = high - low
    tree = KDTree((position - low) % sides, boxsize=sides)
    near = tree.query_ball_point(tree.data, 2 * radius)
    a = np.repeat(np.arange(len(radius)), [len(neighbours) for neighbours in near])
    b = np.concatenate(near).astype(int)
    apart = position[a] - position[b]
    apart -= sides * np.rint(apart / sides)
    sigma = radius[a] + radius[b]
    gap = np.hypot(*apart.T) - sigma
    round_off = ROUND_OFF * sigma + 2 * np.spacing(np.abs(position).max())
    gap[(a == b) | (gap >= -round_off)] = 0.0
    deepest = int(np.argmin(gap))
    if not gap[deepest] < 0:
        return None
    first, second = sorted((int(a[deepest]), int(b[deepest])))
    return first, second, float(gap[deepest])
