"""How the disks of a scene move at first: their velocities at t = 0, before any run is made.

The components of drawn velocities have the variance kT/m at a temperature kT, or one standard
deviation s for all disks, whatever their mass; the tracer may have a velocity of its own, and disks
whose positions are given may have given velocities.
Engines draw them (`engines.start.initial_state`); theory, forecasts and estimators that depend on
them ask here. docs/theory.md, section 4.
"""

import math

import numpy as np

from brownpipe.scene.scene import Scene
from brownpipe.scene.species import kinds_of


def temperature(scene: Scene) -> float | None:
    """Return the kT [energy] at which all velocities are drawn; None if they are not."""
    if scene.velocities is None or scene.tracer_velocity is not None:
        return None
    return scene.velocities.temperature


def given_velocities(scene: Scene) -> np.ndarray | None:
    """Return the velocities (N, 2) [length/time] of disks that all have theirs; None if they are
    drawn.
    """
    return None if scene.configuration is None else scene.configuration.velocity


def is_thermal(scene: Scene) -> bool:
    """Return whether the velocities of all disks are drawn at one temperature."""
    return temperature(scene) is not None


def moves(scene: Scene) -> bool:
    """Return whether the velocities of a scene are not all zero."""
    velocity = given_velocities(scene)
    if velocity is not None:
        return bool(velocity.any())
    if scene.velocities is None:
        return False
    if scene.tracer_velocity is not None and any(scene.tracer_velocity):
        return True
    return scene.velocities.draws_motion


# -- the total momentum ----------------------------------------------------------------------------


def starts_with_zero_momentum(scene: Scene) -> bool:
    """Return whether the velocity of the centre of mass is subtracted from all at t = 0."""
    return scene.velocities is not None and bool(scene.velocities.zero_momentum)


def axes_of_zero_momentum(scene: Scene) -> np.ndarray:
    """Return along which of x and y (2,) the velocity of the centre of mass is subtracted at t = 0:
    in a channel along its periodic axis alone.
    """
    if not starts_with_zero_momentum(scene):
        return np.zeros(2, bool)
    return scene.box.periodic_axes if scene.box.is_channel else np.ones(2, bool)


def keeps_momentum_zero(scene: Scene) -> bool:
    """Return whether the total momentum along periodic axes is zero at all times: walls change that
    along the others.
    """
    return scene.box.has_images and starts_with_zero_momentum(scene)


def moving_disks(scene: Scene) -> float:
    """Return half of the degrees of freedom of the velocities: N, less 1/2 for each axis along
    which the total momentum stays zero.
    """
    conserved = scene.box.periodic_axes & axes_of_zero_momentum(scene)
    return scene.particles - np.count_nonzero(conserved) / 2


def mean_square_velocity_of_centre(scene: Scene) -> np.ndarray:
    """Return <V_x^2> and <V_y^2> (2,) [length^2/time^2] of the centre of mass at t = 0: sum of m^2
    <v^2>, over M^2.
    """
    if not scene.particles:
        return np.zeros(2)
    share = _share_of_mass(scene)
    velocity = given_velocities(scene)
    if velocity is not None:
        return (share[:, None] * velocity).sum(axis=0) ** 2
    mean_square = np.full(2, (share**2 * _component_variance(scene)).sum())
    if scene.tracer_velocity is not None:
        mean_square += share[0] ** 2 * np.square(scene.tracer_velocity)
    return np.where(axes_of_zero_momentum(scene), 0.0, mean_square)


# -- tracer and bath -------------------------------------------------------------------------------


def bath_temperature(scene: Scene) -> float:
    """Return kT [energy] of the bath: the mean kinetic energy of all disks but the tracer."""
    velocity = given_velocities(scene)
    if velocity is not None:
        return _mean_energy(scene.mass[1:], velocity[1:])
    if scene.velocities is not None and scene.velocities.temperature is not None:
        return scene.velocities.temperature
    number, mass = _bath(scene)
    largest = mass.max(initial=0.0)
    unit = math.ldexp(1.0, math.frexp(largest)[1] - 1)  # many masses of 1e300 add up to infinity
    mean_mass = float((number * (mass / unit)).sum() / number.sum()) * unit
    deviation = common_deviation(scene)
    return deviation * deviation * mean_mass


def bath_share(scene: Scene) -> float:
    """Return the bath's share of the mass of all disks, 1 - m/M, where their total momentum stays
    zero; otherwise 1. In a channel it is that of motion along its periodic axis.

    In such a box the bath recoils: in equilibrium <v^2> of the tracer is 2kT/m times this share,
    its velocity decays at gamma divided by it, and its diffusion coefficient is kT/(m gamma) times
    its square. docs/theory.md, section 3.
    """
    if not keeps_momentum_zero(scene):
        return 1.0
    number, mass = _bath(scene)
    bath_mass = float((number * (mass / scene.mass[0])).sum())  # in units of the tracer's
    return bath_mass / (1.0 + bath_mass)


def mean_square_speed_of_tracer(scene: Scene) -> float:
    """Return <v0^2> [length^2/time^2] of the tracer at t = 0: the coefficient of ballistic flight.

    From its velocity of component variance w_0 that of the centre of mass is subtracted if the
    total momentum is to be zero: with shares f_i = m_i/M of the mass, and no correlations between
    disks,

        <v0^2> = 2 (w_0 (1 - 2 f_0) + sum_i f_i^2 w_i),

    in a channel half of it, along the periodic axis, and w_0 along the other.
    A tracer with a velocity of its own has its square. NaN if it is not known: without disks, and
    where a tracer of another temperature than its bath exchanges energy with it before t = 0.
    """
    if not scene.particles:
        return math.nan
    equilibration = scene.equilibrate
    if equilibration.time > 0 and equilibration.tracer == "free" and not is_thermal(scene):
        return math.nan
    velocity = given_velocities(scene)
    tracer_velocity = scene.tracer_velocity if velocity is None else velocity[0]
    if tracer_velocity is not None:
        return float(np.square(tracer_velocity).sum())
    variance = _component_variance(scene)
    share = _share_of_mass(scene)
    balanced = variance[0] * (1 - 2 * share[0]) + (share**2 * variance).sum()
    components = np.where(axes_of_zero_momentum(scene), balanced, variance[0])
    return float(components.sum())


def speed_ratios(scene: Scene) -> np.ndarray:
    """Return the rms speed (N,) of each disk at t = 0 over that of its drawn velocity.

    Disks that start with one standard deviation, and equilibrate around a pinned tracer, share the
    energy of the bath equally by then: with the mean mass m_b of the bath it is sqrt(m_b/m_i).
    Otherwise 1, also around a free tracer: how far such disks have come is not known, but they keep
    the mean square of their total momentum.
    """
    ratio = np.ones(scene.particles)
    is_pinned = scene.equilibrate.time > 0 and scene.equilibrate.tracer == "pinned"
    if is_pinned and not is_thermal(scene):
        bath_mass = scene.mass[1:] / scene.mass.max()  # no sum of masses overflows
        ratio[1:] = np.sqrt(bath_mass.sum() / max(len(bath_mass), 1) / bath_mass)
    return ratio


def _component_variance(scene: Scene) -> np.ndarray:
    """Return the variances (N,) [length^2/time^2] of velocity components of drawn disks at t = 0,
    before the velocity of the centre of mass is subtracted.
    """
    if scene.velocities is not None and scene.velocities.temperature is not None:
        variance = scene.velocities.temperature / scene.mass
    else:
        variance = (common_deviation(scene) * speed_ratios(scene)) ** 2
    if scene.tracer_velocity is not None:  # it is not drawn
        variance[0] = 0.0
    return variance


def common_deviation(scene: Scene) -> float:
    """Return the standard deviation [length/time] of which the velocity components of all disks
    are drawn, whatever their mass.

    Raises ValueError where velocities are given, or drawn at a temperature.
    """
    if scene.velocities is None or scene.velocities.standard_deviation is None:
        raise ValueError("no standard deviation: velocities are given, or drawn at a temperature")
    return scene.velocities.standard_deviation


def _share_of_mass(scene: Scene) -> np.ndarray:
    """Return the share (N,) of each disk in the mass of all."""
    relative = scene.mass / scene.mass.max()  # no sum of masses overflows
    return relative / relative.sum()


def _bath(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers (K,) and masses (K,) of the disks of each kind, the tracer left out."""
    if scene.configuration is not None:
        mass = scene.mass[1:]
        return np.ones(len(mass)), mass
    kinds = kinds_of(scene)
    number = kinds.number.copy()
    number[:1] -= 1  # the tracer is of the first kind
    return number[number > 0], kinds.mass[number > 0]


def mean_energy(scene: Scene) -> float:
    """Return the mean kinetic energy [energy] per disk at t = 0: kT, once all disks share it."""
    if not scene.particles:
        return 0.0
    velocity = given_velocities(scene)
    if velocity is not None:
        return _mean_energy(scene.mass, velocity)
    tracer_energy = scene.mass[0] * mean_square_speed_of_tracer(scene) / 2
    if scene.particles == 1:
        return float(tracer_energy)
    bath_energy = (scene.particles - 1) * bath_temperature(scene)
    if scene.tracer_velocity is not None:
        number, mass = _bath(scene)
        # the bath as a whole moves against the tracer
        opposed = np.square(scene.tracer_velocity) @ axes_of_zero_momentum(scene)
        bath_energy += scene.mass[0] ** 2 * opposed / 2 / float((number * mass).sum())
    return float(tracer_energy + bath_energy) / scene.particles


def _mean_energy(mass: np.ndarray, velocity: np.ndarray) -> float:
    """Return the mean kinetic energy of disks of masses (n,) and velocities (n, 2); 0 without
    disks.
    """
    unit = float(np.abs(velocity).max(initial=0.0)) or 1.0  # so that no square overflows
    square_speed = np.sum((velocity / unit) ** 2, axis=1)
    energy = (mass * square_speed).sum() / 2 / max(len(mass), 1)
    return float(unit * unit * energy)
