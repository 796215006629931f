"""Collision rate and contact value of equal hard disks, from published pressures."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe import theory
from brownpipe.figures.style import GREY, SERIES, grid
from validation.comparison import Comparison
from validation.pressure import cases, finite_size, published
from validation.result import Result

QUANTITIES = {
    "collision_rate_at_temperature": "$\\Gamma$",
    "contact_value_rate": "$g(s^+)$ from the collision rate",
    "contact_value": "$g(s^+)$ from $g(r)$",
}


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons of the collision rate and the contact value, by both routes, at every
    density.
    """
    fluid = _fluid(datasets)
    densities = range(fluid.sizes["case"])
    return [_comparison(fluid.isel(case=k), name) for name in QUANTITIES for k in densities]


def _fluid(datasets: Mapping[str, Dataset]) -> Dataset:
    return cases(datasets["contact"].isel(species_pair=0, drop=True))


def _comparison(case: Dataset, name: str) -> Comparison:
    phi, density = float(case.packing_fraction), float(case.density)
    _, error, source = published(density)
    unit = unit_of(name, case)
    return Comparison(
        f"{QUANTITIES[name]}, $n s^2 = {density:g}$, $\\phi = {phi:.3f}$",
        unit * contact_value(case),
        unit * error / (2 * phi),
        float(case[name]),
        float(case[f"{name}_standard_error"]),
        source,
    )


def contact_value(case: Dataset) -> float:
    """Return the contact value chi_N in a periodic box of N disks from the published Z.

    Each disk has N - 1 others, so the virial theorem is Z_N = 1 + 2 phi (1 - 1/N) chi_N.
    """
    phi, n = float(case.packing_fraction), int(case.particles)
    z = published(float(case.density))[0] + float(finite_size(phi, n))
    return (z - 1) / (2 * phi * (1 - 1 / n))


def unit_of(name: str, case: Dataset) -> float:
    """Return the quantity for a contact value of 1; diameter, mass and kT of the scene are 1."""
    if name != "collision_rate_at_temperature":
        return 1.0
    others = float(case.density) * (1 - 1 / int(case.particles))
    return float(
        theory.collision_rate(others, distance=1.0, contact=1.0, mass=0.5, temperature=1.0)
    )


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw g(r) near contact with the published contact values, and the deviation of all quantities
    from them.
    """
    fluid = _fluid(datasets)
    figure, ((left, right),) = grid(1, 2, 4.3, 3.6)
    _near_contact(left, fluid)
    count = fluid.sizes["case"]
    for place, (label, (colour, _, marker)) in enumerate(
        zip(QUANTITIES.values(), SERIES, strict=False)
    ):
        group = comparisons[place * count : (place + 1) * count]
        part = [1e3 * one.departure for one in group]
        error = [2e3 * one.error / one.published for one in group]
        looks = {"fmt": marker, "color": colour, "markersize": 4, "label": label}
        right.errorbar(fluid.packing_fraction.values + 0.008 * (place - 1), part, error, **looks)
    right.axhline(0, color=GREY, linewidth=0.8)
    right.set(xlabel="packing fraction $\\phi$", ylabel="$10^3$ (difference)/published, 95 %")
    right.legend()
    return figure


def _near_contact(axes: Axes, fluid: Dataset) -> None:
    for k, (colour, _, marker) in zip(range(fluid.sizes["case"]), SERIES, strict=False):
        case = fluid.isel(case=k)
        near = (case.distance.values > 1.0) & (case.distance.values < 1.6)
        label = f"$\\phi = {float(case.packing_fraction):.3f}$"
        g = case.pair_distribution.values[near]
        axes.plot(case.distance.values[near], g, marker, color=colour, markersize=3, label=label)
        axes.plot(1.0, contact_value(case), "*", color=colour, markersize=11)
    axes.plot([], [], "*", color=GREY, markersize=11, label="$g(s^+)$, published")
    axes.set(xlabel="$r/s$", ylabel="$g(r)$")
    axes.legend()


RESULT = Result(
    "contact",
    ("contact",),
    compare,
    draw,
    {"contact": {"particles": [640], "seeds": 8}},  # fails if the rate is 1 % off
)
