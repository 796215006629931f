"""The number of runs of each engine that meets a tolerance or fits a budget, with its error and cost: an offer."""

import os
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, forecast
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.study.batches import SHORTEST, automatic_batches
from brownpipe.study.performance import CasePerformance, EnginePerformance
from brownpipe.study.study import REFERENCE
from brownpipe.tradeoff import FEWEST_RUNS, runs_for

SECONDS_PER_BYTE = 4e-8  # CPU seconds to compress, verify and write trajectories


class Offer(NamedTuple):
    """A number of runs of one engine in each of some cases."""

    engine: Engine
    runs: int  # of each case
    error: float  # expected total error, relative: the largest of the cases
    seconds: float  # of CPU, with starting the processes
    wall_seconds: float  # on the cores of this machine
    size: float  # bytes of files
    failing: int = 0  # of these runs of a case, that are expected to fail


def offers(cases: list[CasePerformance], tolerance: float | None, budget: float | None) -> list[Offer]:
    """Return the offers that meet the tolerance in all cases within the budget (CPU seconds), the cheapest first.

    Without a tolerance: one offer for each engine that spends the budget, the most accurate first. An engine that was
    not compared, or costs at least as much as the exact one in all cases together, offers nothing.
    """
    made = []
    for engine in cases[0].engines:
        performances = [case.engines.get(engine) for case in cases]
        if any(performance is None or np.isnan(performance.bias_square) for performance in performances):
            continue
        if engine != REFERENCE and sum(_seconds_per_run(cases, engine)) >= sum(_seconds_per_run(cases, REFERENCE)):
            continue
        if tolerance is None:
            share_sound = min(each.share_sound for each in performances)
            runs = _runs_for_budget(_seconds_per_run(cases, engine), budget, share_sound)
        else:
            runs = _runs_for_tolerance(performances, tolerance)
        if runs:
            made.append(_offer(cases, engine, runs))
    if tolerance is None:
        return sorted(made, key=lambda offer: offer.error)
    return sorted((offer for offer in made if budget is None or offer.seconds <= budget), key=lambda o: o.seconds)


def _offer(cases: list[CasePerformance], engine: Engine, runs: int) -> Offer:
    """Return the error and cost of so many runs of an engine in each case, in jobs as of `batch: auto`."""
    seconds, longest = 0.0, 0.0
    for case, per_run in zip(cases, _seconds_per_run(cases, engine), strict=True):
        batches = automatic_batches(range(runs), engine.forecast(case.scene))
        seconds += runs * per_run + len(batches) * forecast.START_UP
        longest = max(longest, per_run * max(last - first + 1 for first, last in batches))
    performances = [case.engines[engine] for case in cases]
    error = max(float(np.sqrt(each.bias_square + each.scatter**2 / (runs * each.share_sound))) for each in performances)
    failing = round(runs * (1.0 - min(each.share_sound for each in performances)))
    size = runs * sum(map(_recorded, cases))
    return Offer(engine, runs, error, seconds, max(seconds / cores(), longest), size, failing)


def _seconds_per_run(cases: list[CasePerformance], engine: Engine) -> list[float]:
    """Return the CPU seconds of a run in each case, with writing it to the file."""
    return [case.engines[engine].seconds + SECONDS_PER_BYTE * _recorded(case) for case in cases]


def _recorded(case: CasePerformance) -> float:
    """Return the bytes that a run takes in the file."""
    return forecast.of_run(case.scene).recorded


def _runs_for_tolerance(performances: list[EnginePerformance], tolerance: float) -> int | None:
    """Return the runs, failing ones included, that the most demanding case needs.

    None if a bias is too large, or for too many runs.
    """
    needed = [runs_for(tolerance, each.bias_square, each.scatter, each.share_sound) for each in performances]
    return None if None in needed or max(needed) > MOST_SEEDS else max(needed)


def _runs_for_budget(seconds_per_run: list[float], budget: float, share_sound: float) -> int | None:
    """Return the runs of each case that the budget pays for; None if fewer than FEWEST_RUNS of them do not fail."""
    left = budget - len(seconds_per_run) * forecast.START_UP
    runs = int(min(left / (sum(seconds_per_run) * (1 + 2 * forecast.START_UP / SHORTEST)), MOST_SEEDS))
    return runs if runs * share_sound >= FEWEST_RUNS else None


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
