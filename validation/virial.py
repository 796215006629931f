"""Virial coefficients of hard disks, from their collision rate at low densities."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import DATA, GREY, grid
from validation.comparison import Comparison

EXACT = {  # B_k/B_2^(k-1), with B_2 = 2 in units of the area of a disk
    "B_2": 1.0,
    "B_3/B_2^2": 4 / 3 - np.sqrt(3) / np.pi,
    "B_4/B_2^3": 2 - 9 * np.sqrt(3) / (2 * np.pi) + 10 / np.pi**2,
}


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of B_2 to B_4."""
    x, y, error = _reduced(datasets["virial"])
    powers = x[:, None] ** np.arange(4) / error[:, None]
    covariance = np.linalg.inv(powers.T @ powers)
    fitted = covariance @ powers.T @ (y / error)
    return [
        Comparison(f"${name}$", exact, 0.0, fitted[k], np.sqrt(covariance[k, k]), "Clisby and McCoy (2006)")
        for k, (name, exact) in enumerate(EXACT.items())
    ]


def _reduced(data: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x = 2 phi (k,), (Z - 1)/x of infinitely many disks, and its standard error."""
    cases = data.isel(scene=0, engine=0)
    n, x = cases.particles.values, 2 * cases.packing_fraction.values
    # canonical ensemble of N disks: Z_N = 1 + (1 - 1/N) B_2 n + [(1 - 1/N)(1 - 2/N) B_3 + (2/N)(1 - 1/N) B_2^2] n^2 ...
    z = (cases.compressibility_rate.values - 1) / x / (1 - 1 / n)
    b3 = EXACT["B_3/B_2^2"]
    return x, z + x * (2 * b3 - 2) / n, cases.compressibility_rate_standard_error.values / x


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw (Z - 1)/(2 phi) against 2 phi, and the virial series with one to three terms."""
    x, y, error = _reduced(datasets["virial"])
    figure, ((axes,),) = grid(1, 1, 5.6, 4.2)
    axes.errorbar(x, y, 2 * error, fmt="o", color=DATA, markersize=4, label="brownpipe, 95 %")
    line = np.linspace(0, x.max())
    for terms in (1, 2, 3):
        series = sum(b * line**k for k, b in enumerate(list(EXACT.values())[:terms]))
        axes.plot(line, series, color=GREY, linewidth=0.8 + 0.4 * terms, label=f"$B_2$ to $B_{terms + 1}$")
    axes.set_xlabel("$2\\phi$")
    axes.set_ylabel("$(Z - 1)/2\\phi$")
    axes.legend()
    return figure
