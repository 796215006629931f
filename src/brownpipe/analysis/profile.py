"""Density at contact with the walls: the force on the walls over kT and their length.

K species, B bins of distance, n runs. See docs/theory.md, section 3.
"""

import numpy as np

from brownpipe import theory
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.pairs import contact_weights, truncation, widened
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.runs import RunBlock
from brownpipe.analysis.variables import EACH, Mean
from brownpipe.engines.friction import DENSEST
from brownpipe.observables.profile import bins
from brownpipe.observables.species import species_table
from brownpipe.scene import Scene

DECAY = 2.2  # -d ln n/dz over phi chi near a wall, in diameters; theory has 8/pi at phi = 0


def wall_weights(scene: Scene) -> np.ndarray:
    """Return weights (2, K, B) of the profiles: for the density at contact, and for its change by the next order.

    `pairs.contact_weights` for a flat wall, up to a fifth of a diameter from it.
    """
    phi = min(scene.packing_fraction, DENSEST)
    number, width = bins(scene)
    edges, diameters = np.arange(number + 1) * width, 2 * species_table(scene).radius
    decay = DECAY * phi * float(theory.contact_value(phi))
    return np.stack([contact_weights(edges + one, one, decay, flat=True) for one in diameters], axis=1)


def _columns(case: Case, runs: RunBlock) -> Columns:
    if "density_profile" not in runs.observables:
        return Columns()
    profile = np.asarray(runs.observables["density_profile"], float)
    contact, following = ((profile * weights).sum(axis=-1) for weights in wall_weights(case.scene))
    return Columns({"contact_density": contact, "contact_density_following": following})


def _derived(case: Case, averages: Averages) -> dict[str, Estimate]:
    if "contact_density" not in averages:
        return {}
    error = truncation(averages.estimate("contact_density_following"))
    return {"contact_density": widened(averages.estimate("contact_density"), error)}


SPECIES = (*EACH, "species")

VARIABLES = {
    "contact_density": Mean(
        SPECIES, "1/length^2", "number density at the walls, extrapolated from up to 0.2 diameters"
    ),
}
ESTIMATOR = Estimator(_columns, VARIABLES, _derived)
