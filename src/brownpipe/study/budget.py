"""The runs that a CPU time pays, and the errors that they should have: `brownpipe plan --budget`.

The runs are those of a study with one of the engines, as many in each of its cases, in one job
each. Errors follow from the spread over pilot runs, as the number of runs for a tolerance does: a
tolerance that is one of these errors needs these runs.
"""

import math
import re
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import BeforeValidator

from brownpipe.engines import Engine, forecast
from brownpipe.errors import RequestError
from brownpipe.figures.cases import aligned
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.reading import refuse
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.study.plan import (
    Offer,
    Pilot,
    drifts_of,
    percent,
    pilots_of,
    precisions_of,
    tells_from_zero,
)
from brownpipe.study.run_sets import seconds_of_jobs
from brownpipe.study.study import REFERENCE, Study
from brownpipe.text import in_lines, in_time

TIME = re.compile(r"(\d+\.?\d*|\.\d+) ?(s|min|h)", re.ASCII)
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def _seconds(value: object) -> float:
    """Return the seconds of a CPU time with its unit: 300 for 5min, 7200 for 2h."""
    match = TIME.fullmatch(str(value))
    seconds = float(match[1]) * SECONDS[match[2]] if match else 0.0
    if not 0.0 < seconds < math.inf:
        refuse(f"must be a CPU time above zero, such as 60s, 5min or 2h, not {value!r:.80}")
    return seconds


Budget = Annotated[float, BeforeValidator(_seconds)]  # CPU time [s]


# -- the runs


def affordable_runs(budget: float, costs: Sequence[forecast.Cost]) -> int:
    """Return how many runs in each of some cases a CPU time [s] pays, at most MOST_SEEDS.

    costs: of one run of each case.
    """
    start = sum(seconds_of_jobs(cost, 0) for cost in costs)
    seconds = sum(cost.seconds for cost in costs)
    runs = min((budget - start) / seconds, MOST_SEEDS)
    return max(0, math.floor(runs))


def paid_offers(study: Study, budget: float) -> list[Offer]:
    """Return the runs in each of its cases that a CPU time [s] pays, for every engine of a study.

    Raises RequestError if it pays no run of each case by any engine.
    """
    offers: list[Offer] = []
    least: dict[Engine, float] = {}  # CPU seconds of one run of each case
    for engine in dict.fromkeys(use.engine for use in study.uses):
        cases = [use.case for use in study.uses if use.engine == engine]
        costs = [engine.forecast(case, *study.recording) for case in cases]
        runs = affordable_runs(budget, costs)
        offers.append(Offer(engine, runs, sum(seconds_of_jobs(cost, runs) for cost in costs)))
        least[engine] = sum(seconds_of_jobs(cost, 1) for cost in costs)
    if not any(offer.runs for offer in offers):
        cheapest = min(least, key=least.__getitem__)
        smallest = math.ceil(10 * least[cheapest]) / 10
        raise RequestError(
            f"--budget: {in_time(budget)} of CPU do not pay one run of each case; must be at least "
            f"{smallest}s ({cheapest.label})"
        )
    return offers


# -- their errors


class PaidRuns(NamedTuple):
    """Runs of an engine in a case that the budget pays."""

    scene: Scene
    offer: Offer
    seconds: float  # of CPU, of one run
    # relative errors, with bias, by target; NaN for a D that the pilot runs do not tell from zero,
    # and where walls make the motion along x and y differ
    errors: dict[str, float]


def errors_within(
    study: Study, offers: Sequence[Offer], target: str
) -> tuple[list[PaidRuns], list[Pilot]]:
    """Return the runs of offers of at least one run in each case, with the errors of the MSD at the
    end, of D in the first fit window and of the target; and the pilot runs.
    """
    by_engine = {offer.engine: offer for offer in offers if offer.runs}
    affordable = [use for use in study.uses if use.engine in by_engine]
    affordable_study = study.with_uses(affordable)
    targets = [*dict.fromkeys(["msd", "d", target])]
    window = study.fit_windows[0]
    paid: list[PaidRuns] = []
    all_pilots: list[Pilot] = []
    for case in tracked(dict.fromkeys(use.case for use in affordable), "cases"):
        pilots = pilots_of(affordable_study, case, target)
        exact = pilots[REFERENCE]
        has_d = tells_from_zero(exact.runs, window) and not case.box.axes_differ
        for engine in affordable_study.engines_of(case):
            pilot = pilots[engine]
            runs = by_engine[engine].runs
            precisions = precisions_of(pilot, exact, window, targets)
            errors = {name: precisions[name].error_of(runs) for name in targets}
            if not has_d:
                errors["d"] = math.nan
            paid.append(PaidRuns(case, by_engine[engine], pilot.cost.seconds, errors))
        all_pilots += pilots.values()
    return paid, all_pilots


def best_offer(study: Study, paid: Sequence[PaidRuns], target: str) -> Offer | None:
    """Return the offer with the smallest error of a target, the largest of its cases; None if no
    engine is for all cases, or the error is not known in one of them.
    """
    largest: dict[Offer, float] = {}
    for offer in dict.fromkeys(runs.offer for runs in paid):
        errors = [runs.errors[target] for runs in paid if runs.offer == offer]
        if len(errors) == len(study.cases) and all(map(math.isfinite, errors)):
            largest[offer] = max(errors)
    return min(largest, key=largest.__getitem__, default=None)


def describe_budget(
    study: Study,
    budget: float,
    offers: Sequence[Offer],
    paid: Sequence[PaidRuns],
    pilots: Sequence[Pilot],
    target: str,
) -> str:
    """Return a table of the runs that a CPU time [s] pays and of their errors, whether pilot runs
    drift, and the best offer.
    """
    targets = [*paid[0].errors]
    table = [["case"], ["engine"], ["CPU of a run"], ["runs"]]
    table += [[f"error of {name}"] for name in targets]
    for runs in paid:
        row = [runs.scene.title, runs.offer.engine.label, in_time(runs.seconds)]
        row.append(f"{runs.offer.runs:,}")
        row += [_error_in_words(runs, name) for name in targets]
        for column, cell in zip(table, row, strict=True):
            column.append(cell)
    lines = aligned(table)
    lines += drifts_of(pilots)
    start, end = study.fit_windows[0]
    lines.append(f"msd: at the end; d: in the window [{start:g}, {end:g}]")
    lines.append(f"{in_time(budget)} of CPU for all cases of an engine:")
    for offer in offers:
        if not offer.runs:
            lines.append(f"{offer.engine.label}: not one run of each case")
        if offer.runs == MOST_SEEDS:
            most = f"{MOST_SEEDS:,} runs"
            lines.append(f"{offer.engine.label}: {most} in each case are the most of a study")
    best = best_offer(study, paid, target)
    if best is None:
        lines.append(f"no engine with an error of {target} in all cases")
    else:
        workload = f"{best.engine.label}: {best.runs:,} runs in each case"
        lines.append(f"use {workload}; {in_time(best.seconds)} of CPU")
    return in_lines(lines)


def _error_in_words(runs: PaidRuns, target: str) -> str:
    """Return an error, or why there is none."""
    error = runs.errors[target]
    if not math.isnan(error):
        return percent(error)
    if runs.scene.box.is_channel:
        return "not planned in channels"
    if runs.scene.box.axes_differ:
        return "not planned for walls of unequal lengths"
    return "not told from zero"
