"""The workload of a study: how many runs and jobs it has, and the CPU time and disk space they are expected to take."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from brownpipe.engines import Engine, forecast
from brownpipe.formatting import in_bytes, in_time
from brownpipe.scene import Scene
from brownpipe.study.study import SimulationJob, Study

LONG = 2 * 86400.0  # CPU seconds from which a forecast is cautioned about, in days


class EngineWorkload(NamedTuple):
    """The runs of one engine in a study: every seed of every case."""

    engine: Engine
    seeds: Sequence[int]
    cases: list[Scene]
    costs: list[forecast.Cost]  # of a run of each case
    batches: list[tuple[int, int]]  # first and last seed of each job
    seconds: float  # of CPU, with starting the processes
    size: float  # bytes of trajectory files

    @property
    def most_seeds(self) -> int:
        """The largest number of seeds of a job."""
        return max(_seeds_in(self.seeds, batch) for batch in self.batches)


def workloads(study: Study) -> list[EngineWorkload]:
    """Return the workload of each entry of the study's `engines`. The study's seeds must be known."""
    return [_workload(study, use.engine, use.seeds or study.seeds, study.cases_of(use)) for use in study.engine_uses]


def _workload(study: Study, engine: Engine, seeds: Sequence[int], cases: list[Scene]) -> EngineWorkload:
    costs = [engine.forecast(case, *recording_of(study)) for case in cases]
    batches = study.batches_of(seeds)
    seconds = sum(
        len(batches) * (forecast.START_UP + cost.once) + len(seeds) * (cost.seconds + cost.storing) for cost in costs
    )
    size = len(seeds) * sum(cost.recorded for cost in costs)
    return EngineWorkload(engine, seeds, cases, costs, batches, seconds, size)


def _seeds_in(seeds: Sequence[int], batch: tuple[int, int]) -> int:
    """Return how many of the ascending seeds lie in a batch (first, last)."""
    return bisect_right(seeds, batch[1]) - bisect_left(seeds, batch[0])


def _seconds_of_job(cost: forecast.Cost, runs: int) -> float:
    return forecast.START_UP + cost.once + runs * (cost.seconds + cost.storing)


def cautions(study: Study) -> list[str]:
    """Return a line for the job that needs more memory than this machine has, for the longest, and for the total time.

    The seeds of the study must be known.
    """
    parts = workloads(study)
    jobs = [(part, case, cost) for part in parts for case, cost in zip(part.cases, part.costs, strict=True)]
    largest = max(jobs, key=lambda job: forecast.memory(job[2], job[0].most_seeds))
    longest = max(jobs, key=lambda job: _seconds_of_job(job[2], job[0].most_seeds))
    total = sum(part.seconds for part in parts)
    lines = [_too_large(study, *largest), _too_long(study, *longest)]
    if total >= LONG:
        lines.append(
            f"the study takes some {in_time(total)} of CPU; {_fewer(study)}, a shorter duration or fewer disks"
        )
    return [line for line in lines if line is not None]


def _fewer(study: Study) -> str:
    """Return the key by which a study has fewer runs."""
    return "must be fewer `seeds`" if study.tolerance is None else "must be a larger `tolerance`"


def _job(study: Study, part: EngineWorkload, case: Scene) -> str:
    """Return the file of the first of the largest jobs of a case by an engine, as messages name it."""
    batch = next(batch for batch in part.batches if _seeds_in(part.seeds, batch) == part.most_seeds)
    return f"the job {SimulationJob(case.name, case.particles, part.engine.label, *batch).file}"


def _too_large(study: Study, part: EngineWorkload, case: Scene, cost: forecast.Cost) -> str | None:
    """Return a line if a job needs more memory than this machine has."""
    runs, available = part.most_seeds, forecast.machine_memory()
    needed = forecast.memory(cost, runs)
    if needed <= available:
        return None
    fits = forecast.most_runs(cost)
    cure = f"must be at most `batch: {fits}`" if fits else "must be fewer samples or disks, or less measured"
    of_runs = "its single run" if runs == 1 else f"its {runs:,} runs"
    memory = f"needs some {in_bytes(needed)} of memory for {of_runs}, and this machine has {in_bytes(available)}"
    return f"{_job(study, part, case)} {memory}; {cure}"


def _too_long(study: Study, part: EngineWorkload, case: Scene, cost: forecast.Cost) -> str | None:
    """Return a line if a job takes days."""
    runs = part.most_seeds
    seconds = _seconds_of_job(cost, runs)
    if seconds < LONG:
        return None
    cure = "must be a shorter duration or fewer disks"
    if runs > 1:
        cure = f"must be a smaller `batch` than {study.batch}, for shorter jobs that run at the same time"
    return f"{_job(study, part, case)} takes some {in_time(seconds)} of CPU on one core; {cure}"


def describe_workload(study: Study) -> str:
    """Return the workload of the whole study in one line. Its seeds must be known."""
    parts = workloads(study)
    runs = sum(len(part.seeds) * len(part.cases) for part in parts)
    longest = min(study.batch, max(len(part.seeds) for part in parts))
    seconds = in_time(sum(part.seconds for part in parts))
    size = in_bytes(sum(part.size for part in parts))
    jobs = f"{runs:,} runs in {len(study.jobs())} jobs of up to {longest:,} seeds"
    return f"{jobs}: some {seconds} of CPU, {size} in results/{study.name}"


def recording_of(study: Study) -> tuple[set[str], tuple[str, ...], str]:
    """Return the last arguments of `Engine.forecast`: what each run records, what it measures, and the average."""
    return {study.record}, study.observables, study.average
