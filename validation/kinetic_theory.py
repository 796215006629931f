"""Kinetic theory of a disk in a bath, beyond Enskog's friction. Diameter, mass and kT of the bath
are 1.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import eval_genlaguerre

from brownpipe import theory

TERMS = 8  # Sonine polynomials; D of a disk of mass 1 changes by 1e-4 from 3 to 8
NODES = 20  # of each Gaussian quadrature; exact for these polynomials


def velocity_modes(mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Return decay rates (K,), in units of Enskog's friction rate, and weights (K,) of the velocity
    autocorrelation.

    The Lorentz-Boltzmann equation of a disk of this mass in a bath in equilibrium, on the functions
    v S_k(m v^2/2kT) with the Sonine polynomials S_k of index 1. In a collision the component u of v
    along the line of centres becomes u - (2 mu/m) g, g the relative velocity along it, by which
    collisions are weighted; the other component y stays. The matrix has the means of |g| (change of
    function j) . (change of function k) for Gaussian g, y and that part of u that is independent of
    g. In the first order there is one rate, that of Enskog's friction. Contact values scale all
    rates alike: this is Enskog's theory, too.
    """
    mu = theory.reduced_mass(mass, 1.0)
    z, of_z = np.polynomial.laguerre.laggauss(NODES)  # z = mu g^2/2
    x, of_x = np.polynomial.hermite_e.hermegauss(NODES)
    g = np.sqrt(2 * z / mu)[:, None, None]
    before = mu / mass * g + (np.sqrt((1 - mu / mass) / mass) * x)[:, None]
    after, y = before - 2 * mu / mass * g, np.sqrt(1 / mass) * x
    weight = of_z[:, None, None] * of_x[:, None] * of_x
    changes = []
    for k in range(TERMS):
        first, last = (
            eval_genlaguerre(k, 1, mass * (u**2 + y**2) / 2) / np.sqrt(k + 1)
            for u in (before, after)
        )
        changes.append((after * last - before * first, y * (last - first)))
    matrix = np.array(
        [[(weight * (a[0] * b[0] + a[1] * b[1])).sum() for b in changes] for a in changes]
    )
    rates, vectors = np.linalg.eigh(matrix / matrix[0, 0])
    return rates, vectors[0] ** 2


def correlation(mass: float, time: np.ndarray | float) -> np.ndarray:
    """Return the normalised velocity autocorrelation at times (T,) in units of the inverse of
    Enskog's friction.
    """
    rates, weights = velocity_modes(mass)
    return (weights * np.exp(-rates * np.asarray(time)[..., None])).sum(axis=-1)


def energy_decay(
    times: np.ndarray, energy: float, bath: float, number: int, mass: float, rate_factor: float
) -> np.ndarray:
    """Return the mean energy (T,) of a hot disk of this mass among `number` disks of mean energy
    `bath` each.

    For velocities that stay Maxwellian at two temperatures the energy goes over at the rate
    4 n chi sigma sqrt(2 pi (T_a/m_a + T_b/m_b)) mu/(m_a + m_b) (T_a - T_b), exact at first.
    `rate_factor` is
    n chi sigma. The sum of all energies is kept. For T_a near T_b the excess decays at 2 gamma
    m_a/(m_a + m_b), gamma Enskog's friction rate.
    """
    mu, total = theory.reduced_mass(mass, 1.0), energy + number * bath

    def change(_: float, hot: np.ndarray) -> np.ndarray:
        cold = (total - hot) / number
        speed = np.sqrt(2 * np.pi * (hot / mass + cold))
        return -4 * rate_factor * speed * mu / (mass + 1) * (hot - cold)

    return solve_ivp(change, (0.0, times[-1]), [energy], t_eval=times, rtol=1e-8).y[0]
