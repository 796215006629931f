"""Equations (1)-(10) as kernels: against 50 digits, against the note's own formulas, and where
these lose digits.
"""

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest

import naive
from brownpipe.engines.collisions import delay, encounter, exchange, meets, shares, wall_time
from brownpipe.engines.exact.predictions import leave_time

getcontext().prec = 60
EPSILON = 2.0**-52


def exact_time(x, y, u, v, sigma):
    """Eq. (1) with 60 digits, for an approaching pair that is apart; inf if it passes by."""
    x, y, u, v, sigma = map(Decimal, (x, y, u, v, sigma))
    a = u * u + v * v
    b = x * u + y * v
    c = x * x + y * y - sigma * sigma
    root = b * b - a * c
    meets_exactly = b < 0 and root > 0
    return float((-b - root.sqrt()) / a) if meets_exactly else math.inf


def aimed(rng, distance, impact, sigma, speed=1.0):
    """A pair at a distance, of which one flies past the other's centre at `impact`, in a random
    direction.
    """
    angle = rng.uniform(0, 2 * np.pi)
    cos = math.cos(angle)
    sin = math.sin(angle)
    along = math.sqrt(distance**2 - impact**2)
    x = -along * cos - impact * sin
    y = -along * sin + impact * cos
    return x, y, speed * cos, speed * sin, sigma


def pair_time(x, y, u, v, sigma):
    """Time until two disks touch, inf if never, as the engine puts it together."""
    b, c, d = encounter(x, y, u, v, sigma * sigma)
    return delay(b, c, d) if meets(b, d) else math.inf


def test_pair_time_is_eq_1_to_round_off():
    """The relative error of t is 1e-16 times distance / sqrt(sigma^2 - impact^2), for all but the
    last gap.
    """
    rng = np.random.default_rng(0)
    for _ in range(2000):
        sigma = rng.uniform(0.1, 2)
        distance = 10 ** rng.uniform(0.01, 2)
        impact = rng.uniform(-0.999, 0.999)
        speed = 10 ** rng.uniform(-2, 2)
        pair = aimed(rng, sigma * distance, sigma * impact, sigma, speed)
        expected = exact_time(*pair)
        gap = 1 - 1 / distance  # of the path that is left: near contact, t is a small difference
        bound = 8 * EPSILON * distance / math.sqrt(1 - impact**2) / gap
        assert abs(pair_time(*pair) / expected - 1) < bound


@pytest.mark.parametrize("distance", [1.5, 10.0, 1000.0])
def test_no_grazing_hit_is_missed_and_no_miss_is_hit(distance):
    """Impact parameter sigma (1 -+ 1e-12), and the time still right to 1e-4 of the time spent
    inside sigma.

    The cross product is off by 1e-16 distance/sigma, 1e-13 at the most. b^2 - a c from eq. (1) is
    off by 1e-10 at a distance of 1000 sigma and misses half of them.
    """
    rng = np.random.default_rng(2)
    missed = 0
    for _ in range(500):
        hit = aimed(rng, distance, 1 - 1e-12, 1.0)
        miss = aimed(rng, distance, 1 + 1e-12, 1.0)
        time = pair_time(*hit)
        expected = exact_time(*hit)
        assert math.isfinite(time)
        assert math.isfinite(expected)
        assert pair_time(*miss) == math.inf
        assert abs(time - expected) < 1.5e-6 * max(1, distance / 10)
        place, velocity = np.array(hit[:4]).reshape(2, 2, 1)
        missed += bool(np.isinf(naive.pair_time(place, velocity, 1.0)))
    assert (missed > 50) == (distance == 1000.0)  # the formula as printed


def test_an_approaching_pair_in_contact_collides_now_and_a_receding_one_never():
    for overlap in (0.0, 1e-16, 1e-15, 1e-12):
        assert pair_time(0.2 - overlap, 0.0, -1.0, 0.3, 0.2) == 0.0
        assert pair_time(0.2 - overlap, 0.0, 1.0, 0.3, 0.2) == math.inf
    assert pair_time(0.2, 0.0, 0.0, 1.0, 0.2) == math.inf  # sliding
    assert pair_time(0.2, 0.0, 0.0, 0.0, 0.2) == math.inf  # together
    assert pair_time(0.0, 0.0, 0.0, 0.0, 0.2) == math.inf  # a disk and itself
    assert pair_time(1.0, 0.0, 0.0, 0.0, 0.2) == math.inf


def test_wall_time():
    assert wall_time(2.0, 0.5) == wall_time(-2.0, -0.5) == 4.0
    assert wall_time(0.0, 0.5) == 0.0
    assert wall_time(2.0, 0.0) == wall_time(0.0, 0.0) == wall_time(-1e-16, -0.0) == math.inf


def test_a_disk_meets_the_wall_that_it_moves_to():
    """Eq. (4) for a disk of radius 0.5 at the time 10 in a box from 0 to 4: walls stop its centre
    at 0.5 and 3.5.
    """
    walls = (0.0, 4.0, 0.5)
    period = np.zeros((9, 2))
    assert leave_time(None, 1.5, 0.5, 10.0, 4.0, *walls) == (14.0, True)
    assert leave_time(None, 1.5, -0.5, 10.0, 0.0, *walls) == (12.0, True)
    # the edge of its cell comes first
    assert leave_time(None, 1.5, 0.5, 10.0, 2.0, *walls) == (11.0, False)
    assert leave_time(period, 1.5, 0.5, 10.0, 4.0, *walls) == (15.0, False)  # no walls
    assert leave_time(None, 1.5, 0.0, 10.0, 0.0, *walls) == (math.inf, False)
    assert leave_time(None, 3.5, 0.5, 10.0, 4.0, *walls) == (10.0, True)
    # pressed into the wall by round-off: now
    time, wall = leave_time(None, 3.5 + 1e-15, 0.5, 10.0, 4.0, *walls)
    assert 10.0 - 4e-15 < time <= 10.0
    assert wall
    # behind it the wall that it came from
    time, wall = leave_time(None, 0.5 - 1e-15, 0.5, 10.0, 4.0, *walls)
    assert time == pytest.approx(16.0, rel=2 * EPSILON)
    assert wall


def accelerated(velocity, f, whole, rest):
    """A velocity after an impulse along f, whose share is the sum of a whole number and a rest."""
    return tuple(v + whole * each + rest * each for v, each in zip(velocity, f, strict=True))


def after(x, y, a, b, mass_a, mass_b):
    """Velocities after a collision by the kernels, r = (x, y) of b seen from a."""
    f = exchange(x, y, b[0] - a[0], b[1] - a[1])
    whole_a, rest_a, whole_b, rest_b, _ = shares(mass_a, mass_b)
    return accelerated(a, f, whole_a, rest_a), accelerated(b, f, -whole_b, -rest_b)


def test_a_collision_is_that_of_eqs_5_to_8():
    rng = np.random.default_rng(4)
    for _ in range(500):
        r, a, b = rng.standard_normal((3, 2))
        mass_a, mass_b = 10 ** rng.uniform(-3, 3, 2)
        expected = naive.collide(-r, a, b, mass_a, mass_b)
        velocities = after(*r, a, b, mass_a, mass_b)
        np.testing.assert_allclose(velocities, expected, rtol=0, atol=2e-14)


# In 1; floats are integers in these units, and Python is faster with integers than with fractions.
UNITS = 2**400


def in_units(number):
    """A float as an integer, exactly."""
    numerator, denominator = number.as_integer_ratio()
    assert denominator <= UNITS
    return numerator * (UNITS // denominator)


def total(masses, velocities, power):
    """Exact sum of m v, or of m v^2, per component, in UNITS to the power of the number of
    factors.
    """
    total_x, total_y = 0, 0
    for mass, (vx, vy) in zip(masses, velocities, strict=True):
        total_x += in_units(mass) * in_units(vx) ** power
        total_y += in_units(mass) * in_units(vy) ** power
    return [total_x, total_y]


@pytest.mark.parametrize("ratio", [1.0, 2.0, 7.3, 1e3, 1e12])
@pytest.mark.parametrize("heavy_first", [True, False])
def test_a_collision_conserves_momentum_and_energy(ratio, heavy_first):
    """To a few units of round-off, exactly, and without a bias that would add up over many
    collisions.

    The mean over 4,000 collisions has a standard error of 0.014 units; bound: 4.5 of them, false
    alarm 1 in 150,000. Shares that do not add up to 2 in the last bit have means of 0.1 to 0.28
    units.
    """
    rng = np.random.default_rng(5)
    masses = (ratio, 1.0) if heavy_first else (1.0, ratio)
    energies = []
    for _ in range(4000):
        x, y, *v = rng.standard_normal(6).tolist()
        first = [component / math.sqrt(masses[0]) for component in v[:2]]
        second = [component / math.sqrt(masses[1]) for component in v[2:]]
        before = [first, second]
        result = after(x, y, *before, *masses)
        momenta = total(masses, before, 1)
        momenta_after = total(masses, result, 1)
        lost = [abs(p - q) / UNITS**2 for p, q in zip(momenta, momenta_after, strict=True)]
        round_off = EPSILON * math.sqrt(ratio) * max(map(abs, v))
        assert max(lost) < 4 * round_off
        energy = sum(total(masses, before, 2))
        energy_after = sum(total(masses, result, 2))
        energies.append((energy_after - energy) / energy / EPSILON)
    assert np.abs(energies).max() < 10
    standard_error = np.std(energies) / np.sqrt(len(energies))
    assert abs(np.mean(energies)) < 4.5 * standard_error


def test_shares_at_the_limits():
    for mass in (1e-300, 1.0, 1e300 / 4):
        assert shares(mass, mass) == (0.0, 1.0, 2.0, -1.0, mass)
    assert shares(math.inf, 1.0) == (0.0, 0.0, 2.0, 0.0, 2.0)
    assert shares(1.0, math.inf) == (2.0, 0.0, 0.0, 0.0, 2.0)
    whole, part, _, share, impulse = shares(1.0, 1e12)
    assert (whole, part) == (2.0, -share)
    # impulse: twice the reduced mass
    assert (share, impulse) == pytest.approx((2e-12, 2.0), rel=1e-11, abs=0)
