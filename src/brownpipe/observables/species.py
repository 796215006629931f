"""The kinds of disks that a scene has, which measures tell apart."""

from typing import NamedTuple

import numpy as np

from brownpipe.scene import Scene


class SpeciesTable(NamedTuple):
    """The K kinds of disks of which there are any: the species, the tracer one of its own."""

    name: tuple[str, ...]
    number: np.ndarray  # (K,)
    radius: np.ndarray  # (K,) [length]
    mass: np.ndarray  # (K,)
    label: np.ndarray  # (N,) the kind of each disk


def species_table(scene: Scene) -> SpeciesTable:
    """Return the kinds of a scene; of a list of disks, one for every pair of radius and mass, by first appearance."""
    if scene.disks:
        found = {pair: k for k, pair in enumerate(dict.fromkeys((disk.radius, disk.mass) for disk in scene.disks))}
        names = tuple(f"kind-{k + 1}" for k in found.values())
        label = np.array([found[disk.radius, disk.mass] for disk in scene.disks])
    else:
        present = [one for one in scene.species if one.count]
        found, names = [(one.radius, one.mass) for one in present], tuple(one.name for one in present)
        label = np.repeat(np.arange(len(present)), [one.count for one in present])
    radius, mass = np.array(list(found), float).reshape(-1, 2).T
    return SpeciesTable(names, np.bincount(label, minlength=len(names)), radius, mass, label)


def equal_disks(scene: Scene) -> np.ndarray:
    """The indices of the disks of the tracer's radius and mass, its own (0) among them."""
    radius, mass = scene.radius, scene.mass
    return np.flatnonzero((radius == radius[0]) & (mass == mass[0]))


def tracer_tracks(scene: Scene, run, average: str):
    """The `state.Track` of the tracer, M = 1, or in an average over `disks` that of all disks equal to it."""
    if average != "disks":
        return run.tracer
    disks = equal_disks(scene)
    return run.whole._make(None if values is None else values[:, disks] for values in run.whole)


def bath_disks(scene: Scene) -> np.ndarray:
    """The indices of the disks of the most numerous kind that is not the tracer's; none where there is one kind."""
    kinds = species_table(scene)
    number = np.where(np.isin(np.arange(len(kinds.number)), kinds.label[:1]), 0, kinds.number)
    return np.flatnonzero(kinds.label == np.argmax(number)) if number.any() else np.array([], int)
