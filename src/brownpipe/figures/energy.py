"""Figure `energy`: mean kinetic energy per disk of each species against time.

In equilibrium all species have the same, kT in two dimensions (equipartition); a tracer that starts
hotter cools.
"""

from typing import Any

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import defined, estimate_of, has
from brownpipe.figures.style import DOTTED, INK, band, highest, time_axis, told_apart

NAME = "species_energy"
LABELS = ("kinetic energy per disk",)
TABLE = (("species", "time"), (NAME,))


def curves(axes: Axes, parts: list[Dataset], **looks: Any) -> None:
    """Draw the energy of each species with its 95 % band, and the mean over all disks."""
    parts = [defined(part, NAME) for part in parts]
    for part, line in told_apart(
        parts, lambda part: f"{estimate_of(part.isel(time=-1), NAME)} at the end", looks
    ):
        band(axes, part, NAME, **line)
    for mean in dict.fromkeys(
        float(part.kinetic_temperature) for part in parts if has(part, "kinetic_temperature")
    ):
        axes.axhline(mean, color=INK, linestyle=DOTTED, label=f"equipartition, $kT$ = {mean:.4g}")
    axes.set_ylim(0, 1.05 * highest(parts, NAME) or 1.0)
    time_axis(axes, parts)
