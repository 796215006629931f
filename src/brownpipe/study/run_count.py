"""The number of runs that a tolerance needs, from pilot runs of the exact engine with seeds that no study uses.

The number of pilot runs follows from the forecast, not from a clock: a study has as many runs on every machine.
"""

from pathlib import Path
from typing import Any

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

COMMENT = "# The number of runs that the tolerance of this study needs, determined once."
SQUARES, DISTRIBUTION = "square_displacement", "displacement_distribution"  # an observable; a target
LEAST_SOUND = 0.01  # share of runs that do not fail
FIRST_SEED = 2**40
PILOT_SECONDS = 4.0  # CPU time of a pilot, as forecast
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
