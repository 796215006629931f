"""How many runs a tolerance needs, and of which engine: from what was measured before, or from a pilot of some runs."""

import json
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import DEFINITIONS, Engine, configured, forecast, recorded
from brownpipe.errors import RequestError
from brownpipe.formatting import in_bytes, in_time
from brownpipe.scene import Scene, reading
from brownpipe.scene.reading import Entry
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.storage import read_dataset, write_file
from brownpipe.study import Study
from brownpipe.study.study_file import MOST_JOBS, read_tolerance
from brownpipe.tradeoff import bias, compare, runs_for, runs_of, spread_of, timing

PILOT_SEED = 2**40  # first seed of pilots, which no study shares
PILOT_SECONDS = 4.0  # CPU time of a pilot, as expected
MOST_PILOT, FEWEST_PILOT = 400, 10  # runs
SECONDS_PER_BYTE = 4e-8  # to compress, verify and write trajectories
JOB_SECONDS = 20 * forecast.START_UP  # of a job at least, so that starting it takes 5 % of its time at most
LONG_JOB = 60.0  # CPU seconds that may be lost if a job is interrupted


NAMES = {"msd": "MSD at the end", "d": "D in its window", "displacement": "distribution of displacements"}


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


class Case(NamedTuple):
    """A scene, and what is known of the engines in it."""

    scene: Scene
    source: str  # where that is known from
    known: dict[Engine, Known]


class Offer(NamedTuple):
    """So many runs of one engine in each of some scenes."""

    engine: Engine
    runs: int  # of each
    error: float  # expected total error, the largest of them
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
        write_yaml(path, stored, "How many runs the tolerance of this study needs; made by its workflow, once.")
    settled = replace(study, seeds=range(stored["runs"]))
    while len(settled.jobs()) > MOST_JOBS:
        settled = replace(settled, batch=2 * settled.batch)
    return settled


def runs_needed(scene: Scene, study: Study) -> int:
    """Return the number of exact runs that bring the standard error down to the study's tolerance."""
    runs = runs_for(study.tolerance, 0.0, spread(scene, study.observable, study.fit_windows[0]))
    if runs > MOST_SEEDS:
        raise RequestError(
            f"{_title(scene)}: a tolerance of {study.tolerance:g} needs {runs} runs; at most {MOST_SEEDS}"
        )
    return runs


def spread(scene: Scene, observable: str, window: tuple[float, float]) -> float:
    """Return the relative scatter of `observable` in one exact run, by a pilot whose seeds and number are fixed."""
    if observable == "displacement":
        return bias.spread_of_shares()
    return spread_of(pilot(scene, Engine("exact"), pilot_runs(scene)), observable, window)


def pilot_runs(scene: Scene) -> int:
    """Return the number of runs of a pilot: those of some seconds by the expected cost, which no clock decides."""
    return int(np.clip(PILOT_SECONDS / forecast.of_run(scene).seconds, FEWEST_PILOT, MOST_PILOT))


def pilot(scene: Scene, engine: Engine, runs: int):
    """Return so many runs (`tradeoff.Runs`) of the pilot's seeds."""
    seeds = range(PILOT_SEED, PILOT_SEED + runs)
    return runs_of(scene, engine, engine.simulate(scene, seeds, frozenset({"tracer"})))


def _stored(path) -> dict:
    """What the file of an earlier plan holds; nothing if there is none that can be read."""
    try:
        stored = reading.read_yaml(path, 2**20) if os.path.exists(path) else {}
    except RequestError:
        return {}
    return stored if isinstance(stored, dict) else {}


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _title(scene: Scene) -> str:
    return f"{scene.name}, N = {scene.particles}"


# -- which engine ---------------------------------------------------------------------------------------------------


def cases_of(study: Study, observable: str, results: str | Path = "results") -> list[Case]:
    """Return for each case of the study what is known of the engines.

    Known from stored trade-offs below `results` that hold the same scene, or else from a pilot.
    """
    cases, window = [], study.fit_windows[0]
    for scene in study.cases:
        source, known = stored(scene, observable, window, results) or trial(scene, observable, window)
        cases.append(Case(scene, source, {one.engine: one for one in known}))
    return cases


def tolerance_of(text: str) -> float:
    """Return the tolerance of a command line, 2% or 0.02. Raises RequestError."""
    try:
        value = float(text)
    except ValueError:
        value = text
    return read_tolerance(Entry(value, "", ("--tolerance",)))


def offers(cases: list[Case], tolerance: float | None, budget: float | None) -> list[Offer]:
    """Return what meets the tolerance in all cases, the cheapest first; without one, what the CPU seconds of the budget
    buy, the most accurate first.

    With both, a tolerance that costs more than the budget is not met. An engine that costs more than the exact one and
    was not compared for that reason offers nothing.
    """
    found = []
    for engine in cases[0].known:
        known = [case.known.get(engine) for case in cases]
        if any(one is None or np.isnan(one.bias_square) for one in known):
            continue
        runs = (
            _runs_for_budget(_prices(cases, engine), budget)
            if tolerance is None
            else _runs_for_tolerance(known, tolerance)
        )
        if runs:
            found.append(offer(cases, engine, runs))
    if tolerance is None:
        return sorted(found, key=lambda one: one.error)
    return sorted((one for one in found if budget is None or one.seconds <= budget), key=lambda one: one.seconds)


def offer(cases: list[Case], engine: Engine, runs: int) -> Offer:
    """Return what so many runs of an engine in each case come to."""
    known, prices, cores = [case.known[engine] for case in cases], _prices(cases, engine), _cores()
    work = runs * max(prices)
    jobs = int(np.clip(max(np.ceil(work / LONG_JOB), min(cores, work // JOB_SECONDS)), 1, min(runs, MOST_JOBS)))
    batch = -(-runs // jobs)
    jobs = -(-runs // batch)
    seconds = [runs * price + jobs * forecast.START_UP for price in prices]
    wall = max(sum(seconds) / cores, max(seconds) / jobs)
    error = max(float(np.sqrt(one.bias_square + one.spread**2 / runs)) for one in known)
    return Offer(engine, runs, error, sum(seconds), batch, wall, runs * sum(map(_recorded, cases)))


def _prices(cases: list[Case], engine: Engine) -> list[float]:
    """CPU seconds of a run in each case, with its share of the file."""
    return [case.known[engine].seconds + SECONDS_PER_BYTE * _recorded(case) for case in cases]


def _recorded(case: Case) -> float:
    return forecast.of_run(case.scene).recorded


def _runs_for_tolerance(known: list[Known], tolerance: float) -> int | None:
    needed = [runs_for(tolerance, one.bias_square, one.spread) for one in known]
    return None if None in needed or max(needed) > MOST_SEEDS else max(needed)


def _runs_for_budget(prices: list[float], budget: float) -> int | None:
    left = budget - len(prices) * forecast.START_UP
    runs = int(min(left / (sum(prices) * (1 + forecast.START_UP / JOB_SECONDS)), MOST_SEEDS))
    return runs if runs >= FEWEST_PILOT else None


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def stored(scene: Scene, observable: str, window, results: str | Path) -> tuple[str, list[Known]] | None:
    """Return where the engines were measured in this very scene, and what is known of them; None if nowhere."""
    for path in sorted(Path(results).glob("*/tradeoff/*.nc")):
        dataset = read_dataset(path)
        if not {"digest", "engine", f"{observable}_bias_careful"} <= set(dataset.data_vars):
            continue  # of another version
        here = np.flatnonzero(dataset.digest.values == scene.digest)
        if here.size:
            of_scene = dataset.isel(scene=here[0])
            same = np.allclose([of_scene.window_start, of_scene.window_end], window)
            if observable != "d" or same:
                return str(path), _known_from(of_scene, observable)
    return None


def _known_from(of_scene, observable: str) -> list[Known]:
    known = []
    for label in of_scene.setting.values:
        one = of_scene.sel(setting=label)
        engine = recorded(json.loads(one.engine.item()), str(label)) if one.runs > 0 else None
        if engine is not None and engine.label == label:  # not another scene that may stand in
            known.append(
                _known(engine, {name: one[name].item() for name in one.data_vars if one[name].ndim == 0}, observable)
            )
    return sorted(known, key=lambda one: one.engine.name != "exact")


def _known(engine: Engine, values: dict, observable: str) -> Known:
    scatter = "displacement_bias_noise" if observable == "displacement" else f"{observable}_bias_standard_error"
    numbers = (values[f"{observable}_bias"], values[scatter], values[f"{observable}_spread"], values["seconds"])
    return Known(engine, *map(float, numbers))


def trial(scene: Scene, observable: str, window) -> tuple[str, list[Known]]:
    """Return what a pilot of some seconds tells of the exact engine and of those that cost less than it does."""
    engine, runs = Engine("exact"), pilot_runs(scene)
    exact, seconds = pilot(scene, engine, runs), timing.seconds_per_run(engine, scene, stretches=3)
    known = [_known(engine, compare(exact, exact, window, seconds), observable)]
    for one in candidates(scene):
        price = timing.seconds_per_run(one, scene, stretches=3)
        if price < seconds:
            known.append(_known(one, compare(pilot(scene, one, runs), exact, window, price), observable))
        else:
            known.append(Known(one, np.nan, np.nan, known[0].spread, price))
    return f"a pilot of {runs} runs", known


def candidates(scene: Scene) -> list[Engine]:
    """Return approximate engines worth a trial, those that are fit for the scene."""
    tried = []
    for name, definition in DEFINITIONS.items():
        if name == "exact":
            continue
        for settings in definition.candidates(scene):
            with suppress(RequestError):
                one = configured(name, **settings)
                one.refuse_unfit(scene)
                tried.append(one)
    return tried


# -- in words, and as a study ----------------------------------------------------------------------------------------


def describe(cases: list[Case], observable: str, tolerance: float | None, budget: float | None) -> str:
    """Return what to use for each case, the runner-up, what does not do, and what to use for all of them."""
    asked = [f"to {_percent(tolerance)}"] if tolerance is not None else []
    asked += [f"within {in_time(budget)} of CPU"] if budget is not None else []
    lines = []
    for case in cases:
        lines.append(f"{_title(case.scene)}: {NAMES[observable]} {' '.join(asked)}, by {case.source}")
        lines += _in_words([case], tolerance, budget / len(cases) if budget is not None else None)
    if len(cases) > 1:
        lines += ["one engine for all", *_in_words(cases, tolerance, budget)]
    return "\n".join(lines)


def _in_words(cases: list[Case], tolerance, budget) -> list[str]:
    found = offers(cases, tolerance, budget)
    lines = [f"  {what}  {_offered(one)}" for what, one in zip(("use      ", "runner-up"), found, strict=False)]
    if not found:
        lines = ["  cannot be met" + (f" within {in_time(budget)} of CPU" if budget is not None else "")]
        if tolerance is not None and budget is not None:
            lines += [f"  instead    {_offered(one)}" for one in offers(cases, None, budget)[:1]]
    return lines + (_drawbacks(cases[0], tolerance) if len(cases) == 1 else [])


def _offered(one: Offer) -> str:
    runs = f"{one.engine.label}: {one.runs:,} runs, {one.batch:,} a job, error {_percent(one.error)}"
    price = f"{in_time(one.seconds)} of CPU, {in_time(one.wall)} on {_cores()} cores, {in_bytes(one.size)}"
    return f"{runs}; {price}"


def _drawbacks(case: Case, tolerance) -> list[str]:
    """What speaks against the others."""
    exact, lines = case.known[Engine("exact")], []
    for one in case.known.values():
        if one.seconds >= exact.seconds and one is not exact:
            lines.append(
                f"  never      {one.engine.label}: a run costs {one.seconds / exact.seconds:.2g} times an exact one"
            )
        elif tolerance is not None and one.bias_square >= tolerance**2:
            off = f"off by {_percent(one.bias)}" if abs(one.bias) > 2 * one.bias_error else "its bias is not known"
            lines.append(f"  no         {one.engine.label}: {off}, to {_percent(one.bias_error)}")
    return lines


def study_of(study_file: str | Path, chosen: Offer, path: str | Path) -> dict:
    """Return what a study file at `path` holds that runs `chosen` in the scenes of another study."""
    given = dict(reading.read_yaml(study_file, 2**20))
    scenes = given["scenes"] if isinstance(given["scenes"], list) else [given["scenes"]]
    folder = Path(path).resolve().parent
    given["scenes"] = [os.path.relpath(Path(study_file).resolve().parent / scene, folder) for scene in scenes]
    for key in ("tolerance", "observable", "instead_of"):
        given.pop(key, None)
    settings = {"name": chosen.engine.name, **dict(chosen.engine.settings)}
    return given | {"engines": [settings], "seeds": chosen.runs, "batch": chosen.batch}


def write_yaml(path, values: dict, comment: str) -> None:
    """Write a mapping as YAML under a line of comment; all or nothing."""
    import yaml

    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=120)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_file(path, f"# {comment}\n\n{text}".encode())
