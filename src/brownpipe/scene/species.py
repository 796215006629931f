"""Species of a scene: groups of disks of one radius and mass, which observables and estimators
distinguish.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.scene.scene import Scene


class SpeciesTable(NamedTuple):
    """The K species of which a scene has at least one disk; the tracer is a species of its own."""

    name: tuple[str, ...]  # K of them
    number: np.ndarray  # (K,) int64 disks
    radius: np.ndarray  # (K,) [length]
    mass: np.ndarray  # (K,)
    species_index: np.ndarray  # (N,) int64 of the species of each disk


def species_table(scene: Scene) -> SpeciesTable:
    """Return the species of a scene.

    An explicit list of disks names no species: disks of equal radius and mass are one, called
    kind-1, kind-2, ... in the order of the list.
    """
    kinds: list[tuple[float, float]]  # radius and mass of each species
    if scene.listed:
        disks = [(disk.radius, disk.mass) for disk in scene.listed]
        kinds = list(dict.fromkeys(disks))
        names = tuple(f"kind-{k + 1}" for k in range(len(kinds)))
        index = {kind: k for k, kind in enumerate(kinds)}
        species_index = np.array([index[disk] for disk in disks])
    else:
        present = [species for species in scene.species if species.count]
        kinds = [(species.radius, species.mass) for species in present]
        names = tuple(species.name for species in present)
        species_index = np.repeat(np.arange(len(present)), [species.count for species in present])
    number = np.bincount(species_index, minlength=len(names))
    radius, mass = np.array(kinds, float).reshape(-1, 2).T
    return SpeciesTable(names, number, radius, mass, species_index)


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
