"""Equal hard disks of diameter, mass and kT 1: transport coefficients of Enskog's theory, sound, the long-time tail."""

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
        """Return t C(t) of mode-coupling theory at late times, 1/(8 pi n (D + nu)), with C(0) = 1."""
        return 1 / (8 * np.pi * self.density * (self.diffusion + self.viscosity))

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
        sound=np.sqrt(_slope_of_pressure(phi) + theory.compressibility(phi, chi) ** 2),
    )


def _slope_of_pressure(phi: float) -> float:
    """Return d(phi Z)/d phi at constant temperature. With c_V = k per disk, c^2 = (kT/m) [d(phi Z)/d phi + Z^2]."""
    step = 1e-5
    low, high = (x * theory.compressibility(x, theory.contact_value(x)) for x in (phi - step, phi + step))
    return (high - low) / (2 * step)
