"""Quarters of a run, in which a scene that claims to be in equilibrium is looked at for drifts (`analysis.drift`)."""

import numpy as np

from brownpipe.observables.observable import Axis, RunArray
from brownpipe.scene import Scene

AXES = {"quarter": Axis("1", "quarter of the run, between the samples next to its ends", lambda _: np.arange(1, 5))}
ARRAYS = {  # that engines of all disks report
    "quarter_collisions": RunArray(("quarter",), "1", "collisions between disks in each quarter of the run"),
    "quarter_virial": RunArray(("quarter",), "energy*time", "virial in each quarter of the run"),
    "quarter_energy": RunArray(
        ("quarter", "species"), "energy", "kinetic energy per disk, mean of those at both ends of each quarter"
    ),
}


def claims_equilibrium(scene: Scene) -> bool:
    """Return whether a scene claims that its runs are in equilibrium from t = 0: whether it equilibrates.

    A tracer that is pinned meanwhile may start hot, or from a place of its own between walls: with it the claim needs a
    temperature and a periodic box. Between walls a total momentum set to zero at t = 0 is no equilibrium.
    """
    velocities, periodic = scene.velocities, scene.box.periodic
    if velocities is None or scene.equilibrate.time == 0 or (velocities.zero_momentum and not periodic):
        return False
    return scene.equilibrate.tracer == "free" or (velocities.temperature is not None and periodic)


def ends_of_quarters(times: np.ndarray) -> np.ndarray:
    """Return the samples (5,) next to 0, 1/4, 1/2, 3/4 and 1 of a run sampled at `times` (T,); (0,) if two are one."""
    if len(times) < 5:
        return np.zeros(0, np.int64)
    ends = np.searchsorted((times[1:] + times[:-1]) / 2, times[-1] * np.arange(5) / 4)
    return ends if (np.diff(ends) > 0).all() else ends[:0]


def has_quarters(scene: Scene) -> bool:
    """Return whether runs of a scene are counted in quarters."""
    return claims_equilibrium(scene) and len(ends_of_quarters(scene.times)) > 0
