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
from typing import Any, NamedTuple

import numpy as np

from brownpipe import tradeoff
from brownpipe.analysis.dataset import refuse_windows
from brownpipe.engines import Engine, forecast
from brownpipe.engines.ensemble import joined, select
from brownpipe.errors import RequestError
from brownpipe.figures.cases import aligned, plus_minus
from brownpipe.inspection.reports import equilibrium
from brownpipe.observables.own import is_own
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.reading import read_yaml, yaml_text
from brownpipe.scene.seeds import MOST_SEEDS, ranges
from brownpipe.storage.files import naming, verified, write_file, write_sealed
from brownpipe.storage.store import RUNS, stored_runs, without
from brownpipe.storage.trajectories import Trajectories, write_trajectories
from brownpipe.study.run_sets import digests, run_set, seconds_of_jobs
from brownpipe.study.study import REFERENCE, EngineUse, Study
from brownpipe.text import counted, in_lines, in_time

PILOT_SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_PILOT_RUNS, MOST_PILOT_RUNS = 10, 400
# For D, whose standard deviation over runs is 1.1 to 2 times its mean where motion is diffusive: it
# is then 5 to 9 standard errors from zero.
FEWEST_FOR_D = 100
RESOLVED = 3.0  # standard errors from zero, of a D whose relative error can be planned
SQUARES, DISTRIBUTION = (
    "square_displacement",
    "displacement_distribution",
)  # an observable; a target
NOT_INHERITED = (
    "batch",
    "tolerance",
    "target",
    "instead_of",
    "figures",
)  # keys of a study that is planned


# -- pilot runs


class Pilot(NamedTuple):
    """Pilot runs of an engine in a case."""

    runs: tradeoff.EngineRuns
    cost: forecast.Cost  # of one run
    made: int  # runs that were not there before
    drifts: list[str]  # a line that says whether the runs drift, if that is tested


def pilot_of(study: Study, scene: Scene, engine: Engine, target: str) -> Pilot:
    """Return the pilot of a scene by an engine, with the same first seed for all engines; runs that
    lack are made.

    Squared displacements are averaged within a run as in the study, unless the target is their
    distribution. Raises RequestError if the study's runs do not have them, or hardly any run is
    sound.
    """
    record, observables, average = study.recording
    squares = SQUARES if SQUARES in observables and target != DISTRIBUTION else None
    if squares is None and "tracer" not in record:
        raise RequestError(
            f"{study.name}: the target {target} needs record: tracer, or {SQUARES} for msd and d"
        )
    cost, first = engine.forecast(scene, *study.recording), study.seeds[0]
    fewest = min(FEWEST_FOR_D if target == "d" else FEWEST_PILOT_RUNS, MOST_PILOT_RUNS)
    number = int(np.clip(PILOT_SECONDS / cost.seconds, fewest, MOST_PILOT_RUNS))
    wanted = run_set(study, scene, engine, range(first, first + number))
    seeds = np.asarray(wanted.seeds)
    parts = stored_runs(scene, engine, wanted.digest, seeds)
    missing = without(seeds, [(part.seeds[0], part.seeds[-1]) for part in parts])
    for first, last in ranges(missing):
        parts.append(
            engine.simulate(
                scene, range(first, last + 1), record, observables=observables, average=average
            )
        )
        write_trajectories(
            wanted.folder / f"{first}-{last}.h5", scene, engine, parts[-1], digest=wanted.digest
        )
    every = joined(parts)
    ensemble = select(every, np.isin(every.seeds, seeds))
    runs = tradeoff.runs_of(scene, engine, ensemble, squares)
    return Pilot(runs, cost, len(missing), equilibrium(Trajectories(scene, engine, ensemble)))


def refuse_unresolved(runs: tradeoff.EngineRuns, window: tuple[float, float]) -> None:
    """Raise RequestError if D of exact pilot runs in a fit window is not told from zero, or is
    negative: the number of runs for a relative error is then noise.
    """
    mean, error = tradeoff.diffusion_of(runs, window)
    if mean > RESOLVED * error:
        return
    start, end = window
    raise RequestError(
        f"{case_title(runs.scene)}: the {counted(len(runs.seeds), 'pilot run')} do not tell D from "
        f"zero, {plus_minus(mean, error)} in the window [{start:g}, {end:g}], and a tolerance is "
        "relative to it; choose a fit window in which the MSD grows, target: msd, or seeds"
    )


def spent_on(pilots: Sequence[Pilot]) -> str:
    """Return a line that says how many pilot runs were made, and where they are."""
    return (
        f"{counted(sum(pilot.made for pilot in pilots), 'pilot run')} made in {RUNS}; the study "
        "uses them again"
    )


def case_title(scene: Scene) -> str:
    """Return scene and number of disks, as messages name a case."""
    return f"{scene.name}, N = {scene.particles}"


# -- the runs of a study with a tolerance


def write_plan(study: Study, path: str | Path) -> tuple[int, list[Pilot]]:
    """Determine by pilot runs how many runs the tolerance of a study needs, and store it; return it
    with the pilots.

    It is the largest number of all cases and covers statistical errors only: more runs do not
    reduce an engine's bias. Raises RequestError for too many runs, and for a study without a
    tolerance.
    """
    if study.tolerance is None:
        raise RequestError(
            f"{study.name}: --count is for a study with a tolerance; this one says its seeds"
        )
    alone = study.model_copy(
        update={"uses": [EngineUse(REFERENCE, case, None) for case in study.cases]}
    )
    performances, pilots = performance_of(alone, study.target, study.tolerance)
    needed = {case_title(each.scene): each.runs or 0 for each in performances}  # there is no bias
    title, most = max(needed.items(), key=lambda item: item[1])
    if most > MOST_SEEDS:
        raise RequestError(
            f"{title}: a tolerance of {study.tolerance:g} needs {most} runs; at most {MOST_SEEDS}"
        )
    plan = {"planned": f"study {digests(study)['plan']}", "needed": needed, "runs": most}
    write_sealed(
        path,
        (
            f"# Runs for a tolerance of {study.tolerance:g} of {study.target}\n\n{yaml_text(plan)}"
        ).encode(),
    )
    return most, pilots


def settled(study: Study, path: str | Path | None) -> Study:
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
    if (
        plan.get("planned") != f"study {digests(study)['plan']}"
    ):  # a digest alone may be a number in YAML
        raise RequestError(
            f"{path}: is the plan of another study; delete it and run the study again"
        )
    return study.model_copy(update={"seeds": range(plan["runs"])})


# -- engines for a tolerance


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean; number and cost of
    runs it takes.
    """

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine
    bias_error: float  # standard error of the bias
    runs: (
        int | None
    )  # needed for the tolerance, failing ones included; None if bias or its error is too large
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
    quantity = "displacement" if target == DISTRIBUTION else target
    names = [
        f"{quantity}_{part}" for part in ("bias", "bias_standard_error", "spread")
    ]  # of `tradeoff.compare`
    found, pilots = list[Performance](), list[Pilot]()
    for case in (
        study.cases if target == "d" else ()
    ):  # those of default windows are counted here only
        refuse_windows(study.fit_windows[:1], [case.times])
    for case in tracked(study.cases, "cases"):
        engines = [use.engine for use in study.uses if use.case is case]
        every = [*dict.fromkeys([REFERENCE, *engines])]
        of_engine = {
            engine: pilot_of(study, case, engine, target) for engine in tracked(every, "engines")
        }
        if target == "d":
            refuse_unresolved(of_engine[REFERENCE].runs, study.fit_windows[0])
        for engine in engines:
            runs, cost, *_ = of_engine[engine]
            values = tradeoff.compare(
                runs, of_engine[REFERENCE].runs, study.fit_windows[0], cost.seconds
            )
            bias, error, spread = (float(values[name]) for name in names)
            pilot = np.inf if target == DISTRIBUTION else len(runs.seeds)
            needed = tradeoff.runs_for(
                tolerance, bias**2 + error**2, spread, runs.share_sound, pilot
            )
            found.append(Performance(case, engine, bias, error, needed, cost))
        pilots += of_engine.values()
    return found, pilots


def offers(performances: Sequence[Performance]) -> list[Offer]:
    """Return the offers of engines that meet the tolerance in all cases, the cheapest first."""
    made, cases = list[Offer](), {case_title(each.scene) for each in performances}
    for engine in dict.fromkeys(each.engine for each in performances):
        of_engine = [each for each in performances if each.engine == engine]
        runs = max(each.runs or MOST_SEEDS + 1 for each in of_engine)
        if len(of_engine) == len(cases) and runs <= MOST_SEEDS:
            made.append(
                Offer(engine, runs, sum(seconds_of_jobs(each.cost, runs) for each in of_engine))
            )
    return sorted(made, key=lambda offer: offer.seconds)


def recommendation(
    performances: Sequence[Performance], pilots: Sequence[Pilot], target: str, tolerance: float
) -> str:
    """Return a table of the engines in each case, whether runs drift, and the best two offers for
    all cases.
    """
    columns = {
        "case": [case_title(each.scene) for each in performances],
        "engine": [each.engine.label for each in performances],
        "CPU of a run": [in_time(each.cost.seconds) for each in performances],
        f"bias of {target}": [
            f"{_percent(each.bias)} +- {_percent(each.bias_error)}" for each in performances
        ],
        "runs": [
            f"{each.runs:,}" if each.runs else "bias or its error too large"
            for each in performances
        ],
    }
    table = aligned([(heading, *cells) for heading, cells in columns.items()])
    drifts = [
        f"{case_title(pilot.runs.scene)}: {line}" for pilot in pilots for line in pilot.drifts
    ]
    lines = [*table, *drifts, f"{target} to {_percent(tolerance)}:"]
    made = offers(performances)
    for word, offer in zip(("use", "or"), made, strict=False):
        runs = f"{offer.engine.label}: {offer.runs:,} runs in each case"
        lines.append(f"{word:<4}{runs}; {in_time(offer.seconds)} of CPU")
    return in_lines(lines if made else [*lines, "no engine can"])


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def write_study(
    study: Study, keys: Mapping[str, Any], path: str | Path, offer: Offer, comment: str
) -> None:
    """Write a study file, completely or not at all: a copy of a study with engine and number of
    runs of an offer.

    keys: those given for the copied study, as from `study.read_keys`. comment: the first line of
    the file.
    """
    mapping: dict[str, Any] = {
        key: value for key, value in keys.items() if key not in NOT_INHERITED
    }
    folder, first = Path(path).resolve().parent, study.seeds[0]
    mapping["scenes"] = [os.path.relpath(scene, folder) for scene in study.scenes]
    mapping["observables"] = [
        os.path.relpath(name, folder) if is_own(name) else name for name in study.observables
    ]
    mapping["engines"] = [{"name": offer.engine.name, **dict(offer.engine.settings)}]
    mapping["seeds"] = f"{first}-{first + offer.runs - 1}" if first else offer.runs
    write_file(path, f"# {comment}\n\n{yaml_text(mapping)}".encode())
