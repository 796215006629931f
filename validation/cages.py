"""Non-Gaussian parameter of hard disks: its exact start, and its maximum as cages form."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import DASHED, GREY, SERIES, grid
from validation.comparison import Comparison
from validation.result import Result

# collisions of a disk up to the time at which the start is compared: the next order is some 3 %
# there
SHORT = 0.1


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons with the exact start, alpha_2 = Gamma t/20 (1 - 1/N)^-2."""
    comparisons = []
    for n, phi, case in _cases(datasets):
        collisions = _collisions(case)
        at = int(np.nanargmin(abs(collisions - SHORT)))
        # the control variate takes the value at the first sample away
        slope = 20 * (1 - 1 / n) ** 2 / (collisions[at] - collisions[1])
        start, error = (slope * value for value in _at(case, at))
        quantity = f"$20\\, \\alpha_2/\\Gamma t$, $\\phi = {phi:.2f}$"
        comparisons.append(
            Comparison(quantity, 1.0, 0.0, start, error, "[theory](theory.md), section 4")
        )
    return comparisons


def _at(case: Dataset, samples: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha_2, less the scatter of the initial velocities, and its standard error at
    samples.
    """
    name = "non_gaussian_parameter_controlled"
    return case[name].values[samples], case[f"{name}_standard_error"].values[samples]


def _cases(datasets: Mapping[str, Dataset]) -> Iterator[tuple[int, float, Dataset]]:
    """Yield the number of disks, the packing fraction and the variables of each case, at the times
    that it has.
    """
    for data in (datasets["cages_short"], datasets["cages"]):
        for n in data.particles.values.tolist():
            case = data.isel(scene=0, engine=0).sel(particles=n)
            yield n, float(case.packing_fraction), case


def _collisions(case: Dataset) -> np.ndarray:
    """Return the mean number of collisions of a disk (T,) up to each time."""
    return case.time.values * float(case.collision_rate)


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw the non-Gaussian parameter against the number of collisions of a disk."""
    figure, ((axes,),) = grid(1, 1, 5.6, 4.2)
    looks = (("#555555", ":", "v"), *SERIES)
    for (_, phi, case), (colour, _, marker) in zip(_cases(datasets), looks, strict=False):
        shown = np.flatnonzero(_collisions(case) >= SHORT / 2)
        value, error = _at(case, shown)
        axes.errorbar(
            _collisions(case)[shown],
            value,
            2 * error,
            fmt=f"{marker}-",
            color=colour,
            markersize=3,
            linewidth=0.7,
            label=f"$\\phi = {phi:.2f}$, 95 %",
        )
    line = np.geomspace(SHORT / 2, 3.0)
    axes.plot(line, line / 20, color=GREY, linestyle=DASHED, label="exact start, $\\Gamma t/20$")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=0.01)
    axes.set_ylim(-0.012, 1.5)
    axes.set_xlabel("collisions of a disk, $\\Gamma t$")
    axes.set_ylabel("$\\alpha_2 = \\langle r^4 \\rangle/2 \\langle r^2 \\rangle^2 - 1$")
    axes.legend(fontsize=8)
    return figure


RESULT = Result(
    "cages",
    ("cages", "cages_short"),
    compare,
    draw,
    {
        "cages": {"particles": [163], "seeds": 12},
        "cages_short": {"seeds": 280},
    },  # fails if alpha_2 is 60 % off
)
