"""The scene: what is simulated and nothing else. Frozen, validated, hashable.

A scene is read from a YAML file (`scene_file`) and is right when it exists: all numbers are finite, radii and masses
positive, the disks inside the box and without overlap, or, for species, not more than can fit.
"""

import hashlib
import json
import math
from dataclasses import asdict, dataclass

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
        """The lower left corner, from which the engines measure."""
        return self.x[0], self.y[0]

    @property
    def periodic(self) -> bool:
        return self.boundary == "periodic"


@dataclass(frozen=True)
class Species:
    """Disks of one kind, placed by `state.draw`."""

    name: str
    count: int
    radius: float
    mass: float
    position: tuple[float, float] | None = None  # of the tracer; None is placed like the others


@dataclass(frozen=True)
class Disk:
    """One disk of an explicit list."""

    position: tuple[float, float]
    velocity: tuple[float, float]
    radius: float
    mass: float


@dataclass(frozen=True)
class Velocities:
    """How velocity components are drawn: normal, of a given standard deviation or of variance kT/m."""

    standard_deviation: float | None
    temperature: float | None  # kT [energy]
    zero_momentum: bool = False


@dataclass(frozen=True)
class Scene:
    """The physics of one run. Disk 0 is the disk that is followed."""

    name: str
    box: Box
    species: tuple[Species, ...]  # the tracer, if any, first; () for explicit disks
    disks: tuple[Disk, ...]  # () for species
    placement: str  # "random" or "lattice"
    velocities: Velocities | None  # None for explicit disks
    duration: float
    sample_interval: float
    equilibrate: float = 0.0  # time before t = 0
    tracer_while_equilibrating: str = "free"  # or "pinned"
    samples: Samples | None = None  # logarithmic sample times, in the place of the sample interval

    @property
    def particles(self) -> int:
        """The number of disks, N."""
        return len(self.disks) + sum(species.count for species in self.species)

    @property
    def radius(self) -> np.ndarray:
        """(N,) radii [length]."""
        return self._of_each_disk("radius")

    @property
    def mass(self) -> np.ndarray:
        """(N,) masses."""
        return self._of_each_disk("mass")

    @property
    def packing_fraction(self) -> float:
        """phi = sum(pi R^2)/A."""
        return float(math.pi * np.sum((self.radius / self.box.width) * (self.radius / self.box.height)))

    @property
    def times(self) -> np.ndarray:
        """(T,) sample times: 0, the multiples of the sample interval, and the duration exactly.

        Logarithmic ones: 0, first * 10**(k / per_decade) for k = 0, 1, ... below the duration, and the duration.
        """
        if self.samples is not None:
            return sample_times.logarithmic_times(self.samples, self.duration)
        return sample_times.linear_times(self.sample_interval, self.duration)

    @property
    def text(self) -> str:
        """The physics as canonical JSON: `parse_scene(json.loads(scene.text), ...)` gives an equal scene."""
        return json.dumps(_as_mapping(self), sort_keys=True, allow_nan=False)

    @property
    def digest(self) -> str:
        """SHA-256 of the text: equal for equal physics, whatever the name."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def _of_each_disk(self, what: str) -> np.ndarray:
        kinds = self.disks or self.species
        counts = np.array([getattr(kind, "count", 1) for kind in kinds], dtype=int)
        return np.repeat(np.array([getattr(kind, what) for kind in kinds], dtype=float), counts)


def _as_mapping(scene: Scene) -> dict:
    """Return what a scene file that leaves nothing to defaults would hold."""
    common = {"box": asdict(scene.box), "duration": scene.duration}
    if scene.samples is None:
        common["sample_interval"] = scene.sample_interval
    else:  # not even named in other scenes, so that their digests are what they were
        common["samples"] = asdict(scene.samples)
    if scene.velocities is None:
        return common | {"disks": [asdict(disk) for disk in scene.disks]}
    disks = {"tracer": None, "species": [], "placement": scene.placement}
    for one in scene.species:
        if one.name == "tracer":
            disks["tracer"] = {"radius": one.radius, "mass": one.mass, "position": one.position}
        else:
            disks["species"].append({"name": one.name, "count": one.count, "radius": one.radius, "mass": one.mass})
    return common | {
        "particles": scene.particles,
        "disks": disks,
        "velocities": asdict(scene.velocities),
        "equilibrate": {"time": scene.equilibrate, "tracer": scene.tracer_while_equilibrating},
    }
