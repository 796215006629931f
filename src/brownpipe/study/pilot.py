"""Pilot runs: a few seconds of a scene with seeds that no study uses.

Their number follows from the forecast, not from a clock, so that it is the same on every machine.
"""

import numpy as np

from brownpipe import tradeoff
from brownpipe.engines import Engine, forecast
from brownpipe.engines.saturation import share_failing
from brownpipe.scene import Scene
from brownpipe.study.study import Study

SQUARES = "square_displacement"  # the observable
FIRST_SEED = 2**40
SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_RUNS, MOST_RUNS = 10, 400


def average_of_msd(study: Study) -> str:
    """Return over what the squared displacements of a study are averaged within a run: runs (not at all) or another."""
    return study.average if SQUARES in study.observables else "runs"


def pilot_runs(scene: Scene, average: str = "runs") -> int:
    """Return the number of runs of a pilot; the time of those that fail does not count, as they say nothing."""
    seconds = _seconds(scene, average) - forecast.SECONDS_TO_FAIL * share_failing(scene)
    return int(np.clip(SECONDS / seconds, FEWEST_RUNS, MOST_RUNS))


def pilot_seconds(scene: Scene, average: str = "runs") -> float:
    """Return the CPU time that a pilot of the exact engine is expected to take [s]."""
    return pilot_runs(scene, average) * _seconds(scene, average)


def run_pilot(scene: Scene, engine: Engine, average: str = "runs") -> tradeoff.EngineRuns:
    """Run the pilot of a scene by an engine; all engines have the same seeds.

    The squared displacements of each run are those that a study with this `average` has.
    """
    seeds = range(FIRST_SEED, FIRST_SEED + pilot_runs(scene, average))
    ensemble = engine.simulate(scene, seeds, frozenset({"tracer"}), observables=_measured(average), average=average)
    runs = tradeoff.runs_of(scene, engine, ensemble)
    if average == "runs":
        return runs
    return runs._replace(squared=ensemble.observables[SQUARES][ensemble.observables["failed"] == 0])


def _measured(average: str) -> tuple[str, ...]:
    return () if average == "runs" else (SQUARES,)


def _seconds(scene: Scene, average: str) -> float:
    return forecast.of_run(scene, observables=_measured(average), average=average).seconds
