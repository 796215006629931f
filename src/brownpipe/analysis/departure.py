"""Time at which an approximate trajectory departs from the exact one with the same initial state."""

import numpy as np

SHARE = 1e-3  # of the tracer's radius: two trajectories further apart than this have departed


def departure_time(
    times: np.ndarray,
    position: np.ndarray,
    reference: np.ndarray,
    bound: np.ndarray | float,
    size: tuple[float, float] | None = None,
) -> np.ndarray:
    """Return the first sample time (S,) at which trajectories are further apart than `bound`; inf for never.

    times: (T,) [time].
    position, reference: (T, S, 2) [length] of the same seeds.
    bound: a number or (S,) [length]; for the tracer `SHARE` of its radius.
    size: (width, height) of a periodic box, in which the nearest images are compared.

    A position that is NaN counts as departed. Trajectories of hard disks diverge exponentially, so this time grows only
    as the logarithm of 1/error: it tells for how long single collisions are right, but nothing about averages. It is
    resolved to one sample interval.
    """
    apart = np.asarray(position, float) - np.asarray(reference, float)
    if size is not None:
        apart = apart - np.round(apart / size) * size
    departed = ~(np.hypot(apart[..., 0], apart[..., 1]) <= bound)
    return np.where(departed.any(axis=0), np.asarray(times)[departed.argmax(axis=0)], np.inf)
