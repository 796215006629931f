"""Published pressures of the hard-disk fluid, and the effect of a fixed number of disks on them."""

import numpy as np
import pytest

from validation.pressure import MOLECULAR_DYNAMICS, VIRIAL_COEFFICIENTS, finite_size, fit, published, series


def test_table_and_fit_of_the_same_paper_agree():
    """A wrong digit in either would show; chi-square of 16 values, less than 40 with probability 0.9992."""
    residuals = [(z - fit(np.pi / 4 * density)) / error for density, (z, error) in MOLECULAR_DYNAMICS.items()]
    assert np.sum(np.square(residuals)) < 40
    assert np.max(np.abs(residuals)) < 3


@pytest.mark.parametrize("density", [0.1, 0.2, 0.3])
def test_virial_series_agrees_with_the_fit_to_its_remainder(density):
    z, remainder, _ = published(density)
    assert fit(np.pi / 4 * density) == pytest.approx(z, abs=2 * remainder + 1e-8)
    assert remainder < 1e-5
    assert float(series(np.pi / 4 * density)) == z


def test_effect_of_a_fixed_number_of_disks_is_that_of_the_virial_series():
    """The canonical partition function of N disks gives (1 - 1/N) B_2 n + [(1 - 1/N)(1 - 2/N) B_3 + ...] n^2 + ..."""
    phi, b3 = np.array([1e-3, 2e-3]), VIRIAL_COEFFICIENTS[2]
    in_density = -2 * phi + (2 - 3 * b3) * (2 * phi) ** 2
    assert 100 * finite_size(phi, 100) == pytest.approx(in_density, abs=20 * phi[-1] ** 3)
