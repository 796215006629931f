"""The runs that a study asks for: where they are stored, which are there, the jobs that make the
others, their cost.

What a step is made from stands as a digest in the name of a file beside its results: a step whose
file is missing is due, whatever times of modification say. The forecast of costs is good to a
factor of 2. Snakemake passes requests on to the queue of a cluster, which ends jobs that exceed
them; on one machine they have no effect.
"""

import json
import math
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, forecast
from brownpipe.provenance import digest_of, source_digest
from brownpipe.scene import Scene
from brownpipe.scene.seeds import ranges, seed_text
from brownpipe.scene.variation import short_name
from brownpipe.storage.store import (
    DIGITS,
    StoredFile,
    folder_of_runs,
    runs_digest,
    seeds_without_file,
    stored_batches,
)
from brownpipe.study.study import REFERENCE, Study
from brownpipe.text import counted, in_ascii, in_bytes, in_time, shell_path

SECONDS = 30.0  # CPU time of a job of `batch: auto`: starting one takes 2 % of it
OFTEN = 20.0  # plus this many times the CPU time of what a job computes only once
LARGEST = 3e8  # bytes of memory of such a job
# of a case; then their length doubles whenever the number of runs before has doubled
EQUAL_JOBS = 256

MARGIN = 2.0  # requested over forecast memory and time
# further bytes, for the two processes of Snakemake that wait on the node for the job
AROUND = 300e6
# further seconds: to compile kernels, to start an analysis, to wait for a network file system
DELAY = 300.0
ANALYSIS = 300e6  # bytes of a process that analyses or draws, besides data
REPLICATES = 10_000  # memory of the bootstrap's sums, in units of one run's data
COPIES = 5  # in memory, of a file while it is read
ANALYSIS_TIME = 1800.0  # CPU seconds, enough for 1e10 bytes of runs
RUNS_TRIED = 100  # of each engine and case in the trade-off, and in a plan


class RunSet(NamedTuple):
    """The runs of one engine in one case of a study."""

    engine: Engine
    case: Scene
    seeds: Sequence[int]  # ascending
    batch: int | None  # seeds of a job; None: by their cost
    cost: forecast.Cost  # of one run
    digest: str  # of all that determines the runs
    folder: Path  # of their files

    @property
    def key(self) -> str:
        """The digits at the end of the folder."""
        return self.digest[:DIGITS]

    @property
    def jobs(self) -> list[int]:
        """The number of seeds of each job."""
        return [
            last - first + 1
            for first, last in split_into_batches(self.seeds, self.cost, self.batch)
        ]


def split_into_batches(
    seeds: Sequence[int] | np.ndarray, cost: forecast.Cost, length: int | None = None
) -> list[tuple[int, int]]:
    """Return first and last seed of each batch of ascending seeds; `length` None: batches of
    SECONDS or more.

    Neither the number of cores nor that of seeds enters: a study has the same jobs on every
    machine, and complete batches stay valid when seeds are added. Every range of consecutive seeds
    is cut from its first seed on.
    """
    if length:
        most = size = length
    else:
        most = max(1, forecast.most_runs(cost, LARGEST))
        size = min(most, _power_of_two((SECONDS + OFTEN * cost.seconds_per_process) / cost.seconds))
    ends = []
    for first, last in ranges(seeds):
        start = first
        while start <= last:
            growth = _power_of_two((start - first) / (EQUAL_JOBS * size))
            following = start + min(most, size * growth)
            ends.append((start, min(following - 1, last)))
            start = following
    return ends


def _power_of_two(number: float) -> int:
    """Return the largest power of two up to a number; 1 for less."""
    return 1 << max(int(number).bit_length() - 1, 0)


def run_sets(study: Study) -> list[RunSet]:
    """Return the runs of a study, case by case."""
    return [run_set(study, use.case, use.engine, use.seeds or study.seeds) for use in study.uses]


def run_set(study: Study, case: Scene, engine: Engine, seeds: Sequence[int]) -> RunSet:
    """Return the runs of these seeds of one engine in one case, recorded and measured as the study
    says.
    """
    cost = engine.forecast(case, *study.recording)
    digest = runs_digest(case, engine, *study.recording)
    folder = folder_of_runs(case, engine, digest)
    batch = None if study.batch == "auto" else study.batch
    return RunSet(engine, case, seeds, batch, cost, digest, folder)


def files_of(study: Study) -> list[StoredFile]:
    """Return the files with the runs of a study, relative to the working directory: those that are
    there, and those to be made of the seeds that are not."""
    files = []
    for runs in run_sets(study):
        seeds = np.asarray(runs.seeds, np.int64)
        stored = stored_batches(runs.folder, seeds)
        due = split_into_batches(seeds_without_file(seeds, stored), runs.cost, runs.batch)
        for first, last in sorted([*stored, *due]):
            files.append(StoredFile(runs.folder / f"{first}-{last}.h5", runs.seeds))
    return files


def commands(study: Study) -> dict[str, str]:
    """Return the words of `brownpipe simulate` for each set of runs, by the digits at the end of
    its folder.
    """
    recording = f"--record {','.join(study.record)}"
    if study.observables:
        names = shell_path(",".join(study.observables))
        recording += f" --observables {names} --average {study.average}"
    commands_by_key = {}
    for runs in run_sets(study):
        scene = _scene_words(*study.varied[runs.case.name])
        commands_by_key[runs.key] = (
            f"{scene} --particles {runs.case.particles} --engine {runs.engine.options} "
            f"{recording} --planned {runs.digest}"
        )
    return commands_by_key


def _scene_words(path: Path, values: Mapping[str, object]) -> str:
    """Return the words of a command that name a scene file and the values of its varied keys:
    "box.yaml --value packing_fraction=0.3".
    """
    words = [shell_path(os.path.relpath(path))]
    for key, value in values.items():
        words += ["--value", shlex.quote(f"{key}={json.dumps(value)}")]
    return " ".join(words)


def listed_runs(study: Study) -> list[str]:
    """Return a line for each set of runs: its folder and its seeds."""
    return [f"{runs.folder} {seed_text(runs.seeds)}" for runs in run_sets(study)]


def figure_options(study: Study) -> list[str]:
    """Return the options of `brownpipe figures` for a study, in ASCII: a locale may lack a letter
    of title or note.
    """
    figures = study.figures if "figures" in study.model_fields_set else ()
    panel = [short_name(name) if name in study.vary else name for name in study.panel]
    options = {
        "--figures": ",".join(figures),
        "--particles": study.shown_particles,
        "--panel": ",".join(panel),
        "--title": study.title and in_ascii(study.title),
        "--note": study.note and in_ascii(study.note),
    }
    return [f"{option}={value}" for option, value in options.items() if value]


def digests(study: Study) -> dict[str, str]:
    """Return the first digits of a SHA-256 over all that each step of the workflow after `simulate`
    is made from.
    """
    unknown = {"seeds": ()} if study.tolerance else {}
    folders = listed_runs(study.model_copy(update=unknown))
    runs = [*folders, study.tolerance, study.target, study.fit_windows[0]]
    analysed = {"fit_windows", "displacement_times", "rings", "vary", "vary_together"}
    keys = study.model_dump(include=analysed)
    # The dataset says if windows were asked for.
    analysis = (keys, study.asked_windows is not None)
    tradeoff_source = source_digest("tradeoff")
    figures_source = source_digest("figures")
    aggregate = digest_of(runs, analysis, source_digest("aggregate"))
    tradeoff = digest_of(runs, study.instead_of, tradeoff_source)
    return {
        "plan": digest_of(runs, tradeoff_source),
        "aggregate": aggregate,
        "figures": digest_of(aggregate, study.figures, figure_options(study), figures_source),
        "tradeoff": tradeoff,
        "tradeoff_figures": digest_of(tradeoff, figures_source),
    }


# -- cost ------------------------------------------------------------------------------------------


def seconds_of_jobs(cost: forecast.Cost, runs: int, jobs: int = 1) -> float:
    """Return the CPU seconds of `jobs` processes that make and write `runs` runs together."""
    return jobs * (forecast.START_UP + cost.seconds_per_process) + runs * cost.seconds


def describe_workload(study: Study) -> str:
    """Return the workload of the whole study in one line."""
    sets = run_sets(study)
    numbers = [len(runs.seeds) for runs in sets]
    jobs = [len(runs.jobs) for runs in sets]
    cpu_times = [seconds_of_jobs(runs.cost, len(runs.seeds), len(runs.jobs)) for runs in sets]
    sizes = [len(runs.seeds) * runs.cost.bytes_in_file for runs in sets]
    total = f"{counted(sum(numbers), 'run')} in {counted(sum(jobs), 'job')}"
    return f"{total}: some {in_time(sum(cpu_times))} of CPU, {in_bytes(sum(sizes))} of runs"


def job_resources(study: Study) -> dict[str, dict[str, object]]:
    """Return the `resources` of each rule: functions of wildcards and attempt, each twice as
    large.
    """
    sets = run_sets(study)
    costs = {runs.key: runs.cost for runs in sets}
    sizes = [
        (REPLICATES + COPIES * max(runs.jobs)) * runs.cost.bytes_until_written for runs in sets
    ]
    memory = ANALYSIS + max(sizes)
    exact = [REFERENCE.forecast(case, *study.recording) for case in study.cases]
    trials = [RUNS_TRIED * cost.seconds for cost in (*costs.values(), *exact)]
    trial_time = ANALYSIS_TIME + sum(trials)

    def need_of_runs(wildcards: Mapping[str, str]) -> tuple[float, float]:
        cost = costs[wildcards["digest"]]
        runs = int(wildcards["last"]) - int(wildcards["first"]) + 1
        return forecast.memory(cost, runs), seconds_of_jobs(cost, runs)

    analysis = _resources(lambda _: (memory, ANALYSIS_TIME))
    trial = _resources(lambda _: (memory, trial_time))
    return {
        "simulate": _resources(need_of_runs),
        "aggregate": analysis,
        "figures": analysis,
        "tradeoff_drawings": analysis,
        "plan": trial,
        "tradeoff": trial,
    }


def _resources(need: Callable[[Mapping[str, str]], tuple[float, float]]) -> dict[str, object]:
    """Return the resources of a rule, memory [MB] and wall time [min]; `need`: bytes and CPU
    seconds of a job.
    """

    def megabytes(wildcards: Mapping[str, str], attempt: int) -> int:
        size, _ = need(wildcards)
        return 2 ** (attempt - 1) * math.ceil((MARGIN * size + AROUND) / 1e6)

    def minutes(wildcards: Mapping[str, str], attempt: int) -> int:
        _, seconds = need(wildcards)
        return 2 ** (attempt - 1) * math.ceil((MARGIN * seconds + DELAY) / 60)

    return {"mem_mb": megabytes, "runtime": minutes, "cpus_per_task": 1}
