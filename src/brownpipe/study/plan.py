"""The number of runs and the engine that a tolerance needs, from pilot runs that the study uses
again.

Pilot runs are the first ones of the study: of its first seeds, with its record and observables, in
its store. Their number follows from the forecast, not from a clock: a study has as many runs on
every machine.

The number n of runs is proportional to the variance of the pilot, and the mean is over all n runs,
pilot included. That is the two-stage sampling of C. Stein, Ann. Math. Stat. 16, 243 (1945): the
further runs do not depend on the pilot, and the variance of a normal quantity says nothing of the
mean of the pilot, so that the mean over all runs has no bias. For r^2, as skewed as an exponential
variable, that was tried with pilots of 10 to 400 runs and n of 90 to 1,100: the bias is below a
fiftieth of the standard error, and the 95 % interval covers the mean in 93 to 97 % of some 300
studies. The tolerance is relative, though: a pilot whose D is too small asks for more further runs,
or is refused if it cannot be told from zero. That makes D too large: over 6,000 plans each, from
slopes of Brownian paths, with pilots of 100 runs by 0.02(1) and 0.07(1) tolerances of 5 and 10 %
for a spread of 1.2 times D, and by 0.10(1), 0.19(1) and 0.30(1) of 5, 10 and 20 % for one of 2.4.

`write_plan` is for a study with a tolerance, of the exact engine alone. `performance_of` and what
follows are for `brownpipe plan`, a table of the study's engines. The squared error of n runs is
bias^2 + se^2 + spread^2/n, with the standard error se of the bias and the standard deviation
`spread` over runs.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe import tradeoff
from brownpipe.analysis.dataset import refuse_windows
from brownpipe.engines import Engine, forecast
from brownpipe.engines.ensemble import join_ensembles, select
from brownpipe.errors import RequestError
from brownpipe.figures.cases import aligned, plus_minus
from brownpipe.inspection.reports import equilibrium
from brownpipe.observables.own import is_own
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.reading import Count, YamlValue, read_yaml, validated, yaml_text
from brownpipe.scene.seeds import MOST_SEEDS, ranges
from brownpipe.storage.files import naming, verified, write_file, write_sealed
from brownpipe.storage.store import RUNS, seeds_without_file, stored_runs
from brownpipe.storage.trajectories import Trajectories, write_trajectories
from brownpipe.study.run_sets import digests, run_set, seconds_of_jobs
from brownpipe.study.study import REFERENCE, EngineUse, Study, why_target_is_not_planned
from brownpipe.text import counted, in_lines, in_time

PILOT_SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_PILOT_RUNS, MOST_PILOT_RUNS = 10, 400
# For D, whose standard deviation over runs is 1.1 to 2 times its mean where motion is diffusive: it
# is then 5 to 9 standard errors from zero.
FEWEST_FOR_D = 100
RESOLVED = 3.0  # standard errors from zero, of a D whose relative error can be planned
SQUARES = "square_displacement"  # an observable
DISTRIBUTION = "displacement_distribution"  # a target
# keys that a study with a plan does not take over from the study that was planned
NOT_INHERITED = ("batch", "tolerance", "target", "instead_of", "figures")


# -- pilot runs


class Pilot(NamedTuple):
    """Pilot runs of an engine in a case."""

    runs: tradeoff.EngineRuns
    cost: forecast.Cost  # of one run
    new_runs: int  # that were not there before
    drifts: list[str]  # a line that says whether the runs drift, if that is tested


def pilot_of(study: Study, scene: Scene, engine: Engine, target: str) -> Pilot:
    """Return the pilot of a scene by an engine, with the same first seed for all engines; runs that
    lack are made.

    Squared displacements are averaged within a run as in the study, unless the target is their
    distribution. Raises RequestError if the study's runs do not have them, for a D that is not
    planned, and if hardly any run is sound.
    """
    reason = why_target_is_not_planned(target, [scene])
    if reason:
        raise RequestError(f"{study.name}: the target d: {reason}; must be msd")
    record, observables, average = study.recording
    squares = SQUARES if SQUARES in observables and target != DISTRIBUTION else None
    if squares is None and "tracer" not in record:
        raise RequestError(
            f"{study.name}: the target {target} needs record: tracer, or {SQUARES} for msd and d"
        )
    cost = engine.forecast(scene, *study.recording)
    fewest = FEWEST_FOR_D if target == "d" else FEWEST_PILOT_RUNS
    number = int(np.clip(PILOT_SECONDS / cost.seconds, fewest, MOST_PILOT_RUNS))
    start = study.seeds[0]
    planned = run_set(study, scene, engine, range(start, start + number))
    seeds = np.asarray(planned.seeds)
    batches = stored_runs(scene, engine, planned.digest, seeds)
    missing = seeds_without_file(seeds, [(batch.seeds[0], batch.seeds[-1]) for batch in batches])
    for first, last in ranges(missing):
        batch = engine.simulate(
            scene, range(first, last + 1), record, observables=observables, average=average
        )
        path = planned.folder / f"{first}-{last}.h5"
        write_trajectories(path, scene, engine, batch, digest=planned.digest)
        batches.append(batch)
    stored = join_ensembles(batches)
    ensemble = select(stored, np.isin(stored.seeds, seeds))
    runs = tradeoff.runs_of(scene, engine, ensemble, squares)
    drifts = equilibrium(Trajectories(scene, engine, ensemble))
    return Pilot(runs, cost, len(missing), drifts)


def pilots_of(study: Study, case: Scene, target: str) -> dict[Engine, Pilot]:
    """Return the pilots of the exact engine and of the study's engines in a case."""
    engines = dict.fromkeys([REFERENCE, *study.engines_of(case)])
    return {engine: pilot_of(study, case, engine, target) for engine in tracked(engines, "engines")}


def tells_from_zero(runs: tradeoff.EngineRuns, window: tuple[float, float]) -> bool:
    """Whether pilot runs tell D in a fit window from zero; NaN, of fewer than three samples, is
    not told.
    """
    mean, error = tradeoff.diffusion_of(runs, window)
    return mean > RESOLVED * error


def refuse_unresolved(runs: tradeoff.EngineRuns, window: tuple[float, float]) -> None:
    """Raise RequestError if D of exact pilot runs in a fit window is not told from zero, or is
    negative: the number of runs for a relative error is then noise.
    """
    if tells_from_zero(runs, window):
        return
    mean, error = tradeoff.diffusion_of(runs, window)
    start, end = window
    pilot = counted(len(runs.seeds), "pilot run")
    value = f"{plus_minus(mean, error)} in the window [{start:g}, {end:g}]"
    raise RequestError(
        f"{runs.scene.title}: the {pilot} do not tell D from zero, {value}, and a tolerance "
        "is relative to it; choose a fit window in which the MSD grows, target: msd, or seeds"
    )


def drifts_of(pilots: Sequence[Pilot]) -> list[str]:
    """Return lines that say of each case whether its pilot runs drift, as far as that is tested."""
    lines: list[str] = []
    for pilot in pilots:
        lines += [f"{pilot.runs.scene.title}: {drift}" for drift in pilot.drifts]
    return lines


def spent_on(pilots: Sequence[Pilot]) -> str:
    """Return a line that says how many pilot runs were made, and where they are."""
    number = sum(pilot.new_runs for pilot in pilots)
    return f"{counted(number, 'pilot run')} made in {RUNS}; the study uses them again"


# -- the runs of a study with a tolerance


def tolerance_of(study: Study) -> float:
    """Return the tolerance of a study. Raises RequestError if it has none."""
    if study.tolerance is None:
        raise RequestError(
            f"{study.name}: --count is for a study with a tolerance; this one says its seeds"
        )
    return study.tolerance


def write_plan(study: Study, path: str | Path) -> tuple[int, list[Pilot]]:
    """Determine by pilot runs how many runs the tolerance of a study needs, and store it; return it
    with the pilots.

    It is the largest number of all cases and covers statistical errors only: more runs do not
    reduce an engine's bias. Raises RequestError for too many runs, and for a study without a
    tolerance.
    """
    tolerance = tolerance_of(study)
    uses = [EngineUse(REFERENCE, case, None) for case in study.cases]
    exact_study = study.with_uses(uses)
    performances, pilots = performance_of(exact_study, study.target, tolerance)
    needed: dict[str, int] = {}
    for performance in performances:
        needed[performance.scene.title] = performance.runs or 0  # there is no bias
    title, most = max(needed.items(), key=lambda item: item[1])
    if most > MOST_SEEDS:
        raise RequestError(
            f"{title}: a tolerance of {tolerance:g} needs {most} runs; at most {MOST_SEEDS}"
        )
    planned = f"study {digests(study)['plan']}"
    plan: dict[str, YamlValue] = {"planned": planned, "needed": needed, "runs": most}
    heading = f"# Runs for a tolerance of {tolerance:g} of {study.target}"
    write_sealed(path, f"{heading}\n\n{yaml_text(plan)}".encode())
    return most, pilots


def with_planned_seeds(study: Study, path: str | Path | None) -> Study:
    """Return the study with as many seeds as the file that `write_plan` wrote says; one that has
    seeds is unchanged.

    Raises RequestError if there is no such file or it is of another study, StorageError if it is
    not as it was written.
    """
    if study.tolerance is None:
        return study
    if path is None:
        raise RequestError(
            "--plan: missing; the number of runs for a tolerance is in results/STUDY/plan/*.yaml"
        )
    with naming(path, "plan"):
        plan = read_yaml(verified(path))
    # "study": a digest alone may be a number in YAML
    if plan.get("planned") != f"study {digests(study)['plan']}":
        raise RequestError(
            f"{path}: is the plan of another study; delete it and run the study again"
        )
    runs = validated(Count, plan.get("runs"), str(path), "runs")
    return study.model_copy(update={"seeds": range(runs)})


# -- engines for a tolerance


class Precision(NamedTuple):
    """What decides the error of a target in a number of runs, relative to the exact mean."""

    bias: float  # 0 for the exact engine
    bias_error: float  # standard error of the bias
    spread: float  # standard deviation over runs
    share_sound: float  # of runs that do not fail
    pilot_runs: float  # that the spread is from; inf if it is known without any

    def runs_for(self, tolerance: float) -> int | None:
        """Return the number of runs with this error; None if the bias or its error is too large."""
        return tradeoff.runs_for(tolerance, *self._terms())

    def error_of(self, runs: int) -> float:
        """Return the error of this number of runs."""
        return tradeoff.error_of(runs, *self._terms())

    def _terms(self) -> tuple[float, float, float, float]:
        bias_square = self.bias**2 + self.bias_error**2
        return bias_square, self.spread, self.share_sound, self.pilot_runs


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean; number and cost of
    runs it takes.
    """

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine
    bias_error: float  # standard error of the bias
    # needed for the tolerance, failing ones included; None if bias or its error is too large
    runs: int | None
    cost: forecast.Cost  # of one run


class Offer(NamedTuple):
    """A number of runs of one engine in each case."""

    engine: Engine
    runs: int  # of each case
    seconds: float  # of CPU, of the jobs of all cases


def performance_of(
    study: Study, target: str, tolerance: float
) -> tuple[list[Performance], list[Pilot]]:
    """Return the performance of the study's engines in each case, in their order, and the pilot
    runs.

    Approximate engines are compared with pilot runs of the exact engine, also if the study does
    without it. Raises AnalysisError, before any run, for D without three samples in its window,
    RequestError for one that the pilot does not tell from zero.
    """
    window = study.fit_windows[0]
    performances: list[Performance] = []
    pilots: list[Pilot] = []
    if target == "d":  # the samples of default windows are counted here only
        for case in study.cases:
            refuse_windows([window], [case.times])
    for case in tracked(study.cases, "cases"):
        by_engine = pilots_of(study, case, target)
        exact = by_engine[REFERENCE]
        if target == "d":
            refuse_unresolved(exact.runs, window)
        for engine in study.engines_of(case):
            pilot = by_engine[engine]
            precision = precisions_of(pilot, exact, window, [target])[target]
            needed = precision.runs_for(tolerance)
            performances.append(
                Performance(case, engine, precision.bias, precision.bias_error, needed, pilot.cost)
            )
        pilots += by_engine.values()
    return performances, pilots


def precisions_of(
    pilot: Pilot, exact: Pilot, window: tuple[float, float], targets: Sequence[str]
) -> dict[str, Precision]:
    """Return the precision of targets by target, from pilot runs and exact ones; D is that in a fit
    window.
    """
    runs = pilot.runs
    values = tradeoff.compare(runs, exact.runs, window, pilot.cost.seconds)
    precisions: dict[str, Precision] = {}
    for target in targets:
        quantity = "displacement" if target == DISTRIBUTION else target
        precisions[target] = Precision(
            bias=float(values[f"{quantity}_bias"]),
            bias_error=float(values[f"{quantity}_bias_standard_error"]),
            spread=float(values[f"{quantity}_spread"]),
            share_sound=runs.share_sound,
            pilot_runs=np.inf if target == DISTRIBUTION else len(runs.seeds),
        )
    return precisions


def offers(performances: Sequence[Performance]) -> list[Offer]:
    """Return the offers of engines that meet the tolerance in all cases, the cheapest first."""
    sufficient: list[Offer] = []
    cases = {performance.scene.title for performance in performances}
    engines = dict.fromkeys(performance.engine for performance in performances)
    for engine in engines:
        in_cases = [performance for performance in performances if performance.engine == engine]
        runs = max(performance.runs or MOST_SEEDS + 1 for performance in in_cases)
        if len(in_cases) == len(cases) and runs <= MOST_SEEDS:
            seconds = sum(seconds_of_jobs(performance.cost, runs) for performance in in_cases)
            sufficient.append(Offer(engine, runs, seconds))
    return sorted(sufficient, key=lambda offer: offer.seconds)


def recommendation(
    performances: Sequence[Performance], pilots: Sequence[Pilot], target: str, tolerance: float
) -> str:
    """Return a table of the engines in each case, whether runs drift, and the best two offers for
    all cases.
    """
    cases = ["case"]
    engines = ["engine"]
    cpu_times = ["CPU of a run"]
    biases = [f"bias of {target}"]
    runs = ["runs"]
    for performance in performances:
        cases.append(performance.scene.title)
        engines.append(performance.engine.label)
        cpu_times.append(in_time(performance.cost.seconds))
        biases.append(f"{percent(performance.bias)} +- {percent(performance.bias_error)}")
        number = performance.runs
        runs.append(f"{number:,}" if number else "bias or its error too large")
    lines = aligned([cases, engines, cpu_times, biases, runs])
    lines += drifts_of(pilots)
    lines.append(f"{target} to {percent(tolerance)}:")
    cheapest = offers(performances)[:2]
    for word, offer in zip(("use", "or"), cheapest, strict=False):
        workload = f"{offer.engine.label}: {offer.runs:,} runs in each case"
        lines.append(f"{word:<4}{workload}; {in_time(offer.seconds)} of CPU")
    if not cheapest:
        lines.append("no engine can")
    return in_lines(lines)


def percent(share: float) -> str:
    """Return a share with two digits: 1.2 % for 0.0123, 120 % for 1.234."""
    two_digits = float(f"{100 * share:.2g}")
    return f"{two_digits:g} %"


def write_study(
    study: Study, keys: Mapping[str, YamlValue], path: str | Path, offer: Offer, comment: str
) -> None:
    """Write a study file, completely or not at all: a copy of a study with engine and number of
    runs of an offer.

    keys: those given for the copied study, as from `study.read_keys`. comment: the first line of
    the file.
    """
    inherited = keys.keys() - {*NOT_INHERITED}
    mapping: dict[str, YamlValue] = {key: value for key, value in keys.items() if key in inherited}
    folder = Path(path).resolve().parent
    first = study.seeds[0]
    mapping["scenes"] = [os.path.relpath(scene, folder) for scene in study.scene_files]
    mapping["observables"] = [
        os.path.relpath(name, folder) if is_own(name) else name for name in study.observables
    ]
    engine = offer.engine
    mapping["engines"] = [{"name": engine.name, **dict(engine.settings)}]
    mapping["seeds"] = f"{first}-{first + offer.runs - 1}" if first else offer.runs
    write_file(path, f"# {comment}\n\n{yaml_text(mapping)}".encode())
