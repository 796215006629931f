"""What a run costs, by running some: CPU seconds of this process, with start and compilation left out."""

import time

import numpy as np

STRETCHES, FEWER = 5, 3  # the median of so many; of fewer where a run takes longer than LONG
LEAST, LONG = 0.2, 2.0  # CPU seconds of a stretch at least, and of a long run
MOST_RUNS = 2000  # in a stretch
FIRST_SEED = 2**41  # of no study


def seconds_per_run(engine, scene, stretches=STRETCHES):
    """CPU seconds of a run, from drawing its state to its last sample; the file is not written.

    The median over `stretches` of runs of different seeds, all in this process and after a first one that does not
    count, as it may have to compile. Other work on the machine still shows: it takes cache and memory away.
    """
    _timed(engine, scene, 0, 1)
    one = _timed(engine, scene, 1, 1)
    runs = int(np.clip(np.ceil(LEAST / max(one, 1e-9)), 1, MOST_RUNS))
    stretches = min(stretches, FEWER) if one > LONG else stretches
    return float(np.median([_timed(engine, scene, 2 + k * runs, runs) for k in range(stretches)]))


def _timed(engine, scene, after, runs):
    seeds = range(FIRST_SEED + after, FIRST_SEED + after + runs)
    begun = time.process_time()
    engine.simulate(scene, seeds, frozenset({"tracer"}))
    return (time.process_time() - begun) / runs
