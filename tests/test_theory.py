"""The closed forms against their limits, numerical integrals and independent Monte Carlo.

Monte-Carlo tolerances are 4.5 standard errors: a false alarm in 1 of 150,000 comparisons.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial.hermite import hermgauss
from numpy.polynomial.legendre import leggauss
from scipy.special import eval_genlaguerre, roots_genlaguerre

from brownpipe import theory

SIGMAS = 4.5


def propagator(r, t, diffusion):
    """Return the probability per area [1/length^2] to be at distance `r` from the start after time
    `t > 0`: eq. (11).

    It solves the diffusion equation, eqs. (13)-(16), for a start at the origin, eq. (17).
    """
    square = 4.0 * diffusion * np.asarray(t, float)
    return np.exp(-np.square(r) / square) / (np.pi * square)


def integral(f, low, high, points=20001):
    x = np.linspace(low, high, points)
    return np.trapezoid(f(x), x)


def assert_mean(samples, expected):
    standard_error = samples.std(ddof=1) / np.sqrt(samples.size)
    assert abs(samples.mean() - expected) < SIGMAS * standard_error


# --- diffusion


def square_walkers(rng, tau, runs=200_000):
    """Distances from the centre of runs that diffuse from there in the square of half-width 1,
    reflected exactly.
    """
    free = np.sqrt(2 * tau) * rng.standard_normal((runs, 2))
    x, y = (np.abs((free + 1) % 4 - 2) - 1).T  # by images: fold the plane into the square
    return np.hypot(x, y)


@pytest.mark.parametrize("tau", [0.0067, 0.0069, 0.05, 0.3, 2.0])
def test_radial_law_of_the_reflecting_square(tau):
    """Against 200,000 walkers; at 0.0068 the free law takes over."""
    r = np.array([0.05, 0.2, 0.5, 0.9, 1.0, 1.1, 1.35])
    distance = square_walkers(np.random.default_rng(12), tau)
    share = (distance[:, None] < r).mean(axis=0)
    law = theory.reflecting_square_within(r * 2.7, tau * 2.7**2 / 0.25, 0.25, 2.7)
    standard_error = np.sqrt(law * (1 - law) / 200_000)
    assert (np.abs(share - law) <= SIGMAS * standard_error + 1e-5).all()


def test_radial_law_has_its_limits():
    r = np.linspace(0, 1.5, 31)
    free = theory.reflecting_square_within(r, 0.0068 - 1e-12, 1.0, 1.0)
    first = theory.reflecting_square_within(r, 0.0068 + 1e-12, 1.0, 1.0)
    assert np.abs(free - first).max() < 1e-9  # the law itself moves by 1e-10 between the two times
    last = theory.reflecting_square_within(r, 50.0, 1.0, 1.0)
    inscribed = r <= 1
    assert last[inscribed] == pytest.approx(np.pi * r[inscribed] ** 2 / 4, abs=1e-13)
    assert (last[r >= 1.4143] == 1).all()
    corner = theory.reflecting_square_within(np.sqrt(2) - 1e-9, 50.0, 1.0, 1.0)
    assert corner == pytest.approx(1, abs=1e-12)


@pytest.mark.slow
def test_radial_law_has_the_msd_of_the_square():
    r = np.linspace(0, np.sqrt(2), 2001)
    for tau in (0.003, 0.02, 0.4):
        beyond = 1 - theory.reflecting_square_within(r, tau, 1.0, 1.0)
        msd = theory.reflecting_square_msd(tau, 1.0, 1.0)
        assert np.trapezoid(2 * r * beyond, r) == pytest.approx(msd, rel=1e-5)


def test_diffusion_from_the_msd_in_the_square():
    for diffusion in (1e-3, 0.3, 2.0):
        msd = theory.reflecting_square_msd(1.3, diffusion, 2.7)
        from_msd = theory.reflecting_square_diffusion(msd, 1.3, 2.7)
        assert from_msd == pytest.approx(diffusion, rel=1e-9)
    assert np.isnan(theory.reflecting_square_diffusion(2 * 2.7**2 / 3, 1.3, 2.7))
    assert np.isnan(theory.reflecting_square_diffusion(0.0, 1.3, 2.7))


def test_ring_probability_is_the_integral_of_the_propagator():
    def density(r):
        return propagator(r, 2.0, 0.3) * 2 * np.pi * r

    probability = theory.ring_probability(0.5, 0.9, 2.0, 0.3)
    assert probability == pytest.approx(integral(density, 0.5, 0.9), rel=1e-8)


def test_thin_ring_keeps_its_digits():
    probability = theory.ring_probability(1.0, 1.0 + 1e-9, 0.25, 1.0)
    assert probability == pytest.approx(2e-9 * np.exp(-1), rel=1e-7)


def test_reflecting_square_starts_free_and_ends_uniform():
    early = theory.reflecting_square_msd(1e-9, 0.3, 2.7)
    assert early == pytest.approx(4 * 0.3 * 1e-9, rel=1e-14)
    late = theory.reflecting_square_msd(1e6, 0.3, 2.7)
    assert late == pytest.approx(2 * 2.7**2 / 3, rel=1e-14)
    assert theory.reflecting_square_msd(0.0, 0.3, 2.7) == 0.0


# --- Enskog


def test_contact_values_of_a_thin_gas():
    """B3 = (4/3 - sqrt(3)/pi) B2^2 gives chi = 1 + 1.5640 phi exactly; both forms have 25/16 =
    1.5625 instead.
    """
    phi = 1e-6
    exact = 2 * (4 / 3 - np.sqrt(3) / np.pi)
    for chi in (theory.contact_value(phi), theory.contact_value_henderson(phi)):
        assert (chi - 1) / phi == pytest.approx(exact, rel=1e-3)


def test_mixture_of_one_kind_is_henderson():
    n = 0.6
    s = 0.9
    pure = theory.contact_value_henderson(np.pi / 4 * n * s**2)
    for densities, diameters in (([n], [s]), ([n / 3, 2 * n / 3], [s, s])):
        mixed = theory.contact_value_mixture(s, s, densities, diameters)
        assert mixed == pytest.approx(pure, rel=1e-14)


@pytest.mark.parametrize(("phi", "z", "z_error", "rate", "rate_error"), [
    (0.14, 1.35485, 0.00021, 0.80101, 0.00038),
    (0.50, 4.10536, 0.00220, 7.00997, 0.00421),
])  # fmt: skip
def test_luding_against_simulation(phi, z, z_error, rate, rate_error):
    """Molecular dynamics of 1,024 periodic disks, s = m = temperature = 1; the form itself is good
    to 0.1 %.
    """
    chi = theory.contact_value(phi)
    n = 4 * phi / np.pi
    off_z = theory.compressibility(phi, chi) - z
    assert abs(off_z) < SIGMAS * z_error + 1e-3 * z
    off_rate = theory.collision_rate(n, 1.0, chi, 0.5, 1.0) - rate
    assert abs(off_rate) < SIGMAS * rate_error + 1e-3 * rate


def test_collision_rate_against_free_flight():
    """Rate = n sigma chi times the mean over relative velocities of the swept width 2 |u|, by
    Maxwell sampling.
    """
    rng = np.random.default_rng(13)
    n = 0.5
    sigma = 0.4
    chi = 1.3
    temperature = 1.6
    m_a, m_b = 1.0, 0.4
    size = (200_000, 2)
    velocity_a = rng.normal(0, np.sqrt(temperature / m_a), size)
    velocity_b = rng.normal(0, np.sqrt(temperature / m_b), size)
    speed = np.hypot(*(velocity_a - velocity_b).T)
    reduced_mass = theory.reduced_mass(m_a, m_b)
    expected = theory.collision_rate(n, sigma, chi, reduced_mass, temperature)
    assert_mean(2 * n * sigma * chi * speed, expected)


def test_mean_root_of_a_chi_square():
    """2 degrees: the mean of a Rayleigh variate, sqrt(pi)/2; many: 1 - 1/4d + 1/32d^2. By
    recurrence in between.
    """
    assert theory.mean_root_chi_square(2) == pytest.approx(np.sqrt(np.pi) / 2, rel=1e-14)
    for d in range(2, 50, 2):  # Gamma(x + 1) = x Gamma(x)
        recurrence = (d + 1) / np.sqrt(d * (d + 2))
        expected = theory.mean_root_chi_square(d) * recurrence
        assert theory.mean_root_chi_square(d + 2) == pytest.approx(expected, rel=1e-13)
    two_orders = 1 - 1 / 4000 + 1 / 32e6
    assert theory.mean_root_chi_square(1000) == pytest.approx(two_orders, abs=2e-10)
    assert theory.mean_root_chi_square(2_000_000) == pytest.approx(1 - 1 / 8e6, abs=1e-8)


# --- two sizes of disks


def test_distance_of_points_in_two_rectangles():
    """Against 400,000 pairs of points, in bins up to the farthest distance there is."""
    rng = np.random.default_rng(20)
    first = np.array([4.0, 3.0])
    second = np.array([5.0, 1.0])
    point = (rng.random((400_000, 2)) - 0.5) * first
    partner = (rng.random((400_000, 2)) - 0.5) * second
    distance = np.hypot(*(point - partner).T)
    edges = np.linspace(0, np.hypot(4.5, 2.0), 41)
    expected = 400_000 * theory.pair_distance_probability(edges, first, second)
    assert expected.sum() == pytest.approx(400_000, rel=1e-6)
    counts = np.histogram(distance, edges)[0]
    assert (np.abs(counts - expected) < SIGMAS * np.sqrt(expected) + 2).all()


@pytest.mark.parametrize("heights", [(1.0, 3.0), (0.4, 0.4), (7.0, 9.0), (1e-3, 2.0)])
def test_distance_of_points_in_two_strips_of_a_channel(heights):
    """Against 400,000 pairs of points, in bins up to half the length of the channel, 10."""
    rng = np.random.default_rng(21)
    apart = rng.random(400_000) * 10 % 10
    along = np.minimum(apart, 10 - apart)
    a, b = heights
    across = (rng.random(400_000) - 0.5) * a - (rng.random(400_000) - 0.5) * b
    distance = np.hypot(along, across)
    edges = np.linspace(0, 5, 41)
    expected = 400_000 * np.diff(theory.pair_distance_in_channel(edges, 10.0, a, b))
    counts = np.histogram(distance, edges)[0]
    assert (np.abs(counts - expected) < SIGMAS * np.sqrt(expected) + 2).all()


@pytest.mark.parametrize("heights", [(1.0, 3.0), (0.4, 0.4), (1e-9, 1e-9), (7.0, 9.0)])
def test_density_of_distances_in_a_channel_is_that_of_its_probabilities(heights):
    """By Gauss-Legendre quadrature from kink to kink, which the density has at abs(a - b)/2 and
    (a + b)/2: near them it is no polynomial, to 1e-6.
    """
    a, b = heights
    kinks = [abs(a - b) / 2, (a + b) / 2]
    ends = np.array(sorted([0.0, 5.0, *(kink for kink in kinks if kink < 5)]))
    node, weight = leggauss(100)
    half = np.diff(ends)[:, None] / 2
    r = ends[:-1, None] + half * (node + 1)
    density = theory.pair_distance_density_in_channel(r, 10.0, a, b)
    probability = np.cumsum((weight * half * density).sum(axis=1))
    within = theory.pair_distance_in_channel(ends, 10.0, a, b)
    assert within[0] == 0 == theory.pair_distance_density_in_channel(0.0, 10.0, a, b)
    assert probability == pytest.approx(within[1:], rel=1e-6)


def test_a_channel_is_a_line_or_a_plane_at_distances_much_longer_or_shorter_than_its_height():
    """To round-off, though the difference of two integrals is a 1e-18th of each."""
    r = np.array([1e-3, 0.3, 4.0])
    narrow = theory.pair_distance_in_channel(r, 10.0, 1e-9, 1e-9)
    assert narrow == pytest.approx(2 * r / 10, rel=1e-13, abs=0)
    wide = theory.pair_distance_in_channel(r, 10.0, 20.0, 30.0)
    assert wide == pytest.approx(np.pi * r**2 / (10 * 30), rel=1e-13, abs=0)
    line = theory.pair_distance_density_in_channel(r, 10.0, 1e-9, 1e-9)
    assert line == pytest.approx(0.2, rel=1e-13)


def test_mixture_of_equal_species_is_one_species():
    chi = theory.contact_value(0.3)
    n = 0.3 / (np.pi / 4)
    densities = [n / 3, 2 * n / 3]
    rates = theory.mixture_collision_rates(densities, [1.0, 1.0], [2.0, 2.0], 1.7)
    pure_rate = theory.collision_rate(n, 1.0, chi, 1.0, 1.7)
    assert rates.sum(axis=1) == pytest.approx(pure_rate)
    z = theory.mixture_compressibility(densities, [1.0, 1.0])
    assert z == pytest.approx(1 + 0.6 * chi)


def test_second_virial_coefficient_of_a_mixture():
    """Of 3 and 5 disks in 8, of diameters 1 and 0.4: unlike ones touch at 0.7."""
    weighted_squares = 3 * 3 * 1.0**2 + 2 * 3 * 5 * 0.7**2 + 5 * 5 * 0.4**2
    second = np.pi / 2 * weighted_squares / 8
    z = theory.mixture_compressibility([3e-7, 5e-7], [1.0, 0.4])
    assert (z - 1) * 1e7 == pytest.approx(second, rel=1e-5)


def test_collisions_of_a_mixture_balance():
    """What species i suffers from j, j suffers from i."""
    n = np.array([0.2, 0.5])
    rates = theory.mixture_collision_rates(n, [1.0, 0.4], [3.0, 0.5], 1.1)
    suffered_by_first = n[0] * rates[0, 1]
    suffered_by_second = n[1] * rates[1, 0]
    assert suffered_by_first == pytest.approx(suffered_by_second)


# --- an ideal gas around a disk in a box


def test_area_of_a_disk_within_and_around_a_rectangle():
    """The whole disk, half of it, a quarter, nothing, and the whole rectangle."""
    for centre, r, area in (
        ((0.2, -0.1), 1.3, np.pi * 1.3**2),
        ((2.0, 0.0), 1.0, np.pi / 2),
        ((2.0, -1.5), 1.0, np.pi / 4),
        ((3.5, 0.0), 1.0, 0.0),
        ((0.2, -0.1), 2.8, 12.0),
    ):
        inside = theory.disk_area_in_rectangle(r, *centre, 4.0, 3.0)
        assert inside == pytest.approx(area, rel=1e-14, abs=1e-14)


@pytest.mark.parametrize(
    "is_periodic", [(True, True), (True, False), (False, True), (False, False)]
)
def test_no_rectangle_has_more_points_than_its_bound(is_periodic):
    """Rows of points a distance of 1 apart, every other one shifted by a half, in the smallest
    rectangle that has them: in a row, a zigzag, and a crystal. Of large ones the bound is near.
    """
    up = math.sqrt(3) / 2
    for columns, rows in ((2, 2), (9, 2), (9, 4), (400, 200)):
        shift = 0.0 if is_periodic[0] else 0.5
        width = columns if is_periodic[0] else columns - 1 + shift
        height = up * (rows if is_periodic[1] else rows - 1)
        size = np.array([width, height])
        points = columns * rows
        bound = theory.most_points(2.5 * size, 2.5, np.array(is_periodic))
        assert points <= bound * (1 + 1e-12) < 1.5 * points
        assert columns < 400 or bound < 1.01 * points
    row = np.array([9.0 if is_periodic[0] else 8.0, 0.0])
    if not is_periodic[1]:
        assert theory.most_points(row, 1.0, np.array(is_periodic)) == pytest.approx(9.0)


def test_rings_around_a_uniform_centre_in_a_channel_are_those_of_two_uniform_points():
    """Around a centre that is in the middle of the nearest images, 8 long."""
    edges = np.linspace(0, 4, 13)
    node, weight = leggauss(200)
    y = 3.0 / 2 * node
    area = theory.disk_area_in_rectangle(edges, 0.0, y[:, None], 8.0, 2.4)
    within = np.einsum("i,ik->k", weight / 2, area) / (8.0 * 2.4)
    expected = theory.pair_distance_in_channel(edges, 8.0, 3.0, 2.4)
    # a kink per wall: quadrature is off by some 200^-2
    assert within == pytest.approx(expected, abs=1e-5)


def test_rings_around_a_uniform_centre_are_those_of_two_uniform_points():
    edges = np.linspace(0, 3, 13)
    first, second = (4.0, 3.0), (3.4, 2.4)
    node, weight = leggauss(200)
    x, y = first[0] / 2 * node, first[1] / 2 * node
    area = theory.disk_area_in_rectangle(edges, x[:, None, None], y[:, None], *second)
    mean = np.einsum("i,j,ijk->k", weight / 2, weight / 2, area) / np.prod(second)
    expected = theory.pair_distance_probability(edges, first, second)
    # a kink per wall: quadrature is off by some 200^-2
    assert np.diff(mean) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("light", "heavy"), [(1e-300, 1e-300), (1e-300, 1e300), (1e300, 1e300), (2.0, 3.0)]
)
def test_reduced_mass_friction_and_rate_in_any_units(light, heavy):
    """sqrt(2 pi mu kT) and sqrt(2 pi kT/mu) to 4 units of round-off, where mu kT, kT/mu or m_a m_b
    are no numbers.
    """
    mu = theory.reduced_mass(light, heavy)
    assert mu == theory.reduced_mass(heavy, light)
    exact = Fraction(light) * Fraction(heavy) / (Fraction(light) + Fraction(heavy))
    assert mu == pytest.approx(float(exact), rel=1e-15)
    for temperature in (1e-200, 1.0, 1e200):
        friction = theory.enskog_friction(1.0, 1.0, 1.0, mu, temperature)
        root = math.sqrt(2 * math.pi) * math.sqrt(mu) * math.sqrt(temperature)
        assert friction == pytest.approx(2 * root, rel=1e-15)
        rate = theory.collision_rate(1.0, 1.0, 1.0, mu, temperature)
        root = math.sqrt(2 * math.pi) / math.sqrt(mu) * math.sqrt(temperature)
        assert rate == pytest.approx(root, rel=1e-15)


# --- Enskog's viscosity


def sonine_factors(trial):
    """What two, three and four Sonine orders make of the first, for disks.

    `trial(p, mean, relative)` is the pth trial function, summed over the disks that count.
    Integrals over the mean velocity of a pair, their relative speed s^(1/2), the impact parameter b
    and the direction a of the relative velocity, by Gaussian rules (the direction by the
    trapezoidal rule): exact.
    """
    x, weight_x = hermgauss(9)
    b, weight_b = leggauss(12)
    s, weight_s = roots_genlaguerre(9, 0.5)
    weight = np.einsum("i,j,k,l->ijkl", weight_x, weight_x, weight_s, weight_b)[..., None]
    direction = np.arange(18) * np.pi / 9
    u, v, s, b, a = np.meshgrid(x, x, s, b, direction, indexing="ij")
    deflected = a + np.pi + 2 * np.arcsin(b)
    before = np.sqrt(s) * np.array([np.cos(a), np.sin(a)])
    after = np.sqrt(s) * np.array([np.cos(deflected), np.sin(deflected)])
    change = [trial(p, (u, v), after) - trial(p, (u, v), before) for p in range(4)]
    bracket = np.zeros((4, 4))
    for p, q in np.ndindex(4, 4):
        bracket[p, q] = (weight * change[p] * change[q]).sum()
    inverses = [np.linalg.inv(bracket[:k, :k]) for k in (2, 3, 4)]
    return [bracket[0, 0] * inverse[0, 0] for inverse in inverses]


def disk_of(mean, relative, sign=1):
    """(velocity of a disk) and its square, in units in which the density is exp(-c^2)."""
    velocity = (np.array(mean) + sign * relative) / np.sqrt(2)
    return velocity, (velocity**2).sum(axis=0)


def test_sonine_factors_of_disks():
    """Of viscosity and self-diffusion: exact in the second order, 51/50 and 43/42, and converged in
    the fourth.
    """

    def stress(p, mean, relative):
        total = 0.0
        for sign in (1, -1):
            c, square = disk_of(mean, relative, sign)
            total = total + c[0] * c[1] * eval_genlaguerre(p, 2, square)
        return total

    def current(p, mean, relative):
        c, square = disk_of(mean, relative)
        return c[0] * eval_genlaguerre(p, 1, square)

    for trial, second, converged in (
        (stress, 51 / 50, theory.SONINE_VISCOSITY),
        (current, 43 / 42, theory.SONINE_DIFFUSION),
    ):
        factors = sonine_factors(trial)
        assert factors[0] == pytest.approx(second, rel=1e-12)
        assert factors[2] == pytest.approx(converged, abs=2e-4)


def test_enskog_viscosity_is_that_of_a_thin_gas_and_of_colliding_disks():
    """In a weak shear flow at the rate g a pair at contact has the mean relative velocity g s k_y
    along x.
    """
    n = 0.4
    s = 0.7
    chi = 1.9
    m = 1.3
    kt = 2.1
    kinetic = 1.022 * np.sqrt(m * kt / np.pi) / (2 * s)
    thin = theory.enskog_viscosity(1e-9, s, 1.0, m, kt)
    assert thin == pytest.approx(kinetic, rel=1e-8)
    k = np.arange(64) * 2 * np.pi / 64
    shear = 1e-4
    width = np.sqrt(2 * kt / m)
    mean = shear * s * np.cos(k) * np.sin(k)
    approach = np.linspace(-12 * width, 0, 20001)[:, None]
    density = np.exp(-((approach - mean) ** 2) / (2 * width**2))
    square = np.trapezoid(approach**2 * density, approach, axis=0)
    square /= np.sqrt(2 * np.pi) * width
    over_directions = (np.cos(k) * np.sin(k) * square).sum() * 2 * np.pi / 64
    flux = n**2 * chi * s**2 * m / 2 * over_directions
    carried = kinetic * (1 + np.pi / 4 * n * s**2 * chi) ** 2 / chi
    collisional = theory.enskog_viscosity(n, s, chi, m, kt) - carried
    assert collisional == pytest.approx(-flux / shear, rel=1e-6)
