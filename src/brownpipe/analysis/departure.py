"""When the track of an approximate run departs from that of the exact run with the same initial state."""

import numpy as np

SHARE = 1e-3  # of the tracer's radius: beyond it two tracks are no longer the same


def departure_time(times, position, reference, bound, size=None):
    """Return the first sample time at which tracks are further apart than `bound` [length], (S,); inf if never.

    times: (T,) [time]. position, reference: (T, S, 2) of the same seeds at these times, as tracks are recorded.
    bound: a number or (S,), for the tracer `SHARE` of its radius. size: (width, height) of a periodic box, in which
    the nearest images count. What is no number counts as departed.

    Neighbouring courses part exponentially, so that the time grows only as the logarithm of 1/error: it says for how
    long single events can be believed, and nothing about averages. It is known to one sample interval.
    """
    apart = np.asarray(position, float) - np.asarray(reference, float)
    if size is not None:
        apart = apart - np.round(apart / size) * size
    departed = ~(np.hypot(apart[..., 0], apart[..., 1]) <= bound)
    return np.where(departed.any(axis=0), np.asarray(times)[departed.argmax(axis=0)], np.inf)
