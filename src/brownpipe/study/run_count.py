"""The number of runs that a tolerance needs: the same on every machine, for a given study."""

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from brownpipe.engines.saturation import share_failing
from brownpipe.errors import AnalysisError, RequestError
from brownpipe.formatting import in_time
from brownpipe.scene import Scene
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.scene.yaml_file import read_yaml, yaml_text
from brownpipe.storage.checksums import write_sealed_text
from brownpipe.study.pilot import average_of_msd, pilot_seconds, run_pilot
from brownpipe.study.study import REFERENCE, Study
from brownpipe.study.study_file import MOST_JOBS, RENAMED_TARGETS
from brownpipe.tradeoff import bias, runs_for, spread_of

COMMENT = "# The number of runs that the tolerance of this study needs, determined once."
PLAN = "plan.yaml"
LEAST_SOUND = 0.01  # share of runs that do not fail
DISTRIBUTION = "displacement_distribution"  # the target whose scatter is known without pilot runs


def settle(study: Study, path: str | Path, say: Callable[[str], object], dry_run: bool = False) -> Study:
    """Return the study with as many seeds as its tolerance needs; a study that has seeds is returned unchanged.

    The number is determined once, by pilot runs of the exact engine that `say` announces, and stored in the file at
    `path`. It is determined again when scenes, tolerance, target or fit window change. It is the largest of all cases
    and covers statistical errors only: more runs do not reduce an engine's bias. A dry run neither starts pilot runs
    nor writes the file: it assumes a number (`assumed_runs`) and says so. Raises RequestError for too many runs.
    """
    if study.tolerance is None:
        return study
    request = {
        "tolerance": study.tolerance,
        "target": study.target,
        "window": list(study.fit_windows[0]),
        "scenes": {case_title(case): case.digest for case in study.cases},
    }
    average = average_of_msd(study)
    if average != "runs" and study.target != DISTRIBUTION:
        request["average"] = average
    plan = _stored_plan(path)
    if {key: plan.get(key) for key in request} != request:
        seconds = 0.0 if study.target == DISTRIBUTION else sum(pilot_seconds(case, average) for case in study.cases)
        goal = f"a tolerance of {100 * study.tolerance:g} % of {study.target} needs"
        pilots = f"pilot runs, some {in_time(seconds)} of CPU once kernels are compiled,"
        if seconds and dry_run:
            runs = assumed_runs(study.tolerance)
            say(f"brownpipe: the study {study.name}: {runs:,} runs assumed; {pilots} will determine how many {goal}")
            return _with_runs(study, runs)
        if seconds:
            say(f"brownpipe: the study {study.name}: {pilots} determine how many runs {goal}")
        needed = {case_title(case): _runs_needed(case, study) for case in study.cases}
        plan = request | {"needed": needed, "runs": max(needed.values())}
        if not dry_run:
            write_sealed_text(path, f"{COMMENT}\n\n{yaml_text(plan)}")
    return _with_runs(study, plan["runs"])


def _with_runs(study: Study, runs: int) -> Study:
    """Return the study with the seeds 0 to runs - 1, in batches large enough for the number of jobs allowed."""
    study = replace(study, seeds=range(runs))
    while study.batch is not None and len(study.jobs()) > MOST_JOBS:
        study = replace(study, batch=2 * study.batch)
    return study


def assumed_runs(tolerance: float) -> int:
    """Return the number of runs for a quantity whose standard deviation is its mean, as that of r^2 in diffusion."""
    return math.ceil(tolerance**-2)


def _runs_needed(scene: Scene, study: Study) -> int:
    """Return the number of exact runs of a scene, with failing ones, whose standard error is the study's tolerance."""
    if study.target == DISTRIBUTION:
        scatter, sound = bias.spread_of_shares(), 1.0 - share_failing(scene)
    else:
        pilot = run_pilot(scene, REFERENCE, average_of_msd(study))
        try:
            scatter, sound = spread_of(pilot, study.target, study.fit_windows[0]), pilot.share_sound
        except AnalysisError as error:
            raise RequestError(str(error)) from error
    if sound < LEAST_SOUND:
        share = f"{100 * (1 - sound):.4g} % of the runs are expected to fail"
        raise RequestError(f"{case_title(scene)}: {share}; must be fewer or smaller disks, or `placement: lattice`")
    runs = runs_for(study.tolerance, 0.0, scatter, sound)
    if runs > MOST_SEEDS:
        needed = f"a tolerance of {study.tolerance:g} needs {runs} runs; at most {MOST_SEEDS}"
        raise RequestError(f"{case_title(scene)}: {needed}")
    return runs


def case_title(scene: Scene) -> str:
    """Return scene and number of disks, as messages name a case."""
    return f"{scene.name}, N = {scene.particles}"


def is_plan(path: str | Path) -> bool:
    """Whether a file is a plan that does not contradict itself."""
    return bool(_stored_plan(path))


def _stored_plan(path: str | Path) -> dict:
    """Return the contents of the plan file; empty if there is none, it cannot be read or it contradicts itself."""
    try:
        plan = read_yaml(path, 2**20) if os.path.exists(path) else {}
    except RequestError:
        return {}
    if not isinstance(plan, dict):
        return {}
    needed = plan.get("needed")
    counts = [*needed.values()] if isinstance(needed, dict) else []
    if not counts or not all(isinstance(count, int) for count in counts) or plan.get("runs") != max(counts):
        return {}
    old = plan.get("observable")  # the key of files written before it was renamed
    return {"target": RENAMED_TARGETS.get(old, old)} | plan if isinstance(old, str) else plan
