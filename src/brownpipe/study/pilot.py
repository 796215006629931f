"""Pilot runs: a few seconds of a scene with seeds that no study uses.

Their number follows from the forecast, not from a clock, so that it is the same on every machine.
"""

import numpy as np

from brownpipe import tradeoff
from brownpipe.engines import Engine, forecast
from brownpipe.engines.saturation import share_failing
from brownpipe.scene import Scene

FIRST_SEED = 2**40
SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_RUNS, MOST_RUNS = 10, 400


def pilot_runs(scene: Scene) -> int:
    """Return the number of runs of a pilot; the time of those that fail does not count, as they say nothing."""
    seconds = forecast.of_run(scene).seconds - forecast.SECONDS_TO_FAIL * share_failing(scene)
    return int(np.clip(SECONDS / seconds, FEWEST_RUNS, MOST_RUNS))


def pilot_seconds(scene: Scene) -> float:
    """Return the CPU time that a pilot of the exact engine is expected to take [s]."""
    return pilot_runs(scene) * forecast.of_run(scene).seconds


def run_pilot(scene: Scene, engine: Engine) -> tradeoff.EngineRuns:
    """Run the pilot of a scene by an engine; all engines have the same seeds."""
    seeds = range(FIRST_SEED, FIRST_SEED + pilot_runs(scene))
    return tradeoff.runs_of(scene, engine, engine.simulate(scene, seeds, frozenset({"tracer"})))
