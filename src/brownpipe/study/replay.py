"""The run of a study that can be replayed in its pages: recorded once more, with all disks and collisions."""

from dataclasses import replace

from brownpipe.engines import forecast
from brownpipe.study.study import REFERENCE, SimulationJob, Study

MOST_DISKS = 500
MOST_COLLISIONS = 3000  # expected in the run: its page, `figures.replay`, takes less than 100 kB


def replay_jobs(study: Study) -> list[SimulationJob]:
    """Return the first run of the case that a study shows first, as a list of one job.

    The list is empty if the exact engine does not run this case or has no seeds yet, and for a case without disks, with
    more than MOST_DISKS or with more than MOST_COLLISIONS.
    """
    case = study.cases[0]
    uses = [use for use in study.engine_uses if use.engine == REFERENCE and case.name in use.scenes]
    seeds = [seed for use in uses for seed in (use.seeds or study.seeds)[:1]]
    if not seeds or not 0 < case.particles <= MOST_DISKS or _collisions(study) > MOST_COLLISIONS:
        return []
    return [SimulationJob(case.name, case.particles, REFERENCE.label, seeds[0], seeds[0])]


def _collisions(study: Study) -> float:
    """Return the expected number of collisions in a run of the case shown first, once it is equilibrated."""
    cost = forecast.of_run(replace(study.cases[0], equilibrate=0.0))
    return cost.pair_collisions + cost.wall_collisions
