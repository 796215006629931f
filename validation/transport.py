"""Equal hard disks of diameter, mass and kT 1: transport coefficients of Enskog's theory, sound,
the long-time tail.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from brownpipe import theory

# Factors by which all further Sonine orders correct the first, for equal disks: of the viscosity of
# a dilute gas, of D
SONINE_VISCOSITY = 1.022
SONINE_DIFFUSION = 1.027


class Fluid(NamedTuple):
    """A fluid of packing fraction phi in reduced units."""

    phi: float
    density: float  # n, disks per area
    rate: float  # collisions of a disk per time
    diffusion: float  # D of Enskog's theory, all Sonine orders
    viscosity: float  # kinematic, Enskog's theory
    sound: float  # adiabatic speed of sound

    @property
    def tail(self) -> float:
        """Return t C(t) of mode-coupling theory at late times, 1/(8 pi n (D + nu)), with C(0) =
        1.
        """
        return 1 / (8 * np.pi * self.density * (self.diffusion + self.viscosity))

    def crossing(self, particles: int) -> float:
        """Return the time that sound takes across the periodic square box of so many disks."""
        return np.sqrt(particles / self.density) / self.sound


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
    carried = SONINE_VISCOSITY * momentum / (2.0 * diameter) * np.square(1.0 + crowding) / contact
    return (
        carried
        + np.pi
        / 4.0
        * np.square(number_density)
        * diameter
        * np.square(diameter)
        * contact
        * momentum
    )


def fluid(phi: float) -> Fluid:
    """Return the fluid of a packing fraction; contact values of Luding's equation of state."""
    n, chi = 4 * phi / np.pi, theory.contact_value(phi)
    return Fluid(
        phi,
        n,
        rate=theory.collision_rate(n, 1.0, chi, 0.5, 1.0),
        diffusion=SONINE_DIFFUSION / theory.enskog_friction(n, 1.0, chi, 0.5, 1.0),
        viscosity=enskog_viscosity(n, 1.0, chi, 1.0, 1.0) / n,
        sound=np.sqrt(_slope_of_pressure(phi) + theory.compressibility(phi, chi) ** 2),
    )


def displacement(phi: float, t: float) -> float:
    """Return MSD/4t of Enskog's theory: D [1 - (1 - exp(-x))/x], x = t/D, that of an exponential
    C(t).
    """
    d = fluid(phi).diffusion
    return d * (1 + np.expm1(-t / d) * d / t)


def fixed_number(mean: Callable[[float], float], phi: float, particles: int) -> float:
    """Return what a fixed number of disks N adds to a mean over disks, -(phi S_0/2N) d^2(phi
    mean)/d phi^2.

    `mean` is that of infinitely many disks at a packing fraction. If the number varies as in the
    grand canonical ensemble, with the variance N S_0, 1/S_0 = d(phi Z)/d phi, the sum over all
    disks has no term in 1/N. For the mean Z this is `pressure.finite_size`.
    """
    step = 1e-3
    low, middle, high = (x * mean(x) for x in (phi - step, phi, phi + step))
    return -phi * (low - 2 * middle + high) / step**2 / (2 * particles * _slope_of_pressure(phi))


def _slope_of_pressure(phi: float) -> float:
    """Return d(phi Z)/d phi at constant temperature. With c_V = k per disk, c^2 = (kT/m) [d(phi
    Z)/d phi + Z^2].
    """
    step = 1e-5
    low, high = (
        x * theory.compressibility(x, theory.contact_value(x)) for x in (phi - step, phi + step)
    )
    return (high - low) / (2 * step)
