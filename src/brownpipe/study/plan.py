"""The number of runs and the engine that a tolerance needs, from pilot runs with seeds that no study uses.

`write_plan` is for a study with a tolerance, of the exact engine alone. The number of pilot runs follows from the
forecast, not from a clock: a study has as many runs on every machine.
`performance_of` and what follows are for `brownpipe plan`, a table of engines. The squared error of n runs is
bias^2 + se^2 + spread^2/n, with the standard error se of the bias and the standard deviation `spread` over runs. An
engine that costs more than the exact one is not compared.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from brownpipe import tradeoff
from brownpipe.analysis import drift
from brownpipe.engines import DEFINITIONS, Engine, configured, forecast
from brownpipe.engines.saturation import share_failing
from brownpipe.errors import AnalysisError, RequestError
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.reading import read_yaml, yaml_text
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.study.study import MOST_JOBS, REFERENCE, Study
from brownpipe.text import in_lines, in_time
from brownpipe.tradeoff import timing

COMMENT = "# The number of runs that the tolerance of this study needs, determined once."
SQUARES, DISTRIBUTION = "square_displacement", "displacement_distribution"  # an observable; a target
LEAST_SOUND = 0.01  # share of runs that do not fail
FIRST_SEED = 2**40
PILOT_SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_RUNS, MOST_RUNS = 10, 400  # of a pilot
VARIABLES = {  # of `tradeoff.compare`: bias, its standard error or noise, spread of a run
    "msd": ("msd_bias", "msd_bias_standard_error", "msd_spread"),
    "d": ("d_bias", "d_bias_standard_error", "d_spread"),
    DISTRIBUTION: ("displacement_bias", "displacement_bias_noise", "displacement_spread"),
}
NOT_INHERITED = ("batch", "tolerance", "target", "instead_of", "figures", "record")  # keys of a study that is planned
TIMING_REPEATS = 3
EQUAL = 0.1  # relative difference of costs within which the exact engine is preferred


# -- the runs of a study with a tolerance


def write_plan(study: Study, path: str | Path) -> int:
    """Determine by pilot runs how many runs the tolerance of a study needs, store it in a file, and return it.

    It is the largest number of all cases and covers statistical errors only: more runs do not reduce an engine's bias.
    Raises RequestError for too many runs, and for a study without a tolerance.
    """
    if study.tolerance is None:
        raise RequestError(f"{study.name}: --count is for a study with a tolerance; this one says its seeds")
    needed = {case_title(case): _runs_needed(case, study) for case in tracked(study.cases, "cases")}
    runs = max(needed.values())
    plan = {"tolerance": study.tolerance, "target": study.target, "needed": needed, "runs": runs}
    write_file(path, sealed(f"{COMMENT}\n\n{yaml_text(plan)}".encode()))
    return runs


def settled(study: Study, path: str | Path | None) -> Study:
    """Return the study with as many seeds as the file that `write_plan` wrote says; one that has seeds is unchanged.

    A `batch` too small for so many runs is replaced by batches of their cost. Raises RequestError if there is no such
    file, StorageError if it is not as it was written.
    """
    if study.tolerance is None:
        return study
    if path is None:
        raise RequestError("--plan: missing; the number of runs for a tolerance is in results/STUDY/plan/*.yaml")
    with naming(path, "plan"):
        read_sealed(path)
    runs = read_yaml(path)["runs"]
    too_many = study.batch is not None and runs * len(study.cases) > MOST_JOBS * study.batch
    return study.model_copy(update={"seeds": range(runs)} | ({"batch": None} if too_many else {}))


def run_pilot(study: Study, scene: Scene, engine: Engine, target: str) -> tradeoff.EngineRuns:
    """Run the pilot of a scene by an engine, with the same seeds for all engines.

    Squared displacements are averaged within a run as in the study, unless the target is their distribution.
    """
    failing = 1.0 - _share_sound(scene)
    names = (SQUARES,) if SQUARES in study.observables and target != DISTRIBUTION else ()
    measured: dict[str, Any] = {"observables": names, "average": study.average if names else "runs"}
    seconds = forecast.of_run(scene, **measured).seconds - forecast.SECONDS_TO_FAIL * failing
    number = int(np.clip(PILOT_SECONDS / seconds, FEWEST_RUNS, MOST_RUNS))  # of failing ones more, as they take no time
    ensemble = engine.simulate(scene, range(FIRST_SEED, FIRST_SEED + number), frozenset({"tracer"}), **measured)
    runs = tradeoff.runs_of(scene, engine, ensemble)
    sound = ensemble.observables["failed"] == 0
    return runs._replace(squared=ensemble.observables[SQUARES][sound]) if names else runs


def case_title(scene: Scene) -> str:
    """Return scene and number of disks, as messages name a case."""
    return f"{scene.name}, N = {scene.particles}"


def _share_sound(scene: Scene) -> float:
    """Return the share of runs that find places for all disks. Raises RequestError if hardly any does."""
    failing = share_failing(scene)
    if failing > 1 - LEAST_SOUND:
        share = f"{100 * failing:.4g} % of the runs are expected to fail"
        raise RequestError(f"{case_title(scene)}: {share}; must be fewer or smaller disks, or `placement: lattice`")
    return 1.0 - failing


def _runs_needed(scene: Scene, study: Study) -> int:
    """Return the number of exact runs of a scene, with failing ones, whose standard error is the study's tolerance."""
    if study.target == DISTRIBUTION:  # known without pilot runs
        scatter, sound = tradeoff.bias.spread_of_shares(), _share_sound(scene)
    else:
        pilot = run_pilot(study, scene, REFERENCE, study.target)
        try:
            scatter, sound = tradeoff.spread_of(pilot, study.target, study.fit_windows[0]), pilot.share_sound
        except AnalysisError as error:
            raise RequestError(str(error)) from error
    runs = tradeoff.runs_for(study.tolerance, 0.0, scatter, sound)
    if runs > MOST_SEEDS:
        needed = f"a tolerance of {study.tolerance:g} needs {runs} runs; at most {MOST_SEEDS}"
        raise RequestError(f"{case_title(scene)}: {needed}")
    return runs


# -- engines for a tolerance


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean, and the cost of a run."""

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine; NaN if it was not compared, as it costs more
    bias_error: float  # standard error of the bias
    spread: float  # standard deviation over runs
    seconds: float  # of CPU for one run
    share_sound: float = 1.0  # of runs that do not fail
    settled: str = ""  # whether the pilot runs drift, in words; "" if that was not tested

    def runs_for(self, tolerance: float) -> int | None:
        """Return the runs, failing ones included, that a tolerance needs; None for a bias too large or not compared."""
        if np.isnan(self.bias):
            return None
        return tradeoff.runs_for(tolerance, self.bias**2 + self.bias_error**2, self.spread, self.share_sound)


class Offer(NamedTuple):
    """A number of runs of one engine in each case."""

    engine: Engine
    runs: int  # of each case
    seconds: float  # of CPU, of the runs of all cases


def performance_of(study: Study, target: str) -> list[list[Performance]]:
    """Return, for each case, the exact engine and the candidates by pilot runs; one that costs more is not compared."""
    return [_by_pilots(study, scene, target) for scene in tracked(study.cases, "cases")]


def _by_pilots(study: Study, scene: Scene, target: str) -> list[Performance]:
    found: list[Performance] = []
    for engine in tracked([REFERENCE, *candidates(scene)], "engines"):
        seconds = timing.seconds_per_run(engine, scene, TIMING_REPEATS)
        if found and seconds >= found[0].seconds:
            found.append(Performance(scene, engine, np.nan, np.nan, np.nan, seconds))
            continue
        runs = run_pilot(study, scene, engine, target)
        if engine == REFERENCE:  # the first
            exact = runs
        values = tradeoff.compare(runs, exact, study.fit_windows[0], seconds)
        bias, error, spread = (float(values[name]) for name in VARIABLES[target])
        found.append(Performance(scene, engine, bias, error, spread, seconds, runs.share_sound, _settled(runs)))
    return found


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


def candidates(scene: Scene) -> list[Engine]:
    """Return the approximate engines, with settings, that are worth a pilot and fit for the scene."""
    engines = []
    for name, definition in DEFINITIONS.items():
        for settings in definition.candidates(scene) if definition is not REFERENCE.definition else ():
            with suppress(RequestError):
                engine = configured(name, **settings)
                engine.refuse_unfit(scene)
                engines.append(engine)
    return engines


def offers(cases: Sequence[Sequence[Performance]], tolerance: float) -> list[Offer]:
    """Return the offers that meet the tolerance in all cases, the cheapest first.

    An engine that was not compared in a case offers nothing.
    """
    made = []
    for engine in [performance.engine for performance in cases[0]]:
        needed = [each.runs_for(tolerance) for case in cases for each in case if each.engine == engine]
        if None not in needed and len(needed) == len(cases) and max(needed) <= MOST_SEEDS:
            seconds = sum(each.seconds for case in cases for each in case if each.engine == engine)
            made.append(Offer(engine, max(needed), max(needed) * seconds))
    return sorted(made, key=lambda offer: offer.seconds * (1.0 - EQUAL if offer.engine == REFERENCE else 1.0))


def recommendation(cases: Sequence[Sequence[Performance]], target: str, tolerance: float) -> str:
    """Return a table of the engines in each case, and the best two offers for all cases."""
    import pandas as pd  # takes 0.3 s

    rows = [
        {
            "case": case_title(each.scene),
            "engine": each.engine.label,
            "CPU of a run": in_time(each.seconds),
            f"bias of {target}": "" if np.isnan(each.bias) else f"{_percent(each.bias)} +- {_percent(each.bias_error)}",
            "runs": each.runs_for(tolerance) or ("costs more than exact" if np.isnan(each.bias) else "bias too large"),
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


def write_study(study_file: str | Path, path: str | Path, offer: Offer, comment: str) -> None:
    """Write a study below a line of comment, all or nothing: the scenes of another study, with the runs of an offer."""
    mapping: dict[str, Any] = {key: value for key, value in read_yaml(study_file).items() if key not in NOT_INHERITED}
    scenes = mapping["scenes"] if isinstance(mapping["scenes"], list) else [mapping["scenes"]]
    folder = Path(path).resolve().parent
    mapping["scenes"] = [os.path.relpath(Path(study_file).resolve().parent / scene, folder) for scene in scenes]
    mapping |= {"engines": [{"name": offer.engine.name, **dict(offer.engine.settings)}], "seeds": offer.runs}
    folder.mkdir(parents=True, exist_ok=True)
    write_file(path, f"# {comment}\n\n{yaml_text(mapping)}".encode())
