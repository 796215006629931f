"""Memory and time of each job of a study: what it is expected to need, what it asks a cluster for, what it took.

Snakemake passes a request on to the queue of a cluster, which ends jobs that exceed it; on one machine it has no
effect. The need of a job of `simulate` is the forecast of its runs.
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from brownpipe import observables
from brownpipe.engines import forecast
from brownpipe.formatting import in_time
from brownpipe.study.replay import RECORD, replay_jobs
from brownpipe.study.study import REFERENCE, Study
from brownpipe.study.workload import CaseWorkload, case_workloads, seconds_of_job

MARGIN = 1.5  # of memory
COMPILING = 150e6  # further bytes of a process that compiles kernels
AROUND = 300e6  # further bytes on a cluster: two processes of Snakemake wait on the node for that of the job
SLOWER = 2.0  # how much slower the processors of a cluster may be
DELAY = 300.0  # further seconds: to compile kernels, and to wait for a network file system
ANALYSIS = 170e6  # bytes of memory of a process that analyses or draws, besides data
ANALYSIS_START = 1.0  # CPU seconds, to import what the analysis needs
PER_CASE = 0.15  # further CPU seconds to analyse a case
BYTES_PER_NUMBER = 130e3  # of memory for the replicates of a quantity that is averaged over the runs of a case
COPIES_READ = 5  # of the largest file in memory: two files are kept, a third is read, decoded and verified
MOST_IN_A_SECOND_CASE = 300e6  # bytes, which the margin of a request covers
BYTES_PER_RUN = 300  # of memory for what a dataset has of each run
SECONDS_PER_NUMBER = 6.5e-7  # CPU, to read and average a number of a run
SECONDS_PER_FILE = 0.03  # CPU, to open and verify a file
FIGURE = 0.4  # CPU seconds to draw a figure and store it in its formats
TIMING = 30.0  # runs in the CPU time measurements of a case by an engine, at least
LEAST_TIMING = 4.0  # CPU seconds of these measurements
BYTES_COMPARED = 60  # of memory for a number of a run in the trade-off, which has all of them in memory


class Need(NamedTuple):
    """What a job is expected to take."""

    memory: float  # peak [bytes]
    seconds: float  # of CPU

    def megabytes(self, attempt: int = 1) -> int:
        """Memory to ask for [MB], doubled at every further attempt."""
        return 2 ** (attempt - 1) * math.ceil((MARGIN * self.memory + COMPILING + AROUND) / 1e6)

    def minutes(self, attempt: int = 1) -> int:
        """Wall time to ask for [min], doubled at every further attempt."""
        return 2 ** (attempt - 1) * math.ceil((SLOWER * self.seconds + DELAY) / 60)


class Used(NamedTuple):
    """What a finished job took, as Snakemake measured it."""

    job: str  # rule and what it made
    need: Need  # as expected
    seconds: float  # wall time
    memory: float  # largest resident memory seen [bytes]


def requests(study: Study) -> dict[str, dict[str, object]]:
    """Return the `resources` of each rule of the workflow; those that depend on wildcards or attempt are functions."""
    costs, others = costs_of_runs(study), needs_of_others(study)

    def need_of(rule: str, wildcards: Mapping[str, str]) -> Need:
        if rule in others:
            return others[rule]
        case = wildcards["scene"], int(wildcards["particles"]), wildcards["engine"]
        return need_of_runs(costs[case], int(wildcards["last"]) - int(wildcards["first"]) + 1)

    def asked(rule: str) -> dict[str, object]:
        return {
            "mem_mb": lambda wildcards, attempt: need_of(rule, wildcards).megabytes(attempt),
            "runtime": lambda wildcards, attempt: need_of(rule, wildcards).minutes(attempt),
            "cpus_per_task": 1,
        }

    return {rule: asked(rule) for rule in ("simulate", *others)}


def costs_of_runs(study: Study) -> dict[tuple[str, int, str], forecast.Cost]:
    """Return the forecast of a run by scene, number of disks and engine."""
    return {(part.case.name, part.case.particles, part.engine.label): part.cost for part in case_workloads(study)}


def needs_of_simulation(study: Study) -> dict[str, Need]:
    """Return the need of each job of `simulate` by its file, below results/STUDY/simulate."""
    costs = costs_of_runs(study)
    return {job.file: need_of_runs(costs[job[:3]], job.last - job.first + 1) for job in study.jobs()}


def needs_of_others(study: Study) -> dict[str, Need]:
    """Return the need of each rule that has one job."""
    return {
        "replay": need_of_replay(study),
        "aggregate": need_of_aggregate(study),
        "figures": need_of_figures(study, len(study.figures)),
        "tradeoff": need_of_tradeoff(study),
        "tradeoff_drawings": need_of_figures(study, len(study.tradeoff_cases)),
    }


def need_of_runs(cost: forecast.Cost, runs: int) -> Need:
    """Return the need of a job of so many runs."""
    return Need(forecast.memory(cost, runs), seconds_of_job(cost, runs))


def need_of_replay(study: Study) -> Need:
    """Return the need of the job that records one run for its replay; that of an empty one if there is none."""
    if not replay_jobs(study):
        return Need(forecast.PROCESS, forecast.START_UP)
    request = study.request_of(replay_jobs(study)[0])
    return need_of_runs(REFERENCE.forecast(request.scene, RECORD), 1)


def need_of_aggregate(study: Study) -> Need:
    """Return the need of the analysis on one core.

    Its memory is for the replicates of one case, for some of its files, and for some numbers of each run.
    """
    parts = case_workloads(study)
    runs = sum(len(part.seeds) for part in parts)
    numbers = [_numbers_in(study, part) for part in parts]
    of_case = max(
        BYTES_PER_NUMBER * count + COPIES_READ * part.most_seeds * part.cost.kept
        for count, part in zip(numbers, parts, strict=True)
    )
    seconds = ANALYSIS_START + PER_CASE * len(parts) + SECONDS_PER_FILE * sum(len(part.batches) for part in parts)
    seconds += SECONDS_PER_NUMBER * sum(count * len(part.seeds) for count, part in zip(numbers, parts, strict=True))
    return Need(ANALYSIS + of_case + BYTES_PER_RUN * runs, seconds)


def cores_of_aggregate(study: Study) -> int:
    """Return on how many cores of one machine cases are analysed: one if a second case might take much memory."""
    return 2 if need_of_aggregate(study).memory < ANALYSIS + MOST_IN_A_SECOND_CASE else 1


def _numbers_in(study: Study, part: CaseWorkload) -> int:
    """Return how many numbers of a run are averaged: of the tracer's path, and of the observables."""
    tracer = len(part.case.times) if study.record == "tracer" else 0
    return tracer + observables.numbers_in(part.case, study.observables)


def need_of_figures(study: Study, figures: int) -> Need:
    """Return the need of drawing so many figures, which hold the numbers of each run."""
    runs = sum(len(part.seeds) for part in case_workloads(study))
    return Need(ANALYSIS + 100e6 + BYTES_PER_RUN * runs, ANALYSIS_START + FIGURE * (figures + 1))


def need_of_tradeoff(study: Study) -> Need:
    """Return the need of the trade-off: all runs in memory, and measurements of CPU time."""
    parts = case_workloads(study)
    numbers = sum(len(part.seeds) * _numbers_in(study, part) for part in parts)
    timed = sum(max(TIMING * part.cost.seconds, LEAST_TIMING) for part in parts)
    return Need(ANALYSIS + BYTES_COMPARED * numbers, need_of_aggregate(study).seconds + timed)


def describe_used(study: Study) -> str:
    """Return in one line what the finished jobs of a study took, against the forecast and against their requests."""
    jobs = list(used(study))
    if not jobs:
        return "no job was measured"
    took, expected = sum(job.seconds for job in jobs), sum(job.need.seconds for job in jobs)
    time = max(job.seconds / (60 * job.need.minutes()) for job in jobs)
    memory = max(job.memory / (1e6 * job.need.megabytes()) for job in jobs)
    largest = f"at most {100 * time:.0f} % of the requested time, {100 * memory:.0f} % of the requested memory"
    return f"{len(jobs)} jobs took {in_time(took)}, forecast {in_time(expected)} of CPU; {largest}"


def used(study: Study) -> Iterator[Used]:
    """Yield what each finished job of a study took, of those that were long enough to be measured."""
    needs = {f"simulate/{file}": need for file, need in needs_of_simulation(study).items()}
    needs |= {f"replay/{job.file}": need_of_replay(study) for job in replay_jobs(study)}
    needs |= {f"{rule}/{study.name}": need for rule, need in needs_of_others(study).items() if rule != "replay"}
    for job, need in needs.items():
        measured = _measured(Path(f"results/{study.name}/benchmarks/{job.removesuffix('.h5')}.tsv"))
        if measured is not None:
            yield Used(job, need, *measured)


def _measured(path: Path) -> tuple[float, float] | None:
    """Return wall time [s] and memory [bytes] in a table of Snakemake; None without one, or if it has no memory."""
    try:
        names, values = (line.split("\t") for line in path.read_text().splitlines()[:2])
        row = dict(zip(names, values, strict=True))
        return float(row["s"]), 2**20 * float(row["max_rss"])
    except (OSError, UnicodeDecodeError, ValueError, KeyError):
        return None
