"""What walls do to the rates of collisions: the room that they take, and narrow channels.

For N disks of diameter sigma, whose centres lie in a rectangle of sides h_x and h_y, the free
energy per disk beyond that of an ideal gas is taken to be a function of one number,
b = N e/(2 h_x h_y), with the mean area e in which a disk excludes the centre of another. It is that
of the fluid in the plane, where b = 2 phi; if the rectangle is narrower than sigma, so that disks
cannot pass each other, that of hard rods (L. Tonks, Phys. Rev. 50, 955 (1936)). Along a periodic
axis the rectangle is as long as the box, and excludes as a strip without ends does. The rate of
collisions between disks and the density at each wall are its derivatives by sigma and by the sides.
In channels 1.05 to 10 diameters wide it gives 0.7 to 1.2 times the collisions of simulations.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe import theory
from brownpipe.engines.friction import DENSEST
from brownpipe.scene import Scene

RADII = 100  # of the integration over an excluded disk
STEP = 1e-3  # relative, of a difference quotient
CLOSEST = 1e-6  # of disks in a row: the share of its length that they leave free, at least


class Confinement(NamedTuple):
    """Rates of collisions between walls, relative to those that bulk theory gives."""

    pairs: float  # the factor of the rate between disks
    walls: np.ndarray  # (2,) density of centres at the walls in x and y, relative to the mean


def confinement(scene: Scene) -> Confinement:
    """Return the factors of the rates in a box with walls, for disks of the mean radius."""
    sigma = 2 * float(np.mean(scene.radius))
    between_walls = np.maximum(scene.box.size - sigma, theory.SMALLEST_GAP * sigma)
    sides = np.where(scene.box.periodic_axes, np.inf, between_walls)
    phi = min(scene.packing_fraction, DENSEST)
    accessible = np.where(scene.box.periodic_axes, scene.box.size, between_walls)
    room = scene.box.area / np.prod(accessible)
    crowding = 2 * phi * room * excluded_share(sigma, sides)
    narrow = sides.min() < sigma
    contact = _contact_value_between_walls(crowding, narrow)
    bulk_contact = float(theory.contact_value(phi))
    pairs = room * np.prod(open_arc(sigma / sides)) * contact / bulk_contact

    crowding_by_others = crowding * (1 - 1 / scene.particles)
    excess = crowding_by_others * _contact_value_between_walls(crowding_by_others, narrow)
    return Confinement(float(pairs), 1 + excess * _wall_shares(sigma, sides))


def _contact_value_between_walls(crowding: float, narrow: bool) -> float:
    """Return the derivative of the excess free energy [kT] by b: 1 for few disks."""
    if narrow:
        return 1 / max(1 - crowding, CLOSEST)
    return float(theory.contact_value(min(crowding / 2, DENSEST)))


def _wall_shares(sigma: float, sides: np.ndarray) -> np.ndarray:
    """Return -d ln b/d ln h (2,) for both sides: 1 if they are long, 0 across a narrow channel;
    infinite sides are periodic.
    """
    shares = []
    for axis in (0, 1):
        longer = sides.copy()
        longer[axis] *= 1 + STEP
        grown = excluded_share(sigma, longer) / excluded_share(sigma, sides)
        shares.append(1 - math.log(grown) / math.log(1 + STEP))
    return np.array(shares)


def excluded_share(sigma: float, sides: np.ndarray) -> float:
    """Return e/(pi sigma^2): the part of a disk's excluded area in the rectangle of centres (2,).

    It is a mean over places of the disk in the rectangle.

    >>> round(excluded_share(1.0, np.array([1e3, 1e3])), 3)
    0.999
    """
    radius = (np.arange(RADII) + 0.5) / RADII * sigma
    arc = open_arc(radius / sides[0]) * open_arc(radius / sides[1])
    return float((2 * radius * arc).sum() / (RADII * sigma))


def open_arc(ratio: np.ndarray) -> np.ndarray:
    """Return the part of a circle that lies in a strip, for ratios of its radius to the strip's
    width, in the mean over places of its centre in the strip: the mean of max(0, 1 - ratio |sin|).

    >>> open_arc(np.array([0.0, 1e9])).tolist()
    [1.0, 3.183098861837907e-10]
    """
    wide = 1 - 2 / np.pi * ratio
    inverse = 1 / np.maximum(ratio, 1.0)
    cosine = np.sqrt((1 - inverse) * (1 + inverse))
    narrow = 2 / np.pi * (np.arcsin(inverse) - inverse / (1 + cosine))
    return np.where(ratio > 1, narrow, wide)
