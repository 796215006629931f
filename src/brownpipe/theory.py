"""Closed forms that the simulation is compared with: diffusion, ballistic flight, Enskog, and the
ideal gas in a box.

Unless stated otherwise, a function takes scalars or arrays that broadcast against each other and
returns an array of the broadcast shape. Quantities are in the scene's units of length, time and
mass; `temperature` is kT, an energy. "Eq." is an equation of D. W. Harrison, "Brownian motion
simulation" (2020), the note that brownpipe follows. docs/theory.md states the formulas, their
limits and their sources; each docstring names its section.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

Numbers = float | np.ndarray
# a float if all arguments are floats, otherwise an array: more than a type checker can tell
Broadcast = Any
leggauss = cache(legendre.leggauss)  # 64 nodes take 10 ms

# Below this D t / a^2 the walls of a square of half-width a change the MSD by less than round-off:
# the probability erfc(1 / (2 sqrt(0.0068))) to have reached a wall is 1e-17. Above it 24 terms of
# the series are exact to round-off.
_WALLS_UNSEEN = 0.0068
_SERIES_TERMS = 24
# Decay of the last mode between two walls above which the series is not complete, and the walls are
# not felt yet.
_FORGOTTEN_MODE = 1e-17
# nodes of the quadrature over a quarter circle; error 1e-15 for the narrowest density of the series
_NODES = 64
SMALLEST_TOLERANCE = 4 * np.finfo(float).eps  # relative, of SciPy's brentq
HEXAGONAL_PACKING = math.pi / math.sqrt(12.0)  # of equal disks; none are packed more densely
# Factors by which all further Sonine orders correct the first, for equal disks: of the viscosity of
# a dilute gas, of D
SONINE_VISCOSITY = 1.022
SONINE_DIFFUSION = 1.027
SMALLEST_GAP = 1e-6  # between neighbours in a crystal, relative to their distance


# --- diffusion


def diffusive_msd(t: Numbers, diffusion: Numbers) -> Broadcast:
    """Return the MSD [length^2] of free diffusion in the plane, 4 D t: eq. (12); docs/theory.md,
    section 2.
    """
    return 4.0 * diffusion * np.asarray(t, float)


def ring_probability(inner: Numbers, outer: Numbers, t: Numbers, diffusion: Numbers) -> Broadcast:
    """Return the probability that free diffusion from the origin ends between two radii after time
    `t > 0`.

    Eq. (18) integrated over the ring, exact for any width: exp(-inner^2/4Dt) - exp(-outer^2/4Dt).
    `outer` may be inf. docs/theory.md, section 2.
    """
    square = 4.0 * diffusion * np.asarray(t, float)
    inner_exponent = np.square(inner) / square
    outer_exponent = np.square(outer) / square
    return np.exp(-inner_exponent) * -np.expm1(inner_exponent - outer_exponent)


def reflecting_square_msd(t: Numbers, diffusion: Numbers, half_width: Numbers) -> Broadcast:
    """Return the MSD [length^2] of diffusion that starts at the centre of a reflecting square.

    `half_width` is that of the accessible square, a = w - R for a disk of radius R between walls at
    +-w. The two components are independent; each is the cosine series of the diffusion equation on
    [-a, a],
    <x^2> = a^2/3 + (4 a^2/pi^2) sum_k (-1)^k k^-2 exp(-D k^2 pi^2 t / a^2), which rises as 2Dt at
    first and approaches a^2/3. docs/theory.md, section 2.
    """
    tau = np.asarray(diffusion * np.asarray(t, float) / np.square(half_width), float)
    k = np.arange(1, _SERIES_TERMS + 1)
    sign = np.where(k % 2, -1.0, 1.0)
    decay = np.exp(-(np.pi**2) * k**2 * tau[..., None])
    series = (sign / k**2 * decay).sum(axis=-1)
    between_walls = 1.0 / 3.0 + 4.0 / np.pi**2 * series
    component = np.where(tau < _WALLS_UNSEEN, 2.0 * tau, between_walls)
    return 2.0 * np.square(half_width) * component


def reflecting_square_within(
    r: Numbers, t: float, diffusion: float, half_width: float
) -> np.ndarray:
    """Return the probability (K,) that diffusion in a reflecting square ends within `r` (K,) of the
    centre.

    It started at the centre a time `t > 0` earlier; `half_width` a is that of the accessible
    square. Both components have the density p(x) = (1 + 2 sum_k cos(k pi x/a) exp(-D k^2 pi^2
    t/a^2)) / 2a on [-a, a], whose integral over [-h, h] is C(h). With s = sqrt(max(r^2 - a^2, 0))
    the probability is C(s) + 2 int_s^a p(x) C(sqrt(r^2 - x^2)) dx, by Gauss-Legendre quadrature
    over the angle. For D t/a^2 < 0.0068 it is that of free diffusion; for r beyond the corners it
    is 1. docs/theory.md, section 2.
    """
    a = half_width
    r = np.atleast_1d(np.asarray(r, float))
    tau = diffusion * t / a**2
    if not tau >= _WALLS_UNSEEN:
        return ring_probability(0.0, r, t, diffusion)
    s = np.sqrt(np.maximum(r**2 - a**2, 0.0))
    longest = np.maximum(r, a)
    first = np.arcsin(s / longest)
    last = np.arcsin(np.minimum(a / longest, 1.0))
    node, weight = leggauss(_NODES)
    angle = first + (last - first) * (node[:, None] + 1) / 2
    density = _component_density(r * np.sin(angle), tau, a)
    within = _component_within(r * np.cos(angle), tau, a)
    integrand = density * within
    arc = (weight[:, None] * integrand * r * np.cos(angle)).sum(axis=0) * (last - first)
    probability = np.minimum(_component_within(s, tau, a) + arc, 1.0)
    return np.where(r >= np.sqrt(2.0) * a, 1.0, probability)


def _component_density(x: np.ndarray, tau: float, a: float) -> np.ndarray:
    """Return the density [1/length] of one component at x after the time tau = D t/a^2."""
    k = np.arange(1, _SERIES_TERMS + 1)
    decay = np.exp(-(np.pi**2) * k**2 * tau)
    series = (decay * np.cos(k * np.pi * x[..., None] / a)).sum(axis=-1)
    return (1.0 + 2.0 * series) / (2.0 * a)


def _component_within(h: np.ndarray, tau: float, a: float) -> np.ndarray:
    """Return the probability C(h) that one component is in [-h, h]."""
    k = np.arange(1, _SERIES_TERMS + 1)
    decay = np.exp(-(np.pi**2) * k**2 * tau) / (k * np.pi)
    series = (decay * np.sin(k * np.pi * h[..., None] / a)).sum(axis=-1)
    return h / a + 2.0 * series


def reflecting_square_diffusion(msd: float, t: float, half_width: float) -> float:
    """Return the D [length^2/time] for which `reflecting_square_msd` at time `t > 0` is `msd`.

    NaN where there is none: `msd` is not positive, or not below its limit 2 a^2/3 by more than
    round-off. docs/theory.md, section 2.

    >>> d = reflecting_square_diffusion(0.5, 1.0, 1.0)
    >>> bool(np.isclose(reflecting_square_msd(1.0, d, 1.0), 0.5))
    True
    """
    from scipy.optimize import brentq

    largest = 4.0 * np.square(half_width) / t  # of D, whose MSD is the limit to round-off
    if not 0.0 < msd < reflecting_square_msd(t, largest, half_width):
        return np.nan

    def excess(diffusion: float) -> float:
        return float(reflecting_square_msd(t, diffusion, half_width)) - msd

    smallest = np.finfo(float).tiny
    return brentq(excess, 0.0, largest, xtol=smallest, rtol=SMALLEST_TOLERANCE)


# --- diffusion between two walls, along the axis at right angles to them


def reflecting_interval_msd(
    half_variance: float, length: float, start: float | None = None
) -> float:
    """Return the MSD [length^2] along one axis of diffusion between two walls `length` apart.

    half_variance: D t [length^2], half the variance without walls. start: distance of the start
    from the first wall [length]; None for the mean over all starts, as many everywhere. At first
    the MSD is 2 D t. It approaches L^2/6 for the mean over starts, L^2/12 from the middle and L^2/3
    from a wall:

        <x> = L/2 - sum_odd 4 L/(k pi)^2 cos(k pi x0/L) e_k
        <x^2> = L^2/3 + sum_k (-1)^k 4 L^2/(k pi)^2 cos(k pi x0/L) e_k
        <(x - x0)^2> = <x^2> - 2 x0 <x> + x0^2,  its mean L^2/6 - sum_odd 16 L^2/(k pi)^4 e_k

    with e_k = exp(-k^2 pi^2 D t/L^2). docs/theory.md, section 2.
    """
    k, decay = _wall_modes(half_variance, length)
    if decay[-1] > _FORGOTTEN_MODE:
        return 2.0 * half_variance
    wave = k * np.pi
    odd = k % 2 == 1
    if start is None:
        modes = 16 * length**2 * decay / wave**4
        return float(length**2 / 6 - modes[odd].sum())
    amplitude = 4 / wave**2 * np.cos(wave * start / length) * decay
    alternating = np.where(odd, -1, 1) * amplitude
    mean = length / 2 - length * amplitude[odd].sum()
    mean_square = length**2 / 3 + length**2 * alternating.sum()
    return float(mean_square - 2 * start * mean + start**2)


def reflecting_interval_slope(
    half_variance: float, length: float, start: float | None = None
) -> float:
    """Return the derivative of `reflecting_interval_msd` by D t: 2 in free space, 0 in the end.

    With the same arguments. Half of it is the factor by which the walls reduce the slope of the
    MSD along this axis:

        -4 sum_k (-1)^k cos(k pi x0/L) e_k - (8 x0/L) sum_odd cos(k pi x0/L) e_k,
        its mean over all starts 16/pi^2 sum_odd e_k/k^2
    """
    k, decay = _wall_modes(half_variance, length)
    if decay[-1] > _FORGOTTEN_MODE:
        return 2.0
    odd = k % 2 == 1
    if start is None:
        return float((16 * decay / (k * np.pi) ** 2)[odd].sum())
    mode = np.cos(k * np.pi * start / length) * decay
    alternating = np.where(odd, 1, -1) * mode
    return float(4 * alternating.sum() - 8 * start / length * mode[odd].sum())


def _wall_modes(half_variance: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers k of the modes between two walls, and their decay exp(-k^2 pi^2 D t/L^2).

    At the earliest times that they describe, D t = 4e-6 L^2, walls reduce the slope of the MSD by
    0.5 % in the mean over all starts.
    """
    k = np.arange(1, 1001)
    return k, np.exp(-(np.pi**2) * k**2 * half_variance / length**2)


# --- from ballistic flight to diffusion


def ballistic_msd(t: Numbers, mean_square_speed: Numbers) -> Broadcast:
    """Return the MSD [length^2] before the first collision, <v0^2> t^2; `mean_square_speed` counts
    both components.

    docs/theory.md, section 4.
    """
    return mean_square_speed * np.square(np.asarray(t, float))


# --- hard disks in equilibrium: Enskog


def contact_value_henderson(packing_fraction: Numbers) -> Broadcast:
    """Return Henderson's contact value g(sigma+) of equal disks; its Z is 2 % too high at a packing
    fraction of 0.65.

    D. Henderson, Mol. Phys. 30, 971 (1975); docs/theory.md, section 3.
    """
    return (1.0 - 7.0 / 16.0 * packing_fraction) / np.square(1.0 - packing_fraction)


def contact_value(packing_fraction: Numbers) -> Broadcast:
    """Return Luding's contact value chi = g(sigma+), the pair correlation function at contact, of
    equal disks.

    Henderson's form less phi^3 / (128 (1 - phi)^4): within 0.1 % of simulations up to a packing
    fraction of 0.65, not applicable to the dense phases above 0.7. S. Luding, Phys. Rev. E 63,
    042201 (2001); docs/theory.md, section 3.
    """
    cube = packing_fraction * np.square(packing_fraction)
    fourth_power = np.square(np.square(1.0 - packing_fraction))
    crowding = cube / (128.0 * fourth_power)
    return contact_value_henderson(packing_fraction) - crowding


def contact_value_crystal(packing_fraction: Numbers) -> Broadcast:
    """Return the contact value chi of a triangular crystal of equal disks, by free volume.

    Z = 1 + 2 phi chi = s/(s - sigma), where neighbours are at the distance s: within 4 % of
    simulations at 0.75 and 0.85; docs/theory.md, section 3. Z. W. Salsburg & W. W. Wood, J. Chem.
    Phys. 37, 798 (1962).

    >>> round(float(contact_value_crystal(0.9)), 1)
    145.2
    """
    gap = np.maximum(1.0 - np.sqrt(packing_fraction / HEXAGONAL_PACKING), SMALLEST_GAP)
    return (1.0 / gap - 1.0) / (2.0 * packing_fraction)


def most_points(size: np.ndarray, distance: float, is_periodic: np.ndarray) -> float:
    """Return an upper bound of the number of points in a rectangle that are at least a distance
    apart; the sides along periodic axes are closed to rings.

    With area A and perimeter P it is 2 A/(sqrt(3) d^2) + P/(2 d) + 1 (N. Oler, Acta Math. 105, 19
    (1961)). Along a periodic axis it holds for any number n of periods, so that per period only the
    terms proportional to n count. In a strip narrower than d, points that follow each other along
    it are sqrt(d^2 - width^2) or more apart.

    >>> round(most_points(np.array([20.0, 0.2]), 1.0, np.array([True, False])), 2)
    20.41
    """
    length = size / distance  # (2,)
    width = length[::-1]  # across it
    has_ends = (~is_periodic).astype(float)
    has_sides = has_ends[::-1]
    area_term = 2 / math.sqrt(3) * length.prod()
    plane_bound = area_term + (length * has_sides).sum() + has_ends.prod()
    is_strip = (has_sides > 0) & (width < 1)
    spacing = np.sqrt(1 - width[is_strip] ** 2)
    strip_bounds = length[is_strip] / spacing + has_ends[is_strip]
    return float(strip_bounds.min(initial=plane_bound))


def dilute_pair_distribution(r: Numbers, diameter: Numbers, packing_fraction: Numbers) -> Broadcast:
    """Return g(r) of equal disks to first order in the density n: 1 + n A(r) beyond contact, 0
    within.

    A(r) is the area within a diameter of both of two points at distance r, 0 from two diameters on:
    a third disk cannot have its centre there. docs/theory.md, section 3.
    """
    half = np.minimum(np.asarray(r, float) / (2 * np.asarray(diameter, float)), 1.0)
    triangle = half * np.sqrt(1.0 - half * half)
    overlap = 2.0 * (np.arccos(half) - triangle)  # A(r) over the squared diameter
    first_order = 4.0 / np.pi * packing_fraction * overlap
    return np.where(np.asarray(r) < diameter, 0.0, 1.0 + first_order)


def contact_value_mixture(
    diameter_i: Numbers, diameter_j: Numbers, number_densities: np.ndarray, diameters: np.ndarray
) -> Broadcast:
    """Return the contact value g_ij of disks of two diameters in a mixture of K species.

    `number_densities` [1/length^2] and `diameters` [length] have shape (K,). For radius ratios
    up to 4 the Z of these values is 0.5 to 1 % too high at a packing fraction of 0.5, and 2 % at
    0.69; equal to `contact_value_henderson` for one species. J. T. Jenkins & F. Mancini, J. Appl.
    Mech. 54, 27 (1987); docs/theory.md, section 3.
    """
    number_densities = np.asarray(number_densities, float)
    diameters = np.asarray(diameters, float)
    covered = np.pi / 4.0 * np.sum(number_densities * diameters**2)
    surface = np.pi / 4.0 * np.sum(number_densities * diameters)
    reduced = diameter_i * diameter_j / (diameter_i + diameter_j)
    free = 1.0 - covered
    return 1.0 / free + 9.0 / 8.0 * reduced * surface / free**2


def compressibility(packing_fraction: Numbers, contact: Numbers) -> Broadcast:
    """Return Z = P/(n kT) = 1 + 2 phi chi of equal disks, the virial theorem in the plane;
    docs/theory.md, section 3.

    `contact` is the contact value chi.
    """
    return 1.0 + 2.0 * packing_fraction * contact


def reduced_mass(mass_a: Numbers, mass_b: Numbers) -> Broadcast:
    """Return mu = m_a m_b/(m_a + m_b) [mass], as light/(1 + light/heavy), which neither over- nor
    underflows.
    """
    light = np.minimum(mass_a, mass_b)
    heavy = np.maximum(mass_a, mass_b)
    return light / (1.0 + light / heavy)


def collision_rate(
    number_density: Numbers,
    distance: Numbers,
    contact: Numbers,
    mass: Numbers,
    temperature: Numbers,
) -> Broadcast:
    """Return the collisions per time [1/time] of one disk with a species in equilibrium, n chi
    sigma sqrt(2 pi kT/mu).

    n is the species' `number_density` [1/length^2], sigma = R_a + R_b the contact `distance`
    [length], chi the `contact` value and mu the reduced `mass`. For equal disks of diameter s it is
    2 n s chi sqrt(pi kT/m). Enskog's theory, S. Chapman & T. G. Cowling, The Mathematical Theory of
    Non-Uniform Gases (1970); docs/theory.md, section 3.
    """
    speed = np.sqrt(2.0 * np.pi) * np.sqrt(temperature) / np.sqrt(mass)
    return number_density * contact * distance * speed


def mean_root_chi_square(degrees: float) -> float:
    """Return the mean of sqrt(X/d), X chi-square with d > 0 `degrees` of freedom: sqrt(2/d)
    Gamma((d+1)/2)/Gamma(d/2).

    This is the mean of sqrt(kT_run/kT) over runs whose kinetic energy has d degrees of freedom,
    about 1 - 1/(4 d). Its inverse is the mean relative speed at fixed energy, divided by that of
    the Maxwell-Boltzmann distribution at the same kT. By its series from d = 128 on, and by
    Gamma(x + 1) = x Gamma(x) below, within 1e-15: `scipy.special.poch` is off by 2e-12 at d = 1e4,
    and takes long to import for engines that need nothing else of SciPy. docs/theory.md, section 3.

    >>> bool(np.isclose(mean_root_chi_square(2), np.sqrt(np.pi) / 2, rtol=1e-15))
    True
    """
    half = degrees / 2.0
    steps = max(0, math.ceil(64.0 - half))
    w = half + steps - 0.25
    u = 1.0 / (w * w)
    series = 1.0 + u * (1 / 64 + u * (-19 / 8192 + u * 631 / 524288))
    ratio = math.sqrt(w) * series  # of Gamma, from 64 on
    for k in reversed(range(steps)):
        ratio *= (half + k) / (half + k + 0.5)
    return ratio / math.sqrt(half)


def enskog_friction(
    number_density: Numbers,
    distance: Numbers,
    contact: Numbers,
    mass: Numbers,
    temperature: Numbers,
) -> Broadcast:
    """Return the friction coefficient zeta = 2 n chi sigma sqrt(2 pi mu kT) [mass/time] of a disk
    in a bath.

    Enskog's theory in the first Sonine order; arguments and source as for `collision_rate`. The
    friction rate gamma = zeta/m_a is exact for the initial decay of the velocity autocorrelation.
    The frictions of several species add up. Enskog's diffusion coefficient is D_E = kT/zeta. It
    describes the times after a few collisions: in the plane the velocity autocorrelation has a 1/t
    tail, so that D(t) goes on rising slowly. docs/theory.md, sections 3 and 4.
    """
    momentum = np.sqrt(2.0 * np.pi) * np.sqrt(mass) * np.sqrt(temperature)
    return 2.0 * number_density * contact * distance * momentum


def enskog_viscosity(
    number_density: float, diameter: float, contact: float, mass: float, temperature: float
) -> float:
    """Return Enskog's shear viscosity [mass/time], 1.022 eta_B (1 + phi chi)^2/chi + n^2 s^3 chi
    sqrt(pi m kT)/4.

    For equal disks of packing fraction phi. eta_B = sqrt(m kT/pi)/(2 s) is Boltzmann's in the first
    Sonine order, n the `number_density` [1/length^2], s the `diameter` [length], chi the `contact`
    value. The first term is the momentum that disks carry, the second that exchanged in collisions.
    Enskog's theory, D. M. Gass, J. Chem. Phys. 54, 1898 (1971); docs/theory.md, section 3.
    """
    crowding = np.pi / 4.0 * number_density * np.square(diameter) * contact
    momentum = np.sqrt(mass * temperature / np.pi)
    boltzmann = momentum / (2.0 * diameter)
    carried = SONINE_VISCOSITY * boltzmann * np.square(1.0 + crowding) / contact
    exchanged = np.square(number_density) * diameter**3 * contact * np.pi * momentum / 4.0
    return float(carried + exchanged)


def pressure_slope(packing_fraction: float) -> float:
    """Return d(phi Z)/d phi of equal disks at constant temperature, Z of `contact_value`."""
    step = 1e-5
    low, high = (
        phi * compressibility(phi, contact_value(phi))
        for phi in (packing_fraction - step, packing_fraction + step)
    )
    return float((high - low) / (2 * step))


def sound_speed(packing_fraction: float, mass: float, temperature: float) -> float:
    """Return the adiabatic speed of sound c [length/time] of equal disks, c^2 = (kT/m) [d(phi
    Z)/d phi + Z^2], with c_V = k for each disk.
    """
    z = compressibility(packing_fraction, contact_value(packing_fraction))
    square = temperature / mass * (pressure_slope(packing_fraction) + z**2)
    return float(np.sqrt(square))


def tail_amplitude(number_density: float, diffusion: float, viscosity: float) -> float:
    """Return t C(t)/C(0) [time] of the velocity autocorrelation C of a disk in an infinite fluid at
    late times, 1/(8 pi n (D + nu)).

    viscosity: the kinematic one, nu [length^2/time]. Mode-coupling theory in two dimensions, M. H.
    Ernst, E. H. Hauge and J. M. J. van Leeuwen, Phys. Rev. Lett. 25, 1254 (1970); docs/theory.md,
    section 4.
    """
    return 1.0 / (8.0 * np.pi * number_density * (diffusion + viscosity))


def mixture_contact_values(number_densities: np.ndarray, diameters: np.ndarray) -> np.ndarray:
    """Return the contact values (K, K) of all pairs of K species, from densities [1/length^2] and
    diameters (K,).

    `contact_value` if all diameters are equal, else `contact_value_mixture`. docs/theory.md,
    section 3.
    """
    number_densities = np.asarray(number_densities, float)
    diameters = np.asarray(diameters, float)
    if np.unique(diameters).size == 1:
        chi = contact_value(np.pi / 4.0 * np.sum(number_densities * diameters**2))
        return np.full((len(diameters), len(diameters)), chi)
    return contact_value_mixture(diameters[:, None], diameters, number_densities, diameters)


def mixture_collision_rates(
    number_densities: np.ndarray, diameters: np.ndarray, masses: np.ndarray, temperature: float
) -> np.ndarray:
    """Return the collisions per time (K, K) [1/time] of one disk of species i with all disks of
    species j.

    Densities [1/length^2], diameters and masses have shape (K,). `collision_rate`; docs/theory.md,
    section 3.
    """
    chi = mixture_contact_values(number_densities, diameters)
    distance = np.add.outer(diameters, diameters) / 2.0
    masses = np.asarray(masses, float)
    mu = reduced_mass(masses[:, None], masses)
    return collision_rate(np.asarray(number_densities, float), distance, chi, mu, temperature)


def mixture_compressibility(number_densities: np.ndarray, diameters: np.ndarray) -> float:
    """Return Z = P/(n kT) = 1 + (pi/2n) sum_ij n_i n_j sigma_ij^2 chi_ij of a mixture of K species.

    The virial theorem in the plane, from densities [1/length^2] and diameters (K,). docs/theory.md,
    section 3.
    """
    n = np.asarray(number_densities, float)
    distance = np.add.outer(diameters, diameters) / 2.0
    pairs = n[:, None] * n * distance**2 * mixture_contact_values(n, diameters)
    return 1.0 + np.pi / 2.0 * pairs.sum() / n.sum()


# --- two uniform points in a box


def pair_distance_density_between(
    r: Numbers, first: tuple[float, float], second: tuple[float, float]
) -> np.ndarray:
    """Return the density [1/length] of the distance of two independent uniform points, one in each
    of two rectangles.

    `first` and `second` are (width, height) of rectangles with the same centre: where the centres
    of disks of two sizes can be between walls. The pair count of an ideal gas there is the number
    of pairs times this density; it normalises g(r). p(r) = 4 r times the integral over a quarter
    circle of directions q of f_x(r cos q) f_y(r sin q), where f is the density of the difference of
    two uniform numbers: constant up to half the difference of the sides, then falling linearly to 0
    at half their sum. Gauss-Legendre quadrature from kink to kink is exact to round-off.
    docs/theory.md, section 3.
    """
    r = np.asarray(r, float)
    d = np.where(r > 0.0, r, 1.0)[..., None]
    width_1, height_1 = first
    width_2, height_2 = second
    kinks_x = np.array([abs(width_1 - width_2), width_1 + width_2]) / 2
    kinks_y = np.array([abs(height_1 - height_2), height_1 + height_2]) / 2
    angles_x = np.arccos(np.minimum(kinks_x / d, 1.0))
    angles_y = np.arcsin(np.minimum(kinks_y / d, 1.0))
    angles = [np.zeros_like(d), angles_x, angles_y, np.full_like(d, np.pi / 2)]
    cuts = np.sort(np.concatenate(angles, axis=-1))[..., None]
    node, weight = leggauss(16)
    wide = np.diff(cuts, axis=-2) / 2
    q = cuts[..., :-1, :] + wide * (node + 1)
    x = _difference_density(d[..., None] * np.cos(q), width_1, width_2)
    y = _difference_density(d[..., None] * np.sin(q), height_1, height_2)
    integral = (weight * wide * x * y).sum(axis=(-2, -1))
    return np.where(r > 0.0, 4.0 * r * integral, 0.0)


def _difference_density(x: np.ndarray, a: float, b: float) -> np.ndarray:
    """Return the density at x >= 0 of the difference of uniform numbers on concentric intervals of
    lengths a and b.
    """
    return np.clip((a + b) / 2 - x, 0.0, min(a, b)) / (a * b)


def pair_distance_probability(
    edges: np.ndarray, first: tuple[float, float], second: tuple[float, float]
) -> np.ndarray:
    """Return the probability (K,) that the distance of two such points is between edges[k] and
    edges[k + 1].

    `edges` has shape (K + 1,). `pair_distance_density_between` is integrated over each bin by
    Gauss's formula with 8 points. As the density has kinks, this is meant for narrow bins: over all
    distances the probabilities of 32 equal bins sum to 1 within 1e-6, those of 2 within 1e-3.
    docs/theory.md, section 3.
    """
    edges = np.asarray(edges, float)
    node, weight = leggauss(8)
    half = np.diff(edges)[:, None] / 2
    r = edges[:-1, None] + half * (node + 1)
    density = pair_distance_density_between(r, first, second)
    return (weight * half * density).sum(axis=-1)


def pair_distance_density_in_channel(
    r: Numbers, length: float, first: float, second: float
) -> np.ndarray:
    """Return the density [1/length] of the distance r <= L/2 of two independent uniform points in a
    channel of `length` L, periodic along it.

    `first` and `second` are the heights a and b of two strips with the same axis, one for each
    point: where the centres of disks of two sizes can be between the walls. The derivative by r of
    `pair_distance_in_channel`: with K(h) = r (h asin(m/r) - r + sqrt(r^2 - m^2)), m = min(h, r),

        p(r) = 4/(L a b) (K((a + b)/2) - K(abs(a - b)/2)).

    docs/theory.md, section 3.
    """

    def within(h: float, r: np.ndarray) -> np.ndarray:
        m = np.minimum(h, r)
        depth = m * m / (r + np.sqrt(r * r - m * m))  # r - sqrt(r^2 - m^2)
        return r * (h * np.arcsin(m / r) - depth)

    return _over_strips(within, r, length, first, second)


def pair_distance_in_channel(r: Numbers, length: float, first: float, second: float) -> np.ndarray:
    """Return the probability that the distance of two such points is at most r <= L/2.

    Along the channel the distance of the nearest images is uniform up to L/2; across it the
    difference u of the two points has the density q(u) of `_difference_density`, constant up to
    abs(a - b)/2 and falling linearly to 0 at (a + b)/2. With m = min(h, r)

        P(r) = 4/L int_0^r q(u) sqrt(r^2 - u^2) du = 4/(L a b) (G((a + b)/2) - G(abs(a - b)/2)),
        G(h) = int_0^m (h - u) sqrt(r^2 - u^2) du
             = h/2 (m sqrt(r^2 - m^2) + r^2 asin(m/r)) - (r^3 - (r^2 - m^2)^(3/2))/3.

    In a channel much narrower than r this is 2 r/L, in one much wider pi r^2/(L h). docs/theory.md,
    section 3.

    >>> round(float(pair_distance_in_channel(0.5, 4.0, 1e-3, 1e-3)), 6)
    0.25
    >>> round(float(pair_distance_in_channel(0.5, 4.0, 100.0, 300.0)) * 1200 / np.pi, 6)
    0.25
    """

    def within(h: float, r: np.ndarray) -> np.ndarray:
        m = np.minimum(h, r)
        s = np.sqrt(r * r - m * m)
        strip = (m * s + r * r * np.arcsin(m / r)) / 2
        cubes = m * m * (r * r + r * s + s * s) / (r + s)  # r^3 - s^3, as r - s = m^2/(r + s)
        return h * strip - cubes / 3

    return _over_strips(within, r, length, first, second)


def _over_strips(
    integral: Callable[[float, np.ndarray], np.ndarray],
    r: Numbers,
    length: float,
    first: float,
    second: float,
) -> np.ndarray:
    """Return 4/(L a b) times the difference of an integral between h = (a + b)/2 and abs(a - b)/2
    at distances r; 0 at r = 0.
    """
    r = np.asarray(r, float)
    distance = np.where(r > 0.0, r, 1.0)
    longest = (first + second) / 2
    flat = abs(first - second) / 2  # up to here the density of the difference is constant
    difference = integral(longest, distance) - integral(flat, distance)
    return np.where(r > 0.0, 4.0 / (length * first * second) * difference, 0.0)


# --- an ideal gas around a disk in a box


def disk_area_in_rectangle(
    r: Numbers, x: Numbers, y: Numbers, width: float, height: float
) -> Broadcast:
    """Return the area [length^2] that a disk of radius `r` >= 0 around (x, y) shares with a
    rectangle around (0, 0).

    The centre may be outside the rectangle. Of N uniform points in the rectangle, N/(width height)
    times the growth of this area from r to r + dr are expected at distances between r and r + dr
    from (x, y). The disk is cut into four quadrants, each bounded by walls at the distances a and
    b. A quadrant has the area of 0 <= u <= min(a, r), 0 <= w <= min(b, sqrt(r^2 - u^2)): a b if the
    corner (a, b) is within the disk, else F(a) + F(b) - pi r^2/4, with the area F(u) = (u sqrt(r^2
    - u^2) + r^2 asin(u/r))/2 of the strip up to u, F(r) for u > r. It is odd in a and in b, so that
    a wall on the other side of the centre subtracts. docs/theory.md, section 3.
    """
    r = np.asarray(r, float)
    square = r**2
    safe = np.where(r > 0.0, r, 1.0)
    excess = np.pi / 8 * square

    def strip(wall: Numbers) -> np.ndarray:  # F less half the area of a quarter disk
        u = np.minimum(np.abs(wall), r)
        triangle = u * np.sqrt(square - u**2)
        sector = square * np.arcsin(u / safe)
        return (triangle + sector) / 2 - excess

    def quadrant(a: Numbers, b: Numbers, strips: np.ndarray) -> np.ndarray:
        is_corner_within = a**2 + b**2 <= square
        return np.where(is_corner_within, a * b, np.sign(a) * np.sign(b) * strips)

    walls_x = [width / 2 - x, width / 2 + x]
    walls_y = [height / 2 - y, height / 2 + y]
    strips_x = [strip(wall) for wall in walls_x]
    strips_y = [strip(wall) for wall in walls_y]
    area: np.ndarray | float = 0.0
    for a, strip_x in zip(walls_x, strips_x, strict=True):
        for b, strip_y in zip(walls_y, strips_y, strict=True):
            area = area + quadrant(a, b, strip_x + strip_y)
    return area
