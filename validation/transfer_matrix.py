"""Equal hard disks in a channel too narrow for more than neighbours to touch: exact force, density
and wall pressure.

N disks of diameter 1 in a channel of length L, periodic, across which the centres have the height
a < sqrt(3)/2. The disks keep their order, and only neighbours can be in contact: along the channel
their centres are at least

    c(y, y') = sqrt(1 - (y - y')^2)

apart. The Laplace transform of the partition function is therefore a power of a transfer matrix
(Kofke and Post 1993):

    Z_N(L) = (L/N) 1/(2 pi i) int ds exp(s L) Tr (K(s)/s)^N,  K(s; y, y') = exp(-s c(y, y')),

on Gauss-Legendre nodes of [0, a], along a line parallel to the imaginary axis. It is exact for N
disks on their ring of length L. The line runs through the saddle point on the real axis: its s is
F/kT up to 1/N.

Length in diameters, force and pressure over kT.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Legendre
from scipy.optimize import brentq

NODES = 24  # across the channel; 40 change F by less than 1e-12, P at a = 0.8 by 1e-9
NEGLECTED = 1e-10  # to which the integrand has fallen where the line ends
TAIL = 12.0, 40.0  # of the distribution of lengths: standard deviations, and decay lengths
WIDEST = np.sqrt(3) / 2  # height in which a disk may touch its next neighbour but one
STEP = 1e-4  # relative, of the derivative of the force


class Channel(NamedTuple):
    """A channel and its disks."""

    particles: int
    length: float  # L
    height: float  # a, of the strip in which the centres are

    @property
    def density(self) -> float:
        """Disks per length."""
        return self.particles / self.length


class Equilibrium(NamedTuple):
    """Disks in a channel in equilibrium."""

    force: float  # F/kT across a section [1/length], the derivative of ln Z_N by L
    density: Callable[[np.ndarray], np.ndarray]  # of the centres at heights y (B,) [1/length^2]

    @property
    def wall_density(self) -> float:
        """Density at the walls, P/kT [1/length^2] by the contact theorem."""
        return float(self.density(np.zeros(1))[0])

    def mean_density(self, low: float, high: float) -> float:
        """Return the mean density [1/length^2] between two heights."""
        node, weight = np.polynomial.legendre.leggauss(8)
        y = low + (node + 1) * (high - low) / 2
        return float(weight @ self.density(y)) / 2


def equilibrium(channel: Channel) -> Equilibrium:
    """Return the exact equilibrium, in closed form for one disk and for two.

    >>> one = equilibrium(Channel(1, 4.0, 0.5))
    >>> one.force, one.wall_density
    (0.25, 0.5)
    """
    if channel.particles == 1:
        return _one_disk(channel)
    if channel.particles == 2:
        return _two_disks(channel)
    if channel.height >= WIDEST:
        raise ValueError(f"a = {channel.height} is not below sqrt(3)/2: not only neighbours touch")
    return _neighbours(channel)


# --- one disk and two


def _one_disk(channel: Channel) -> Equilibrium:
    uniform = 1 / (channel.length * channel.height)
    return Equilibrium(1 / channel.length, lambda y: np.full(np.shape(y), uniform))


def _two_disks(channel: Channel) -> Equilibrium:
    """Return the equilibrium of two disks, which may pass each other if a > 1.

    The second is at a distance of c to L - c along the ring, so that

        Z_2 = (L/2) int dy dy' (L - 2 c(y, y')).
    """
    length = channel.length
    a = channel.height
    excluded = 2 * _mean_excluded(a)
    free = a**2 * length - excluded

    def density(y: np.ndarray) -> np.ndarray:
        partner = a * length - 2 * (_excluded_below(y) + _excluded_below(a - y))
        return 2 / length * partner / free

    return Equilibrium(1 / length + a**2 / free, density)


def _excluded_below(u: np.ndarray) -> np.ndarray:
    """Return the integral of c = sqrt(1 - v^2) over differences v of height from 0 to u; c = 0
    beyond 1.
    """
    m = np.minimum(u, 1.0)
    return (m * np.sqrt(1 - m**2) + np.arcsin(m)) / 2


def _mean_excluded(a: float) -> float:
    """Return the integral of c over both heights, 2 int_0^a (a - u) c(u) du."""
    rest = max(1 - a**2, 0.0)
    return float(2 * a * _excluded_below(np.array(a)) - 2 / 3 * (1 - rest**1.5))


# --- more of them, of which only neighbours touch


class _Nodes(NamedTuple):
    """Gauss-Legendre nodes across the channel."""

    y: np.ndarray  # (K,)
    weight: np.ndarray  # (K,)
    distance: np.ndarray  # (K, K) c(y, y')
    scale: np.ndarray  # (K, K) square roots of the products of weights

    @property
    def shortest(self) -> float:
        return float(self.distance.min())

    def matrix(self, s: np.ndarray) -> np.ndarray:
        """Return exp(-s (c - shortest)) (..., K, K) at s (...), symmetric with the weights."""
        beyond = self.distance - self.shortest
        return self.scale * np.exp(-np.asarray(s)[..., None, None] * beyond)


def _nodes(a: float) -> _Nodes:
    node, weight = np.polynomial.legendre.leggauss(NODES)
    y = (node + 1) * a / 2
    weight = weight * a / 2
    distance = np.sqrt(1 - (y[:, None] - y) ** 2)
    return _Nodes(y, weight, distance, np.sqrt(weight[:, None] * weight))


def _neighbours(channel: Channel) -> Equilibrium:
    """Return the equilibrium of disks of which only neighbours touch."""
    n = channel.particles
    nodes = _nodes(channel.height)
    free = channel.length - n * nodes.shortest  # of the densest zigzag
    saddle = _saddle(nodes, channel.length / n, n)
    s = _line(saddle, n, free)
    power = np.linalg.matrix_power(nodes.matrix(s) * (saddle / s)[:, None, None], n)
    weight = np.exp((s - saddle) * free)
    weight[0] /= 2  # the other half of the line is the complex conjugate of this one
    visits = weight[:, None] * np.diagonal(power, axis1=1, axis2=2)
    total = visits.real.sum()
    force = 1 / channel.length + (s[:, None] * visits).real.sum() / total
    share = visits.real.sum(axis=0) / nodes.weight / total
    polynomial = Legendre.fit(nodes.y, share, NODES - 1, domain=[0, channel.height])
    return Equilibrium(float(force), lambda y: channel.density * polynomial(y))


def _saddle(nodes: _Nodes, length: float, n: float) -> float:
    """Return the real s > 0 where exp(s n length) Tr (K/s)^n has its minimum: where the mean length
    per disk is this one.
    """

    def excess(log_s: float) -> float:
        s = np.exp(log_s)
        return float(1 / s + _mean_distance(nodes, s, n) - length)

    lowest = -np.log(length - nodes.shortest)  # where 1/s alone is the length
    return float(np.exp(brentq(excess, lowest, lowest + 5, xtol=1e-13)))


def _mean_distance(nodes: _Nodes, s: float, n: float) -> float:
    """Return the mean of c, weighted with the trace of the n-th power of the matrix at s; n may be
    infinite. Of an odd n the signs of the eigenvalues are left out.
    """
    matrix = nodes.matrix(np.array(s))
    eigenvalue, vector = np.linalg.eigh(matrix)
    mean = np.einsum("ik,ij,jk->k", vector, matrix * nodes.distance, vector)
    # in a zigzag the lowest is the opposite of the highest, to round-off
    relative = np.minimum(np.abs(eigenvalue) / eigenvalue[-1], 1.0)
    return float((relative ** (n - 1) * mean).sum() / (relative**n).sum() / eigenvalue[-1])


def _line(saddle: float, n: int, free: float) -> np.ndarray:
    """Return points (M,) of the line of integration, for the trapezoidal rule.

    With the step 2 pi/T the rule gives the sum of all Z_N(L + k T) exp(-k T s): none is left for
    k < 0 if T > free, and those with k > 0 are beyond the TAIL.
    """
    deviations, decays = TAIL
    period = free + (deviations * np.sqrt(n) + decays) / saddle
    end = saddle * NEGLECTED ** (-1 / n)
    return saddle + 1j * np.arange(0, end, 2 * np.pi / period)


# --- a channel of infinite length


def force_in_long_channel(density: float, height: float) -> float:
    """Return F/kT at a number of disks per length, in the limit of infinitely many disks.

    At constant force the length per disk is 1/s + <c>, with s = F/kT and the mean of c in the state
    of the largest eigenvalue of K(s).
    """
    return _saddle(_nodes(height), 1 / density, np.inf)


def speed_of_sound(density: float, height: float) -> float:
    """Return c [length/time] along a long channel, where m = kT = 1.

    As in the plane, c^2 = kT/m [f' + (f/rho)^2] with F = kT f(rho): the second term is the heat of
    compression in two degrees of freedom.
    """
    up, down = (force_in_long_channel(density * (1 + side * STEP), height) for side in (1.0, -1.0))
    slope = (up - down) / (2 * STEP * density)
    return float(np.sqrt(slope + (force_in_long_channel(density, height) / density) ** 2))
