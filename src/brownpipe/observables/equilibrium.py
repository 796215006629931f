"""Which scenes are in equilibrium from t = 0, and what that allows.

In a stationary run every sample is as good a time origin as t = 0. In a scene that claims to be in
equilibrium the quarters of the runs are compared: they must not drift (`analysis.drift`).
"""

from collections.abc import Iterator

import numpy as np

from brownpipe.observables.observable import Axis, RunArray
from brownpipe.scene import Scene, motion
from brownpipe.scene.scene import SAME

MOST_ORIGINS = 20_000  # which have 2e8 pairs
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
    if scene.velocities is None:
        return "its disks are listed one by one"
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
    it the claim needs a temperature and a periodic box. Between walls a total momentum set to zero
    at t = 0 is no equilibrium.
    """
    periodic = scene.box.periodic
    if scene.velocities is None or scene.equilibrate.time == 0:
        return False
    if motion.starts_with_zero_momentum(scene) and not periodic:
        return False
    return scene.equilibrate.tracer == "free" or (motion.is_thermal(scene) and periodic)


def ends_of_quarters(times: np.ndarray) -> np.ndarray:
    """Return the samples (5,) next to 0, 1/4, 1/2, 3/4 and 1 of a run sampled at `times` (T,); (0,)
    if two coincide.
    """
    if len(times) < 5:
        return np.zeros(0, np.int64)
    between_samples = (times[1:] + times[:-1]) / 2
    ends = np.searchsorted(between_samples, times[-1] * np.arange(5) / 4)
    return ends if (np.diff(ends) > 0).all() else ends[:0]


# -- time origins ----------------------------------------------------------------------------------


def why_no_origins(scene: Scene) -> str | None:
    """Return why a stationary scene has no average over time origins, None if it has one."""
    if scene.samples is not None:
        return "origins needs sample_interval, not samples: lags are differences of sample times"
    if len(scene.times) > MOST_ORIGINS:
        return f"origins needs at most {MOST_ORIGINS} samples; there are {len(scene.times)}"
    return None


def lags(scene: Scene) -> Iterator[tuple[slice, slice]]:
    """For each sample time t yield the slices (earlier, later) of all pairs of samples that are t
    apart.

    Sample times are multiples of the sample interval; a duration that is not has t = 0 as its only
    time origin.
    """
    interval = scene.sample_interval
    count = len(scene.times)
    is_multiple = abs(scene.duration - (count - 1) * interval) <= SAME * interval
    equidistant = count if is_multiple else count - 1
    for lag in range(equidistant):
        yield slice(0, equidistant - lag), slice(lag, equidistant)
    if not is_multiple:
        yield slice(0, 1), slice(equidistant, count)
