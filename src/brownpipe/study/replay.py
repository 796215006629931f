"""The run of a study that can be replayed in its pages: recorded once more, with all disks and collisions."""

from dataclasses import replace

from brownpipe.engines import forecast
from brownpipe.figures.cases import shown_count
from brownpipe.scene import Scene
from brownpipe.storage import Expected
from brownpipe.study.study import REFERENCE, SimulationJob, Study

MOST_DISKS = 500
RECORD = frozenset(("tracer", "all", "events"))
MOST_COLLISIONS = 3000  # expected in the run, so that all fit into a page in single precision (`figures.replay`)
MOST_POSITIONS = 1_000_000  # disks times samples, all of which are recorded: 32 MB
LONGEST = 10.0  # CPU seconds expected, most of which can only be the equilibration


def replay_jobs(study: Study) -> list[SimulationJob]:
    """Return the first run of the case that a study shows first, as a list of one job.

    The list is empty if the exact engine does not run this case or has no seeds yet, if the case has no disks, or if
    its disks, collisions, samples or CPU time exceed the constants above.
    """
    in_scene = {case.particles: case for case in study.cases if case.name == study.cases[0].name}
    case = in_scene[shown_count([*in_scene])]
    uses = [use for use in study.engine_uses if use.engine == REFERENCE and case.name in use.scenes]
    seeds = [seed for use in uses for seed in (use.seeds or study.seeds)[:1]]
    if not seeds or not 0 < case.particles <= MOST_DISKS or not _is_short(case):
        return []
    return [SimulationJob(case.name, case.particles, REFERENCE.label, seeds[0], seeds[0])]


def replay_files(study: Study) -> list[Expected]:
    """Return the trajectory file of `replay_jobs`, relative to the working directory, with the run it is to hold."""
    requests = [(job.file, study.request_of(job)) for job in replay_jobs(study)]
    return [
        Expected(f"results/{study.name}/replay/{file}", request._replace(record=RECORD, observables=(), average="runs"))
        for file, request in requests
    ]


def _is_short(case: Scene) -> bool:
    """Whether a run of a case is expected to be short enough to be made again, and its replay small enough."""
    shown = forecast.of_run(replace(case, equilibrate=0.0))
    is_small = shown.pair_collisions + shown.wall_collisions <= MOST_COLLISIONS
    return is_small and case.particles * len(case.times) <= MOST_POSITIONS and forecast.of_run(case).seconds <= LONGEST
