"""The workload of a study: how many runs and jobs it has, and the CPU time and disk space they are expected to take."""

from collections.abc import Sequence
from typing import NamedTuple

from brownpipe.engines import Engine, forecast
from brownpipe.formatting import in_bytes, in_time
from brownpipe.scene import Scene
from brownpipe.study.study import Study


class EngineWorkload(NamedTuple):
    """The runs of one engine in a study: every seed of every case."""

    engine: Engine
    seeds: Sequence[int]
    cases: list[Scene]
    seconds: float  # of CPU, with starting the processes
    size: float  # bytes of trajectory files


def workloads(study: Study) -> list[EngineWorkload]:
    """Return the workload of each entry of the study's `engines`. The study's seeds must be known."""
    return [_workload(study, use.engine, use.seeds or study.seeds, study.cases_of(use)) for use in study.engine_uses]


def _workload(study: Study, engine: Engine, seeds: Sequence[int], cases: list[Scene]) -> EngineWorkload:
    costs = [engine.forecast(case, *recording_of(study)) for case in cases]
    jobs = len(study.batches_of(seeds))
    seconds = sum(jobs * (forecast.START_UP + cost.once) + len(seeds) * cost.seconds for cost in costs)
    size = len(seeds) * sum(forecast.of_run(case, *recording_of(study)).recorded for case in cases)
    return EngineWorkload(engine, seeds, cases, seconds, size)


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
