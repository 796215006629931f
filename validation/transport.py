"""Equal hard disks of diameter, mass and kT 1: transport coefficients of Enskog's theory, sound,
the long-time tail.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from brownpipe import theory


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
        return theory.tail_amplitude(self.density, self.diffusion, self.viscosity)

    def crossing(self, particles: int) -> float:
        """Return the time that sound takes across the periodic square box of so many disks."""
        return np.sqrt(particles / self.density) / self.sound


def fluid(phi: float) -> Fluid:
    """Return the fluid of a packing fraction; contact values of Luding's equation of state."""
    n, chi = 4 * phi / np.pi, theory.contact_value(phi)
    return Fluid(
        phi,
        n,
        rate=theory.collision_rate(n, 1.0, chi, 0.5, 1.0),
        diffusion=theory.SONINE_DIFFUSION / theory.enskog_friction(n, 1.0, chi, 0.5, 1.0),
        viscosity=theory.enskog_viscosity(n, 1.0, chi, 1.0, 1.0) / n,
        sound=theory.sound_speed(phi, 1.0, 1.0),
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
    return -phi * (low - 2 * middle + high) / step**2 / (2 * particles * theory.pressure_slope(phi))
