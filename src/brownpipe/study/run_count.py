"""The number of runs that a tolerance needs, from pilot runs of the exact engine with seeds that no study uses.

The number of pilot runs follows from the forecast, not from a clock: a study has as many runs on every machine.
"""

from pathlib import Path

import numpy as np

from brownpipe import tradeoff
from brownpipe.engines import Engine, forecast
from brownpipe.engines.saturation import share_failing
from brownpipe.errors import AnalysisError, RequestError
from brownpipe.scene import Scene
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.scene.yaml_file import read_yaml, yaml_text
from brownpipe.stages import tracked
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.study.study import MOST_JOBS, REFERENCE, Study
from brownpipe.study.workload import PILOT_SECONDS

COMMENT = "# The number of runs that the tolerance of this study needs, determined once."
LEAST_SOUND = 0.01  # share of runs that do not fail
DISTRIBUTION = "displacement_distribution"  # the target whose scatter is known without pilot runs
SQUARES = "square_displacement"  # the observable
FIRST_SEED = 2**40
FEWEST_RUNS, MOST_RUNS = 10, 400  # of a pilot


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

    Raises RequestError if there is no such file, StorageError if it is not as it was written.
    """
    if study.tolerance is None:
        return study
    if path is None:
        raise RequestError("--plan: missing; the number of runs for a tolerance is in results/STUDY/plan/*.yaml")
    with naming(path, "plan"):
        read_sealed(path)
    plan = read_yaml(path)
    runs = plan.get("runs") if isinstance(plan, dict) else None
    if not isinstance(runs, int) or not 0 < runs <= MOST_SEEDS:
        raise RequestError(f"{path}: says no number of runs; delete it and run the study again")
    study = study.model_copy(update={"seeds": range(runs)})
    while study.batch is not None and runs * len(study.cases) > MOST_JOBS * study.batch:
        study = study.model_copy(update={"batch": 2 * study.batch})
    return study


def average_of_msd(study: Study) -> str:
    """Return over what the squared displacements of a study are averaged within a run: runs (not at all) or another."""
    return study.average if SQUARES in study.observables else "runs"


def pilot_runs(scene: Scene, average: str = "runs") -> int:
    """Return the number of runs of a pilot; the time of those that fail does not count, as they say nothing."""
    seconds = _forecast(scene, average) - forecast.SECONDS_TO_FAIL * share_failing(scene)
    return int(np.clip(PILOT_SECONDS / seconds, FEWEST_RUNS, MOST_RUNS))


def run_pilot(scene: Scene, engine: Engine, average: str = "runs") -> tradeoff.EngineRuns:
    """Run the pilot of a scene by an engine, with the same seeds for all engines and this `average` in each run."""
    seeds = range(FIRST_SEED, FIRST_SEED + pilot_runs(scene, average))
    ensemble = engine.simulate(scene, seeds, frozenset({"tracer"}), observables=_measured(average), average=average)
    runs = tradeoff.runs_of(scene, engine, ensemble)
    if average == "runs":
        return runs
    return runs._replace(squared=ensemble.observables[SQUARES][ensemble.observables["failed"] == 0])


def case_title(scene: Scene) -> str:
    """Return scene and number of disks, as messages name a case."""
    return f"{scene.name}, N = {scene.particles}"


def _measured(average: str) -> tuple[str, ...]:
    return () if average == "runs" else (SQUARES,)


def _forecast(scene: Scene, average: str) -> float:
    """CPU seconds of a run of the pilot."""
    return forecast.of_run(scene, observables=_measured(average), average=average).seconds


def _runs_needed(scene: Scene, study: Study) -> int:
    """Return the number of exact runs of a scene, with failing ones, whose standard error is the study's tolerance."""
    if study.target == DISTRIBUTION:
        scatter, sound = tradeoff.bias.spread_of_shares(), 1.0 - share_failing(scene)
    else:
        pilot = run_pilot(scene, REFERENCE, average_of_msd(study))
        try:
            scatter, sound = tradeoff.spread_of(pilot, study.target, study.fit_windows[0]), pilot.share_sound
        except AnalysisError as error:
            raise RequestError(str(error)) from error
    if sound < LEAST_SOUND:
        share = f"{100 * (1 - sound):.4g} % of the runs are expected to fail"
        raise RequestError(f"{case_title(scene)}: {share}; must be fewer or smaller disks, or `placement: lattice`")
    runs = tradeoff.runs_for(study.tolerance, 0.0, scatter, sound)
    if runs > MOST_SEEDS:
        needed = f"a tolerance of {study.tolerance:g} needs {runs} runs; at most {MOST_SEEDS}"
        raise RequestError(f"{case_title(scene)}: {needed}")
    return runs
