"""Windows of time in which straight lines are fitted to the MSD: their names, the default ones, and
a caution on those that begin too early. W windows, T sample times.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from brownpipe.engines.friction import DECAY_TIMES, not_diffusive_before
from brownpipe.observables.average import over_origins
from brownpipe.scene import Scene
from brownpipe.scene.times import decimal_of

Window = tuple[float, float]  # start and end [time]

# A window may begin at this share of 3/gamma: the start of default windows is rounded.
ROUNDED = 0.95
SHARES = (0.1, 0.25, 0.5)  # of the time at which a window ends: at the earliest it begins there
SHORTER = math.sqrt(2)  # ratio of the times at which windows may end
MOST_ENDS = 16  # the last is 1/181 of the first


def window_labels(windows: Sequence[Window]) -> list[str]:
    """Return labels of windows, from the first six digits of their ends.

    >>> window_labels([(0.1, 1.0), (0.25, 12345678.0)])
    ['[0.1, 1]', '[0.25, 1.23457e+07]']
    """
    return [f"[{start:g}, {end:g}]" for start, end in windows]


def times_in_window(times: np.ndarray, window: Window) -> np.ndarray:
    """Return which of the times (T,) lie in a window, its ends included to round-off."""
    start, end = window
    slack = 1e-9 * max(abs(start), abs(end))
    return (times >= start - slack) & (times <= end + slack)


def default_windows(scenes: Sequence[Scene], average: str = "runs") -> tuple[Window, Window]:
    """Return the two windows [time] that are known before any run: the first candidate."""
    return candidate_windows(scenes, longest_end(scenes, average))[0]


def longest_end(scenes: Sequence[Scene], average: str) -> float:
    """Return when default windows end at the latest [time]: with the shortest run.

    With averages over time `origins`, with its first half: of the longest times there are few.
    """
    shortest = min(scene.duration for scene in scenes)
    return shortest / 2 if over_origins(average) else shortest


def earlier_ends(scenes: Sequence[Scene], average: str) -> list[float]:
    """Return times [time] at which windows may end, descending from `longest_end` by factors.

    The last is not below twice the time in which the slowest tracer forgets its initial velocity.
    """
    last = longest_end(scenes, average)
    shorter = [float(f"{last / SHORTER**power:.2g}") for power in range(1, MOST_ENDS)]
    return [last, *(end for end in shorter if slowest_start(scenes) <= end / 2)]


def slowest_start(scenes: Sequence[Scene]) -> float:
    """Return when the slowest tracer has forgotten its initial velocity [time], to two digits."""
    starts = np.array([not_diffusive_before(scene) for scene in scenes])
    return float(f"{starts[np.isfinite(starts)].max(initial=0.0):.2g}")


def candidate_windows(scenes: Sequence[Scene], end: float) -> list[tuple[Window, Window]]:
    """Return pairs of windows [time] up to `end` in which the motion of all tracers may be
    diffusive.

    The first window of a pair begins where the slowest tracer has forgotten its initial velocity,
    from a tenth to a half of `end`, the second at twice that time, from a half to three quarters.
    The second and third pair begin later, for motion that is diffusive late, as in cages.
    """
    pairs = []
    for share in SHARES:
        first = min(max(slowest_start(scenes), share_of(share, end)), end / 2)
        second = min(max(2 * first, end / 2), share_of(0.75, end))
        pairs.append(((first, end), (second, end)))
    return pairs


def share_of(share: float, end: float) -> float:
    """Return a share of a time as one writes it.

    >>> share_of(0.75, 0.4), 0.75 * 0.4
    (0.3, 0.30000000000000004)
    """
    return float(decimal_of(share) * decimal_of(end))


def window_caution(window: Window, starts: Mapping[str, float]) -> str | None:
    """Return one line of caution if a window begins before the initial velocity is forgotten.

    starts: `not_diffusive_before` [time] of scenes by their names. None if no window does. Lone
    disks, which never forget it, do not count.
    """
    finite = {name: start for name, start in starts.items() if start < math.inf}
    early = {name: start for name, start in finite.items() if window[0] < ROUNDED * start}
    if not early:
        return None
    latest = max(early, key=lambda name: early[name])
    number = f" in {len(early)} of {len(starts)} cases" if len(starts) > 1 else ""
    where = f"{number}, {early[latest]:.3g} for {latest}"
    begins = f"{window_labels([window])[0]} begins before {DECAY_TIMES:g}/gamma of the tracer"
    return f"the fit window {begins}{where}: D there is not yet that of diffusion"
