"""CPU time of a run, measured by running some; start-up and compilation are left out."""

import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import NamedTuple

import numpy as np

from brownpipe import progress
from brownpipe.engines import Engine
from brownpipe.scene import Scene

# measurements, of which the median is taken; FEWER if a run takes longer than LONG
REPEATS = 5
FEWER = 3
LEAST = 0.2  # CPU seconds of the shortest measurement
LONG = 2.0  # CPU seconds of a long run
MOST_TIMED_RUNS = 10_000  # in a measurement
# shortest measurement in units of the fixed part of a call, so that the noise of that part is small
LONGER = 4.0
FIRST_TIMED_SEED = 2**41  # of the timed runs; no study uses these seeds


class Ratio(NamedTuple):
    """Ratio of the CPU times of two runs: median and range."""

    ratio: float
    low: float
    high: float


def seconds_per_run(engine: Engine, scene: Scene) -> float:
    """Return the CPU seconds of a run, from drawing its state to its last sample, without writing
    the file.

    The median of REPEATS measurements with runs of different seeds, all in this process and after a
    first call that does not count, as it may have to compile. The fixed part of a call (such as
    measuring a friction rate) is left out: a measurement is the difference of a call with many runs
    and one with a single run. Other work on the machine still affects it, by its use of cache and
    memory bandwidth.
    """
    measurement, repeats = _ready(engine, scene)
    return float(np.median([measurement() for _ in range(repeats)]))


def ratio_to(reference: tuple[Engine, Scene], engine: Engine, scene: Scene) -> Ratio:
    """Return the ratio of the CPU time of a run to that of a run of `reference`, by measuring both
    in turn.

    The speed of a shared machine changes from minute to minute; the ratio of two measurements, one
    after the other, varies less.
    """
    measurement, repeats = _ready(engine, scene)
    reference_measurement, _ = _ready(*reference)
    ratios = np.array([measurement() / reference_measurement() for _ in range(repeats)])
    return Ratio(float(np.median(ratios)), float(ratios.min()), float(ratios.max()))


def _ready(engine: Engine, scene: Scene) -> tuple[Callable[[], float], int]:
    """A function that measures the CPU seconds of a run, and how often to call it."""
    seeds = count(FIRST_TIMED_SEED)
    _seconds(engine, scene, seeds, 1)
    single = _seconds(engine, scene, seeds, 1)
    five = _seconds(engine, scene, seeds, 5)
    estimate = max((five - single) / 4, 1e-6)
    shortest = max(LEAST, LONGER * (single - estimate))  # measurement
    runs = int(np.clip(np.ceil(shortest / estimate), 1, MOST_TIMED_RUNS))

    def measurement() -> float:
        single = _seconds(engine, scene, seeds, 1)
        several = _seconds(engine, scene, seeds, 1 + runs)
        return max((several - single) / runs, 1e-9)

    return measurement, FEWER if estimate > LONG else REPEATS


def _seconds(engine: Engine, scene: Scene, seeds: Iterator[int], runs: int) -> float:
    """CPU seconds of a call with runs of the next seeds."""
    batch = [next(seeds) for _ in range(runs)]
    with progress.unreported():
        began = time.process_time()
        engine.simulate(scene, batch, frozenset({"tracer"}))
        return time.process_time() - began
