"""The number of runs and the engine that a tolerance needs, from pilot runs that the study uses again.

Pilot runs are the first ones of the study: of its first seeds, with its record and observables, in its store. Their
number follows from the forecast, not from a clock: a study has as many runs on every machine.

The number n of runs is proportional to the variance of the pilot, and the mean is over all n runs, pilot included. That
is the two-stage sampling of C. Stein, Ann. Math. Stat. 16, 243 (1945): the further runs do not depend on the pilot, and
the variance of a normal quantity says nothing of the mean of the pilot, so that the mean over all runs has no bias. For
r^2, as skewed as an exponential variable, that was tried with pilots of 10 to 400 runs and n of 90 to 1,100: the bias
is below a fiftieth of the standard error, and the 95 % interval covers the mean in 93 to 97 % of some 300 studies.

`write_plan` is for a study with a tolerance, of the exact engine alone. `performance_of` and what follows are for
`brownpipe plan`, a table of the study's engines. The squared error of n runs is bias^2 + se^2 + spread^2/n, with the
standard error se of the bias and the standard deviation `spread` over runs.
"""

import os
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brownpipe import tradeoff
from brownpipe.analysis import drift
from brownpipe.analysis.dataset import refuse_taken
from brownpipe.engines import Engine, forecast
from brownpipe.engines.ensemble import joined, select
from brownpipe.errors import RequestError
from brownpipe.observables.own import is_own
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.reading import read_yaml, yaml_text
from brownpipe.scene.seeds import MOST_SEEDS, ranges
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.store import stored_runs, without
from brownpipe.storage.trajectories import write_trajectories
from brownpipe.study.run_sets import batches, pilot_runs, run_set, seconds_of_jobs
from brownpipe.study.study import REFERENCE, Study
from brownpipe.text import counted, in_lines, in_time

SQUARES, DISTRIBUTION = "square_displacement", "displacement_distribution"  # an observable; a target
NOT_INHERITED = ("batch", "tolerance", "target", "instead_of", "figures")  # keys of a study that is planned


# -- pilot runs


class Pilot(NamedTuple):
    """Pilot runs of an engine in a case."""

    runs: tradeoff.EngineRuns
    cost: forecast.Cost  # of one run; the forecast, with the CPU seconds as measured if runs were made
    folder: Path
    made: int  # runs that were not there before
    seconds: float  # of CPU, to make them


def pilot_of(study: Study, scene: Scene, engine: Engine, target: str) -> Pilot:
    """Return the pilot of a scene by an engine, with the same first seed for all engines; runs that lack are made.

    Squared displacements are averaged within a run as in the study, unless the target is their distribution. Raises
    RequestError if the study's runs do not have them, or hardly any run is sound.
    """
    record, observables, average = study.recording
    squares = SQUARES if SQUARES in observables and target != DISTRIBUTION else None
    if squares is None and "tracer" not in record:
        raise RequestError(f"{study.name}: the target {target} needs record: tracer, or {SQUARES} for msd and d")
    cost, first = engine.forecast(scene, *study.recording), _first_seed(study)
    wanted = run_set(study, scene, engine, range(first, first + pilot_runs(cost)))
    seeds = np.asarray(wanted.seeds)
    parts = stored_runs(scene, engine, wanted.digest, seeds)
    missing = ranges(without(seeds, [(part.seeds[0], part.seeds[-1]) for part in parts]))
    simulate = partial(engine.simulate, scene, record=record, observables=observables, average=average)
    began, seconds = time.process_time(), 0.0
    if missing:
        simulate(seeds=[first])  # loads kernels
        wanted.folder.mkdir(parents=True, exist_ok=True)
    for first, last in missing:
        before = time.process_time()
        parts.append(simulate(seeds=range(first, last + 1)))
        seconds += time.process_time() - before - cost.once
        refuse_taken(parts[-1].own)
        write_trajectories(wanted.folder / f"{first}-{last}.h5", scene, engine, parts[-1], digest=wanted.digest)
    if made := sum(last - first + 1 for first, last in missing):
        cost = cost._replace(seconds=max(seconds / made, 1e-9))
    every = joined(parts)
    runs = tradeoff.runs_of(scene, engine, select(every, np.isin(every.seeds, seeds)), squares)
    return Pilot(runs, cost, wanted.folder, made, time.process_time() - began)


def _first_seed(study: Study) -> int:
    return study.seeds[0] if study.seeds else 0


def spent_on(pilots: Sequence[Pilot]) -> str:
    """Return a line that says what the pilot runs took, and where they are."""
    made, seconds = sum(pilot.made for pilot in pilots), sum(pilot.seconds for pilot in pilots)
    took = f"{counted(made, 'pilot run')} made in {in_time(seconds)} of CPU" if made else "no pilot run had to be made"
    return f"{took}; the study uses them again: {', '.join(str(pilot.folder) for pilot in pilots) or '-'}"


def case_title(scene: Scene) -> str:
    """Return scene and number of disks, as messages name a case."""
    return f"{scene.name}, N = {scene.particles}"


# -- the runs of a study with a tolerance


def write_plan(study: Study, path: str | Path) -> tuple[int, list[Pilot]]:
    """Determine by pilot runs how many runs the tolerance of a study needs, store it in a file; return it, and them.

    It is the largest number of all cases and covers statistical errors only: more runs do not reduce an engine's bias.
    Raises RequestError for too many runs, and for a study without a tolerance.
    """
    if study.tolerance is None:
        raise RequestError(f"{study.name}: --count is for a study with a tolerance; this one says its seeds")
    needed, pilots = dict[str, int](), list[Pilot]()
    for case in tracked(study.cases, "cases"):
        pilots.append(pilot_of(study, case, REFERENCE, study.target))
        runs = pilots[-1].runs
        scatter = tradeoff.spread_of(runs, study.target, study.fit_windows[0])
        needed[case_title(case)] = tradeoff.runs_for(study.tolerance, 0.0, scatter, runs.share_sound)
    title, most = max(needed.items(), key=lambda item: item[1])
    if most > MOST_SEEDS:
        raise RequestError(f"{title}: a tolerance of {study.tolerance:g} needs {most} runs; at most {MOST_SEEDS}")
    plan = {"tolerance": study.tolerance, "target": study.target, "needed": needed, "runs": most}
    write_file(path, sealed(f"# The runs that a tolerance needs, determined once\n\n{yaml_text(plan)}".encode()))
    return most, pilots


def settled(study: Study, path: str | Path | None) -> Study:
    """Return the study with as many seeds as the file that `write_plan` wrote says; one that has seeds is unchanged.

    Raises RequestError if there is no such file, StorageError if it is not as it was written.
    """
    if study.tolerance is None:
        return study
    if path is None:
        raise RequestError("--plan: missing; the number of runs for a tolerance is in results/STUDY/plan/*.yaml")
    with naming(path, "plan"):
        read_sealed(path)
    return study.model_copy(update={"seeds": range(read_yaml(path)["runs"])})


# -- engines for a tolerance


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean, and the cost of a run."""

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine
    bias_error: float  # standard error of the bias
    spread: float  # standard deviation over runs
    cost: forecast.Cost  # of one run
    share_sound: float = 1.0  # of runs that do not fail
    settled: str = ""  # whether the pilot runs drift, in words; "" if that was not tested

    def runs_for(self, tolerance: float) -> int | None:
        """Return the runs, failing ones included, that a tolerance needs; None for a bias too large."""
        return tradeoff.runs_for(tolerance, self.bias**2 + self.bias_error**2, self.spread, self.share_sound)

    def seconds_of(self, runs: int) -> float:
        """Return the CPU seconds of the jobs of so many runs."""
        return seconds_of_jobs(self.cost, runs, len(batches(range(runs), self.cost)))


class Offer(NamedTuple):
    """A number of runs of one engine in each case."""

    engine: Engine
    runs: int  # of each case
    seconds: float  # of CPU, of the jobs of all cases


def performance_of(study: Study, target: str) -> tuple[list[list[Performance]], list[Pilot]]:
    """Return the performance of the study's engines in each case, in their order, and the pilot runs.

    Approximate engines are compared with pilot runs of the exact engine, also if the study does without it.
    """
    quantity = "displacement" if target == DISTRIBUTION else target
    names = [f"{quantity}_{part}" for part in ("bias", "bias_standard_error", "spread")]  # of `tradeoff.compare`
    cases, pilots = list[list[Performance]](), list[Pilot]()
    for scene in tracked(study.cases, "cases"):
        engines = [use.engine for use in study.uses if use.case is scene]
        every = [*dict.fromkeys([REFERENCE, *engines])]
        found = {engine: pilot_of(study, scene, engine, target) for engine in tracked(every, "engines")}
        exact = found[REFERENCE].runs
        cases.append([])
        for engine in engines:
            runs, cost, *_ = found[engine]
            values = tradeoff.compare(runs, exact, study.fit_windows[0], cost.seconds)
            bias, error, spread = (float(values[name]) for name in names)
            cases[-1].append(Performance(scene, engine, bias, error, spread, cost, runs.share_sound, _settled(runs)))
        pilots += found.values()
    return cases, pilots


def _settled(runs: tradeoff.EngineRuns) -> str:
    """Return what drifts within runs, and the time to equilibrate to try; or the drift that would have been found."""
    if not drift.is_tested(runs.scene, runs.engine):
        return ""
    found = drift.drift_of(runs.quarters)
    if not np.isfinite(found.p).any():
        return drift.TOO_FEW
    least = drift.found_with_power(found.error, len(runs.seeds), len(found.quantity))
    none = f"no drift within the runs; 90 % of the pressure's drifts by {_percent(least)} are found"
    return drift.in_words(found, drift.time_to_try(runs.scene)) or none


def offers(cases: Sequence[Sequence[Performance]], tolerance: float) -> list[Offer]:
    """Return the offers of engines that meet the tolerance in all cases, the cheapest first."""
    made = []
    for engine in [performance.engine for performance in cases[0]]:
        of_engine = [each for case in cases for each in case if each.engine == engine]
        needed = [each.runs_for(tolerance) for each in of_engine]
        if None not in needed and len(needed) == len(cases) and max(needed) <= MOST_SEEDS:
            made.append(Offer(engine, max(needed), sum(each.seconds_of(max(needed)) for each in of_engine)))
    return sorted(made, key=lambda offer: offer.seconds)


def recommendation(cases: Sequence[Sequence[Performance]], target: str, tolerance: float) -> str:
    """Return a table of the engines in each case, and the best two offers for all cases."""
    import pandas as pd  # takes 0.3 s

    rows = [
        {
            "case": case_title(each.scene),
            "engine": each.engine.label,
            "CPU of a run": in_time(each.cost.seconds),
            f"bias of {target}": f"{_percent(each.bias)} +- {_percent(each.bias_error)}",
            "runs": each.runs_for(tolerance) or "bias too large",
        }
        for case in cases
        for each in case
    ]
    settled = [f"{case_title(case[0].scene)}: {case[0].settled}" for case in cases if case[0].settled]
    lines = [*pd.DataFrame(rows).to_string(index=False).splitlines(), *settled, f"{target} to {_percent(tolerance)}:"]
    made = offers(cases, tolerance)
    for word, offer in zip(("use", "or"), made, strict=False):
        runs = f"{offer.engine.label}: {offer.runs:,} runs in each case"
        lines.append(f"{word:<4}{runs}; {in_time(offer.seconds)} of CPU")
    return in_lines(lines if made else [*lines, "no engine can"])


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def write_study(study: Study, study_file: str | Path, path: str | Path, offer: Offer, comment: str) -> None:
    """Write a study below a line of comment, all or nothing: what another study runs, with the runs of an offer."""
    mapping: dict[str, Any] = {key: value for key, value in read_yaml(study_file).items() if key not in NOT_INHERITED}
    folder, first = Path(path).resolve().parent, _first_seed(study)
    mapping["scenes"] = [os.path.relpath(scene, folder) for scene in study.scenes]
    mapping["observables"] = [os.path.relpath(name, folder) if is_own(name) else name for name in study.observables]
    mapping["engines"] = [{"name": offer.engine.name, **dict(offer.engine.settings)}]
    mapping["seeds"] = f"{first}-{first + offer.runs - 1}" if first else offer.runs
    folder.mkdir(parents=True, exist_ok=True)
    write_file(path, f"# {comment}\n\n{yaml_text(mapping)}".encode())
