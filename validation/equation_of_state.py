"""The equation of state of the hard-disk fluid, from the collision rate and from the virial."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import Dataset, concat

from brownpipe.figures.style import DATA, FIT, GREY, grid
from validation.comparison import Comparison
from validation.hard_disk_fluid import MOLECULAR_DYNAMICS, SERIES_UP_TO, cases, finite_size, published

ROUTES = {"compressibility_rate": "collision rate", "compressibility": "virial"}
STUDIES = ("virial", "fluid", "dense_fluid")
SMALL_BOXES = "small_boxes"


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of Z at every published density, and of Z_N in small boxes."""
    fluid, small = _fluid(datasets), cases(datasets[SMALL_BOXES])
    return [
        *(one for name in ROUTES for one in _comparisons(fluid, name)),
        *_comparisons(small, "compressibility_rate", at_n=True),
    ]


def _fluid(datasets: Mapping[str, Dataset]) -> Dataset:
    names = [f"{name}{suffix}" for name in ROUTES for suffix in ("", "_standard_error")]
    variables = [*names, "packing_fraction", "particles", "density"]
    fluid = concat([cases(datasets[study]).reset_coords()[variables] for study in STUDIES], "case")
    known = [density in MOLECULAR_DYNAMICS or density in (0.1, 0.2, SERIES_UP_TO) for density in fluid.density.values]
    return fluid.isel(case=known)


def _comparisons(fluid: Dataset, name: str, at_n: bool = False) -> list[Comparison]:
    """Compare Z of infinitely many disks, or Z_N if `at_n`."""
    comparisons = []
    for k in range(fluid.sizes["case"]):
        case = fluid.isel(case=k)
        n, density = int(case.particles), float(case.density)
        z, error, source = published(density)
        shift = float(finite_size(case.packing_fraction, n))
        ours, sigma = float(case[name]), float(case[f"{name}_standard_error"])
        at = f"$n s^2 = {density:g}$, $\\phi = {float(case.packing_fraction):.3f}$"
        if at_n:
            quantity = f"$Z_N$, $N = {n}$, {at}, {ROUTES[name]}"
            comparisons.append(Comparison(quantity, z + shift, error, ours, sigma, f"{source}, with the term in $1/N$"))
        else:
            comparisons.append(Comparison(f"$Z$, {at}, {ROUTES[name]}", z, error, ours - shift, sigma, source))
    return comparisons


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw the deviation of Z from the published one against phi, and Z_N against 1/N."""
    fluid, small = _fluid(datasets), cases(datasets[SMALL_BOXES])
    figure, ((left, right),) = grid(1, 2, 4.5, 3.6)
    phi, n = fluid.packing_fraction.values, fluid.particles.values
    z = np.array([published(density)[0] for density in fluid.density.values])
    for name, colour, marker, aside in zip(ROUTES, (DATA, FIT), "os", (-0.004, 0.004), strict=True):
        ours, error = fluid[name].values, fluid[f"{name}_standard_error"].values
        part = 1e4 * (ours - finite_size(phi, n) - z) / z
        left.errorbar(phi + aside, part, 2e4 * error / z, fmt=marker, color=colour, markersize=4, label=ROUTES[name])
    left.plot(phi, 1e4 * finite_size(phi, n) / z, "_", color=GREY, label="the term in $1/N$, subtracted")
    left.axhline(0, color=GREY, linewidth=0.8)
    left.set(
        xlabel="packing fraction $\\phi$", ylabel="$10^4\\, (Z - Z_\\mathrm{published})/Z_\\mathrm{published}$, 95 %"
    )
    left.legend()
    _sizes(right, fluid, small)
    return figure


def _sizes(axes: Axes, fluid: Dataset, small: Dataset) -> None:
    """Draw Z_N against 1/N at the density of the small boxes, with the largest box of this density."""
    alike = concat([fluid, small.reset_coords()[list(fluid)]], "case")
    alike = alike.isel(case=alike.density.values == small.density.values[0])
    inverse, phi = 1 / alike.particles.values, float(alike.packing_fraction[0])
    error = alike.compressibility_rate_standard_error.values
    axes.errorbar(
        inverse,
        alike.compressibility_rate.values,
        2 * error,
        fmt="o",
        color=DATA,
        markersize=4,
        label="brownpipe, 95 %",
    )
    line = np.array([0, 1.1 * inverse.max()])
    z = published(float(alike.density[0]))[0]
    axes.plot(line, z + finite_size(phi, 1) * line, color=GREY, label="$Z$ published, with the term in $1/N$")
    axes.set(xlabel="$1/N$", ylabel=f"$Z_N$ at $\\phi = {phi:.3f}$")
    axes.legend()
