"""Figure `velocity_distribution`: velocity components and speeds of each species, and the Maxwell-Boltzmann ones."""

from itertools import cycle
from math import erf

import numpy as np

from brownpipe.figures.cases import has, title_of
from brownpipe.figures.style import INK, KINDS, START, columns, heads
from brownpipe.figures.tables import Table, long_table

LIKELY = 2.0  # deviations of up to so many standard errors lie in the grey band
FEWEST_COUNTS = 5  # expected in a bin whose residual is shown
FEWEST = 1e-6  # densities below are not shown
LABELS = ("probability density", "(found - expected)\n/ standard error")
HEIGHTS = (3.6, 1.4)  # of a density and its residuals [inch]
VARIABLES = ("velocity_density",)
LACKING = "the observable velocity_distribution was not asked for"


def _normal(v):
    """Probability that a component in units of sqrt(kT/m) is below v."""
    return 0.5 * (1 + np.vectorize(erf)(v / np.sqrt(2)))


def _rayleigh(u):
    """Probability that a speed in units of sqrt(kT/m) is below u, in the plane."""
    return 1 - np.exp(-(np.maximum(u, 0) ** 2) / 2)


SHOWN = {
    "velocity_density": ("velocity", _normal, "components", "velocity component $v\\,/\\,\\sqrt{kT/m}$"),
    "speed_density": ("speed", _rayleigh, "speeds", "speed $|v|\\,/\\,\\sqrt{kT/m}$"),
}  # dimension, distribution function, words, axis


def draw(cases):
    """One column per case; components and speeds, each as a density above and its residuals below."""
    names = [name for name in SHOWN if any(has(case, name) for case in cases)]
    figure, axes = columns(LABELS * len(names), len(cases), HEIGHTS * len(names))
    for k, name in enumerate(names):
        for case, (main, low) in zip(cases, axes[2 * k : 2 * k + 2].T, strict=True):
            _density(main, low, case, name)
            low.set_xlabel(SHOWN[name][3])
        heads(axes[2 * k], [f"{title_of(case)}: {SHOWN[name][2]}" for case in cases])
        axes[2 * k + 1, 0].locator_params(axis="y", nbins=5, steps=[1, 2, 5, 10], integer=True)
    return figure


def _density(main, low, case, name):
    dim, *_ = SHOWN[name]
    edges, expected = _expected(case[dim].values, name)
    main.stairs(expected, edges, color=INK, linewidth=1.0, label="Maxwell-Boltzmann")
    low.axhspan(-LIKELY, LIKELY, color="#EFEFEF", linewidth=0)
    low.axhline(0, color=START, linewidth=0.8)
    kinds = [kind for kind in case.species.values if has(case.sel(species=kind), name)]
    for kind, (colour, _, marker) in zip(kinds, cycle(KINDS), strict=False):
        mine = case.sel(species=kind)
        found, error = mine[name].values, mine[f"{name}_standard_error"].values
        main.plot(case[dim], found, marker, color=colour, markersize=3, markerfacecolor="none", label=kind)
        some = (error > 0) & (expected * found >= FEWEST_COUNTS * error**2)  # (found/error)^2 were counted
        scatter = (error * np.sqrt(expected / np.where(some, found, 1)))[some]  # of as many as are expected
        low.plot(case[dim][some], (found - expected)[some] / scatter, marker, color=colour, markersize=2.5)
    seen = expected > FEWEST
    for axes in (main, low):
        axes.set_xlim(edges[:-1][seen][0], edges[1:][seen][-1])
    main.set_ylim(0, 1.15 * expected.max())
    main.tick_params(labelbottom=False)


def _expected(centres, name):
    """Edges (R + 1,) of the bins and the density (R,) expected in them; the outermost bins hold what lies beyond."""
    width, below = centres[1] - centres[0], SHOWN[name][1]
    edges = np.append(centres - width / 2, centres[-1] + width / 2)
    upto = below(edges)
    upto[[0, -1]] = 0, 1
    return edges, np.diff(upto) / width


def table(cases):
    """One row per case, species and bin, of the components first and then of the speeds, with the expected density."""
    header = ("scene", "particles", "engine", "species", "of", "value", "density")
    rows = []
    for name in (name for name in SHOWN if any(has(case, name) for case in cases)):
        centres = cases[0][SHOWN[name][0]].values
        maxwell = dict(zip(centres, _expected(centres, name)[1], strict=True))
        found = long_table(cases, ("species", SHOWN[name][0]), [name]).rows
        rows += [(*row[:4], SHOWN[name][0], *row[4:], maxwell[row[4]]) for row in found]
    return Table((*header, "standard_error", "low", "high", "maxwell"), rows)
