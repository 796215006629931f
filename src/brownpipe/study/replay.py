"""The run of a study that can be replayed in its pages: recorded once more, with all disks and collisions."""

from dataclasses import replace

from brownpipe.engines import forecast
from brownpipe.figures.cases import shown_count
from brownpipe.scene import Scene
from brownpipe.storage import Expected
from brownpipe.study.study import REFERENCE, SimulationJob, Study

MOST_DISKS = 500
RECORD = frozenset(("tracer", "all", "events"))
MOST_COLLISIONS = 3000  # expected in the run: its page, `figures.replay`, takes less than 100 kB


def replay_jobs(study: Study) -> list[SimulationJob]:
    """Return the first run of the case that a study shows first, as a list of one job.

    The list is empty if the exact engine does not run this case or has no seeds yet, and for a case without disks, with
    more than MOST_DISKS or with more than MOST_COLLISIONS.
    """
    in_scene = {case.particles: case for case in study.cases if case.name == study.cases[0].name}
    case = in_scene[shown_count([*in_scene])]
    uses = [use for use in study.engine_uses if use.engine == REFERENCE and case.name in use.scenes]
    seeds = [seed for use in uses for seed in (use.seeds or study.seeds)[:1]]
    if not seeds or not 0 < case.particles <= MOST_DISKS or _collisions(case) > MOST_COLLISIONS:
        return []
    return [SimulationJob(case.name, case.particles, REFERENCE.label, seeds[0], seeds[0])]


def replay_files(study: Study) -> list[Expected]:
    """Return the trajectory file of `replay_jobs`, relative to the working directory, with the run it is to hold."""
    requests = [(job.file, study.request_of(job)) for job in replay_jobs(study)]
    return [
        Expected(f"results/{study.name}/replay/{file}", request._replace(record=RECORD, observables=(), average="runs"))
        for file, request in requests
    ]


def _collisions(case: Scene) -> float:
    """Return the expected number of collisions in a run of a case, once it is equilibrated."""
    cost = forecast.of_run(replace(case, equilibrate=0.0))
    return cost.pair_collisions + cost.wall_collisions
