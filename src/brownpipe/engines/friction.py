"""The friction of a disk in a bath of others, by Enskog's and Boltzmann's theories."""

import math
from typing import NamedTuple

import numpy as np

from brownpipe import theory
from brownpipe.errors import RequestError
from brownpipe.scene import Scene, Species

SMALLEST = 2.3e-308  # floating-point number that has all its digits
DENSEST = 0.7  # packing fraction above which disks freeze; the contact value holds for the fluid


class Bath(NamedTuple):
    """All disks but the one that is followed, by species, shape (K,) each."""

    number: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    temperature: float  # kT, the mean kinetic energy per disk


class Partners(NamedTuple):
    """Enskog's theory of the followed disk, by species of its bath, shape (K,) each."""

    contact_value: np.ndarray  # [1]
    friction: np.ndarray  # gamma = zeta/m_a [1/time]
    rate: np.ndarray  # collisions of the followed disk with the species [1/time]


def followed(scene: Scene) -> Species:
    """Return the species of disk 0."""
    return next(one for one in scene.species if one.count)


def bath_of(scene: Scene) -> Bath:
    """Return the bath of a scene of species: all disks but the one that is followed."""
    tracer, given = followed(scene), scene.velocities
    counted = [(one, one.count - (one is tracer)) for one in scene.species]
    rows = [(count, one.radius, one.mass) for one, count in counted if count]
    number, radius, mass = np.array(rows, dtype=float).reshape(-1, 3).T
    temperature = given.temperature
    if temperature is None:
        unit = math.ldexp(1.0, math.frexp(mass.max(initial=0.0))[1] - 1)  # many masses of 1e300 add up to infinity
        mean = float((number * (mass / unit)).sum() / number.sum()) * unit
        temperature = given.standard_deviation * given.standard_deviation * mean
    return Bath(number, radius, mass, temperature)


def friction_rate(scene: Scene, friction: str, measured: float | None = None) -> float:
    """Return gamma [1/time] of the followed disk, dv/dt = -gamma v + noise.

    `enskog`: the sum of the frictions of all species of the bath (`partners_of`). `boltzmann`: the same with contact
    values 1, the limit of a thin bath. `measured`: Enskog's sum times the tracer's `measured` collision rate [1/time]
    over Enskog's. For each species zeta = 2 n chi sigma sqrt(2 pi mu kT) = 2 mu times the rate
    n chi sigma sqrt(2 pi kT/mu). With one species gamma is therefore 2 mu rate/m, the initial decay of the velocity
    autocorrelation, whatever chi is; with several the measured rate is divided in Enskog's proportions. It includes the
    density increase due to excluded volume at the walls.

    Raises RequestError if gamma is beyond the floating-point numbers.
    """
    partners = partners_of(scene, crowded=friction != "boltzmann")
    gamma = partners.friction.sum()
    if friction == "measured" and gamma > 0:
        gamma *= measured / partners.rate.sum()
    moves = scene.velocities.temperature or scene.velocities.standard_deviation
    if not (math.isfinite(gamma) and (gamma >= SMALLEST or not moves)):
        raise RequestError(
            f"{scene.name}, N = {scene.particles}: --engine langevin needs a friction rate from {SMALLEST:.3g} to "
            f"1.8e308, found {gamma:g}; choose another unit of time"
        )
    return float(gamma)


def partners_of(scene: Scene, crowded: bool = True) -> Partners:
    """Return contact values, frictions and collision rates of the followed disk with every species of its bath.

    A species of N_k disks, the followed one not counted, has the number density N_k/A. The contact values are those of
    the whole box, the followed disk included (`theory.mixture_contact_values`), at a packing fraction of at most
    DENSEST; 1 unless `crowded`. Walls are not considered. Masses and kT are divided by the mass of the followed disk
    first: its friction coefficient zeta alone may be no floating-point number.
    """
    tracer, bath = followed(scene), bath_of(scene)
    present = [one for one in scene.species if one.count]
    chi = np.ones(len(bath.number))
    if crowded:
        fluid = min(1.0, DENSEST / scene.packing_fraction)
        density = fluid * np.array([one.count for one in present]) / scene.box.area
        contact = theory.mixture_contact_values(density, 2 * np.array([one.radius for one in present]))
        met = np.array([one.count > (one is tracer) for one in present])
        chi = contact[present.index(tracer), met]
    mu = theory.reduced_mass(1.0, bath.mass / tracer.mass)
    known = bath.number / scene.box.area, tracer.radius + bath.radius, chi, mu, bath.temperature / tracer.mass
    return Partners(chi, theory.enskog_friction(*known), theory.collision_rate(*known))
