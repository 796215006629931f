"""Figure `velocity_distribution`: velocity components and speeds of each species against
Maxwell-Boltzmann.
"""

from itertools import cycle

import numpy as np
from matplotlib import figure as matplotlib_figure
from matplotlib.axes import Axes
from pandas import DataFrame, concat
from scipy.special import ndtr
from xarray import Dataset

from brownpipe.figures.cases import SUFFIXES, frame_of, parts_of, title_of
from brownpipe.figures.figure import Figure
from brownpipe.figures.style import (
    INK,
    SERIES,
    put_titles_and_legends,
    residual_panel,
    stacked_panels,
)

FEWEST_COUNTS = 5  # expected independent counts of a bin whose residual is shown
NEIGHBOURS = np.ones(
    11
)  # weights of a bin and of five on either side, whose errors are pooled with its own
LOWEST_DENSITY = 1e-6  # expected density of the outermost bins shown
LABELS = ("probability density", "(observed - expected)\n/ standard error")
HEIGHTS = (3.6, 1.4)  # of a density and its residuals [inch]


def _rayleigh(u: np.ndarray) -> np.ndarray:
    """Probability that a speed in units of sqrt(kT/m) is below u, in two dimensions."""
    return -np.expm1(-(np.maximum(u, 0) ** 2) / 2)


# Dimension of a density in the dataset, distribution function in equilibrium, name in titles, label
# of the axis.
SHOWN = {
    "velocity_density": (
        "velocity_bin",
        ndtr,
        "components",
        "velocity component $v\\,/\\,\\sqrt{kT/m}$",
    ),
    "speed_density": ("speed_bin", _rayleigh, "speeds", "speed $|v|\\,/\\,\\sqrt{kT/m}$"),
}


def draw_velocities(cases: list[Dataset]) -> matplotlib_figure.Figure:
    """Draw one column per case: components and then speeds, each as densities above and their
    residuals below.
    """
    figure, axes = stacked_panels(
        LABELS * len(SHOWN), len(cases), HEIGHTS * len(SHOWN), sharey=True
    )
    for k, (name, (_, _, words, label)) in enumerate(SHOWN.items()):
        for case, (main, low) in zip(cases, axes[2 * k : 2 * k + 2].T, strict=True):
            _density(main, low, case, name)
            low.set_xlabel(label)
        axes[2 * k, 0].set_ylim(bottom=0)
        put_titles_and_legends(axes[2 * k], [f"{title_of(case)}: {words}" for case in cases])
    return figure


def _density(main: Axes, low: Axes, case: Dataset, name: str) -> None:
    """Draw the density of every species with the expected one, and the residuals of bins with
    enough counts.
    """
    dim = SHOWN[name][0]
    edges, expected = _expected(case[dim].values, name)
    main.stairs(expected, edges, color=INK, linewidth=1.0, label="Maxwell-Boltzmann")
    residual_panel(low)
    for part, (colour, _, marker) in zip(
        parts_of(case, "species", name), cycle(SERIES), strict=False
    ):
        looks = {
            "color": colour,
            "markersize": 3,
            "markerfacecolor": "none",
            "label": part.species.item(),
        }
        main.plot(case[dim], part[name], marker, **looks)
        residuals = _residuals(part[name].values, part[f"{name}_standard_error"].values, expected)
        shown = np.isfinite(residuals)
        low.plot(case[dim][shown], residuals[shown], marker, color=colour, markersize=2.5)
    seen = expected > LOWEST_DENSITY
    for axes in (main, low):
        axes.set_xlim(edges[:-1][seen][0], edges[1:][seen][-1])
    main.tick_params(labelbottom=False)


def _residuals(observed: np.ndarray, error: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return the residuals (V,) of a density (V,) in standard errors of the expected one, NaN with
    too few counts.

    Of independent counts, each of which adds c to a density, the variance is c times the density.
    Samples of a run are correlated and c depends on v, so c is the ratio of summed variances to
    summed densities of some bins. With its own error alone, a bin that happens to be low would have
    too small a c, and would be shown more often than one that happens to be high.
    """
    variance, density = (
        np.convolve(values, NEIGHBOURS, mode="same") for values in (error**2, observed)
    )
    known = (variance > 0) & (density > 0)
    variance_of_count = np.where(known, variance, np.inf) / np.where(known, density, 1)
    enough = expected >= FEWEST_COUNTS * variance_of_count
    return np.where(
        enough,
        (observed - expected) / np.sqrt(expected * np.where(enough, variance_of_count, 1)),
        np.nan,
    )


def _expected(centres: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Edges (R + 1,) of the bins and the density (R,) expected in them; the outermost bins include
    the tails.
    """
    width = centres[1] - centres[0]
    edges = np.append(centres - width / 2, centres[-1] + width / 2)
    cumulative = SHOWN[name][1](edges)
    cumulative[[0, -1]] = 0, 1
    return edges, np.diff(cumulative) / width


def table_of_velocities(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, species and bin, components first and then speeds, with the expected
    density.
    """
    frames = []
    for name, (dim, *_) in SHOWN.items():
        plain = {dim: "value", name: "density"}
        plain |= {f"{name}{suffix}": suffix[1:] for suffix in SUFFIXES[1:]}
        frame = frame_of(cases, ("species", dim), [name]).rename(columns=plain)
        centres = cases[0][dim].values
        maxwell = dict(zip(centres, _expected(centres, name)[1], strict=True))
        frames.append(frame.assign(of=dim.removesuffix("_bin"), maxwell=frame.value.map(maxwell)))
    return concat(frames)


FIGURE = Figure(
    draw=draw_velocities,
    variables=("velocity_density",),
    table=table_of_velocities,
)
