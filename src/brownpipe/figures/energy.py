"""Figure `energy`: kinetic energy per disk of each species against time: a hot tracer cools until all have the same."""

from itertools import cycle

import numpy as np

from brownpipe.figures.cases import has, over_time, plus_minus, title_of
from brownpipe.figures.style import DOTTED, INK, KINDS, band, columns, heads, time_axis
from brownpipe.figures.tables import long_table

NAME = "species_energy"
VARIABLES = (NAME,)
LACKING = "the observable species_energy was not asked for"


def draw(cases):
    """One column per case, one curve with its 95 % band per species, and the mean over all disks."""
    figure, axes = columns(["kinetic energy per disk"], len(cases), [4.2])
    for case, panel in zip(cases, axes[0], strict=True):
        case = over_time(case, NAME)
        _curves(panel, case)
        if has(case, "kinetic_temperature"):
            mean = float(case.kinetic_temperature)
            panel.axhline(mean, color=INK, linestyle=DOTTED, label=f"equipartition, $kT$ = {mean:.4g}")
        time_axis(panel, case.time.values)
    axes[0, 0].set_ylim(0, max(_top(case) for case in cases) or 1.0)
    heads(axes[0], map(title_of, cases))
    return figure


def _top(case):
    """Upper end of the axis: above the band, unless this is very wide."""
    mean = float(case[NAME].max())
    return float(np.fmin(1.05 * np.fmax(case[f"{NAME}_high"].max(), mean), 1.5 * mean))


def _curves(axes, case):
    kinds = [name for name in case.species.values if has(case.sel(species=name), NAME)]
    for name, (colour, line, _) in zip(kinds, cycle(KINDS), strict=False):
        mine = case.sel(species=name)
        last = plus_minus(mine[NAME][-1], mine[f"{NAME}_standard_error"][-1])
        band(axes, mine.time.values, mine, NAME, colour, linestyle=line, label=f"{name}: {last} at the end")


def table(cases):
    """One row per case, species and time."""
    return long_table(cases, ("species", "time"), [NAME])
