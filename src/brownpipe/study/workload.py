"""The workload of a study: how many runs and jobs it has, and the CPU time and disk space they are expected to take."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

from brownpipe.engines import Engine, forecast
from brownpipe.formatting import counted, in_bytes, in_time
from brownpipe.scene import Scene
from brownpipe.study.study import EngineUse, Study

PILOT_SECONDS = 4.0  # CPU time of the pilot runs of a case, as forecast
LONG = 2 * 86400.0  # CPU seconds from which a forecast is cautioned about, in days


class CaseWorkload(NamedTuple):
    """The runs of one engine in one case."""

    engine: Engine
    seeds: Sequence[int]
    case: Scene
    cost: forecast.Cost  # of a run
    batches: list[tuple[int, int]]  # first and last seed of each job

    @property
    def largest_batch(self) -> tuple[int, int]:
        """The first of the batches with the most seeds."""
        return max(self.batches, key=self._seeds_in)

    @property
    def most_seeds(self) -> int:
        """The largest number of seeds of a job."""
        return self._seeds_in(self.largest_batch)

    @property
    def seconds(self) -> float:
        """CPU seconds, with starting the processes."""
        return seconds_of_jobs(self.cost, len(self.seeds), len(self.batches))

    def _seeds_in(self, batch: tuple[int, int]) -> int:
        """Return how many of the ascending seeds lie in a batch (first, last)."""
        return bisect_right(self.seeds, batch[1]) - bisect_left(self.seeds, batch[0])


def workloads(study: Study) -> list[list[CaseWorkload]]:
    """Return, for each entry of the study's `engines`, the workload of each case. The study's seeds must be known."""
    return [[_workload(study, use, case) for case in study.cases_of(use)] for use in study.engine_uses]


def _workload(study: Study, use: EngineUse, case: Scene) -> CaseWorkload:
    cost, seeds = use.engine.forecast(case, *study.recording), use.seeds or study.seeds
    return CaseWorkload(use.engine, seeds, case, cost, study.batches_of(use, case, seeds))


def case_workloads(study: Study) -> list[CaseWorkload]:
    """Return all workloads of a study in one list."""
    return [*chain.from_iterable(workloads(study))]


def with_assumed_runs(study: Study) -> Study:
    """Return a study with a tolerance with the runs of a quantity whose standard deviation is its mean, as r^2 has it.

    One that has seeds is returned unchanged.
    """
    if study.tolerance is None or study.seeds:
        return study
    return study.model_copy(update={"seeds": range(math.ceil(study.tolerance**-2))})


def seconds_of_jobs(cost: forecast.Cost, runs: int, jobs: int = 1) -> float:
    """Return the CPU seconds of so many processes that make and write so many runs together."""
    return jobs * (forecast.START_UP + cost.once) + runs * (cost.seconds + cost.storing)


def cautions(study: Study) -> list[str]:
    """Return a line for the job that needs more memory than this machine has, for the longest, and for the total time.

    The seeds of the study must be known.
    """
    parts = case_workloads(study)
    largest = max(parts, key=lambda part: forecast.memory(part.cost, part.most_seeds))
    longest = max(parts, key=lambda part: seconds_of_jobs(part.cost, part.most_seeds))
    total = sum(part.seconds for part in parts)
    lines = [_too_large(largest), _too_long(study, longest)]
    if total >= LONG:
        fewer = "must be fewer `seeds`" if study.tolerance is None else "must be a larger `tolerance`"
        lines.append(f"the study takes some {in_time(total)} of CPU; {fewer}, a shorter duration or fewer disks")
    return [line for line in lines if line is not None]


def _job(part: CaseWorkload) -> str:
    """Return the first of the largest jobs of a case by an engine, as messages name it."""
    first, last = part.largest_batch
    return f"the job of seeds {first}-{last} of {part.case.name}, N = {part.case.particles}, {part.engine.label},"


def _too_large(part: CaseWorkload) -> str | None:
    """Return a line if a job needs more memory than this machine has."""
    runs, available = part.most_seeds, forecast.machine_memory()
    needed = forecast.memory(part.cost, runs)
    if needed <= available:
        return None
    fits = forecast.most_runs(part.cost, available)
    cure = f"must be at most `batch: {fits}`" if fits else "must be fewer samples or disks, or less measured"
    of_runs = "its single run" if runs == 1 else f"its {runs:,} runs"
    memory = f"needs some {in_bytes(needed)} of memory for {of_runs}, and this machine has {in_bytes(available)}"
    return f"{_job(part)} {memory}; {cure}"


def _too_long(study: Study, part: CaseWorkload) -> str | None:
    """Return a line if a job takes days."""
    runs = part.most_seeds
    seconds = seconds_of_jobs(part.cost, runs)
    if seconds < LONG:
        return None
    cure = "must be a shorter duration or fewer disks"
    if runs > 1:
        smaller = f"a smaller `batch` than {study.batch}" if study.batch else f"a `batch` smaller than {runs}"
        cure = f"must be {smaller}, for shorter jobs that run at the same time"
    return f"{_job(part)} takes some {in_time(seconds)} of CPU on one core; {cure}"


def describe_workload(study: Study) -> str:
    """Return the workload of the whole study in one line. Its seeds must be known."""
    parts = case_workloads(study)
    runs = sum(len(part.seeds) for part in parts)
    count = sum(len(part.batches) for part in parts)
    seconds = in_time(sum(part.seconds for part in parts))
    size = in_bytes(sum(len(part.seeds) * part.cost.recorded for part in parts))
    most = counted(max(part.most_seeds for part in parts), "seed")
    jobs = f"{counted(runs, 'run')} in {counted(count, 'job')} of up to {most}"
    return f"{jobs}: some {seconds} of CPU, {size} in results/{study.name}"
