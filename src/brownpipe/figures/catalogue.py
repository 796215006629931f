"""The list of figures. To add one, write `figures/NAME.py` and its caption `figures/NAME.rst`, and
add a line here.

The module has `draw(cases)`, which returns a matplotlib figure; or, if several cases may share a
panel, `curves(axes, cases, **looks)`, which draws them into one, and the `LABELS` of the vertical
axes (`render`). Its numbers are `TABLE`, the dimensions and variables of `cases.frame_of`, or
`table(cases)`. The `needs` of a figure must guarantee that some case has its `variables`. Studies,
the command line and the workflow take the names from here, so that this module imports nothing
heavy.
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
    """What a figure of a study asks for, and how its cases share panels."""

    needs: tuple[str, ...] = ()  # what the study must have
    variables: tuple[str, ...] = ()  # variables of the dataset that a case must have to be shown
    every_count: bool = False  # shows all particle counts of a scene; otherwise one
    part: str = ""  # dimension of the parts of a case that have curves of their own


FIGURES = {  # by name, which is that of the module that draws it
    "msd": Figure((FOLLOWED, SPREADING), ("msd",)),
    "displacement_distribution": Figure(
        (FOLLOWED, ENDS), ("displacement_counts", "displacement_overflow")
    ),
    "diffusion": Figure((FOLLOWED, SPREADING), ("msd",)),
    "velocity_autocorrelation": Figure(
        ("the observable velocity_autocorrelation",), ("velocity_autocorrelation",)
    ),
    "velocity_distribution": Figure(
        ("the observable velocity_distribution",), ("velocity_density",)
    ),
    "pair_distribution": Figure(
        ("the observable pair_distribution",), ("pair_distribution",), part="species_pair"
    ),
    "density_profile": Figure((WALLS,), ("density_profile", "contact_density"), part="species"),
    "orientational_order": Figure(
        ("the observable orientational_order",), ("orientational_order",), True
    ),
    "energy": Figure(("the observable species_energy",), ("species_energy",), part="species"),
    "own_observables": Figure((OWN,), every_count=True),
    "thermodynamics": Figure((COLLISIONS,), ("collision_rate",), every_count=True),
    "scan": Figure((SCAN, SPREADING), ("msd",), every_count=True),
    "health": Figure(every_count=True),
}
