"""The pressure of the hard-disk fluid, as published, and in a periodic box of N disks.

The density is n s^2, with n = N/A disks of diameter s per area; the packing fraction is phi = pi n
s^2/4.
"""

import numpy as np
from numpy.polynomial import Polynomial
from xarray import DataArray, Dataset

CLISBY = "Clisby and McCoy (2006)"
KOLAFA = "Kolafa and Rottner (2006)"

# B_k/B_2^(k-1), k = 1 to 10, with B_2 = 2 in units of the area of a disk: exact to B_4, then Clisby
# and McCoy, table 1
VIRIAL_COEFFICIENTS = (
    1.0,
    1.0,
    4 / 3 - np.sqrt(3) / np.pi,
    2 - 9 * np.sqrt(3) / (2 * np.pi) + 10 / np.pi**2,
    0.33355604,
    0.1988425,
    0.1148728,
    0.0649930,
    0.0362193,
    0.0199537,
)
VIRIAL_ERRORS = (0.0, 0.0, 0.0, 0.0, 1e-8, 42e-7, 43e-7, 34e-7, 35e-7, 80e-7)  # standard errors
SERIES_UP_TO = 0.3  # density up to which the virial series to B_10 serves as published pressure

# Kolafa and Rottner, table 1: density, Z and its standard error, corrected for finite size
MOLECULAR_DYNAMICS = {
    0.40: (2.1514393, 5.2e-6),
    0.45: (2.4276680, 6.5e-6),
    0.50: (2.7601235, 7.9e-6),
    0.55: (3.1647878, 9.8e-6),
    0.60: (3.663691, 12e-6),
    0.65: (4.287926, 15e-6),
    0.70: (5.082362, 19e-6),
    0.75: (6.113391, 26e-6),
    0.80: (7.476491, 36e-6),
    0.83: (8.494891, 50e-6),
    0.84: (8.866011, 59e-6),
    0.85: (9.245785, 72e-6),
    0.86: (9.621609, 82e-6),
    0.87: (9.96782, 13e-5),
    0.88: (10.2309, 3e-4),
    0.89: (10.3176, 11e-4),
}

# Kolafa and Rottner, section 3.2, fit up to the density 0.90: coefficients of powers of x = phi/(1
# - phi) in Z
_FIT = {
    0: 1.0,
    1: 2.0,
    2: 1.12801775,
    3: 0.00181895291,
    4: -0.0526134737,
    5: 0.0504960168,
    6: -0.0325537792,
    7: 0.0134578632,
    8: 0.00140888182,
    9: -0.00834273601,
    10: 0.00694127367,
    11: -0.00262254723,
    12: 0.000355746352,
    22: -5.24672938e-9,
    57: 5.88054639e-23,
}
FIT = Polynomial([_FIT.get(power, 0.0) for power in range(58)])


def series(phi: np.ndarray | float) -> np.ndarray:
    """Return Z of the virial series to B_10."""
    return Polynomial(VIRIAL_COEFFICIENTS)(2 * np.asarray(phi))


def fit(phi: np.ndarray | float) -> np.ndarray:
    """Return Z of the equation of state of Kolafa and Rottner."""
    phi = np.asarray(phi)
    return FIT(phi / (1 - phi))


def published(density: float) -> tuple[float, float, str]:
    """Return Z, its standard error and its source; KeyError at a density that is not in the table.

    At low densities the error is that of the coefficients and of the remainder of the virial
    series, if its coefficients continue to fall by the ratio of the last two: less than 1e-5.
    """
    if density > SERIES_UP_TO:
        return *MOLECULAR_DYNAMICS[density], KOLAFA
    powers = (np.pi / 2 * density) ** np.arange(len(VIRIAL_COEFFICIENTS))
    before, last = (powers * VIRIAL_COEFFICIENTS)[-2:]
    error = np.sqrt(np.sum(np.square(powers * VIRIAL_ERRORS)) + (last**2 / (before - last)) ** 2)
    return float(series(np.pi / 4 * density)), float(error), CLISBY


def finite_size(phi: np.ndarray | float, n: np.ndarray | int) -> np.ndarray:
    """Return Z_N - Z, the effect of a fixed number of disks N on the pressure in a periodic box, to
    first order in 1/N.

    The configurations of a box of N disks are those of the canonical ensemble. The grand canonical
    sum over N at its saddle point gives ln Q_N = ln Xi - N ln z - ln(2 pi N S_0)/2 with N S_0 the
    variance of N, 1/S_0 = d(phi Z)/d phi; its derivative with respect to the area is Z_N = Z +
    (phi/2N) d ln S_0/d phi. In x = phi/(1 - phi),
    1/S_0 = Z + x (1 + x) dZ/dx.
    """
    x = np.asarray(phi) / (1 - np.asarray(phi))
    weight = Polynomial([0.0, 1.0, 1.0])
    stiffness = FIT + weight * FIT.deriv()
    return -weight(x) * stiffness.deriv()(x) / stiffness(x) / (2 * np.asarray(n))


def cases(data: Dataset) -> Dataset:
    """Return the cases of a study of one engine along one dimension, with their density; without
    empty ones.
    """
    one = data.isel(engine=0, drop=True).stack(case=["scene", "particles"], create_index=False)
    one = one.isel(case=np.flatnonzero(np.isfinite(one.packing_fraction.values)))
    return one.assign(
        density=DataArray(np.round(4 / np.pi * one.packing_fraction.values, 6), dims="case")
    )
