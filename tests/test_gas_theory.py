"""The theory of thin gases that validation/ compares with: kinetic theory of a tracer, density in front of a wall."""

import numpy as np
import pytest

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
