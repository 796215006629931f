"""Elementary functions made of arithmetic, against the C library's in extended precision."""

import math

import numpy as np
import pytest

from brownpipe import elementary

RANDOM = np.random.default_rng(11)
SMALL = np.concatenate(
    [RANDOM.uniform(-1, 1, 20_000), RANDOM.uniform(-1, 1, 20_000) * 10.0 ** RANDOM.uniform(-300, 0, 20_000)]
)
WIDE = np.concatenate([SMALL, 0.5 * math.pi * np.arange(-60, 61), RANDOM.uniform(-90, 90, 20_000)])
CASES = [  # function, arguments, largest error in units in the last place of the result, or of 1 if that is larger
    ("exp", np.concatenate([SMALL, RANDOM.uniform(-700, 709, 20_000)]), 1.5),
    ("expm1", np.concatenate([SMALL, RANDOM.uniform(-700, 709, 20_000)]), 4.0),
    ("tanh", np.concatenate([SMALL, RANDOM.uniform(-30, 30, 20_000)]), 4.0),
    ("log", np.concatenate([np.abs(SMALL), 1 + SMALL[:20_000] / 9, np.exp(RANDOM.uniform(-700, 709, 20_000))]), 2.5),
    ("sin", WIDE, 1.5),
    ("cos", WIDE, 1.5),
    ("arcsin", SMALL, 6.0),
    ("arccos", np.abs(SMALL), 6.0),
]


@pytest.mark.parametrize(("name", "x", "largest"), CASES)
def test_errors_are_a_few_units_in_the_last_place(name, x, largest):
    value, exact = getattr(elementary, name)(x), getattr(np, name)(x.astype(np.longdouble))
    size = np.maximum(np.abs(exact).astype(float), 0.5) if name in ("sin", "cos") else np.abs(exact).astype(float)
    assert np.finfo(np.longdouble).nmant > 60, "no extended precision to compare with"
    assert np.max(np.abs(value - exact) / np.spacing(size)) < largest


@pytest.mark.parametrize("name", [name for name, *_ in CASES])
def test_nan_and_ends_are_those_of_numpy(name):
    ends = {"exp": [-np.inf, np.inf, 0.0, -746.0], "expm1": [-np.inf, 0.0], "tanh": [-np.inf, np.inf, 0.0, -0.0]}
    ends |= {"log": [0.0, 1.0], "arcsin": [-1.0, 0.0, 1.0], "arccos": [0.0, 1.0]}
    x = np.array([np.nan, *ends.get(name, [0.0])])
    with np.errstate(divide="ignore", over="ignore"):
        value, expected = getattr(elementary, name)(x), getattr(np, name)(x)
        assert all(np.shape(getattr(elementary, name)(one)) == () for one in x.tolist())
    assert np.array_equal(value, expected, equal_nan=True)
    assert np.array_equal(np.signbit(value[1:]), np.signbit(expected[1:]))


@pytest.mark.parametrize("count", [1, 2, 8, 16, 64])
def test_gauss_legendre_quadrature_integrates_polynomials(count):
    """Up to degree 2 count - 1; the nodes are those of NumPy, to its round-off."""
    node, weight = elementary.gauss_legendre(count)
    for degree in range(2 * count):
        exact = 2 / (degree + 1) if degree % 2 == 0 else 0.0
        assert math.fsum((weight * node**degree).tolist()) == pytest.approx(exact, abs=4e-15)
    for mine, theirs in zip((node, weight), np.polynomial.legendre.leggauss(count), strict=True):
        assert np.allclose(mine, theirs, rtol=0, atol=4e-15)
        assert np.array_equal(np.abs(mine), np.abs(mine[::-1]))
