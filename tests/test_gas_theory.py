"""The theory of thin gases that validation/ compares with: kinetic theory of a tracer, density in front of a wall."""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe import theory
from validation.kinetic_theory import correlation, energy_decay, velocity_modes
from validation.pressure import VIRIAL_COEFFICIENTS
from validation.walls import gas_profile


def test_density_at_a_wall_is_the_virial_series_of_the_pressure():
    n = 0.05
    series = n * (1 + np.pi / 2 * n + VIRIAL_COEFFICIENTS[2] * (np.pi / 2 * n) ** 2)
    at_wall, far = gas_profile(np.array([0.0, 3.0]), n)
    assert at_wall - series == pytest.approx(0.0, abs=1e-3 * n**3)
    assert far - n == pytest.approx(0.0, abs=1e-3 * n**3)


def test_velocity_autocorrelation_begins_with_enskogs_friction_and_gives_all_sonine_orders_of_the_diffusion():
    rates, weights = velocity_modes(1.0)
    assert weights.sum() == pytest.approx(1.0)
    assert (rates * weights).sum() == pytest.approx(1.0)
    assert (weights / rates).sum() == pytest.approx(theory.SONINE_DIFFUSION, abs=2e-4)
    assert correlation(100.0, 1.0) == pytest.approx(np.exp(-1), rel=1e-5)


@pytest.mark.parametrize("mass", [1.0, 20.0])
def test_energy_near_equilibrium_decays_at_twice_the_friction_over_one_plus_the_inverse_mass(mass):
    friction = theory.enskog_friction(1.0, 1.0, 1.0, theory.reduced_mass(mass, 1.0), 1.0) / mass
    rate = 2 * friction / (1 + 1 / mass)
    start, late = energy_decay(np.array([0.0, 1 / rate]), 1.001, 1.0, 10**9, mass, 1.0)
    assert (late - 1) / (start - 1) == pytest.approx(np.exp(-1), rel=1e-3)


def test_first_order_of_the_pair_distribution_is_the_area_from_which_both_exclude_a_third():
    """By summing over a grid of places of the third disk; its contact value gives the third virial coefficient."""
    x, y = np.meshgrid(np.linspace(-1, 2.5, 1401), np.linspace(-1, 1, 801))
    for r in (1.0, 1.3, 1.9, 2.0, 2.4):
        both = (np.hypot(x, y) < 1) & (np.hypot(x - r, y) < 1)
        area = both.sum() * 0.0025**2
        assert theory.dilute_pair_distribution(r, 1.0, np.pi / 4) - 1 == pytest.approx(area, abs=2e-3)
    z3 = 2 * (theory.dilute_pair_distribution(0.7, 0.7, 1.0) - 1)  # of phi^2 in Z = 1 + 2 phi g
    assert z3 == pytest.approx(VIRIAL_COEFFICIENTS[2] * 4, rel=1e-6)
    assert theory.dilute_pair_distribution(0.69, 0.7, 0.1) == 0


@pytest.mark.slow
def test_dilute_disks_have_the_pair_distribution_of_first_order():
    """The size of the correlation within two diameters over that of theory: 1 within four standard errors of 10 %."""
    number, phi = 1000, 0.05
    side = np.sqrt(number * np.pi / 4 / phi)
    scene = bp.Scene(
        box={"x": (0, side), "y": (0, side), "boundary": "periodic"},
        disks={"species": [{"name": "disks", "count": number, "radius": 0.5, "mass": 1.0}]},
        velocities={"temperature": 1.0},
        equilibrate={"time": 5.0, "tracer": "free"},
        duration=100.0,
        sample_interval=5.0,
    )
    runs = bp.simulate(scene, 20, observables=["pair_distribution"], quiet=True)
    result = bp.analyse(runs, quiet=True).squeeze()
    near = result.isel(distance=(result.distance.values > 1) & (result.distance.values < 2))
    expected = theory.dilute_pair_distribution(near.distance.values, 1.0, phi) - 1
    weights = expected * near.distance.values / (expected**2 * near.distance.values).sum()
    size = (weights * (near.pair_distribution.values - 1)).sum()
    error = np.hypot.reduce(weights * near.pair_distribution_standard_error.values)
    assert error < 0.12 and abs(size - 1) < 4 * error
