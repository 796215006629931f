"""Equations (1)-(10) of the note as scalar kernels, in the form that survives finite precision.

Everything here takes and returns plain numbers: positions and velocities of one disk, or of a pair, in any units.
"""

import math

from brownpipe.engines.kernels import kernel

# At contact x*x + y*y is sigma^2 but for its last bits. Floating-point numbers lie twice as far apart just above a
# power of two as just below it. There, at sigma = 1 for instance, the sum is rounded to one side on average, and every
# collision changes the energy by the same 3e-17 kT. The factor takes powers of two off that edge, and as a simple
# fraction it keeps collisions exact whose numbers are simple fractions.
OFF_POWERS_OF_TWO = 0.75


@kernel
def encounter(x, y, u, v, sigma):
    """Return (b, c, d) of the quadratic behind eqs. (1)-(3), for r = (x, y) and v = (u, v) of b seen from a.

    b = r.v, c = r.r - sigma^2, and d = v.v sigma^2 - (r x v)^2, which equals b^2 - v.v c.  Written with the cross
    product it loses a factor abs(r)/sigma less to cancellation, at the same cost.
    """
    cross = x * v - y * u
    return x * u + y * v, x * x + y * y - sigma * sigma, (u * u + v * v) * (sigma * sigma) - cross * cross


@kernel
def meets(b, d):
    """Whether a pair with (b, d) of `encounter` is on a course to touch: approaching, and not passing by."""
    return (b < 0.0) & (d > 0.0)


@kernel
def delay(b, c, d):
    """Time until a pair that `meets` touches, eqs. (1)-(3) multiplied by their conjugate.

    A pair that round-off left overlapped by 1e-16 sigma (c < 0) collides now; eq. (1) taken literally would give a
    negative time, and the disks would pass through each other.
    """
    return max(c, 0.0) / (math.sqrt(d) - b)


@kernel
def pair_time(x, y, u, v, sigma):
    """Time until two disks touch, inf if never, eqs. (1)-(3); (x, y), (u, v) as in `encounter`."""
    b, c, d = encounter(x, y, u, v, sigma)
    return delay(b, c, d) if meets(b, d) else math.inf


@kernel
def wall_time(gap, speed):
    """Time until a disk's edge has covered `gap` to a wall at `speed` towards it, eq. (4); inf if it moves away."""
    return max(gap, 0.0) / speed if speed > 0.0 else math.inf


@kernel
def exchange(x, y, u, v):
    """The vector f of eqs. (7)-(8): the part of the relative velocity (u, v) along the line of centres (x, y).

    Numerator and denominator have a factor that cancels, see OFF_POWERS_OF_TWO.
    """
    f = OFF_POWERS_OF_TWO * (x * u + y * v) / (OFF_POWERS_OF_TWO * (x * x) + OFF_POWERS_OF_TWO * (y * y))
    return f * x, f * y


@kernel
def shares(mass_a, mass_b):
    """Return the factors of eqs. (5)-(6) in two parts each, a's first, and the mass m of an impulse m f.

    The heavier disk's factor is 2 m/(m_a + m_b), m the lighter one's mass; the lighter disk's is 2 minus that. Both
    rounded to one number would not add up to 2 in the last bit, and every collision of these two masses would change
    the energy by the same 1e-16 of it, for ever; so the lighter disk gets its parts, 2 f and that product, one after
    the other. An infinite mass is a disk that does not move.
    """
    light = min(mass_a, mass_b)
    share = 2.0 * light / (mass_a + mass_b)
    impulse = light * (2.0 - share)
    return (2.0, -share, 0.0, share, impulse) if mass_a < mass_b else (0.0, share, 2.0, -share, impulse)
