"""What running a study will take."""

from collections.abc import Sequence

from brownpipe.engines import Engine, forecast
from brownpipe.formatting import in_bytes, in_time
from brownpipe.scene import Scene
from brownpipe.study.study import Study


def total(study: Study) -> str:
    """Return what running a study comes to, in one line. Its seeds must be known."""
    used, most, size = uses_of(study), 0, 0.0
    for _, seeds, cases in used:
        most = max(most, len(seeds))
        size += len(seeds) * sum(forecast.of_run(case, *kept_of(study)).recorded for case in cases)
    runs = sum(len(seeds) * len(cases) for _, seeds, cases in used)
    seconds = sum(seconds_of(study, *use) for use in used)
    jobs = f"{runs:,} runs in {len(study.jobs())} jobs of up to {min(study.batch, most):,} seeds"
    return f"{jobs}: some {in_time(seconds)} of CPU, {in_bytes(size)} in results/{study.name}"


def kept_of(study: Study) -> tuple:
    """What is kept and measured of each run."""
    return {study.record}, study.observables, study.average


def seconds_of(study: Study, engine: Engine, seeds: Sequence[int], cases: Sequence[Scene]) -> float:
    """The CPU time [s] of an engine's jobs."""
    takes, batches = [engine.forecast(case, *kept_of(study)) for case in cases], len(study.batches_of(seeds))
    return sum(batches * (forecast.START_UP + one.once) + len(seeds) * one.seconds for one in takes)


def uses_of(study: Study) -> list[tuple[Engine, Sequence[int], list[Scene]]]:
    """The engines, the seeds and the cases they are used for."""
    cases = {name: [case for case in study.cases if case.name == name] for name in study.table}
    return [
        (one.engine, one.seeds or study.seeds, [c for name in one.scenes for c in cases[name]]) for one in study.uses
    ]
