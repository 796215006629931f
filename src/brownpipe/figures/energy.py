"""Figure `energy`: mean kinetic energy per disk of each species against time.

In equilibrium all species have the same, kT in two dimensions (equipartition); a tracer that starts
hotter cools.
"""

from typing import Unpack

from matplotlib.axes import Axes
from xarray import Dataset

from brownpipe.figures.cases import defined, estimate_of, has
from brownpipe.figures.figure import Columns, Figure
from brownpipe.figures.looks import Looks
from brownpipe.figures.style import DOTTED, INK, band, highest, styled_cases, time_axis

NAME = "species_energy"


def draw_energies(axes: Axes, cases: list[Dataset], **looks: Unpack[Looks]) -> None:
    """Draw the energy of each species with its 95 % band, and the mean over all disks."""
    cases = [defined(species, NAME) for species in cases]
    for species, line in styled_cases(cases, _last_energy, looks):
        band(axes, species, NAME, **line)
    with_mean = [species for species in cases if has(species, "kinetic_temperature")]
    means = [float(species.kinetic_temperature) for species in with_mean]
    for mean in dict.fromkeys(means):
        axes.axhline(mean, color=INK, linestyle=DOTTED, label=f"equipartition, $kT$ = {mean:.4g}")
    axes.set_ylim(0, 1.05 * highest(cases, NAME) or 1.0)
    time_axis(axes, cases)


def _last_energy(species: Dataset) -> str:
    """Return the energy of a species at the end in words, for the legend."""
    return f"{estimate_of(species.isel(time=-1), NAME)} at the end"


FIGURE = Figure(
    curves=draw_energies,
    labels=("kinetic energy per disk",),
    variables=(NAME,),
    component="species",
    table=Columns(("species", "time"), (NAME,)),
)
