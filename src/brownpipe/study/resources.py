"""Memory and time of each job of a study: what it is expected to need, and what it asks a cluster for.

Snakemake passes a request on to the queue of a cluster, which ends jobs that exceed it; on one machine it has no
effect. The need of a job of `simulate` is the forecast of its runs.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from brownpipe import observables
from brownpipe.engines import forecast
from brownpipe.study.run_sets import run_sets
from brownpipe.study.study import Study
from brownpipe.study.workload import (
    PILOT_SECONDS,
    CaseWorkload,
    case_workloads,
    seconds_of_jobs,
    with_assumed_runs,
)

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


def requests(study: Study) -> dict[str, dict[str, object]]:
    """Return the `resources` of each rule of the workflow; those that depend on wildcards or attempt are functions."""
    costs, others = costs_of_runs(study), needs_of_others(with_assumed_runs(study))

    def need_of(rule: str, wildcards: Mapping[str, str]) -> Need:
        if rule in others:
            return others[rule]
        return need_of_runs(costs[wildcards["digest"]], int(wildcards["last"]) - int(wildcards["first"]) + 1)

    def asked(rule: str) -> dict[str, object]:
        return {
            "mem_mb": lambda wildcards, attempt: need_of(rule, wildcards).megabytes(attempt),
            "runtime": lambda wildcards, attempt: need_of(rule, wildcards).minutes(attempt),
            "cpus_per_task": 1,
        }

    return {rule: asked(rule) for rule in ("simulate", *others)}


def costs_of_runs(study: Study) -> dict[str, forecast.Cost]:
    """Return the forecast of a run by the digits at the end of the folder of runs."""
    return {runs.key: runs.use.engine.forecast(runs.case, *study.recording) for runs in run_sets(study)}


def needs_of_others(study: Study) -> dict[str, Need]:
    """Return the need of each rule that has one job."""
    return {
        "plan": Need(ANALYSIS, 2 * PILOT_SECONDS * len(study.cases)),
        "aggregate": need_of_aggregate(study),
        "figures": need_of_figures(study, len(study.figures)),
        "tradeoff": need_of_tradeoff(study),
        "tradeoff_drawings": need_of_figures(study, len(study.tradeoff_cases)),
    }


def need_of_runs(cost: forecast.Cost, runs: int) -> Need:
    """Return the need of a job of so many runs."""
    return Need(forecast.memory(cost, runs), seconds_of_jobs(cost, runs))


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
