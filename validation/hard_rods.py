"""A tracer among hard rods of equal mass on a line: exact, by free flights.

In a collision two rods of equal mass exchange their velocities. Without their lengths they are
points that pass through each other, whose names alone are exchanged (Jepsen 1965): rod j is
wherever the j-th point in order is. N rods of length 1 on a ring of length L are N points on a ring
of length L' = L - N. kT = m = 1.
"""

import numpy as np
from scipy.special import chndtr, ndtr

NODES = 60  # of the quadrature over distances; relative error below 1e-12
FARTHEST = 12.0  # end of the quadrature: in rms displacements by diffusion alone


def ring_displacement(
    particles: int, free_length: float, time: float, runs: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Return the MSD of a rod after a time and its standard error, from so many independent rings
    in equilibrium without total momentum.
    """
    start = np.sort(rng.random((runs, particles)) * free_length, axis=1)
    velocity = rng.normal(size=(runs, particles))
    velocity -= velocity.mean(axis=1, keepdims=True)
    end = after_flights(start, velocity, time, free_length)
    squares = ((end - start) ** 2).mean(axis=1)
    return float(squares.mean()), float(squares.std() / np.sqrt(runs))


def after_flights(
    start: np.ndarray, velocity: np.ndarray, time: float, free_length: float
) -> np.ndarray:
    """Return positions (runs, N) after a time of points that began at `start` (runs, N), ascending
    within one turn of the ring, and exchange velocities (runs, N). Turns are counted.

    Points that pass through each other are at the same places. The ring repeats itself along an
    infinite line; in order along it, the first point of a ring is now the m-th. As the sum of the N
    positions is that of the free flights, and grows by L' with each step of m, m is the number of
    turns of the free flights together.
    """
    particles = start.shape[1]
    flown = start + velocity * time
    turns = np.floor(flown / free_length)
    on_ring = np.sort(flown - turns * free_length, axis=1)
    first = turns.sum(axis=1).astype(int)
    turn, place = np.divmod(np.arange(particles) + first[:, None], particles)
    return np.take_along_axis(on_ring, place, axis=1) + turn * free_length


def displacement(density: float, time: float) -> float:
    """Return the MSD after a time among infinitely many points, so many per length (Jepsen 1965,
    Levitt 1973).

    The tracer is beyond x if more points have come to the right of x than have left it. Both
    numbers are Poisson's, with means

        rho t <(v - x/t)_+> and rho t <(x/t - v)_+>,

    and the tracer's own flight is one of the first with the probability P(v > x/t).

    >>> round(displacement(1.0, 1e-3) * 1e6, 2)
    1.0
    """
    end = min(FARTHEST * np.sqrt(2 * diffusion(density) * time), FARTHEST * time)
    node, weight = np.polynomial.legendre.leggauss(NODES)
    x = (node + 1) * end / 2
    speed = x / time
    faster = ndtr(-speed)
    at_speed = np.exp(-(speed**2) / 2) / np.sqrt(2 * np.pi)
    came = density * time * (at_speed - speed * faster)
    left = density * time * (at_speed + speed * (1 - faster))
    beyond = faster * (1 - _exceeds(left, came)) + (1 - faster) * _exceeds(came, left)
    return float(2 * end * (weight * x * beyond).sum())


def _exceeds(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the probability that a Poisson number of one mean exceeds an independent one: the
    noncentral chi-square distribution of two degrees of freedom.
    """
    return chndtr(2 * first, 2, 2 * second)


def diffusion(density: float) -> float:
    """Return D = <abs v>/(2 rho), to which MSD/2t tends among points, so many per length.

    The difference of the two numbers has the variance rho t <abs v>, and moves the tracer by
    1/rho each.
    """
    return float(np.sqrt(2 / np.pi) / (2 * density))


def largest_displacement(particles: int, free_length: float) -> float:
    """Return the MSD of a rod at late times on its ring without total momentum,
    L'^2 (N - 1)/(6 N^2).

    It is twice the variance of its distance from the centre of mass. The gaps are uniform with the
    given sum: with variance L'^2 (N - 1)/(N^2 (N + 1)) and covariance -L'^2/(N^2 (N + 1)).
    """
    return free_length**2 * (particles - 1) / (6 * particles**2)
