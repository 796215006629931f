"""Elementary functions whose results have the same bits on every processor.

They consist of sums, products, quotients and square roots, which IEEE 754 rounds in one way only. NumPy and the C
library have several versions of each elementary function, choose one by the instructions of the processor (AVX-512,
FMA), and the versions differ in the last bit. Numbers that are stored are therefore computed by the functions below.
Their errors are a few units in the last place.

Arguments are numbers or arrays, results arrays; NaN gives NaN.
"""

import math
from collections.abc import Sequence
from decimal import Decimal, localcontext
from functools import cache

import numpy as np

Numbers = float | np.ndarray

# Constants as sums of parts: the products of all but the last with integers up to 2^20 are exact (Cody-Waite).
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)

# Coefficients of power series, the lowest power first; the first term, 1 or x, is left out.
EXPONENTIAL = [1 / math.factorial(k) for k in range(2, 15)]  # of x^k
SINE = [(-1) ** k / math.factorial(2 * k + 1) for k in range(1, 9)]  # of x^(2k + 1)
COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(1, 9)]  # of x^2k
ARCSINE = [math.comb(2 * k, k) / (4**k * (2 * k + 1)) for k in range(1, 11)]  # of x^(2k + 1)
ARTANH = [1 / (2 * k + 1) for k in range(1, 12)]  # of x^(2k + 1)


def _series(x: np.ndarray, coefficients: Sequence[float]) -> np.ndarray:
    """Return the sum of coefficients[k] x^k, by Horner's rule."""
    total = np.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def exp(x: Numbers) -> np.ndarray:
    """Return e^x, as 2^k e^r with abs(r) < 0.35."""
    x = np.clip(np.asarray(x, float), -746.0, 710.0)  # where it is 0 or infinite
    k = np.rint(np.nan_to_num(x) / LN2[0])
    r = (x - k * LN2[0]) - k * LN2[1]
    return np.ldexp(1.0 + (r + r * r * _series(r, EXPONENTIAL)), k.astype(int))


def expm1(x: Numbers) -> np.ndarray:
    """Return e^x - 1 without cancellation near 0."""
    x = np.asarray(x, float)
    r = np.clip(x, -0.35, 0.35)
    return np.where(r == x, r + r * r * _series(r, EXPONENTIAL), exp(x) - 1.0)


def tanh(x: Numbers) -> np.ndarray:
    """Return the hyperbolic tangent."""
    less = expm1(-2.0 * np.abs(x))
    return np.copysign(less / (less + 2.0), x)


def log(x: Numbers) -> np.ndarray:
    """Return the natural logarithm of numbers below infinity; minus infinity for 0, NaN for negative numbers."""
    x = np.asarray(x, float)
    mantissa, exponent = np.frexp(np.where(x > 0.0, x, 1.0))
    low = mantissa < math.sqrt(0.5)
    mantissa, k = np.where(low, 2.0 * mantissa, mantissa), exponent - low.astype(float)
    f = (mantissa - 1.0) / (mantissa + 1.0)  # log m = 2 artanh f
    value = k * LN2[0] + (2.0 * (f + f * f * f * _series(f * f, ARTANH)) + k * LN2[1])
    return np.where(x > 0.0, value, np.where(x == 0.0, -np.inf, np.nan))


def sin(x: Numbers) -> np.ndarray:
    """Return the sine of angles up to 2^20; the error is relative to 1."""
    return _wave(x, 0)


def cos(x: Numbers) -> np.ndarray:
    """Return the cosine of angles up to 2^20; the error is relative to 1."""
    return _wave(x, 1)


def _wave(x: Numbers, quarters: int) -> np.ndarray:
    """Return the sine of x plus a number of quarters of a turn."""
    x = np.asarray(x, float)
    k = np.rint(x / HALF_PI[0])
    r = ((x - k * HALF_PI[0]) - k * HALF_PI[1]) - k * HALF_PI[2]
    turns, square = np.nan_to_num(k).astype(int) + quarters, r * r
    value = np.where(turns % 2 == 1, 1.0 + square * _series(square, COSINE), r + r * square * _series(square, SINE))
    return np.where(turns % 4 >= 2, -value, value)


def arcsin(x: Numbers) -> np.ndarray:
    """Return the angle in [-pi/2, pi/2] of this sine, from an eighth of the angle."""
    sine = np.asarray(x, float)
    cosine = np.sqrt((1.0 - sine) * (1.0 + sine))
    for _ in range(3):
        cosine = np.sqrt((1.0 + cosine) / 2.0)
        sine = sine / (2.0 * cosine)
    return 8.0 * (sine + sine * sine * sine * _series(sine * sine, ARCSINE))


def arccos(x: Numbers) -> np.ndarray:
    """Return the angle in [0, pi/2] of this cosine, from 0 to 1."""
    return 2.0 * arcsin(np.sqrt((1.0 - np.asarray(x, float)) / 2.0))


@cache
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights (count,) of Gauss-Legendre quadrature over [-1, 1], correctly rounded.

    Zeros of the Legendre polynomial by Newton's method in decimal arithmetic (W. H. Press et al., Numerical Recipes,
    section 4.5): NumPy's come from the linear algebra library, whose bits depend on the processor.
    """
    nodes, weights = [], []
    with localcontext(prec=34):
        for i in reversed(range(count)):
            x = Decimal(math.cos(math.pi * (i + 0.75) / (count + 0.5)))
            for _ in range(5):
                before, here = Decimal(1), x
                for k in range(2, count + 1):
                    before, here = here, ((2 * k - 1) * x * here - (k - 1) * before) / k
                slope = count * (before - x * here) / (1 - x * x)
                x -= here / slope
            nodes.append(float(x))
            weights.append(float(2 / ((1 - x * x) * slope * slope)))
    return np.array(nodes), np.array(weights)
