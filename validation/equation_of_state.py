"""The equation of state of the hard-disk fluid, from the collision rate and from the virial."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import Dataset, concat

from brownpipe.figures.style import DATA, FIT, GREY, grid
from validation.comparison import Comparison
from validation.pressure import MOLECULAR_DYNAMICS, SERIES_UP_TO, cases, finite_size, published
from validation.result import Result

ROUTES = {"compressibility_rate": "collision rate", "compressibility": "virial"}
STUDIES = ("virial", "fluid", "dense_fluid")
SMALL_BOXES = "small_boxes"
NARROW = 12.0  # diameters: side of a box below which the pressure depends on its shape, too


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of Z at every published density, and of Z_N in small boxes."""
    fluid, small = _fluid(datasets), cases(datasets[SMALL_BOXES])
    return [
        *(
            _of_many_disks(fluid.isel(case=k), name)
            for name in ROUTES
            for k in range(fluid.sizes["case"])
        ),
        *(_in_small_box(small.isel(case=k)) for k in range(small.sizes["case"])),
    ]


def _fluid(datasets: Mapping[str, Dataset]) -> Dataset:
    names = [f"{name}{suffix}" for name in ROUTES for suffix in ("", "_standard_error")]
    variables = [*names, "packing_fraction", "particles", "density"]
    fluid = concat([cases(datasets[study]).reset_coords()[variables] for study in STUDIES], "case")
    known = [
        density in MOLECULAR_DYNAMICS or density in (0.1, 0.2, SERIES_UP_TO)
        for density in fluid.density.values
    ]
    return fluid.isel(case=known)


def _of_many_disks(case: Dataset, name: str) -> Comparison:
    """Compare Z of infinitely many disks."""
    z, error, source = published(float(case.density))
    ours = float(case[name] - finite_size(case.packing_fraction, case.particles))
    sigma = float(case[f"{name}_standard_error"])
    return Comparison(f"$Z$, {_place(case)}, {ROUTES[name]}", z, error, ours, sigma, source)


def _in_small_box(case: Dataset) -> Comparison:
    """Compare Z_N by the collision rate; in a narrow box the term in 1/N is not exact: correlations
    reach around it.
    """
    z, error, source = published(float(case.density))
    z_n = z + float(finite_size(case.packing_fraction, case.particles))
    narrow = bool(case.particles < float(case.density) * NARROW**2)
    found = Comparison(
        f"$Z_N$, $N = {int(case.particles)}$, {_place(case)}, collision rate",
        z_n,
        error,
        float(case.compressibility_rate),
        float(case.compressibility_rate_standard_error),
        source,
        approximate=narrow,
    )
    remark = f"{found.z:+.1f} standard errors, not tested: correlations reach around the box"
    return found._replace(remark=remark) if narrow else found


def _place(case: Dataset) -> str:
    return f"$n s^2 = {float(case.density):g}$, $\\phi = {float(case.packing_fraction):.3f}$"


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw the deviation of Z from the published one against phi, and Z_N against 1/N."""
    fluid, small = _fluid(datasets), cases(datasets[SMALL_BOXES])
    figure, ((left, right),) = grid(1, 2, 4.5, 3.6)
    phi, n = fluid.packing_fraction.values, fluid.particles.values
    z = np.array([published(density)[0] for density in fluid.density.values])
    for name, colour, marker, aside in zip(
        ROUTES, (DATA, FIT), "os", (-0.0015, 0.0015), strict=True
    ):
        ours, error = fluid[name].values, fluid[f"{name}_standard_error"].values
        part = 1e4 * (ours - finite_size(phi, n) - z) / z
        left.errorbar(
            phi + aside,
            part,
            2e4 * error / z,
            fmt=marker,
            color=colour,
            markersize=4,
            label=ROUTES[name],
        )
    left.plot(
        phi, 1e4 * finite_size(phi, n) / z, "_", color=GREY, label="the term in $1/N$, subtracted"
    )
    left.axhline(0, color=GREY, linewidth=0.8)
    left.set(
        xlabel="packing fraction $\\phi$",
        ylabel="$10^4\\, (Z - Z_\\mathrm{published})/Z_\\mathrm{published}$, 95 %",
    )
    left.legend()
    _sizes(right, fluid, small)
    return figure


def _sizes(axes: Axes, fluid: Dataset, small: Dataset) -> None:
    """Draw Z_N against 1/N at the density of the small boxes, with the largest box of this
    density.
    """
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
    axes.plot(
        line,
        z + finite_size(phi, 1) * line,
        color=GREY,
        label="$Z$ published, with the term in $1/N$",
    )
    axes.set(xlabel="$1/N$", ylabel=f"$Z_N$ at $\\phi = {phi:.3f}$")
    axes.legend()


RESULT = Result(
    "equation_of_state",
    (*STUDIES, SMALL_BOXES),
    compare,
    draw,
    {  # fails if Z is 1 % off
        "virial": {"particles": [160, 320], "seeds": 8},
        "fluid": {"particles": [960], "seeds": 8},
        "dense_fluid": {"particles": [1440], "seeds": 8},
        "small_boxes": {"seeds": 8},
    },
)
