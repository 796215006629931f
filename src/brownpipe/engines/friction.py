"""Friction of a disk in a bath of other disks, by Enskog's and Boltzmann's theories:
docs/theory.md, section 3.
"""

import math
from typing import NamedTuple

import numpy as np

from brownpipe import theory
from brownpipe.engines.units import SMALLEST_NORMAL
from brownpipe.errors import RequestError
from brownpipe.scene import Scene, motion
from brownpipe.scene.species import kinds_of

# In units of 1/gamma of the tracer: before, its displacements still depend on the initial velocity.
DECAY_TIMES = 3.0
# Packing fraction above which disks freeze and the contact values, those of the fluid, do not hold;
# 0.7 with round-off.
DENSEST = 0.7 * (1 + 1e-12)


class Bath(NamedTuple):
    """All disks but the tracer, as K kinds; arrays of shape (K,)."""

    number: np.ndarray  # of disks
    radius: np.ndarray  # [length]
    mass: np.ndarray  # [mass]
    temperature: float  # kT, the mean kinetic energy per disk


class Partners(NamedTuple):
    """Enskog's theory of the tracer, for each of the K kinds of disks of its bath; arrays of shape
    (K,).
    """

    contact_value: np.ndarray  # [1]
    friction: np.ndarray  # gamma = zeta/m_a [1/time]
    rate: np.ndarray  # the tracer's collisions with the kind [1/time]


def bath_of(scene: Scene) -> Bath:
    """Return the bath of a scene: all disks but the tracer."""
    kinds = kinds_of(scene)
    number = _bath_numbers(kinds.number)
    present = number > 0
    temperature = motion.bath_temperature(scene)
    return Bath(number[present], kinds.radius[present], kinds.mass[present], temperature)


def _bath_numbers(number: np.ndarray) -> np.ndarray:
    """Return how many disks (K,) of each kind are in the bath; the tracer is of the first.

    >>> _bath_numbers(np.array([1, 99]))
    array([ 0, 99])
    """
    is_first = np.arange(len(number)) == 0
    return number - is_first


def not_diffusive_before(scene: Scene) -> float:
    """Return the time [time] before which the MSD depends on the initial velocity of the tracer:
    3/gamma.

    The velocity decays at Enskog's rate gamma, divided by the bath's share of the mass. Infinite
    for a disk without a bath; NaN without disks, and where velocities are given. Motion may become
    diffusive later, or never: cages, walls and light tracers need the test of `analysis.diffusive`.
    """
    if scene.has_one_state or not scene.particles:
        return math.nan
    if scene.particles == 1:
        return math.inf
    gamma = float(partners_of(scene).friction.sum())
    if not gamma > SMALLEST_NORMAL:
        return math.nan
    return DECAY_TIMES * motion.bath_share(scene) / gamma


def rate_at_temperature(scene: Scene, rate: np.ndarray, kt: np.ndarray) -> np.ndarray:
    """Return collision rates (n,) of runs with kinetic temperatures `kt` (n,), scaled to the mean
    at the scene's.

    If all velocities are multiplied by a factor, hard disks follow the same paths, faster by this
    factor: rates are proportional to sqrt(kt). Over runs with velocities drawn at this temperature
    the mean of sqrt(kt/temperature) is slightly below 1 (`mean_root`). With this factor the scaled
    rate has, in equilibrium, the canonical mean of the rate, without the spread due to the
    temperatures of the runs.
    """
    return rate * np.sqrt(motion.bath_temperature(scene) / kt) * mean_root(scene)


def mean_root(scene: Scene) -> float:
    """Return the mean of sqrt(kT_run/kT) over runs with velocities drawn at kT:
    `theory.mean_root_chi_square`.
    """
    return theory.mean_root_chi_square(2 * motion.moving_disks(scene))


def drift_diffusion(scene: Scene) -> float:
    """Return what the drift of the centre of mass adds to D by the end of a run, <V^2> t/2
    [length^2/time].

    Exact for given velocities, and if they are drawn at a temperature. With a standard deviation
    the tracer may start hotter than its bath, and its motion relative to the centre of mass is then
    correlated with V: that adds about D (kT_a/kT_b - 1) m_a/M more, which is left out
    (docs/theory.md, section 3). In a channel the drift is that along its periodic axis. NaN in a
    box of walls, for species whose total momentum is zero, and where a tracer that is held takes up
    momentum of given velocities before t = 0.
    """
    if not scene.box.has_images or motion.starts_with_zero_momentum(scene):
        return math.nan
    before = scene.equilibrate
    if scene.has_one_state and before.time > 0 and before.tracer == "pinned":
        return math.nan
    mean_square = motion.mean_square_velocity_of_centre(scene)[scene.box.periodic_axes].sum()
    return float(mean_square) * scene.duration / 2


def friction_rate(scene: Scene, friction: str, measured: float | None = None) -> float:
    """Return the tracer's friction rate gamma = zeta/m [1/time], dv/dt = -gamma v + noise.

    `friction` is `enskog`, the sum of the frictions of all species of the bath (`partners_of`);
    `boltzmann`, the same with contact values 1, the dilute limit; or `measured`, Enskog's sum times
    the tracer's `measured` collision rate [1/time] over Enskog's rate. A species contributes zeta =
    2 n chi sigma sqrt(2 pi mu kT), which is 2 mu times the collision rate with it. With one species
    gamma is therefore 2 mu rate/m, the initial decay rate of the velocity autocorrelation, for any
    chi. With several species the measured rate is divided in Enskog's proportions. It includes the
    density increase due to excluded volume at the walls.

    Raises RequestError if gamma is beyond the floating-point numbers.
    """
    partners = partners_of(scene, crowded=friction != "boltzmann")
    gamma = partners.friction.sum()
    if friction == "measured" and gamma > 0:
        gamma *= measured / partners.rate.sum()
    is_normal = gamma >= SMALLEST_NORMAL or not motion.moves(scene)
    if not (is_normal and math.isfinite(gamma)):
        raise RequestError(
            f"{scene.title}: --engine langevin needs a friction rate from "
            f"{SMALLEST_NORMAL:.3g} to 1.8e308, found {gamma:g}; choose another unit of time"
        )
    return float(gamma)


def partners_of(scene: Scene, crowded: bool = True) -> Partners:
    """Return contact values, frictions and collision rates of the tracer with every kind of disks
    in its bath.

    A kind of N_k disks, the tracer not counted, has the number density N_k/A. The contact values
    are those of the whole box, the tracer included (`theory.mixture_contact_values`), at a packing
    fraction of at most DENSEST; without `crowded` they are 1. Walls are not considered. Masses and
    kT are divided by the tracer's mass first, because its friction coefficient zeta alone may be
    beyond the floating-point numbers.
    """
    mass = float(scene.mass[0])
    bath = bath_of(scene)
    chi = np.ones(len(bath.number))
    if crowded:
        kinds = kinds_of(scene)
        fluid = min(1.0, DENSEST / scene.packing_fraction)
        density = fluid * kinds.number / scene.box.area
        contact = theory.mixture_contact_values(density, 2 * kinds.radius)
        chi = contact[0, _bath_numbers(kinds.number) > 0]
    mu = theory.reduced_mass(1.0, bath.mass / mass)
    partners = bath.number / scene.box.area
    sigma = float(scene.radius[0]) + bath.radius
    kt = bath.temperature / mass
    friction = theory.enskog_friction(partners, sigma, chi, mu, kt)
    rate = theory.collision_rate(partners, sigma, chi, mu, kt)
    return Partners(chi, friction, rate)
