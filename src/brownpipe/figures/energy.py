"""Figure `energy`: mean kinetic energy per disk of each species against time.

In equilibrium all species have the same, kT in two dimensions (equipartition); a tracer that starts hotter cools.
"""

from itertools import cycle

from matplotlib.figure import Figure
from pandas import DataFrame
from xarray import Dataset

from brownpipe.figures.cases import has, over_time, parts_of, plus_minus, title_of
from brownpipe.figures.style import DOTTED, INK, SERIES, band, columns, heads, highest, time_axis
from brownpipe.figures.tables import frame_of

NAME = "species_energy"


def draw(cases: list[Dataset]) -> Figure:
    """Draw one column per case: a curve with its 95 % band for each species, and the mean over all disks."""
    figure, axes = columns(["kinetic energy per disk"], len(cases), [4.2])
    cases = [over_time(case, NAME) for case in cases]
    for case, panel in zip(cases, axes[0], strict=True):
        for part, (colour, line, _) in zip(parts_of(case, "species", NAME), cycle(SERIES), strict=False):
            last = plus_minus(part[NAME][-1], part[f"{NAME}_standard_error"][-1])
            band(panel, part, NAME, colour, linestyle=line, label=f"{part.species.item()}: {last} at the end")
        if has(case, "kinetic_temperature"):
            mean = float(case.kinetic_temperature)
            panel.axhline(mean, color=INK, linestyle=DOTTED, label=f"equipartition, $kT$ = {mean:.4g}")
        time_axis(panel, case.time.values)
    mean = max(float(case[NAME].max()) for case in cases)
    axes[0, 0].set_ylim(0, min(1.05 * highest(cases, NAME), 1.5 * mean) or 1.0)  # above the bands, unless very wide
    heads(axes[0], map(title_of, cases))
    return figure


def table(cases: list[Dataset]) -> DataFrame:
    """Return one row per case, species and time."""
    return frame_of(cases, ("species", "time"), [NAME])
