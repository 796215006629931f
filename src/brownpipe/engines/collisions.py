"""Pair and wall collisions, eqs. (1)-(10) of the note, as kernels in a form that survives finite
precision.

Everything here takes and returns plain numbers, in any consistent units; `encounter`, `meets` and
`delay` also fours of them, for four pairs at once (`engines.compiled.fours`). docs/theory.md,
section 1, states the equations and measures the difference between their printed form and this
one.

    (1)-(3)   time of a pair collision     `encounter`, `meets`, `delay`
    (4)       time of a wall collision     `wall_time`; the gap in `exact.predictions.leave_time`
    (5)-(6)   velocities after it          `shares`, in `exact.workspace.apply_impulse` and
                                           `timestep.steps.collide`
    (7)-(8)   momentum along the normal    `exchange`
    (9)-(10)  reflection at a wall         `exact.events.bounce`, `timestep.steps.bounce`
"""

import math

import numpy as np

from brownpipe.engines.compiled.kernels import kernel

# At contact x*x + y*y is sigma^2 except for its last bits. Floating-point numbers lie twice as far
# apart just above a power of two as just below it. There, at sigma = 1 for instance, the sum is
# rounded to one side on average, and every collision changes the energy by the same 3e-17 kT. The
# factor moves such sums away from powers of two. It is a simple fraction, so that a collision whose
# numbers are simple fractions remains exact.
OFF_POWERS_OF_TWO = 0.75


@kernel
def encounter(x: float, y: float, u: float, v: float, sigma2: float) -> tuple[float, float, float]:
    """Return (b, c, d) of the quadratic equation behind eqs. (1)-(3) for a pair; `sigma2` is its
    sigma^2.

    r = (x, y) and v = (u, v) are position and velocity of the second disk relative to the first,
    b = r.v, c = r.r - sigma^2, and d = v.v sigma^2 - (r x v)^2, which equals b^2 - v.v c. The form
    with the cross product costs the same, and its round-off error is smaller by a factor of
    abs(r)/sigma.
    """
    cross = x * v - y * u
    return x * u + y * v, x * x + y * y - sigma2, (u * u + v * v) * sigma2 - cross * cross


@kernel
def meets(b: float, d: float) -> bool:
    """Whether a pair with (b, d) of `encounter` is on a course to touch: approaching, and not
    passing by.
    """
    return (b < 0.0) & (d > 0.0)


@kernel
def delay(b: float, c: float, d: float) -> float:
    """Return the time until a pair that `meets` touches, eq. (1) multiplied by its conjugate.

    A pair that overlaps by round-off (c < 0, of order 1e-16 sigma^2) collides now; eq. (1) taken
    literally would give a negative time, and the disks would pass through each other.
    """
    return np.maximum(c, 0.0) / (np.sqrt(d) - b)


@kernel
def wall_time(gap: float, velocity: float) -> float:
    """Return the time, eq. (4), in which a disk of this velocity covers a gap to a wall or a cell's
    edge.

    Gap and velocity have signs. A negative time belongs to a gap behind the disk; the time is inf
    for a disk at rest.
    """
    return gap / velocity if velocity != 0.0 else math.inf


@kernel
def exchange(x: float, y: float, u: float, v: float) -> tuple[float, float]:
    """Return the vector f of eqs. (7)-(8), the part of the relative velocity (u, v) along the line
    of centres (x, y).

    Numerator and denominator have a factor that cancels, see OFF_POWERS_OF_TWO.
    """
    f = (
        OFF_POWERS_OF_TWO
        * (x * u + y * v)
        / (OFF_POWERS_OF_TWO * (x * x) + OFF_POWERS_OF_TWO * (y * y))
    )
    return f * x, f * y


@kernel
def shares(mass_a: float, mass_b: float) -> tuple[float, float, float, float, float]:
    """Return the factors of f in eqs. (5)-(6) in two parts each, a's first, and the mass m of the
    impulse m f.

    The heavier disk's factor is 2 m/(m_a + m_b) with the lighter disk's mass m, the lighter disk's
    is 2 minus that. Rounded to one number each, they would not add up to 2 in the last bit, and
    every collision of these two masses would change the pair's energy by the same 1e-16 of it. The
    lighter disk's velocity is therefore changed in two steps, by 2 f and by -f times the heavier
    one's factor. A disk of infinite mass does not move.
    """
    light = min(mass_a, mass_b)
    share = 2.0 * light / (mass_a + mass_b)
    impulse = light * (2.0 - share)
    return (
        (2.0, -share, 0.0, share, impulse)
        if mass_a < mass_b
        else (0.0, share, 2.0, -share, impulse)
    )
