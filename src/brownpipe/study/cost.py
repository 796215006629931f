"""What the jobs of a study take, from the forecast of one run (`Engine.forecast`), and what they ask a cluster for.

The forecast is good to a factor of 2. Snakemake passes requests on to the queue of a cluster, which ends jobs that
exceed them; on one machine they have no effect.
"""

import math
from collections.abc import Callable, Mapping

from brownpipe.engines import forecast
from brownpipe.engines.saturation import share_failing
from brownpipe.formatting import counted, in_bytes, in_time
from brownpipe.scene import Scene
from brownpipe.study.run_sets import run_sets
from brownpipe.study.study import REFERENCE, Study

MARGIN = 2.0  # of memory and time in requests
AROUND = 300e6  # further bytes: two processes of Snakemake wait on the node for that of the job
DELAY = 300.0  # further seconds: to compile kernels, to start an analysis, to wait for a network file system
ANALYSIS = 300e6  # bytes of a process that analyses or draws, besides data
REPLICATES = 10_000  # of one run's data in memory, to average over the runs of a case
COPIES = 5  # of a file in memory while it is read; in the trade-off of all files
SECONDS_PER_CASE, SECONDS_PER_BYTE = 1.0, 1e-7  # CPU, to analyse
RUNS_TIMED = 30  # of each engine and case in the trade-off
PILOT_SECONDS = 4.0  # CPU time of a pilot, as forecast
FEWEST_PILOT_RUNS, MOST_PILOT_RUNS = 10, 400
Need = tuple[float, float]  # bytes of memory, CPU seconds


def seconds_of_jobs(cost: forecast.Cost, runs: int, jobs: int = 1) -> float:
    """Return the CPU seconds of so many processes that make and write so many runs together."""
    return jobs * (forecast.START_UP + cost.once) + runs * (cost.seconds + cost.storing)


def pilot_runs(scene: Scene, cost: forecast.Cost) -> int:
    """Return the number of pilot runs of a scene; of failing ones it is larger, as they take no time."""
    seconds = cost.seconds - forecast.SECONDS_TO_FAIL * share_failing(scene)
    return int(min(max(PILOT_SECONDS / seconds, FEWEST_PILOT_RUNS), MOST_PILOT_RUNS))


def with_assumed_runs(study: Study) -> Study:
    """Return a study with a tolerance with the runs of a quantity whose standard deviation is its mean, as r^2 has it.

    One that has seeds is returned unchanged.
    """
    if study.tolerance is None or study.seeds:
        return study
    return study.model_copy(update={"seeds": range(math.ceil(study.tolerance**-2))})


def describe_workload(study: Study) -> str:
    """Return the workload of the whole study in one line. Its seeds must be known."""
    sets = run_sets(study)
    total = counted(sum(len(runs.seeds) for runs in sets), "run")
    jobs = [len(runs.jobs(runs.seeds)) for runs in sets]
    cpu = sum(seconds_of_jobs(runs.cost, len(runs.seeds), number) for runs, number in zip(sets, jobs, strict=True))
    size = in_bytes(sum(len(runs.seeds) * runs.cost.recorded for runs in sets))
    return f"{total} in {counted(sum(jobs), 'job')}: some {in_time(cpu)} of CPU, {size} of runs"


def requests(study: Study) -> dict[str, dict[str, object]]:
    """Return the `resources` of each rule: functions of wildcards and attempt, each twice as large."""
    costs = {runs.key: runs.cost for runs in run_sets(study)}
    sets = run_sets(with_assumed_runs(study))
    kept = [len(runs.seeds) * runs.cost.kept for runs in sets]
    files = [runs.most_seeds * runs.cost.kept for runs in sets]
    memory = ANALYSIS + REPLICATES * max(runs.cost.kept for runs in sets) + COPIES * max(files)
    seconds = SECONDS_PER_CASE * len(sets) + SECONDS_PER_BYTE * sum(kept)
    exact = [(case, REFERENCE.forecast(case, *study.recording)) for case in study.cases]
    timed = seconds + sum(5.0 + RUNS_TIMED * cost.seconds for cost in (*costs.values(), *(cost for _, cost in exact)))
    pilots = sum(seconds_of_jobs(cost, pilot_runs(case, cost)) for case, cost in exact)

    def of_simulate(wildcards: Mapping[str, str]) -> Need:
        cost, runs = costs[wildcards["digest"]], int(wildcards["last"]) - int(wildcards["first"]) + 1
        return forecast.memory(cost, runs), seconds_of_jobs(cost, runs)

    analysis = dict.fromkeys(("aggregate", "figures", "tradeoff_drawings"), _asked(lambda _: (memory, seconds)))
    plan, tradeoff = _asked(lambda _: (memory, pilots)), _asked(lambda _: (memory + COPIES * sum(kept), timed))
    return {"simulate": _asked(of_simulate), **analysis, "plan": plan, "tradeoff": tradeoff}


def _asked(need: Callable[[Mapping[str, str]], Need]) -> dict[str, object]:
    """Return the resources of a rule whose jobs have this need: memory [MB] and wall time [min]."""

    def request(part: int, more: float, unit: float) -> Callable[..., int]:
        return lambda wildcards, attempt: 2 ** (attempt - 1) * math.ceil((MARGIN * need(wildcards)[part] + more) / unit)

    return {"mem_mb": request(0, AROUND, 1e6), "runtime": request(1, DELAY, 60), "cpus_per_task": 1}
