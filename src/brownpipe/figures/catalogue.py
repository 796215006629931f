"""The list of figures. To add one, write `figures/NAME.py` and its caption `figures/NAME.rst`, and add a line here.

The module has `draw(cases)`, which returns a matplotlib figure; or, if several cases may share a panel,
`curves(axes, cases, **looks)`, which draws them into one, and the `LABELS` of the vertical axes (`render`). Its numbers
are `TABLE`, the dimensions and variables of `cases.frame_of`, or `table(cases)`. The `needs` of a figure must guarantee
that some case has its `variables`. Studies, the command line and the workflow take the names from here, so that this
module imports nothing heavy.
"""

from typing import NamedTuple

# What a study must have for a figure, as refusals name it
FOLLOWED = "a disk to follow"
COLLISIONS = "disks, and an engine that counts their collisions"
SCAN = "two particle counts or more, or a varied key"
ENDS = "record: tracer, or square_displacement among the observables with average: runs"
WALLS = "the observable density_profile, and walls"
OWN = "an observable of your own"
SPREADING = "record: tracer, or square_displacement among the observables"


class Figure(NamedTuple):
    """One figure of a study, drawn by the module of its name."""

    name: str
    needs: tuple[str, ...] = ()  # what the study must have
    variables: tuple[str, ...] = ()  # variables of the dataset that a case must have to be shown
    every_count: bool = False  # shows all particle counts of a scene; otherwise one
    part: str = ""  # dimension of the parts of a case that have curves of their own


FIGURES = {
    figure.name: figure
    for figure in (
        Figure("msd", (FOLLOWED, SPREADING), ("msd",)),
        Figure("displacement_distribution", (FOLLOWED, ENDS), ("displacement_counts", "displacement_overflow")),
        Figure("diffusion", (FOLLOWED, SPREADING), ("msd",)),
        Figure("velocity_autocorrelation", ("the observable velocity_autocorrelation",), ("velocity_autocorrelation",)),
        Figure("velocity_distribution", ("the observable velocity_distribution",), ("velocity_density",)),
        Figure("pair_distribution", ("the observable pair_distribution",), ("pair_distribution",), part="species_pair"),
        Figure("density_profile", (WALLS,), ("density_profile", "contact_density"), part="species"),
        Figure("orientational_order", ("the observable orientational_order",), ("orientational_order",), True),
        Figure("energy", ("the observable species_energy",), ("species_energy",), part="species"),
        Figure("own_observables", (OWN,), every_count=True),
        Figure("thermodynamics", (COLLISIONS,), ("collision_rate",), every_count=True),
        Figure("scan", (SCAN, SPREADING), ("msd",), every_count=True),
        Figure("health", every_count=True),
    )
}
