"""Figure `density_profile`: the number density of each species against the distance from the
walls.
"""

from typing import Unpack

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import estimate_of
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import DOTTED, band, points, styled_cases

NAME = "density_profile"
BULK = 0.75  # share of the largest distance from which on the density is that of the bulk


def draw_profiles(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw the profile of each species with its 95 % band, its value at the wall, and that of the
    bulk.
    """
    for species, line in styled_cases(cases, _density_at_wall, looks):
        colour = line["color"]
        band(axes, species, NAME, **line)
        points(axes, [0.0], [species], "contact_density", marker="o", color=colour, clip_on=False)
        in_bulk = species.wall_distance > BULK * species.wall_distance[-1]
        bulk = float(species[NAME].where(in_bulk).mean())
        axes.axhline(bulk, color=colour, linestyle=DOTTED, linewidth=1)
    axes.set_xlim(0, max(float(species.wall_distance[-1]) for species in cases))
    axes.set_ylim(bottom=0)
    axes.set_xlabel("distance $z$ of the disk's edge from the wall")


def _density_at_wall(species: Dataset) -> str:
    """Return the density of a species at the wall in words, for the legend."""
    return f"n(wall) = {estimate_of(species, 'contact_density')}"


FIGURE = Figure(
    curves=draw_profiles,
    labels=("number density $n(z)$ of centres",),
    variables=(NAME, "contact_density"),
    component="species",
    table=Columns(("species", "wall_distance"), (NAME,)),
)
