"""Species of a scene: groups of disks that observables and estimators distinguish, and kinds of
disks, of one radius and mass, of which theory makes its sums.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.scene.configuration import in_order_of_appearance
from brownpipe.scene.scene import Scene

CLASSES = 12  # of radii, and in each of them of masses
# the tracer and the classes: sums over pairs of so many take 5 ms. Of more kinds, disks of similar
# radius and mass are taken as one.
MOST_KINDS_IN_SUMS = 1 + CLASSES**2


class SpeciesTable(NamedTuple):
    """The K species of which a scene has at least one disk; the tracer is a species of its own."""

    name: tuple[str, ...]  # K of them
    number: np.ndarray  # (K,) int64 disks
    radius: np.ndarray  # (K,) [length]; the mean of a species of several radii
    mass: np.ndarray  # (K,); the mean of a species of several masses
    species_index: np.ndarray  # (N,) int64 of the species of each disk
    has_one_kind: np.ndarray  # (K,) bool, whether all its disks have one radius and mass
    smallest_radius: np.ndarray  # (K,) [length]


class Kinds(NamedTuple):
    """Disks by radius and mass, K kinds; disk 0 is of the first."""

    number: np.ndarray  # (K,) int64 disks
    radius: np.ndarray  # (K,) [length]
    mass: np.ndarray  # (K,)


def species_table(scene: Scene) -> SpeciesTable:
    """Return the species of a scene, as they are named in it (`scene.configuration.with_names` says
    what unnamed disks are called).
    """
    configuration = scene.configuration
    if configuration is not None:
        return _species_of_given(configuration.names, configuration.species_index, scene)
    present = [species for species in scene.species if species.count]
    number = np.array([species.count for species in present], np.int64)
    radius = np.array([species.radius for species in present], float)
    return SpeciesTable(
        name=tuple(species.name for species in present),
        number=number,
        radius=radius,
        mass=np.array([species.mass for species in present], float),
        species_index=np.repeat(np.arange(len(present)), number),
        has_one_kind=np.ones(len(present), bool),
        smallest_radius=radius,
    )


def _species_of_given(
    names: tuple[str, ...], species_index: np.ndarray, scene: Scene
) -> SpeciesTable:
    number = np.bincount(species_index, minlength=len(names))
    radius = np.zeros(len(names))
    mass = np.zeros(len(names))
    smallest_radius = np.zeros(len(names))
    has_one_kind = np.zeros(len(names), bool)
    for k in range(len(names)):
        radii = scene.radius[species_index == k]
        masses = scene.mass[species_index == k]
        has_one_kind[k] = np.ptp(radii) == 0 and np.ptp(masses) == 0
        smallest_radius[k] = radii.min()
        # the mean of equal numbers may differ from them in its last digit
        radius[k] = radii[0] if np.ptp(radii) == 0 else radii.mean()
        mass[k] = masses[0] if np.ptp(masses) == 0 else masses.mean()
    return SpeciesTable(names, number, radius, mass, species_index, has_one_kind, smallest_radius)


def kinds_of(scene: Scene) -> Kinds:
    """Return the kinds of disks in a scene, for sums over all disks or pairs of disks.

    Of given disks with more than MOST_KINDS_IN_SUMS radii and masses, the tracer is a kind, and the
    others are CLASSES of equal number in the order of their radii, and each of them as many in the
    order of their masses. A class has the rms radius, so that the area that disks cover is exact,
    and the mass of the mean speed at a temperature, <m^(-1/2)>^-2. Other sums differ by the square
    of the width of a class.
    """
    configuration = scene.configuration
    if configuration is None:
        table = species_table(scene)
        return Kinds(table.number, table.radius, table.mass)
    disks = np.stack([scene.radius, scene.mass], axis=1)
    kind = in_order_of_appearance(np.unique(disks, axis=0, return_inverse=True)[1])
    number = np.bincount(kind)
    if len(number) <= MOST_KINDS_IN_SUMS:
        first = np.unique(kind, return_index=True)[1]
        return Kinds(number, scene.radius[first], scene.mass[first])
    by_radius = 1 + np.argsort(scene.radius[1:], kind="stable")
    classes = [np.array([0])]
    for of_radius in np.array_split(by_radius, CLASSES):
        by_mass = of_radius[np.argsort(scene.mass[of_radius], kind="stable")]
        classes += [members for members in np.array_split(by_mass, CLASSES) if len(members)]
    square_radii = np.array([np.mean(scene.radius[members] ** 2) for members in classes])
    return Kinds(
        number=np.array([len(members) for members in classes]),
        radius=np.sqrt(square_radii),
        mass=np.array([np.mean(scene.mass[members] ** -0.5) ** -2 for members in classes]),
    )


def equal_disks(scene: Scene) -> np.ndarray:
    """Return the indices (M,) of the disks with the radius and mass of the tracer, disk 0 among
    them.
    """
    has_radius = scene.radius == scene.radius[0]
    has_mass = scene.mass == scene.mass[0]
    return np.flatnonzero(has_radius & has_mass)


def bath_disks(scene: Scene) -> np.ndarray:
    """Return the indices of the disks of the most numerous species except the tracer's; empty if
    there is no other.
    """
    species = species_table(scene)
    number = species.number.copy()
    number[species.species_index[:1]] = 0  # the tracer's species
    if not number.any():
        return np.array([], int)
    return np.flatnonzero(species.species_index == np.argmax(number))
