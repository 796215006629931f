"""The sections of a scene: the box, the disks and how they move at first, sample times, and what is
simulated before t = 0.

Their fields are the keys of scene files, with their bounds. What contradicts another section is
refused by the scene.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, StrictBool, Tag, model_validator

from brownpipe.scene.configuration import TRACER, ConfigurationKey
from brownpipe.scene.overlaps import ROUND_OFF, PeriodicSides
from brownpipe.scene.reading import (
    As,
    AtLeastOne,
    Count,
    Name,
    NotNegative,
    Number,
    Pair,
    Positive,
    Resolved,
    Section,
    SeedNumber,
    alone,
    key,
    refuse,
)

# side of a box; the shortest is 1/LONGEST: squared displacements of 1e-14 of it do not underflow
LONGEST = 1e140
# relative difference of the sides between walls from which on the motion along each is told apart
UNEQUAL = 0.02
REST = "rest"  # the count of a species that fills up the particles of a scene


Boundary = Literal["reflecting", "periodic"]
WORD = "one word"
BY_AXIS = "word for each axis"


class BoundaryByAxis(Section):
    """What happens at the sides left and right (x), and at those below and above (y)."""

    x: Boundary = key("hard walls, hit by a disk's edge, or periodic")
    y: Boundary = key("hard walls, hit by a disk's edge, or periodic")


def _form_of_boundary(value: object) -> str | None:
    """Return which of the two forms of `boundary` a value has; None if neither."""
    if isinstance(value, Mapping | BoundaryByAxis):
        return BY_AXIS
    return WORD if isinstance(value, str) else None


BoundaryKey = Annotated[
    Annotated[Boundary, Tag(WORD)] | Annotated[BoundaryByAxis, Tag(BY_AXIS)],
    Discriminator(
        _form_of_boundary,
        custom_error_type="form_of_boundary",
        custom_error_message="must be 'reflecting', 'periodic', or one of them for each of x and y",
    ),
]


class Box(Section):
    """A rectangle [length]. Reflecting walls are hard and touch a disk at its edge."""

    x: Pair = key("its sides, [low, high] [length]")
    y: Pair = key("its sides, [low, high] [length]")
    boundary: BoundaryKey = key(
        "hard walls, hit by a disk's edge, or periodic; in a channel {x: periodic, y: reflecting}",
        "reflecting",
    )

    @model_validator(mode="after")
    def _check(self) -> "Box":
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 / LONGEST <= high - low <= LONGEST:
                allowed = f"[low, high] with low < high, {1 / LONGEST:g} to {LONGEST:g} long"
                refuse(f"must be {allowed}, not {[low, high]}", name)
        by_axis = self.boundary
        if isinstance(by_axis, BoundaryByAxis) and by_axis.x == by_axis.y:
            self._resolve(boundary=by_axis.x)
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

    @property
    def size(self) -> np.ndarray:
        """Width and height (2,) [length]."""
        return np.array((self.width, self.height))

    @cached_property
    def periodic_x(self) -> bool:
        """Whether the sides left and right are periodic, not walls."""
        by_axis = self.boundary
        return (by_axis.x if isinstance(by_axis, BoundaryByAxis) else by_axis) == "periodic"

    @cached_property
    def periodic_y(self) -> bool:
        """Whether the sides below and above are periodic, not walls."""
        by_axis = self.boundary
        return (by_axis.y if isinstance(by_axis, BoundaryByAxis) else by_axis) == "periodic"

    @property
    def periodic_axes(self) -> np.ndarray:
        """Whether x and y (2,) are periodic.

        >>> channel = {"x": "periodic", "y": "reflecting"}
        >>> Box(x=[0, 9], y=[0, 2], boundary=channel).periodic_axes
        array([ True, False])
        """
        return np.array((self.periodic_x, self.periodic_y))

    @property
    def has_walls(self) -> bool:
        """Whether some sides are walls."""
        return not (self.periodic_x and self.periodic_y)

    @property
    def has_images(self) -> bool:
        """Whether some sides are periodic."""
        return self.periodic_x or self.periodic_y

    @property
    def is_channel(self) -> bool:
        """Whether one axis is periodic, with walls along it."""
        return self.periodic_x != self.periodic_y

    @property
    def axes_differ(self) -> bool:
        """Whether walls make the motion along x and y differ: in a channel, and in a box of walls
        whose sides differ.

        >>> Box(x=[0, 9], y=[0, 2]).axes_differ, Box(x=[0, 9], y=[0, 9]).axes_differ
        (True, False)
        """
        longer = max(self.width, self.height)
        is_oblong = abs(self.width - self.height) > UNEQUAL * longer
        return self.is_channel or (is_oblong and not self.has_images)

    @property
    def axes_of_diffusion(self) -> tuple[int, ...]:
        """Along which of x (0) and y (1) D is stated: in a channel along it, in a box of walls with
        unequal sides along both; () where it is that of all motion.

        >>> Box(x=[0, 9], y=[0, 2]).axes_of_diffusion, Box(x=[0, 9], y=[0, 9]).axes_of_diffusion
        ((0, 1), ())
        """
        if not self.axes_differ:
            return ()
        return tuple(axis for axis in (0, 1) if self.periodic_axes[axis] or not self.is_channel)

    @property
    def in_words(self) -> str:
        """The kind of box, as messages have it.

        >>> Box(x=[0, 9], y=[0, 2], boundary={"x": "periodic", "y": "reflecting"}).in_words
        'channel along x'
        """
        if isinstance(self.boundary, str):
            return f"{self.boundary} box"
        return f"channel{self.along}"

    @property
    def along(self) -> str:
        """Along which axis a channel is periodic, for sentences on it: ' along x'; '' for boxes."""
        if not self.is_channel:
            return ""
        return " along x" if self.periodic_x else " along y"

    @property
    def with_size_in_words(self) -> str:
        """The kind of box and its size.

        >>> Box(x=[0, 9], y=[0, 2]).with_size_in_words
        'reflecting box 9 x 2'
        >>> channel = {"x": "periodic", "y": "reflecting"}
        >>> Box(x=[0, 9], y=[0, 2], boundary=channel).with_size_in_words
        'channel along x, 9 x 2'
        """
        size = f"{self.width:g} x {self.height:g}"
        return f"{self.in_words}, {size}" if self.is_channel else f"{self.in_words} {size}"

    @property
    def sides_in_words(self) -> str:
        """What is at its sides, as pictures of it say."""
        if not self.is_channel:
            return "periodic" if self.has_images else "hard walls"
        return (
            "periodic in x, hard walls in y"
            if self.periodic_x
            else "periodic in y, hard walls in x"
        )

    @property
    def periodic_sides(self) -> PeriodicSides:
        """(low, high) of x and of y where they are periodic, None where they are walls."""
        return self.x if self.periodic_x else None, self.y if self.periodic_y else None

    def margins(self, radius: float | np.ndarray) -> np.ndarray:
        """Return how far the centre of a disk must be from the sides in x and y (2,) [length]: its
        radius from walls, 0 from periodic sides; (n, 2) for radii (n, 1).
        """
        return np.where(self.periodic_axes, 0.0, radius)

    def accessible(self, radius: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return lower corner (2,) and size (2,) [length] of the rectangle accessible to the centre
        of a disk; (n, 2) for radii (n, 1).

        It is smaller than the box by the radius at each wall.
        """
        margin = self.margins(radius)
        return np.array(self.origin) + margin, self.size - 2 * margin

    def is_filled_by(self, radius: float | np.ndarray) -> np.ndarray:
        """Return along which of x and y (2,) a disk touches both walls, to round-off; (n, 2) for
        radii (n, 1).

        >>> channel = {"x": "periodic", "y": "reflecting"}
        >>> Box(x=[0, 9], y=[0, 2], boundary=channel).is_filled_by(1.0)
        array([False,  True])
        """
        room = self.size - 2 * radius
        farthest = np.abs((self.x, self.y)).max(axis=1)
        round_off = ROUND_OFF * np.maximum(farthest, 2 * radius)
        return ~self.periodic_axes & (room <= round_off)

    def nearest_image(self, apart: np.ndarray) -> np.ndarray:
        """Return vectors (..., 2) between disks, each to the nearest periodic image."""
        return apart - self.size * np.where(self.periodic_axes, np.rint(apart / self.size), 0.0)


class Disk(Section):
    """A disk of a list."""

    position: Pair = key("initial centre, [x, y] [length]")
    velocity: Pair | None = key(
        "[x, y] [length/time]; without it the velocities of all disks are drawn", None
    )
    radius: Positive = key("[length]")
    mass: Positive = key("[mass]")
    species: Name | None = key(
        "name of its species; without it disks of one radius and mass are one", None
    )
    count: ClassVar[int] = 1


class Tracer(Section):
    """Disk 0, whose motion is recorded and analysed. It is a species of its own."""

    radius: Positive = key("[length]")
    mass: Positive = key("[mass]")
    position: Pair | None = key(
        "its initial centre [length]; by default it is placed like the others", None
    )
    velocity: Pair | None = key(
        "[x, y] at t = 0 [length/time]; by default it is drawn like the others", None
    )
    name: ClassVar[str] = TRACER
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


class DiskChanges(Section):
    """Keys of disks of a configuration that replace what is in it."""

    radius: Positive | None = key("[length]", None)
    mass: Positive | None = key("[mass]", None)


class TracerChanges(DiskChanges):
    """Keys of disk 0 that replace what is in the configuration. It is then a species of its own."""

    position: Pair | None = key("its initial centre, [x, y] [length]", None)
    velocity: Pair | None = key("[x, y] at t = 0 [length/time]", None)


class GivenDisks(Section):
    """Disks of a file, or of a program, the tracer first."""

    file: Annotated[str, Field(min_length=1)] | None = key(
        "CSV, extended XYZ, GSD or runs of brownpipe (.h5), relative to the scene file", None
    )
    seed: SeedNumber | None = key(
        "of the run in a file of runs (default: the first whole one)", None
    )
    time: Number | None = key("of the sample in a file [time] (default: the last)", None)
    configuration: ConfigurationKey | None = key("the disks themselves, in place of a file", None)
    push_apart: NotNegative = key(
        "disks that overlap by no more than this are pushed apart [contact distances]", 0.0
    )
    tracer: TracerChanges | None = key("keys of disk 0 that are replaced", None)
    species: dict[Name, DiskChanges] = key(
        "keys of the disks of a species that are replaced, by its name", {}
    )


PLACED = "disks that are placed"
LISTED = "list of disks"
GIVEN = "disks of a file"


def _kind_of_disks(value: object) -> str:
    """Return which of the three forms of `disks` a value has."""
    if isinstance(value, GivenDisks):
        return GIVEN
    if isinstance(value, Mixture):
        return PLACED
    if not isinstance(value, Mapping):
        return LISTED
    return GIVEN if {"file", "configuration"} & {*value} else PLACED


Disks = Annotated[
    Annotated[Mixture, Tag(PLACED)]
    | Annotated[tuple[Disk, ...], Tag(LISTED)]
    | Annotated[GivenDisks, Tag(GIVEN)],
    Discriminator(_kind_of_disks),
]
Group = Tracer | Species  # equal disks, `count` of them


class Velocities(Section):
    """Distribution of the initial velocity components: one of the two widths is given."""

    # Theory that reads `scene.velocities` relies on this distribution.
    standard_deviation: NotNegative | None = key(
        "of every velocity component of every disk [length/time]", None
    )
    temperature: NotNegative | None = key(
        "kT: velocity components have variance kT/m [energy]", None
    )
    distribution: Literal["normal", "uniform"] = key(
        "of the components; uniform between -sqrt(3) and sqrt(3) standard deviations, before the "
        "total momentum is subtracted",
        "normal",
    )
    zero_momentum: Resolved[StrictBool] = key(
        "subtract the velocity of the centre of mass (default: of several disks in a periodic box "
        "or a channel); in a channel along its periodic axis alone",
        None,
    )

    @property
    def draws_motion(self) -> bool:
        """Whether drawn velocities are not all zero."""
        return bool(self.temperature or self.standard_deviation)


class Samples(Section):
    """Logarithmic sample times: 0, first * 10^(k/per_decade) for k = 0, 1, ..., and the
    duration.
    """

    per_decade: Annotated[AtLeastOne, Field(le=10_000)] = key(
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
