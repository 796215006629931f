"""What a run costs, by running some: CPU seconds of this process, with start and compilation left out."""

import time
from itertools import count
from typing import NamedTuple

import numpy as np

STRETCHES, FEWER = 5, 3  # the median of so many; of fewer where a run takes longer than LONG
LEAST, LONG = 0.2, 2.0  # CPU seconds of a stretch at least, and of a long run
MOST_RUNS = 10_000  # in a stretch
LONGER = 4.0  # times what a call takes once is a stretch at least, for the difference to be well above its noise
FIRST_SEED = 2**41  # of no study


class Ratio(NamedTuple):
    """Ratio of the CPU times of two runs: median and range."""

    ratio: float
    low: float
    high: float


def seconds_per_run(engine, scene, stretches=STRETCHES):
    """CPU seconds of a run, from drawing its state to its last sample; the file is not written.

    The median over `stretches` of runs of different seeds, all in this process and after a first call that does not
    count, as it may have to compile. What every call takes once (a friction that is measured, say) is left out: it is
    the difference of a call with many runs and one with a single run. Other work on the machine still shows: it takes
    cache and memory away.
    """
    stretch, each = _ready(engine, scene)
    return float(np.median([stretch() for _ in range(min(stretches, FEWER) if each > LONG else stretches)]))


def ratio_to(reference, engine, scene, stretches=STRETCHES):
    """Ratio of the CPU time of a run to that of a run of `reference`, an engine and a scene; a stretch of each in turn.

    The speed of a shared machine changes from minute to minute; the ratio of two stretches, one after the other, less.
    """
    (stretch, each), (reference_stretch, _) = _ready(engine, scene), _ready(*reference)
    turns = range(min(stretches, FEWER) if each > LONG else stretches)
    ratios = np.array([stretch() / reference_stretch() for _ in turns])
    return Ratio(float(np.median(ratios)), float(ratios.min()), float(ratios.max()))


def _ready(engine, scene):
    """A function that returns the CPU seconds of a run, over a stretch of them, and about how long one takes."""
    seeds = count(FIRST_SEED)
    _seconds(engine, scene, seeds, 1)
    single, few = _seconds(engine, scene, seeds, 1), _seconds(engine, scene, seeds, 5)
    each = max((few - single) / 4, 1e-6)
    runs = int(np.clip(np.ceil(max(LEAST, LONGER * (single - each)) / each), 1, MOST_RUNS))

    def stretch():
        alone = _seconds(engine, scene, seeds, 1)
        return max((_seconds(engine, scene, seeds, 1 + runs) - alone) / runs, 1e-9)

    return stretch, each


def _seconds(engine, scene, seeds, runs):
    """CPU seconds of a call with so many runs of the next seeds."""
    mine = [next(seeds) for _ in range(runs)]
    begun = time.process_time()
    engine.simulate(scene, mine, frozenset({"tracer"}))
    return time.process_time() - begun
