"""The figures by name, and what the runs of a study must have for each of them.

Studies, the command line and the workflow take the names from here, so that this module imports
nothing heavy. How a figure is drawn is in the module of its name in `figures`.
"""

from collections.abc import Callable, Set
from typing import NamedTuple


class RunContents(NamedTuple):
    """What the runs of a study have, as far as figures and settings of the analysis need it."""

    observables: Set[str]  # names of those that some of the runs measure
    has_own_observable: bool
    has_disks: bool
    records_tracer: bool
    averages_over_runs: bool  # alone: not also over time origins or equal disks
    counts_collisions: bool
    has_walls: bool
    is_scan: bool

    @property
    def has_spreading(self) -> bool:
        """Whether the mean squared displacement is known."""
        return self.records_tracer or "square_displacement" in self.observables


class Need(NamedTuple):
    """What a figure or a setting needs of the runs of a study."""

    text: str  # as refusals name it
    is_met: Callable[[RunContents], bool]


def _observable(name: str) -> Need:
    """Return the need of an observable."""
    return Need(f"the observable {name}", lambda runs: name in runs.observables)


FOLLOWED_DISK = Need("a disk to follow", lambda runs: runs.has_disks)
COUNTED_COLLISIONS = Need(
    "disks, and an engine that counts their collisions", lambda runs: runs.counts_collisions
)
SCANNED_KEY = Need(
    "two particle counts or more, or a varied key whose values are numbers",
    lambda runs: runs.is_scan,
)
SPREADING = Need(
    "record: tracer, or square_displacement among the observables",
    lambda runs: runs.has_spreading,
)
DISPLACEMENTS = Need(
    "record: tracer, or square_displacement among the observables with average: runs",
    lambda runs: runs.records_tracer or (runs.has_spreading and runs.averages_over_runs),
)
WALLS = Need(
    "the observable density_profile, and walls",
    lambda runs: "density_profile" in runs.observables and runs.has_walls,
)
OWN_OBSERVABLE = Need("an observable of your own", lambda runs: runs.has_own_observable)
# No study has it: the trade-off is a dataset of its own
COMPARISON = Need("engines compared by brownpipe tradeoff", lambda runs: False)

# By name of the figure, in the order in which figures are shown
FIGURES: dict[str, tuple[Need, ...]] = {
    "msd": (FOLLOWED_DISK, SPREADING),
    "displacement_distribution": (FOLLOWED_DISK, DISPLACEMENTS),
    "diffusion": (FOLLOWED_DISK, SPREADING),
    "first_passage": (_observable("first_passage"),),
    "velocity_autocorrelation": (_observable("velocity_autocorrelation"),),
    "velocity_distribution": (_observable("velocity_distribution"),),
    "pair_distribution": (_observable("pair_distribution"),),
    "density_profile": (WALLS,),
    "orientational_order": (_observable("orientational_order"),),
    "energy": (_observable("species_energy"),),
    "own_observables": (OWN_OBSERVABLE,),
    "thermodynamics": (COUNTED_COLLISIONS,),
    "scan": (SCANNED_KEY, SPREADING),
    "tradeoff": (COMPARISON,),
    "health": (),
}
