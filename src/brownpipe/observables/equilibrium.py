"""Which scenes are in equilibrium from t = 0, and what that allows.

In a stationary run every sample is as good a time origin as t = 0. In a scene that claims to be in
equilibrium the quarters of the runs are compared: they must not drift (`analysis.drift`).
"""

import numpy as np

from brownpipe.observables.observable import Axis, RunArray
from brownpipe.scene import Scene, motion

AXES = {
    "quarter": Axis(
        "1", "quarter of the run, between the samples next to its ends", lambda _: np.arange(1, 5)
    )
}
ARRAYS = {  # that engines of all disks report
    "quarter_collisions": RunArray(
        ("quarter",), "1", "collisions between disks in each quarter of the run"
    ),
    "quarter_virial": RunArray(("quarter",), "energy*time", "virial in each quarter of the run"),
    "quarter_energy": RunArray(
        ("quarter", "species"), "energy", "kinetic energy per disk, mean of a quarter's ends"
    ),
}


def is_stationary(scene: Scene) -> bool:
    """Return whether the runs of a scene are in equilibrium from t = 0, so that their statistics do
    not depend on t.
    """
    return why_not_stationary(scene) is None


def why_not_stationary(scene: Scene) -> str | None:
    """Return why runs of the scene may not be stationary, None if they are.

    They are if all disks are drawn at one temperature and equilibrate, the tracer included, before
    t = 0.
    """
    if scene.has_one_state:
        return "the velocities of its disks are given"
    if not motion.is_thermal(scene):
        return "velocities.temperature is not given"
    if scene.equilibrate.time == 0:
        return "they do not equilibrate; must be equilibrate: {time: T, tracer: free}"
    if scene.equilibrate.tracer == "pinned":
        free = f"equilibrate: {{time: {scene.equilibrate.time:g}, tracer: free}}"
        return f"its tracer is pinned while it equilibrates, the default; must be {free}"
    return None


def claims_equilibrium(scene: Scene) -> bool:
    """Return whether a scene claims that its runs are in equilibrium from t = 0: whether it
    equilibrates.

    A tracer that is pinned meanwhile may start hot, or from a place of its own between walls: with
    it the claim needs a temperature and a box without walls. In a box of walls alone a total
    momentum set to zero at t = 0 is no equilibrium; in a channel that along it is, which no wall
    changes.
    """
    if scene.velocities is None or scene.equilibrate.time == 0:
        return False
    if motion.starts_with_zero_momentum(scene) and not scene.box.has_images:
        return False
    if scene.equilibrate.tracer == "free":
        return True
    return motion.is_thermal(scene) and not scene.box.has_walls


def ends_of_quarters(times: np.ndarray) -> np.ndarray:
    """Return the samples (5,) next to 0, 1/4, 1/2, 3/4 and 1 of a run sampled at `times` (T,); (0,)
    if two coincide.
    """
    if len(times) < 5:
        return np.zeros(0, np.int64)
    between_samples = (times[1:] + times[:-1]) / 2
    ends = np.searchsorted(between_samples, times[-1] * np.arange(5) / 4)
    return ends if (np.diff(ends) > 0).all() else ends[:0]
