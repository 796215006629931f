"""The scene: box, disks and times of a run, everything that decides its physics but the seed.
Frozen and hashable.

Its fields are the keys of scene files, with their bounds. A scene is valid by construction: disks
whose positions are given lie inside the box and do not overlap, and species cover no more of it
than hexagonal packing does.
"""

import hashlib
import json
import math
from collections.abc import Collection, Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, NoReturn

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator
from pydantic.main import IncEx

from brownpipe.errors import RequestError
from brownpipe.scene import reading
from brownpipe.scene.configuration import TRACER, Configuration, csv_text, encoded
from brownpipe.scene.disks import changed_disks, first_outside, listed_disks
from brownpipe.scene.overlaps import Overlaps, crowd, overlaps
from brownpipe.scene.reading import Count, Positive, Resolved, Section, YamlValue, key, refuse
from brownpipe.scene.sections import (
    REST,
    Before,
    Box,
    Disk,
    Disks,
    GivenDisks,
    Group,
    Mixture,
    Samples,
    Species,
    Tracer,
    Velocities,
)
from brownpipe.scene.times import decimal_of, logarithmic, multiples
from brownpipe.text import shell_path
from brownpipe.theory import HEXAGONAL_PACKING, most_points

MOST_SAMPLES = 10_000_000
SAME = 1e-6  # in steps: a sample time this close to the duration is the duration
SAME_PLACE = 0.9  # contact distances: an overlap that no rounding makes
# with it, products of masses and squared speeds neither overflow nor underflow
LARGEST_MASS_RATIO = 1e200
# in units of the longer side of the box: round-off of a position is then 1e-6 of the radius
SMALLEST_RADIUS = 1e-10

# The name of a scene with varied keys (`variation`) has their values: `fluid,tracer_mass=10`.
SceneName = Annotated[str, Field(pattern=rf"^{reading.NAME.pattern}(,[\w-]+=[\w.-]{{1,64}})*$")]


class Scene(Section):
    """The physics of one run. Disk 0 is the tracer."""

    box: Box = key("the rectangle, and what happens at its sides")
    disks: Disks = key(
        "species, whose disks are placed by the program, a list of disks, or a file with them"
    )
    duration: Positive = key("a run goes from t = 0 to t = duration [time]")
    particles: Resolved[Count] = key(
        "total number of disks, tracer included (default: sum of the counts)", None
    )
    velocities: Velocities | None = key(
        "initial velocities; must be given unless the disks have theirs", None
    )
    sample_interval: Resolved[Positive] = key(
        "sample times: its multiples and the duration [time]", None
    )
    samples: Samples | None = key("logarithmic sample times, in place of `sample_interval`", None)
    equilibrate: Before = key(
        "simulated time before t = 0 [time], or a mapping with it", 0.0, validate_default=True
    )
    _given: dict[str, YamlValue] = PrivateAttr()
    _name: str = PrivateAttr()
    _configuration: Configuration | None = PrivateAttr(None)
    _overlaps: Overlaps | None = PrivateAttr(None)

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
            self._resolve_numbers(self.species)
        else:
            self._configuration = self._resolved_configuration(self.disks)
            self._resolve_number_of_given(len(self._configuration.radius))
        self._check_masses()
        self._resolve_start()
        if info.context is None:
            self._check_places()
            self._check_room_between_walls()
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

    def _resolved_configuration(self, disks: tuple[Disk, ...] | GivenDisks) -> Configuration:
        """Return the disks whose positions are given, with the keys that replace those of a file.

        They have no velocities if the scene draws them.
        """
        if isinstance(disks, GivenDisks):
            configuration = changed_disks(disks, has_velocities=self.velocities is None)
        else:
            configuration = listed_disks(disks, has_velocities=self.velocities is None)
        names = configuration.names
        several = np.count_nonzero(configuration.species_index == 0) > 1
        if TRACER in names[1:] or (names[:1] == (TRACER,) and several):
            refuse(f"must have no disk but the first of the species {TRACER}", "disks")
        if self.velocities is not None:
            return configuration._replace(velocity=None)
        return configuration

    def _resolve_number_of_given(self, number: int) -> None:
        """Refuse another number of disks than are given."""
        if "particles" in self.model_fields_set and self.particles != number:
            problem = f"must be {number}, the number of disks in `disks`, not {self.particles}"
            refuse(problem, "particles")
        self._resolve(particles=number)

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
        if self.placement and velocities is None:
            refuse(
                "missing; must be given with species: {temperature: kT} or "
                "{standard_deviation: speed}",
                "velocities",
            )
        if "tracer" not in start.model_fields_set or start.time == 0:
            start._resolve(tracer="pinned" if self.has_tracer else "free")
        elif start.tracer == "pinned" and not self.has_tracer:
            refuse("must be free, as there is no tracer", "equilibrate", "tracer")
        if start.time > 0 and start.tracer == "free" and self.tracer_velocity is not None:
            refuse("must be pinned, as its velocity at t = 0 is given", "equilibrate", "tracer")
        if velocities is not None:
            self._resolve_velocities(velocities)

    def _resolve_velocities(self, velocities: Velocities) -> None:
        """Resolve the total momentum, and refuse distributions without a width, or with two."""
        if (velocities.standard_deviation is None) == (velocities.temperature is None):
            refuse("must have either standard_deviation or temperature", "velocities")
        if velocities.distribution == "uniform" and velocities.standard_deviation is None:
            problem = "must be normal with a temperature; uniform needs standard_deviation"
            refuse(problem, "velocities", "distribution")
        if "zero_momentum" not in velocities.model_fields_set:
            # Periodic disks drift as a whole; a single one would stand still.
            velocities._resolve(zero_momentum=self.box.has_images and self.particles != 1)
        if velocities.zero_momentum and self.tracer_velocity is not None and self.particles == 1:
            problem = "must be false, as the only disk has a velocity of its own"
            refuse(problem, "velocities", "zero_momentum")

    def _check_packing(self) -> None:
        """Refuse given disks that overlap and species that cannot fit; those accepted may still be
        hard to place.
        """
        if self.configuration is not None:
            self._check_overlaps(self.configuration)
            return
        if self.packing_fraction > HEXAGONAL_PACKING * (1 + 1e-9):
            cover = (
                f"{self.particles} disks cover {self.packing_fraction:.4g} times the area of the "
                "box"
            )
            refuse(f"{cover}; must be at most {HEXAGONAL_PACKING:.4g} (hexagonal packing)", "disks")
        for radius in dict.fromkeys(group.radius for group in self.species):
            self._check_disks_fit(radius)

    def _check_disks_fit(self, radius: float) -> None:
        """Refuse more disks of a radius or larger than fit into the box if all had this radius, by
        an upper bound.
        """
        number = sum(group.count for group in self.species if group.radius >= radius)
        _, size = self.box.accessible(radius)
        most = math.floor(most_points(size, 2 * radius, self.box.periodic_axes) * (1 + 1e-9))
        if number > most:
            disks = f"{number} disks of radius {radius:g} or larger"
            refuse(
                f"{disks}; must be at most {most} in this {self.box.with_size_in_words}", "disks"
            )

    def _check_overlaps(self, configuration: Configuration) -> None:
        """Refuse disks that overlap by more than the scene pushes apart."""
        if not len(configuration.radius):
            return
        sides = self.box.periodic_sides
        crowded = crowd(configuration.position, configuration.radius, sides)
        if crowded is not None:
            k = crowded.disk
            place = f"disk {k} at {configuration.position[k].tolist()}"
            diameter = 2 * configuration.radius[k]
            near = f"{crowded.neighbours} disks closer than its diameter, {diameter:g}"
            refuse(
                f"{place} has {near}; must not overlap, with radii in units of positions", "disks"
            )
        self._overlaps = overlaps(configuration.position, configuration.radius, sides)
        if self._overlaps is None:
            return
        overlap = self._overlaps
        if overlap.depth <= self.push_apart:
            return
        deepest = (overlap.first, overlap.second)
        pair = " and ".join(f"disk {k} at {configuration.position[k].tolist()}" for k in deepest)
        problem = f"{pair} overlap: the gap between their edges is {overlap.gap:.6g}; must be >= 0"
        if overlap.number > 1:
            problem += f"; {overlap.number} pairs overlap, these two most"
        if overlap.depth > SAME_PLACE:
            problem += "; is a disk given twice?"
        elif isinstance(self.disks, GivenDisks):
            problem += f"; push_apart: {_rounded_up(overlap.depth):g} would push all apart"
        refuse(problem, "disks")

    def _check_places(self) -> None:
        """Refuse radii that do not fit into the box, and centres outside it or in a wall."""
        if self.configuration is not None:
            self._check_given_places(self.configuration)
        elif isinstance(self.disks, Mixture):
            if self.disks.tracer is not None:
                self._check_tracer(self.disks.tracer)
            for k, species in enumerate(self.disks.species):
                self._check_radius(species.radius, "disks", "species", k, "radius")

    def _check_tracer(self, tracer: Tracer) -> None:
        self._check_radius(tracer.radius, "disks", "tracer", "radius")
        if tracer.position is None:
            return
        outside = first_outside(self.box, np.array([tracer.position]), np.array([tracer.radius]))
        if outside is not None:
            refuse(outside.problem, "disks", "tracer", "position")

    def _check_given_places(self, configuration: Configuration) -> None:
        """Refuse given disks that are too small or too large for the box, or outside it."""
        if not len(configuration.radius):
            return
        smallest = int(configuration.radius.argmin())
        largest = int(configuration.radius.argmax())
        for k in (smallest, largest):
            self._check_radius(float(configuration.radius[k]), "disks", k, "radius")
        slack = 2 * self.push_apart * configuration.radius
        outside = first_outside(self.box, configuration.position, configuration.radius, slack)
        if outside is not None:
            refuse(outside.problem, "disks", outside.disk, "position")

    def _check_radius(self, radius: float, *path: str | int) -> None:
        """Refuse a radius that does not fit, or vanishes in round-off.

        Between periodic sides less than four radii apart a disk could touch two images of one
        neighbour.
        """
        box = self.box
        smallest = SMALLEST_RADIUS * max(box.width, box.height)
        largest = float(np.min(box.size / np.where(box.periodic_axes, 4, 2)))
        if not smallest <= radius <= largest:
            allowed = f"{smallest:g} to {largest!r} in this {box.in_words}"
            refuse(f"must be {allowed}, not {radius!r}", *path)

    def _check_room_between_walls(self) -> None:
        """Refuse disks that touch two opposite walls and move from one to the other: they would
        collide with both for ever, at one time. Along the walls they may move, as hard rods do.
        """
        if not self.box.is_filled_by(self.radius.max(initial=0.0)).any():
            return
        is_filled = self.box.is_filled_by(self.radius[:, None])
        stuck = np.argwhere(is_filled & self._has_velocity_along_axes())
        if not len(stuck):
            return
        disk, axis = stuck[0].tolist()
        name = "xy"[axis]
        refuse(
            f"must be below {self.box.size[axis] / 2:g} by more than round-off, or the velocity "
            f"along {name} 0, not {float(self.radius[disk])!r}: between walls in {name} that it "
            "touches, a disk would collide for ever",
            *self._path_of_disk(disk),
            "radius",
        )

    def _has_velocity_along_axes(self) -> np.ndarray:
        """Return which components (N, 2) of the velocities at t = 0 are given or drawn, and not
        0.
        """
        is_drawn = self.velocities is not None and self.velocities.draws_motion
        has_velocity = np.full((self.particles, 2), is_drawn)
        if self._configuration is not None and self._configuration.velocity is not None:
            has_velocity = self._configuration.velocity != 0
        if self.tracer_velocity is not None:
            has_velocity[0] |= np.array(self.tracer_velocity) != 0
        return has_velocity

    def _path_of_disk(self, disk: int) -> tuple[str | int, ...]:
        """Return the path of keys to the disk of this number, or to its species."""
        if self._configuration is not None:
            return ("disks", disk)
        last = np.cumsum([group.count for group in self.species])
        k = int(np.searchsorted(last, disk, side="right")) - self.has_tracer
        return ("disks", "tracer") if k < 0 else ("disks", "species", k)

    def __repr__(self) -> str:
        box = self.box.with_size_in_words
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
    def given(self) -> dict[str, YamlValue]:
        """The keys that were given, without what follows from them."""
        return self._given

    @property
    def configuration(self) -> Configuration | None:
        """The disks whose positions the scene gives, with names of their species; None if the
        program places them. Their velocities are None if they are drawn.
        """
        return self._configuration

    @property
    def overlaps(self) -> Overlaps | None:
        """The pairs of given disks that overlap, and are pushed apart before a run; None without
        any.
        """
        return self._overlaps

    @property
    def push_apart(self) -> float:
        """By how much given disks may overlap, and be pushed apart [contact distances]."""
        return self.disks.push_apart if isinstance(self.disks, GivenDisks) else 0.0

    @property
    def has_one_state(self) -> bool:
        """Whether there are disks whose positions and velocities are given, so that nothing is
        drawn, and all runs are the same.
        """
        is_given = self._configuration is not None and self.velocities is None
        return is_given and self.particles > 0

    @cached_property
    def species(self) -> tuple[Tracer | Species, ...]:
        """The tracer, if there is one, and the species that the program places; () where positions
        are given. `scene.species.species_table` has the species of both.
        """
        if not isinstance(self.disks, Mixture):
            return ()
        if self.disks.tracer is None:
            return self.disks.species
        return (self.disks.tracer, *self.disks.species)

    @property
    def has_tracer(self) -> bool:
        """Whether disk 0 is a species of its own, called tracer."""
        if self._configuration is not None:
            return self._configuration.names[:1] == (TRACER,)
        return isinstance(self.disks, Mixture) and self.disks.tracer is not None

    @property
    def tracer_position(self) -> tuple[float, float] | None:
        """The given centre of disk 0 [length]; None if it is placed like the others."""
        if self._configuration is not None:
            places = self._configuration.position
            return (float(places[0, 0]), float(places[0, 1])) if len(places) else None
        if not isinstance(self.disks, Mixture) or self.disks.tracer is None:
            return None
        return self.disks.tracer.position

    @property
    def tracer_velocity(self) -> tuple[float, float] | None:
        """The velocity [length/time] at t = 0 that the scene gives disk 0 while it draws those of
        the others; None if it gives none.
        """
        if self.velocities is None:
            return None
        if isinstance(self.disks, tuple):
            return self.disks[0].velocity if self.disks else None
        return None if self.disks.tracer is None else self.disks.tracer.velocity

    @property
    def placement(self) -> str:
        """How the program places the disks: "auto", "random" or "lattice"; "" where positions are
        given.
        """
        return self.disks.placement if isinstance(self.disks, Mixture) else ""

    @cached_property
    def radius(self) -> np.ndarray:
        """The radius of each disk (N,) [length], read-only."""
        if self._configuration is not None:
            return self._configuration.radius
        return self._of_each_disk([group.radius for group in self.species])

    @cached_property
    def mass(self) -> np.ndarray:
        """The mass of each disk (N,), read-only."""
        if self._configuration is not None:
            return self._configuration.mass
        return self._of_each_disk([group.mass for group in self.species])

    def _of_each_disk(self, values: list[float]) -> np.ndarray:
        """Return the values of species for each disk (N,), read-only."""
        counts = [group.count for group in self.species]
        repeated = np.repeat(np.array(values, float), np.array(counts, int))
        repeated.flags.writeable = False
        return repeated

    @cached_property
    def packing_fraction(self) -> float:
        """The share of the box that the disks cover, phi = sum(pi R^2)/A."""
        square = (self.radius / self.box.width) * (self.radius / self.box.height)
        return math.pi * float(np.sum(square))

    @property
    def title(self) -> str:
        """Name and number of disks, as messages and pictures have them: fluid, N = 150."""
        return f"{self.name}, N = {self.particles}"

    @property
    def label(self) -> str:
        """Name and number of disks, as a trade-off names a scene that stands in for another."""
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
        refuse_other_file(keys)
        return parse_scene(
            reading.with_values(self.given, reading.plain(keys)), "", name=name or self.name
        )

    def save(self, path: str | Path) -> None:
        """Write the keys that were given to a scene file (YAML), of which `read_scene` makes an
        equal scene; its name is that of the file. Disks of a file are in a file beside it,
        NAME_disks.csv.

        path: must end in .yaml or .yml. Raises RequestError, also for a file that is there and has
        other contents.

            scene.save("heavy_disk.yaml")
        """
        file: Path = reading.validated(Path, path, key="path")
        if file.suffix not in (".yaml", ".yml"):
            raise RequestError(f"path: {file}: must end in .yaml or .yml")
        reading.validated(SceneName, file.stem, key="path")
        keys = reading.plain(self.given)
        if isinstance(self.disks, GivenDisks):
            assert self.disks.configuration is not None
            table = file.with_name(f"{file.stem}_disks.csv")
            disks = keys["disks"]
            for key_of_file in ("configuration", "file", "seed", "time"):
                disks.pop(key_of_file, None)
            keys["disks"] = {"file": table.name, **disks}
            reading.refuse_other_text(file, reading.yaml_text(keys))
            reading.write_text(table, csv_text(self.disks.configuration))
        reading.write_yaml(file, keys)

    def as_mapping(self) -> dict[str, YamlValue]:
        """Return the scene as a mapping like that of a scene file, with every default written
        out.
        """
        keys: dict[str, YamlValue] = self.model_dump(exclude=self._excluded_keys())
        if isinstance(self.disks, tuple):
            keys["disks"] = _list_as_mappings(self.disks)
        elif isinstance(self.disks, GivenDisks):
            keys["disks"] = self._given_disks_as_mapping(self.disks)
        return keys

    def _excluded_keys(self) -> dict[str, IncEx | bool]:
        """Return the keys that are no part of the mapping of this scene, as pydantic takes them."""
        keys: dict[str, IncEx | bool] = {}
        keys["samples" if self.samples is None else "sample_interval"] = True
        if self.velocities is None:
            keys["velocities"] = True
        elif self.velocities.distribution == "normal":
            keys["velocities"] = {"distribution"}
        if not isinstance(self.disks, Mixture):
            keys["particles"] = True
            if self.equilibrate.time == 0:
                keys["equilibrate"] = True
        elif self.disks.tracer is not None and self.disks.tracer.velocity is None:
            keys["disks"] = {"tracer": {"velocity"}}
        return keys

    def _given_disks_as_mapping(self, disks: GivenDisks) -> dict[str, YamlValue]:
        """Return disks of a file as they are in the text of the scene: with what was in the file,
        radii and masses of species beside them, and without its name.
        """
        configuration = self._configuration
        assert configuration is not None
        keys: dict[str, YamlValue] = {"configuration": encoded(configuration)}
        if disks.push_apart:
            keys["push_apart"] = disks.push_apart
        species: dict[str, dict[str, YamlValue]] = {}
        for k, name in enumerate(configuration.names):
            members = configuration.species_index == k
            radii = np.unique(configuration.radius[members])
            masses = np.unique(configuration.mass[members])
            species[name] = {}
            if len(radii) == 1:
                species[name]["radius"] = float(radii[0])
            if len(masses) == 1:
                species[name]["mass"] = float(masses[0])
        if self.has_tracer:
            tracer = species.pop(TRACER)
            if self.tracer_velocity is not None:
                tracer["velocity"] = self.tracer_velocity
            keys["tracer"] = tracer
        keys["species"] = species
        return keys

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


def parse_scene(
    mapping: Mapping[str, YamlValue],
    where: str,
    particles: int | None = None,
    name: str | None = None,
) -> Scene:
    """Return the scene of a mapping as read from a scene file.

    where: the file that messages name; its stem is the name of the scene, unless `name` is given.
    particles: total number of disks instead of the file's; where positions are given it must be
    their number.

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


def refuse_other_file(values: Collection[str]) -> None:
    """Refuse another file, seed or time of disks in place of one that was read."""
    for path in ("disks.file", "disks.seed", "disks.time"):
        if path in values:
            raise RequestError(f"{path}: must be in a scene of its own, as the file is read once")


def _list_as_mappings(disks: tuple[Disk, ...]) -> list[dict[str, YamlValue]]:
    """Return a list of disks as it is in the text of the scene."""
    return [reading.without_none(disk.model_dump()) for disk in disks]


def scaled_disks(scene: Scene, factor: float) -> YamlValue:
    """Return the disks of a scene whose positions are given, as in its mapping, with positions
    multiplied by a factor.
    """
    configuration = scene.configuration
    assert configuration is not None
    position = factor * configuration.position
    if isinstance(scene.disks, tuple):
        disks = _list_as_mappings(scene.disks)
        for disk, place in zip(disks, position.tolist(), strict=True):
            disk["position"] = place
        return disks
    assert isinstance(scene.disks, GivenDisks)
    keys = scene._given_disks_as_mapping(scene.disks)
    return {**keys, "configuration": configuration._replace(position=position)}


def disks_without_own_velocity(scene: Scene) -> YamlValue:
    """Return the disks of a scene, as in its mapping, with the velocity of disk 0 to be drawn."""
    if isinstance(scene.disks, tuple):
        disks = _list_as_mappings(scene.disks)
        disks[0].pop("velocity", None)
        return disks
    velocity_to_be_drawn = {"disks.tracer.velocity": None}
    return reading.with_values(scene.as_mapping(), velocity_to_be_drawn)["disks"]


def _rounded_up(value: float) -> float:
    """Return a value rounded up to two digits.

    >>> _rounded_up(3.2614e-6)
    3.3e-06
    """
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / digit) * digit:.3g}")
