"""Virial coefficients of hard disks, from their collision rate at low densities."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import INK, SERIES, grid
from validation.comparison import Comparison
from validation.pressure import CLISBY, VIRIAL_COEFFICIENTS, VIRIAL_ERRORS, cases, finite_size
from validation.result import Result

NAMES = {2: "$B_2$", 3: "$B_3/B_2^2$", 4: "$B_4/B_2^3$", 5: "$B_5/B_2^4$"}


class Reduced(NamedTuple):
    """Pressure at K densities."""

    x: np.ndarray  # (K,) 2 phi
    y: np.ndarray  # (K,) (Z - 1)/x of infinitely many disks
    error: np.ndarray  # (K,) standard error of y


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of B_2 to B_5, each with all others as published, and of B_2 to B_4
    from one fit.
    """
    reduced = _reduced(datasets["virial"])
    fits = [((order,), "the others as published") for order in NAMES] + [
        ((2, 3, 4), "fitted together")
    ]
    return [one for orders, how in fits for one in _comparisons(reduced, orders, how)]


def _reduced(data: Dataset) -> Reduced:
    gas = cases(data)
    phi = gas.packing_fraction.values
    z = gas.compressibility_rate.values - finite_size(phi, gas.particles.values)
    return Reduced(
        2 * phi, (z - 1) / (2 * phi), gas.compressibility_rate_standard_error.values / (2 * phi)
    )


def _comparisons(reduced: Reduced, orders: Sequence[int], how: str) -> list[Comparison]:
    """Fit the coefficients of these orders to y = B_2 + B_3 x + ..., by least squares, the others
    as published.
    """
    x, y, error = reduced
    rest = sum(
        b * x ** (k - 2) for k, b in enumerate(VIRIAL_COEFFICIENTS, 1) if k > 1 and k not in orders
    )
    powers = x[:, None] ** (np.array(orders) - 2) / error[:, None]
    covariance = np.linalg.inv(powers.T @ powers)
    fitted = covariance @ powers.T @ ((y - rest) / error)
    square = float(np.sum(((y - rest) / error - powers @ fitted) ** 2))
    quality = f"{how}; $\\chi^2 = {square:.1f}$ with {len(x) - len(orders)} degrees of freedom"
    return [
        Comparison(
            f"{NAMES[order]}, {quality}",
            VIRIAL_COEFFICIENTS[k],
            VIRIAL_ERRORS[k],
            value,
            sigma,
            CLISBY,
        )
        for order, k, value, sigma in zip(
            orders, np.array(orders) - 1, fitted, np.sqrt(np.diag(covariance)), strict=True
        )
    ]


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw (Z - 1)/(2 phi) against 2 phi beside the virial series, and the deviation of Z - 1 from
    it to B_10.
    """
    x, y, error = _reduced(datasets["virial"])
    figure, ((left, right),) = grid(1, 2, 4.1, 3.1)
    line = np.linspace(0, 1.05 * x.max())
    terms = [b * line**k for k, b in enumerate(VIRIAL_COEFFICIENTS[1:])]
    for last, (colour, dashes, _) in zip(
        (2, 3, 4, 5, 10), (*SERIES[:4], (INK, "-", "")), strict=True
    ):
        looks = {
            "color": colour,
            "linestyle": dashes,
            "linewidth": 1.2,
            "label": f"series to $B_{{{last}}}$",
        }
        left.plot(line, sum(terms[: last - 1]), **looks)
        right.plot(line, 1e3 * (sum(terms[: last - 1]) / sum(terms) - 1), **looks)
    series = sum(b * x**k for k, b in enumerate(VIRIAL_COEFFICIENTS[1:]))
    left.errorbar(x, y, 2 * error, fmt="o", color=INK, markersize=4, label="brownpipe, 95 %")
    right.errorbar(
        x, 1e3 * (y / series - 1), 2e3 * error / series, fmt="o", color=INK, markersize=4
    )
    left.set(xlabel="$2\\phi$", ylabel="$(Z - 1)/2\\phi$")
    right.set(xlabel="$2\\phi$", ylabel="$10^3$ deviation of $Z - 1$", ylim=(-9, 3))
    left.legend()
    return figure


RESULT = Result(
    "virial",
    ("virial",),
    compare,
    draw,
    # fails if B_2 is 0.5 % off, B_3 1 % or B_4 4 %
    {"virial": {"particles": [80, 160, 320, 480], "seeds": 8}},
)
