"""Disks whose positions are given: resolved from a list, or from a file and the keys that replace
what is in it; and which of them are not inside the box.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe.scene.configuration import Configuration, named, with_names, with_own_species
from brownpipe.scene.overlaps import ROUND_OFF
from brownpipe.scene.reading import refuse
from brownpipe.scene.sections import Box, Disk, GivenDisks


class Outside(NamedTuple):
    """A disk that is not inside the box."""

    disk: int
    problem: str


def first_outside(
    box: Box, position: np.ndarray, radius: np.ndarray, tolerance: float | np.ndarray = 0.0
) -> Outside | None:
    """Return the first of N disks at positions (N, 2) that is not inside the box; None if all are.

    Its edge is between walls, its centre between periodic sides. tolerance: by how much each disk
    may be outside [length].
    """
    margins = box.margins(radius[:, None])
    for column, (axis, (low, high)) in enumerate((("x", box.x), ("y", box.y))):
        value = position[:, column]
        margin = margins[:, column]
        is_periodic = box.periodic_axes[column]
        if is_periodic:
            is_inside = (low - tolerance <= value) & (value < high + tolerance)
        else:
            slack = tolerance + ROUND_OFF * margin + 2 * math.ulp(max(-low, high))
            is_inside = (low - slack <= value - margin) & (value + margin <= high + slack)
        if not is_inside.all():
            disk = int(np.argmin(is_inside))
            least = float(low + margin[disk])
            most = float(high - margin[disk])
            sign = "<" if is_periodic else "<="
            allowed = f"{least:.10g} <= {axis} {sign} {most:.10g}"
            place = position[disk].tolist()
            return Outside(disk, f"must have the disk inside the box, {allowed}, not {place}")
    return None


def listed_disks(disks: tuple[Disk, ...], has_velocities: bool) -> Configuration:
    """Return the disks of a list. Either all have velocities, or the scene draws them; then disk 0
    alone may have one, and is a species of its own.
    """
    for k, disk in enumerate(disks):
        if has_velocities and disk.velocity is None:
            problem = "missing; must be given, or `velocities` that draw those of all disks"
            refuse(problem, "disks", k, "velocity")
        if not has_velocities and disk.velocity is not None and k > 0:
            problem = "must not be given with `velocities`; disk 0 alone may have one of its own"
            refuse(problem, "disks", k, "velocity")
        if (disk.species is None) != (disks[0].species is None):
            refuse("must be given for all disks or for none", "disks", k, "species")
    number = len(disks)
    velocity = None
    if has_velocities:
        velocity = np.array([disk.velocity for disk in disks], float).reshape(number, 2)
    configuration = Configuration(
        position=np.array([disk.position for disk in disks], float).reshape(number, 2),
        velocity=velocity,
        radius=np.array([disk.radius for disk in disks], float),
        mass=np.array([disk.mass for disk in disks], float),
    )
    names = [disk.species for disk in disks if disk.species is not None]
    if names:
        configuration = named(configuration, np.array(names))
    if not has_velocities and disks and disks[0].velocity is not None:
        configuration = with_own_species(configuration)
    return _read_only(with_names(configuration))


def changed_disks(disks: GivenDisks, has_velocities: bool) -> Configuration:
    """Return the disks of a file with the keys that replace those in it."""
    if disks.configuration is None:
        refuse("must be in a scene file, or in a new Scene, which read it", "disks", "file")
    configuration = disks.configuration
    if has_velocities and configuration.velocity is None:
        refuse("missing; must be given, as the disks have none", "velocities")
    configuration = (
        with_names(configuration) if disks.tracer is None else with_own_species(configuration)
    )
    position = configuration.position.copy()
    velocity = None if configuration.velocity is None else configuration.velocity.copy()
    radius = configuration.radius.copy()
    mass = configuration.mass.copy()
    for name, changes in disks.species.items():
        if name not in configuration.names:
            known = ", ".join(configuration.names)
            refuse(f"must be a species of the disks: {known}", "disks", "species", name)
        members = configuration.species_index == configuration.names.index(name)
        _replace_where(members, radius, changes.radius)
        _replace_where(members, mass, changes.mass)
    if disks.tracer is not None:
        _replace_where(0, radius, disks.tracer.radius)
        _replace_where(0, mass, disks.tracer.mass)
        _replace_where(0, position, disks.tracer.position)
        if has_velocities and velocity is not None:
            _replace_where(0, velocity, disks.tracer.velocity)
    changed = configuration._replace(position=position, velocity=velocity, radius=radius, mass=mass)
    return _read_only(changed)


def _replace_where(
    disks: int | np.ndarray, values: np.ndarray, value: float | tuple[float, float] | None
) -> None:
    """Replace the values of some disks; None replaces none."""
    if value is not None:
        values[disks] = value


def _read_only(configuration: Configuration) -> Configuration:
    """Return the configuration after its arrays were made read-only."""
    for array in configuration:
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return configuration
