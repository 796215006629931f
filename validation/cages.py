"""Non-Gaussian parameter of hard disks: its exact start, its maximum as cages form, and its end."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from xarray import Dataset

from brownpipe.figures.style import DASHED, GREY, SERIES, grid
from validation.comparison import Comparison

SHORT = 0.1  # collisions of a disk up to the time at which the start is compared: the next order is some 3 % there
FLUID = 0.65  # packing fraction up to which the end of the run is compared with the normal distribution
DERIVED, NORMAL = "docs/theory.md, section 4", "normal distribution"
ALPHA = "non_gaussian_parameter"


def compare(datasets: Mapping[str, Dataset]) -> list[Comparison]:
    """Return the comparisons with the exact start, and with the normal distribution at the end of the runs."""
    starts, ends = [], []
    for n, phi, case in _cases(datasets):
        collisions = _collisions(case)
        at, where = int(np.nanargmin(abs(collisions - SHORT))), f"$\\phi = {phi:.2f}$"
        # alpha_2 starts as Gamma t/20 (1 - 1/N)^-2; the control variate takes the value at the first sample away
        slope = 20 * (1 - 1 / n) ** 2 / (collisions[at] - collisions[1])
        start, error = _at(case, f"{ALPHA}_controlled", at)
        starts.append(
            Comparison(f"$20\\, \\alpha_2/\\Gamma t$, {where}", 1.0, 0.0, slope * start, slope * error, DERIVED)
        )
        if 0.3 < phi < FLUID:
            quantity = f"$\\alpha_2({case.time.values[-1]:g})$, {where}"
            ends.append(Comparison(quantity, 0.0, 0.0, *_at(case, ALPHA, -1), NORMAL))
    return starts + ends


def _at(case: Dataset, name: str, sample: int) -> tuple[float, float]:
    """Return a variable and its standard error at a sample."""
    return float(case[name][sample]), float(case[f"{name}_standard_error"][sample])


def _cases(datasets: Mapping[str, Dataset]) -> Iterator[tuple[int, float, Dataset]]:
    """Yield the number of disks, the packing fraction and the variables of each case, at the times that it has."""
    for data in (datasets["cages_short"], datasets["cages"]):
        for n in data.particles.values.tolist():
            case = data.isel(scene=0, engine=0).sel(particles=n)
            yield n, float(case.packing_fraction), case


def _collisions(case: Dataset) -> np.ndarray:
    """Return the mean number of collisions of a disk (T,) up to each time."""
    return case.time.values * float(case.collision_rate)


def draw(datasets: Mapping[str, Dataset], comparisons: Sequence[Comparison]) -> Figure:
    """Draw the non-Gaussian parameter against the number of collisions of a disk."""
    figure, ((axes,),) = grid(1, 1, 6.0, 4.4)
    looks = (("#555555", ":", "v"), *SERIES)
    for (_, phi, case), (colour, _, marker) in zip(_cases(datasets), looks, strict=False):
        collisions, value, error = _collisions(case), case[ALPHA].values, case[f"{ALPHA}_standard_error"].values
        shown = collisions >= SHORT / 2
        axes.errorbar(
            *(values[shown] for values in (collisions, value, 2 * error)),
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
    axes.set_xlabel("collisions of a disk, $\\Gamma t$")
    axes.set_ylabel("$\\alpha_2 = \\langle r^4 \\rangle/2 \\langle r^2 \\rangle^2 - 1$")
    axes.legend(fontsize=8)
    return figure
