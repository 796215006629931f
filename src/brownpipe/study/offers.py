"""The number of runs of each engine that meets a tolerance or fits a budget, with its error and cost: an offer."""

import os
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, forecast
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.study.performance import CasePerformance, EnginePerformance
from brownpipe.study.study_file import MOST_JOBS
from brownpipe.tradeoff import FEWEST_RUNS, runs_for

SECONDS_PER_BYTE = 4e-8  # CPU seconds to compress, verify and write trajectories
SHORTEST_JOB = 20 * forecast.START_UP  # CPU seconds, so that starting a job takes at most 5 % of its time
LONGEST_JOB = 60.0  # CPU seconds that an interrupted job loses at most


class Offer(NamedTuple):
    """A number of runs of one engine in each of some cases."""

    engine: Engine
    runs: int  # of each case
    error: float  # expected total error, relative: the largest of the cases
    seconds: float  # of CPU, with starting the processes
    batch: int  # seeds per job
    wall_seconds: float  # on the cores of this machine
    size: float  # bytes of files


def offers(cases: list[CasePerformance], tolerance: float | None, budget: float | None) -> list[Offer]:
    """Return the offers that meet the tolerance in all cases within the budget (CPU seconds), the cheapest first.

    Without a tolerance: one offer for each engine that spends the budget, the most accurate first. An engine that was
    not compared, because it costs more than the exact one, offers nothing.
    """
    made = []
    for engine in cases[0].engines:
        performances = [case.engines.get(engine) for case in cases]
        if any(performance is None or np.isnan(performance.bias_square) for performance in performances):
            continue
        if tolerance is None:
            runs = _runs_for_budget(_seconds_per_run(cases, engine), budget)
        else:
            runs = _runs_for_tolerance(performances, tolerance)
        if runs:
            made.append(_offer(cases, engine, runs))
    if tolerance is None:
        return sorted(made, key=lambda offer: offer.error)
    return sorted((offer for offer in made if budget is None or offer.seconds <= budget), key=lambda o: o.seconds)


def _offer(cases: list[CasePerformance], engine: Engine, runs: int) -> Offer:
    """Return the error and cost of so many runs of an engine in each case, in jobs of a sensible length."""
    seconds_per_run = _seconds_per_run(cases, engine)
    work = runs * max(seconds_per_run)
    jobs = int(np.clip(max(np.ceil(work / LONGEST_JOB), min(cores(), work // SHORTEST_JOB)), 1, min(runs, MOST_JOBS)))
    batch = -(-runs // jobs)
    jobs = -(-runs // batch)
    seconds = [runs * per_run + jobs * forecast.START_UP for per_run in seconds_per_run]
    wall_seconds = max(sum(seconds) / cores(), max(seconds) / jobs)
    performances = [case.engines[engine] for case in cases]
    error = max(float(np.sqrt(each.bias_square + each.scatter**2 / runs)) for each in performances)
    return Offer(engine, runs, error, sum(seconds), batch, wall_seconds, runs * sum(map(_recorded, cases)))


def _seconds_per_run(cases: list[CasePerformance], engine: Engine) -> list[float]:
    """Return the CPU seconds of a run in each case, with writing it to the file."""
    return [case.engines[engine].seconds + SECONDS_PER_BYTE * _recorded(case) for case in cases]


def _recorded(case: CasePerformance) -> float:
    """Return the bytes that a run takes in the file."""
    return forecast.of_run(case.scene).recorded


def _runs_for_tolerance(performances: list[EnginePerformance], tolerance: float) -> int | None:
    """Return the runs that the most demanding case needs; None if a bias is too large, or for too many runs."""
    needed = [runs_for(tolerance, performance.bias_square, performance.scatter) for performance in performances]
    return None if None in needed or max(needed) > MOST_SEEDS else max(needed)


def _runs_for_budget(seconds_per_run: list[float], budget: float) -> int | None:
    """Return the runs of each case that the budget pays for; None for fewer than FEWEST_RUNS."""
    left = budget - len(seconds_per_run) * forecast.START_UP
    runs = int(min(left / (sum(seconds_per_run) * (1 + forecast.START_UP / SHORTEST_JOB)), MOST_SEEDS))
    return runs if runs >= FEWEST_RUNS else None


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
