"""Closed forms that the simulation is compared with: diffusion, Langevin, Enskog, and the ideal gas in a box.

Every function takes scalars or arrays that broadcast against each other and returns the broadcast shape. All quantities
are in the scene's own units of length, time and mass; `temperature` is kT, an energy. "Eq." is an equation of
D. W. Harrison, "Brownian motion simulation" (2020), the note that brownpipe follows.
"""

import math

import numpy as np

# Below this D t / a^2 the walls of a square of half-width a change the MSD by less than round-off: the chance
# erfc(1 / (2 sqrt(0.0068))) to have reached a wall is 1e-17. Above it 24 terms of the series are exact to round-off.
_WALLS_UNSEEN = 0.0068
_SERIES_TERMS = 24
_NODES = 64  # of the quadrature over a quarter of a circle: 1e-15 for the narrowest density of the series


# --- diffusion


def propagator(r, t, diffusion):
    """Probability per area [1/length^2] to be at distance `r` from the start after time `t > 0`; eq. (11).

    It solves the diffusion equation, eqs. (13)-(16), for a start at the origin, eq. (17).
    """
    spread = 4.0 * diffusion * np.asarray(t, float)
    return np.exp(-np.square(r) / spread) / (np.pi * spread)


def diffusive_msd(t, diffusion):
    """Mean squared displacement [length^2] of free diffusion in the plane, 4 D t; eq. (12)."""
    return 4.0 * diffusion * np.asarray(t, float)


def ring_probability(inner, outer, t, diffusion):
    """Probability to end between the radii `inner` and `outer` (may be inf) after time `t > 0`.

    Eq. (18) counts runs between r and r + dr as N rho 2 pi r dr; here the ring is integrated, which is exact for any
    width: exp(-inner^2 / 4Dt) - exp(-outer^2 / 4Dt).
    """
    spread = 4.0 * diffusion * np.asarray(t, float)
    inside, outside = np.square(inner) / spread, np.square(outer) / spread
    return np.exp(-inside) * -np.expm1(inside - outside)


def reflecting_square_msd(t, diffusion, half_width):
    """MSD [length^2] of a diffusing point that starts in the centre of a reflecting square.

    `half_width` is that of the accessible square, a = w - R for a disk of radius R between walls at +-w. The two
    components are independent; each is the cosine series of the diffusion equation on [-a, a],
    <x^2> = a^2/3 + (4 a^2/pi^2) sum_k (-1)^k k^-2 exp(-D k^2 pi^2 t / a^2): 2Dt at first, a^2/3 in the end.
    """
    tau = np.asarray(diffusion * np.asarray(t, float) / np.square(half_width), float)
    k = np.arange(1, _SERIES_TERMS + 1)
    sign = np.where(k % 2, -1.0, 1.0)
    series = (sign / k**2 * np.exp(-(np.pi**2) * k**2 * tau[..., None])).sum(axis=-1)
    component = np.where(tau < _WALLS_UNSEEN, 2.0 * tau, 1.0 / 3.0 + 4.0 / np.pi**2 * series)
    return 2.0 * np.square(half_width) * component


def reflecting_square_within(r, t, diffusion, half_width):
    """Probability to be within `r` (K,) of the centre of a reflecting square after time `t > 0`, from the centre.

    `half_width` a is that of the accessible square. Both components have the density (1 + 2 sum_k cos(k pi x/a)
    exp(-D k^2 pi^2 t/a^2)) / 2a on [-a, a], which integrated over [-h, h] is C(h); so with s^2 = r^2 - a^2, or 0,
    the probability is C(s) + 2 int_s^a p(x) C(sqrt(r^2 - x^2)) dx, here by Gauss-Legendre over the angle. Before
    the walls are seen it is that of free diffusion; 1 from the corners on.
    """
    a, r = half_width, np.atleast_1d(np.asarray(r, float))
    tau = diffusion * t / a**2
    if not tau >= _WALLS_UNSEEN:
        return ring_probability(0.0, r, t, diffusion)
    s = np.sqrt(np.maximum(r**2 - a**2, 0.0))
    first, last = np.arcsin(s / np.maximum(r, a)), np.arcsin(np.minimum(a / np.maximum(r, a), 1.0))
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    angle = first + (last - first) * (node[:, None] + 1) / 2
    inner = _component_density(r * np.sin(angle), tau, a) * _component_within(r * np.cos(angle), tau, a)
    arc = (weight[:, None] * inner * r * np.cos(angle)).sum(axis=0) * (last - first)
    return np.where(r >= np.sqrt(2.0) * a, 1.0, np.minimum(_component_within(s, tau, a) + arc, 1.0))


def _component_density(x, tau, a):
    k = np.arange(1, _SERIES_TERMS + 1)
    decay = np.exp(-(np.pi**2) * k**2 * tau)
    return (1.0 + 2.0 * (decay * np.cos(k * np.pi * x[..., None] / a)).sum(axis=-1)) / (2.0 * a)


def _component_within(h, tau, a):
    k = np.arange(1, _SERIES_TERMS + 1)
    decay = np.exp(-(np.pi**2) * k**2 * tau) / (k * np.pi)
    return h / a + 2.0 * (decay * np.sin(k * np.pi * h[..., None] / a)).sum(axis=-1)


def reflecting_square_diffusion(msd, t, half_width):
    """The D [length^2/time] for which `reflecting_square_msd` at time `t > 0` is `msd`, a number.

    NaN where there is none: `msd` is not positive, or not below 2 a^2/3 by more than round-off, where it ends.
    """
    low, high = 0.0, 4.0 * np.square(half_width) / t
    if not 0.0 < msd < reflecting_square_msd(t, high, half_width):
        return np.nan
    while True:
        middle = (low + high) / 2
        if middle in (low, high):
            return middle
        low, high = (middle, high) if reflecting_square_msd(t, middle, half_width) < msd else (low, middle)


# --- from ballistic flight to diffusion


def ballistic_msd(t, mean_square_speed):
    """MSD [length^2] before the first collision, <v0^2> t^2; `mean_square_speed` counts both components."""
    return mean_square_speed * np.square(np.asarray(t, float))


def langevin_msd(t, friction_rate, initial_square_speed, equilibrium_square_speed):
    """MSD [length^2] of the Langevin equation (Ornstein-Uhlenbeck velocity) in the plane.

    `friction_rate` is gamma [1/time], 0 allowed; the square speeds count both components, `equilibrium_square_speed`
    = 2 kT/m. With e = exp(-gamma t): (v0^2 - v_eq^2) ((1 - e)/gamma)^2 + (2 v_eq^2/gamma) (t - (1 - e)/gamma);
    v0^2 t^2 at first, slope 2 v_eq^2/gamma = 4 kT/(m gamma) in the end.
    """
    t = np.asarray(t, float)
    x = friction_rate * t
    relaxing = np.square(_relaxed(x)) * (initial_square_speed - equilibrium_square_speed)
    return np.square(t) * (relaxing + 2.0 * equilibrium_square_speed * _relaxed_twice(x))


def _relaxed(x):
    """(1 - exp(-x)) / x, 1 at x = 0."""
    safe = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 1.0, -np.expm1(-safe) / safe)


def _relaxed_twice(x):
    """(x - (1 - exp(-x))) / x^2, 1/2 at x = 0; below 0.1 by its power series, where the closed form cancels."""
    small = 0.5 + x * (-1 / 6 + x * (1 / 24 + x * (-1 / 120 + x * (1 / 720 + x * (-1 / 5040 + x * (1 / 40320))))))
    small = small - x**7 / 362880 + x**8 / 3628800
    safe = np.where(np.abs(x) < 0.1, 1.0, x)
    return np.where(np.abs(x) < 0.1, small, (safe + np.expm1(-safe)) / safe**2)


# --- hard disks in equilibrium: Enskog


def contact_value_henderson(packing_fraction):
    """Pair correlation at contact of equal disks; D. Henderson, Mol. Phys. 30, 971 (1975). 2 % high in Z at 0.65."""
    return (1.0 - 7.0 / 16.0 * packing_fraction) / np.square(1.0 - packing_fraction)


def contact_value(packing_fraction):
    """Pair correlation at contact, chi = g(sigma+), of equal disks; S. Luding, Phys. Rev. E 63, 042201 (2001).

    Henderson's form less phi^3 / (128 (1 - phi)^4): within 0.1 % of simulation up to a packing fraction of 0.65, and
    not defined for the dense phases above 0.7.
    """
    crowding = packing_fraction**3 / (128.0 * (1.0 - packing_fraction) ** 4)
    return contact_value_henderson(packing_fraction) - crowding


def contact_value_mixture(diameter_i, diameter_j, number_densities, diameters):
    """Contact value g_ij of disks of two diameters in a mixture; J. T. Jenkins & F. Mancini, J. Appl. Mech. 54 (1987).

    `number_densities` [1/length^2] and `diameters` have one entry per species, shape (K,). About 1 % high for a radius
    ratio of 5; equals `contact_value_henderson` for one species.
    """
    number_densities, diameters = np.asarray(number_densities, float), np.asarray(diameters, float)
    covered = np.pi / 4.0 * np.sum(number_densities * diameters**2)
    surface = np.pi / 4.0 * np.sum(number_densities * diameters)
    reduced = diameter_i * diameter_j / (diameter_i + diameter_j)
    return 1.0 / (1.0 - covered) + 9.0 / 8.0 * reduced * surface / (1.0 - covered) ** 2


def compressibility(packing_fraction, contact):
    """Z = P/(n kT) of equal disks, 1 + 2 phi chi: the virial theorem in the plane."""
    return 1.0 + 2.0 * packing_fraction * contact


def reduced_mass(mass_a, mass_b):
    """mu = m_a m_b / (m_a + m_b) [mass]; m/2 for equal masses. Light/(1 + light/heavy) never over- or underflows."""
    light, heavy = np.minimum(mass_a, mass_b), np.maximum(mass_a, mass_b)
    return light / (1.0 + light / heavy)


def collision_rate(number_density, distance, contact, mass, temperature):
    """Collisions per time [1/time] of one disk with a species of `number_density` [1/length^2] in equilibrium.

    `distance` is the contact distance sigma = R_a + R_b, `contact` its contact value, `mass` the reduced mass:
    n chi sigma sqrt(2 pi kT / mu). For equal disks this is 2 n s chi sqrt(pi kT / m).
    """
    return number_density * contact * distance * (np.sqrt(2.0 * np.pi) * np.sqrt(temperature) / np.sqrt(mass))


def mean_root_chi_square(degrees):
    """Mean of sqrt(X/d), X chi-square with d > 0 `degrees` of freedom: sqrt(2/d) Gamma((d + 1)/2)/Gamma(d/2).

    The mean of sqrt(kT_run/kT) over runs whose kinetic energy has d degrees of freedom, about 1 - 1/(4 d). Its inverse
    is the mean relative speed at fixed energy over that of the Maxwell-Boltzmann distribution of the same kT. A number.
    """
    half = degrees / 2.0
    return math.exp(math.lgamma(half + 0.5) - math.lgamma(half)) / math.sqrt(half)


def enskog_friction(number_density, distance, contact, mass, temperature):
    """Friction coefficient zeta [mass/time] of a disk in a bath, first Sonine order: 2 n chi sigma sqrt(2 pi mu kT).

    Arguments as in `collision_rate`. The friction rate is gamma = zeta/m_a, exact for the initial decay of the velocity
    autocorrelation; for several species the frictions add.
    """
    return 2.0 * number_density * contact * distance * (np.sqrt(2.0 * np.pi) * np.sqrt(mass) * np.sqrt(temperature))


def enskog_diffusion(number_density, distance, contact, mass, temperature):
    """Enskog's diffusion coefficient D_E = kT/zeta [length^2/time].

    It describes the times after a few collisions. In the plane the true D(t) goes on rising slowly (the velocity
    autocorrelation has a 1/t tail), so D_E is a reference for a stated window of time, not a limit.
    """
    return temperature / enskog_friction(number_density, distance, contact, mass, temperature)


def mixture_contact_values(number_densities, diameters):
    """Contact values (K, K) of all pairs of K species: `contact_value` for one, `contact_value_mixture` for several."""
    number_densities, diameters = np.asarray(number_densities, float), np.asarray(diameters, float)
    if np.unique(diameters).size == 1:
        chi = contact_value(np.pi / 4.0 * np.sum(number_densities * diameters**2))
        return np.full((len(diameters), len(diameters)), chi)
    return contact_value_mixture(diameters[:, None], diameters, number_densities, diameters)


def mixture_collision_rates(number_densities, diameters, masses, temperature):
    """Collisions per time (K, K) [1/time] of one disk of species i with all disks of species j; densities (K,)."""
    chi = mixture_contact_values(number_densities, diameters)
    distance = np.add.outer(diameters, diameters) / 2.0
    mu = reduced_mass(np.asarray(masses, float)[:, None], np.asarray(masses, float))
    return collision_rate(np.asarray(number_densities, float), distance, chi, mu, temperature)


def mixture_compressibility(number_densities, diameters):
    """Z = P/(n kT) of a mixture, 1 + (pi/2n) sum_ij n_i n_j sigma_ij^2 chi_ij: the virial theorem in the plane."""
    n, distance = np.asarray(number_densities, float), np.add.outer(diameters, diameters) / 2.0
    pairs = n[:, None] * n * distance**2 * mixture_contact_values(n, diameters)
    return 1.0 + np.pi / 2.0 * pairs.sum() / n.sum()


# --- two uniform points in a box


def pair_distance_density(r, width, height):
    """Probability density [1/length] of the distance of two independent uniform points in a rectangle.

    N (N - 1) times this is the pair count of an ideal gas between walls, the normaliser of g(r) there (`width` and
    `height` are those of the accessible rectangle). Closed form, 0 beyond the diagonal: p(r) = 4 r / (w h)^2 times the
    integral of (w - r cos q)(h - r sin q) over the directions q for which both factors are positive. For r up to the
    side S of a square it is (2 r/S^2)(pi - 4 r/S + r^2/S^2).
    """
    r = np.asarray(r, float)
    inside = (r > 0.0) & (r < np.hypot(width, height))
    d = np.where(inside, r, 1.0)
    first, last = np.arccos(np.minimum(1.0, width / d)), np.arcsin(np.minimum(1.0, height / d))

    def antiderivative(q):
        return width * height * q - height * d * np.sin(q) + width * d * np.cos(q) + 0.5 * (d * np.sin(q)) ** 2

    ring = 4.0 * d / (width * height) ** 2 * (antiderivative(last) - antiderivative(first))
    return np.where(inside, ring, 0.0)


def pair_distance_density_between(r, first, second):
    """The same of one uniform point in a rectangle `first` (width, height) and one in `second`, of the same centre.

    Disks of two sizes between walls have accessible rectangles of two sizes. p(r) = 4 r times the integral over a
    quarter of the directions q of f_x(r cos q) f_y(r sin q), where f is the density of the difference of two uniform
    numbers: flat up to half the difference of the sides, then falling to 0 at half their sum. Integrated from kink to
    kink by Gauss-Legendre, to round-off.
    """
    r = np.asarray(r, float)
    d = np.where(r > 0.0, r, 1.0)[..., None]
    along_x, along_y = (np.array([abs(a - b), a + b]) / 2 for a, b in zip(first, second, strict=True))
    kinks = [np.arccos(np.minimum(along_x / d, 1.0)), np.arcsin(np.minimum(along_y / d, 1.0))]
    ends = np.zeros_like(d), np.full_like(d, np.pi / 2)
    cuts = np.sort(np.concatenate([ends[0], *kinks, ends[1]], axis=-1))[..., None]
    node, weight = np.polynomial.legendre.leggauss(16)
    wide = np.diff(cuts, axis=-2) / 2
    q = cuts[..., :-1, :] + wide * (node + 1)
    x = _difference_density(d[..., None] * np.cos(q), first[0], second[0])
    y = _difference_density(d[..., None] * np.sin(q), first[1], second[1])
    return np.where(r > 0.0, 4.0 * r * (weight * wide * x * y).sum(axis=(-2, -1)), 0.0)


def _difference_density(x, a, b):
    """Density at x >= 0 of the difference of uniform numbers on intervals of lengths a and b with the same middle."""
    return np.clip((a + b) / 2 - x, 0.0, min(a, b)) / (a * b)


def pair_distance_probability(edges, first, second):
    """Probability (K,) that two such points are at a distance between edges[k] and edges[k + 1]."""
    edges = np.asarray(edges, float)
    node, weight = np.polynomial.legendre.leggauss(8)
    half = np.diff(edges)[:, None] / 2
    r = edges[:-1, None] + half * (node + 1)
    return (weight * half * pair_distance_density_between(r, first, second)).sum(axis=-1)


# --- an ideal gas around a disk in a box


def disk_area_in_rectangle(r, x, y, width, height):
    """Area [length^2] that a disk of radius `r` >= 0 around (x, y) shares with a rectangle around (0, 0).

    N times its growth from r to r + dr, over width * height, is how many of N uniform points of the rectangle are at
    such distances from (x, y), which may be outside. The sum over the four quadrants of the disk, with walls at (a, b),
    of the integral over 0 <= u <= min(a, r) of min(b, sqrt(r^2 - u^2)): a b if the corner is within the disk, else
    F(a) + F(b) - pi r^2/4, with F(u) = (u sqrt(r^2 - u^2) + r^2 asin(u/r))/2 the area up to u, all of it from r on.
    Odd in a and in b, so that a wall on the far side takes away.
    """
    r = np.asarray(r, float)
    square, safe = r**2, np.where(r > 0.0, r, 1.0)
    excess = np.pi / 8 * square

    def less_half(wall):  # F less half a quarter of the disk
        u = np.minimum(abs(wall), r)
        return (u * np.sqrt(square - u**2) + square * np.arcsin(u / safe)) / 2 - excess

    def quadrant(a, b, half_a, half_b):
        return np.where(a**2 + b**2 <= square, a * b, np.sign(a) * np.sign(b) * (half_a + half_b))

    across, along = ([(d, less_half(d)) for d in (s / 2 - at, s / 2 + at)] for s, at in ((width, x), (height, y)))
    return sum(quadrant(a, b, half_a, half_b) for a, half_a in across for b, half_b in along)
