"""Species of a scene: groups of disks of one radius and mass, which observables and estimators
distinguish.
"""

from typing import NamedTuple

import numpy as np

from brownpipe.scene import Scene


class SpeciesTable(NamedTuple):
    """The K species of which a scene has at least one disk; the tracer is a species of its own."""

    name: tuple[str, ...]  # K of them
    number: np.ndarray  # (K,) int64 disks
    radius: np.ndarray  # (K,) [length]
    mass: np.ndarray  # (K,)
    label: np.ndarray  # (N,) int64 the species of each disk


def species_table(scene: Scene) -> SpeciesTable:
    """Return the species of a scene.

    An explicit list of disks names no species: disks of equal radius and mass are one, called
    kind-1, kind-2, ... in the order of the list.
    """
    if scene.listed:
        alike = {
            pair: k
            for k, pair in enumerate(
                dict.fromkeys((disk.radius, disk.mass) for disk in scene.listed)
            )
        }
        sizes, names = list(alike), tuple(f"kind-{k + 1}" for k in alike.values())
        label = np.array([alike[disk.radius, disk.mass] for disk in scene.listed])
    else:
        present = [species for species in scene.species if species.count]
        sizes, names = (
            [(species.radius, species.mass) for species in present],
            tuple(s.name for s in present),
        )
        label = np.repeat(np.arange(len(present)), [species.count for species in present])
    radius, mass = np.array(sizes, float).reshape(-1, 2).T
    return SpeciesTable(names, np.bincount(label, minlength=len(names)), radius, mass, label)


def equal_disks(scene: Scene) -> np.ndarray:
    """Return the indices (M,) of the disks with the radius and mass of the tracer, disk 0 among
    them.
    """
    radius, mass = scene.radius, scene.mass
    return np.flatnonzero((radius == radius[0]) & (mass == mass[0]))


def bath_disks(scene: Scene) -> np.ndarray:
    """Return the indices of the disks of the most numerous species except the tracer's; empty if
    there is no other.
    """
    species = species_table(scene)
    number = np.where(np.isin(np.arange(len(species.number)), species.label[:1]), 0, species.number)
    return np.flatnonzero(species.label == np.argmax(number)) if number.any() else np.array([], int)
