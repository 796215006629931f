"""Figure `density_profile`: the number density of each species against the distance from the
walls.
"""

from typing import Any

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import estimate_of
from brownpipe.figures.style import DOTTED, band, points, told_apart

NAME = "density_profile"
LABELS = ("number density $n(z)$ of centres",)
TABLE = (("species", "wall_distance"), (NAME,))
BULK = 0.75  # share of the largest distance from which on the density is that of the bulk


def curves(axes: Axes, parts: list[Dataset], **looks: Any) -> None:
    """Draw the profile of each species with its 95 % band, its value at the wall, and that of the
    bulk.
    """
    for part, line in told_apart(
        parts, lambda part: f"n(wall) = {estimate_of(part, 'contact_density')}", looks
    ):
        band(axes, part, NAME, **line)
        points(axes, [0.0], [part], "contact_density", fmt="o", color=line["color"], clip_on=False)
        bulk = float(part[NAME].where(part.wall_distance > BULK * part.wall_distance[-1]).mean())
        axes.axhline(bulk, color=line["color"], linestyle=DOTTED, linewidth=1)
    axes.set_xlim(0, max(float(part.wall_distance[-1]) for part in parts))
    axes.set_ylim(bottom=0)
    axes.set_xlabel("distance $z$ of the disk's edge from the wall")
