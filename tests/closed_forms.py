"""Closed forms that only tests need, to compare the package with: eq. (11), the Langevin MSD, distances in a rectangle.

Units and broadcasting as in `brownpipe.theory`.
"""

import numpy as np


def propagator(r, t, diffusion):
    """Return the probability per area [1/length^2] to be at distance `r` from the start after time `t > 0`: eq. (11).

    It solves the diffusion equation, eqs. (13)-(16), for a start at the origin, eq. (17).
    """
    square = 4.0 * diffusion * np.asarray(t, float)
    return np.exp(-np.square(r) / square) / (np.pi * square)


def langevin_msd(t, friction_rate, initial_square_speed, equilibrium_square_speed):
    """Return the MSD [length^2] of the Langevin equation, G. E. Uhlenbeck & L. S. Ornstein, Phys. Rev. 36, 823 (1930).

    In the plane; square speeds count both components. `friction_rate` is gamma [1/time], 0 allowed, and
    `equilibrium_square_speed` 2 kT/m. With e = exp(-gamma t): (v0^2 - v_eq^2) ((1 - e)/gamma)^2 + (2 v_eq^2/gamma)
    (t - (1 - e)/gamma); v0^2 t^2 at first, slope 2 v_eq^2/gamma = 4 kT/(m gamma) in the end.
    """
    t = np.asarray(t, float)
    x = friction_rate * t
    relaxing = np.square(_relaxed(x)) * (initial_square_speed - equilibrium_square_speed)
    return np.square(t) * (relaxing + 2.0 * equilibrium_square_speed * _relaxed_twice(x))


def _relaxed(x):
    """Return (1 - exp(-x))/x, 1 at x = 0."""
    safe = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 1.0, -np.expm1(-safe) / safe)


def _relaxed_twice(x):
    """Return (x - (1 - exp(-x)))/x^2, 1/2 at x = 0; below 0.1 by its power series, where the closed form cancels."""
    small = 0.5 + x * (-1 / 6 + x * (1 / 24 + x * (-1 / 120 + x * (1 / 720 + x * (-1 / 5040 + x * (1 / 40320))))))
    small = small - x**7 / 362880 + x**8 / 3628800
    safe = np.where(np.abs(x) < 0.1, 1.0, x)
    return np.where(np.abs(x) < 0.1, small, (safe + np.expm1(-safe)) / safe**2)


def pair_distance_density(r, width, height):
    """Return the density [1/length] of the distance of two independent uniform points in one rectangle.

    0 beyond the diagonal: p(r) = 4 r/(w h)^2 times the integral of (w - r cos q)(h - r sin q) over the directions q for
    which both factors are positive. For r up to the side S of a square it is (2 r/S^2)(pi - 4 r/S + r^2/S^2).
    """
    r = np.asarray(r, float)
    inside = (r > 0.0) & (r < np.hypot(width, height))
    d = np.where(inside, r, 1.0)
    first, last = np.arccos(np.minimum(1.0, width / d)), np.arcsin(np.minimum(1.0, height / d))

    def antiderivative(q):
        return width * height * q - height * d * np.sin(q) + width * d * np.cos(q) + 0.5 * (d * np.sin(q)) ** 2

    ring = 4.0 * d / (width * height) ** 2 * (antiderivative(last) - antiderivative(first))
    return np.where(inside, ring, 0.0)
