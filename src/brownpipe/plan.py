"""How many runs a tolerance needs, and of which engine: from what was measured before, or from a pilot of some runs."""

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe import cost, reading
from brownpipe.engines import Engine
from brownpipe.reading import Entry, SceneError
from brownpipe.scene import Scene
from brownpipe.study import MOST_JOBS, MOST_SEEDS, Study

PILOT_SEED = 2**40  # first seed of pilots, which no study shares
PILOT_SECONDS = 4.0  # CPU time of a pilot, as expected
MOST_PILOT, FEWEST_PILOT = 400, 10  # runs
JOB_SECONDS = 20 * cost.START_UP  # of a job at least, so that starting it takes 5 % of its time at most
LONG_JOB = 60.0  # CPU seconds that may be lost if a job is interrupted


class Known(NamedTuple):
    """What is known of an engine in a scene, for one observable; relative to the exact result."""

    engine: Engine
    bias: float  # found, 0 for the exact engine
    bias_error: float  # its standard error
    spread: float  # of one run
    seconds: float  # of CPU for one run; NaN if it was not measured

    @property
    def bias_square(self) -> float:
        """The expected square of the bias: what is found beyond its scatter, and the scatter."""
        return max(self.bias**2, self.bias_error**2)


class Offer(NamedTuple):
    """What a tolerance or a budget buys of one engine."""

    engine: Engine
    runs: int
    error: float  # expected total error
    seconds: float  # of CPU, starts of processes included
    batch: int  # seeds per job
    wall: float  # seconds on this machine's cores
    size: float  # bytes of files


# -- a number of runs that depends on nothing but scene, tolerance and observable ------------------------------------


def settle(study: Study, path: str | Path) -> Study:
    """Return the study with as many seeds as its tolerance needs; one with seeds is returned as it is.

    The number is worked out once, from a pilot of the exact engine, and kept in the file at `path`; it is worked out
    again when the scenes, the tolerance, the observable or the window change. It is the largest of all cases, and
    covers scatter: what an approximate engine is off by does not go away with more runs.
    """
    if study.tolerance is None:
        return study
    asked = {
        "tolerance": study.tolerance,
        "observable": study.observable,
        "window": list(study.fit_windows[0]),
        "scenes": {f"{case.name}, N = {case.particles}": case.digest for case in study.cases},
    }
    stored = _stored(path)
    if {key: stored.get(key) for key in asked} != asked:
        needed = {_title(case): runs_needed(case, study) for case in study.cases}
        stored = asked | {"needed": needed, "runs": max(needed.values())}
        _write_yaml(path, stored, "How many runs the tolerance of this study needs; made by its workflow, once.")
    settled = replace(study, seeds=range(stored["runs"]))
    while len(settled.jobs()) > MOST_JOBS:
        settled = replace(settled, batch=2 * settled.batch)
    return settled


def runs_needed(scene: Scene, study: Study) -> int:
    """Return the number of exact runs that bring the standard error down to the study's tolerance."""
    from brownpipe.tradeoff import runs_for

    runs = runs_for(study.tolerance, 0.0, spread(scene, study.observable, study.fit_windows[0]))
    if runs > MOST_SEEDS:
        raise SceneError(f"{_title(scene)}: a tolerance of {study.tolerance:g} needs {runs} runs; at most {MOST_SEEDS}")
    return runs


def spread(scene: Scene, observable: str, window: tuple[float, float]) -> float:
    """Return the relative scatter of `observable` in one exact run, by a pilot whose seeds and number are fixed."""
    from brownpipe.tradeoff import bias, spread_of

    if observable == "displacement":
        return bias.spread_of_shares()
    return spread_of(pilot(scene, Engine("exact"), pilot_runs(scene)), observable, window)


def pilot_runs(scene: Scene) -> int:
    """Return the number of runs of a pilot: those of some seconds by the expected cost, which no clock decides."""
    return int(np.clip(PILOT_SECONDS / cost.of_run(scene).seconds, FEWEST_PILOT, MOST_PILOT))


def pilot(scene: Scene, engine: Engine, runs: int):
    """Return so many runs (`tradeoff.Runs`) of the pilot's seeds."""
    from brownpipe.tradeoff import runs_of

    seeds = range(PILOT_SEED, PILOT_SEED + runs)
    return runs_of(scene, engine, engine.simulate(scene, seeds, frozenset({"tracer"})))


def _stored(path) -> dict:
    """What the file of an earlier plan holds; nothing if there is none that can be read."""
    try:
        stored = reading.read_yaml(path, 2**20) if os.path.exists(path) else {}
    except SceneError:
        return {}
    return stored if isinstance(stored, dict) else {}


def _title(scene: Scene) -> str:
    return f"{scene.name}, N = {scene.particles}"


# -- which engine ---------------------------------------------------------------------------------------------------


def offers(scene: Scene, known: list[Known], tolerance: float | None, budget: float | None) -> list[Offer]:
    """Return what meets the tolerance, or else what a budget of CPU seconds buys, the best first.

    With a tolerance the cheapest comes first, as far as it is within the budget; with a budget alone the most accurate.
    """
    if tolerance is None:
        found = [_for_budget(scene, one, budget) for one in known]
        return sorted((one for one in found if one is not None), key=lambda one: one.error)
    found = [_for_tolerance(scene, one, tolerance) for one in known]
    within = [one for one in found if one is not None and (budget is None or one.seconds <= budget)]
    return sorted(within, key=lambda one: one.seconds)


def _for_tolerance(scene: Scene, one: Known, tolerance: float) -> Offer | None:
    from brownpipe.tradeoff import runs_for

    runs = runs_for(tolerance, one.bias_square, one.spread)
    return None if runs is None or runs > MOST_SEEDS or np.isnan(one.seconds) else _offer(scene, one, runs)


def _for_budget(scene: Scene, one: Known, budget: float) -> Offer | None:
    runs = int(min((budget - cost.START_UP) / (one.seconds * (1 + cost.START_UP / JOB_SECONDS)), MOST_SEEDS))
    return _offer(scene, one, runs) if runs >= FEWEST_PILOT else None


def _offer(scene: Scene, one: Known, runs: int) -> Offer:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    work = runs * one.seconds
    jobs = int(np.clip(max(np.ceil(work / LONG_JOB), min(cores, work // JOB_SECONDS)), 1, min(runs, MOST_JOBS)))
    batch = -(-runs // jobs)
    jobs = -(-runs // batch)
    seconds = work + jobs * cost.START_UP
    wall = -(-jobs // cores) * (batch * one.seconds + cost.START_UP)
    error = float(np.sqrt(one.bias_square + one.spread**2 / runs))
    return Offer(one.engine, runs, error, seconds, batch, wall, runs * cost.of_run(scene).recorded)


def _write_yaml(path, values: dict, comment: str) -> None:
    import yaml

    from brownpipe.storage import write_file

    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=120)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_file(path, f"# {comment}\n\n{text}".encode())
