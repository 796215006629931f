"""The scene: box, disks and times of a run, everything that decides its physics but the seed. Frozen and hashable.

Scenes are made by `scene_file` and valid by construction: all numbers are finite, radii and masses positive; listed
disks lie inside the box and do not overlap, and no species has more disks than can fit.
"""

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache

import numpy as np

from brownpipe.scene import sample_times
from brownpipe.scene.sample_times import Samples


@dataclass(frozen=True)
class Box:
    """A rectangle [length]. Reflecting walls are hard and touch a disk at its edge."""

    x: tuple[float, float]
    y: tuple[float, float]
    boundary: str  # "reflecting" or "periodic"

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


@dataclass(frozen=True)
class Species:
    """Equal disks, which `engines.initial_state.draw` places."""

    name: str
    count: int
    radius: float
    mass: float
    position: tuple[float, float] | None = None  # of the tracer; None: it is placed like the other disks


@dataclass(frozen=True)
class Disk:
    """A disk of an explicit list, with its initial position [length] and velocity [length/time]."""

    position: tuple[float, float]
    velocity: tuple[float, float]
    radius: float
    mass: float


@dataclass(frozen=True)
class Velocities:
    """Normal distribution of the initial velocity components: one of the two widths is given.

    Theory relies on it, wherever `scene.velocities` is read.
    """

    standard_deviation: float | None  # the same for all disks [length/time]
    temperature: float | None  # kT [energy]; the variance is kT/m
    zero_momentum: bool = False  # whether velocities are taken relative to the centre of mass


@dataclass(frozen=True)
class Scene:
    """The physics of one run. Disk 0 is the tracer."""

    name: str
    box: Box
    species: tuple[Species, ...]  # the tracer, if any, first; () for explicit disks
    disks: tuple[Disk, ...]  # () for species
    placement: str  # "random" or "lattice"
    velocities: Velocities | None  # None for explicit disks
    duration: float  # [time]
    sample_interval: float  # [time]
    equilibrate: float = 0.0  # simulated before t = 0 [time]
    tracer_while_equilibrating: str = "free"  # or "pinned"
    samples: Samples | None = None  # logarithmic sample times, which replace the sample interval

    def __repr__(self) -> str:
        box = f"{self.box.boundary} box {self.box.width:g} x {self.box.height:g}"
        packing = f"packing fraction {self.packing_fraction:.4g}"
        return f"<Scene {self.name}: {self.particles} disks in a {box}, {packing}, duration {self.duration:g}>"

    @cached_property
    def particles(self) -> int:
        """The number of disks, N."""
        return len(self.disks) + sum(species.count for species in self.species)

    @property
    def radius(self) -> np.ndarray:
        """Radii (N,) [length], read-only."""
        return _of_each_disk(self.disks or self.species, "radius")

    @property
    def mass(self) -> np.ndarray:
        """Masses (N,), read-only."""
        return _of_each_disk(self.disks or self.species, "mass")

    @property
    def packing_fraction(self) -> float:
        """Packing fraction, phi = sum(pi R^2)/A."""
        return float(math.pi * np.sum((self.radius / self.box.width) * (self.radius / self.box.height)))

    @property
    def times(self) -> np.ndarray:
        """Sample times (T,) [time] from 0 to the duration, both exactly, read-only.

        Multiples of the interval, or logarithmic.
        """
        return _times(self.samples, self.sample_interval, self.duration)

    @property
    def text(self) -> str:
        """The physics as canonical JSON: `parse_scene(json.loads(scene.text), ...)` gives an equal scene."""
        return json.dumps(as_mapping(self), sort_keys=True, allow_nan=False)

    @property
    def digest(self) -> str:
        """SHA-256 of the text: equal for equal physics, whatever the scene's name."""
        return hashlib.sha256(self.text.encode()).hexdigest()


# Arrays of the last scene are kept, as each of its runs reads them.
@lru_cache(maxsize=2)
def _of_each_disk(records: tuple[Disk, ...] | tuple[Species, ...], field: str) -> np.ndarray:
    """Return a field of the listed disks or of the species, repeated for each of their disks, (N,)."""
    counts = np.array([getattr(record, "count", 1) for record in records], dtype=int)
    return _read_only(np.repeat(np.array([getattr(record, field) for record in records], dtype=float), counts))


@lru_cache(maxsize=1)
def _times(samples: Samples | None, interval: float, duration: float) -> np.ndarray:
    """Return the sample times of a scene."""
    if samples is not None:
        return _read_only(sample_times.logarithmic_times(samples, duration))
    return _read_only(sample_times.linear_times(interval, duration))


def _read_only(values: np.ndarray) -> np.ndarray:
    """Return an array, from now on read-only."""
    values.flags.writeable = False
    return values


def as_mapping(scene: Scene) -> dict:
    """Return the scene as a mapping like that of a scene file, with every default written out."""
    common = {"box": asdict(scene.box), "duration": scene.duration}
    if scene.samples is None:
        common["sample_interval"] = scene.sample_interval
    else:  # other scenes do not have the key, so that their digests stay those of earlier versions
        common["samples"] = asdict(scene.samples)
    if scene.velocities is None:
        return common | {"disks": [asdict(disk) for disk in scene.disks]}
    disks: dict = {"tracer": None, "species": [], "placement": scene.placement}
    for species in scene.species:
        size = {"radius": species.radius, "mass": species.mass}
        if species.name == "tracer":
            disks["tracer"] = size | {"position": species.position}
        else:
            disks["species"].append({"name": species.name, "count": species.count} | size)
    return common | {
        "particles": scene.particles,
        "disks": disks,
        "velocities": asdict(scene.velocities),  # a new field must be left out at its default: it changes all digests
        "equilibrate": {"time": scene.equilibrate, "tracer": scene.tracer_while_equilibrating},
    }
