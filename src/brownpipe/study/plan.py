"""`brownpipe plan`: the engine and number of runs that meet a tolerance or fit a budget, from pilot runs.

An engine is excluded if a run costs at least as much as an exact one, or if its bias, with the standard error of that,
is as large as the tolerance. At equal cost, within EQUAL, the exact engine is preferred.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from brownpipe.engines import DEFINITIONS, Engine, configured
from brownpipe.errors import RequestError
from brownpipe.formatting import in_bytes, in_time
from brownpipe.quoting import in_lines
from brownpipe.scene import Scene
from brownpipe.scene.seeds import MOST_SEEDS
from brownpipe.stages import tracked
from brownpipe.study.batches import automatic_batches
from brownpipe.study.run_count import DISTRIBUTION, average_of_msd, case_title, run_pilot
from brownpipe.study.study import REFERENCE, Study
from brownpipe.study.workload import seconds_of_jobs
from brownpipe.tradeoff import FEWEST_RUNS, compare, runs_for, timing

NAMES = {
    "msd": "MSD at the end",
    "d": "D in the first fit window",
    DISTRIBUTION: "displacement distribution at the end",
}
VARIABLES = {  # of `tradeoff.compare`: bias, its standard error or noise, spread of a run
    "msd": ("msd_bias", "msd_bias_standard_error", "msd_spread"),
    "d": ("d_bias", "d_bias_standard_error", "d_spread"),
    DISTRIBUTION: ("displacement_bias", "displacement_bias_noise", "displacement_spread"),
}
TIMING_REPEATS = 3
EQUAL = 0.1  # relative difference of costs, or of errors


class Performance(NamedTuple):
    """Errors of the target by an engine in a case, relative to the exact mean, and the cost of a run."""

    scene: Scene
    engine: Engine
    bias: float  # 0 for the exact engine; NaN if it was not compared, as it costs more
    bias_error: float  # standard error of the bias
    scatter: float  # standard deviation over runs
    seconds: float  # of CPU for one run
    share_sound: float = 1.0  # of runs that do not fail

    @property
    def bias_square(self) -> float:
        """The squared bias that enters the total error, with the variance of its estimate."""
        return self.bias**2 + self.bias_error**2


class Offer(NamedTuple):
    """A number of runs of one engine in each of some cases."""

    engine: Engine
    runs: int  # of each case
    error: float  # expected total error, relative: the largest of the cases
    seconds: float  # of CPU, with starting the processes
    size: float  # bytes of files
    failing: int = 0  # of these runs of a case, that are expected to fail


def performance_of(study: Study, target: str) -> list[list[Performance]]:
    """Return, for each case, the exact engine and the candidates by pilot runs; one that costs more is not compared."""
    window = study.fit_windows[0]
    average = "runs" if target == DISTRIBUTION else average_of_msd(study)
    return [_by_pilots(scene, target, window, average) for scene in tracked(study.cases, "cases")]


def _by_pilots(scene: Scene, target: str, window: tuple[float, float], average: str) -> list[Performance]:
    found: list[Performance] = []
    for engine in tracked([REFERENCE, *candidates(scene)], "engines"):
        seconds = timing.seconds_per_run(engine, scene, TIMING_REPEATS)
        if found and seconds >= found[0].seconds:
            found.append(Performance(scene, engine, np.nan, np.nan, np.nan, seconds))
            continue
        runs = run_pilot(scene, engine, average)
        if engine == REFERENCE:  # the first
            exact = runs
        values = compare(runs, exact, window, seconds)
        bias, error, scatter = (float(values[name]) for name in VARIABLES[target])
        found.append(Performance(scene, engine, bias, error, scatter, seconds, runs.share_sound))
    return found


def candidates(scene: Scene) -> list[Engine]:
    """Return the approximate engines, with settings, that are worth a pilot and fit for the scene."""
    engines = []
    for name, definition in DEFINITIONS.items():
        for settings in definition.candidates(scene) if definition is not REFERENCE.definition else ():
            with suppress(RequestError):
                engine = configured(name, **settings)
                engine.refuse_unfit(scene)
                engines.append(engine)
    return engines


def offers(cases: Sequence[Sequence[Performance]], tolerance: float | None, budget: float | None) -> list[Offer]:
    """Return the offers that meet the tolerance in all cases within the budget (CPU seconds), the cheapest first.

    Without a tolerance: one offer for each engine that spends the budget, the most accurate first. An engine that was
    not compared in a case, or costs at least as much as the exact one in all cases together, offers nothing.
    """
    made = []
    exact_seconds = sum(case[0].seconds for case in cases)
    for engine in [performance.engine for performance in cases[0]]:
        performances = [each for case in cases for each in case if each.engine == engine]
        is_compared = len(performances) == len(cases) and not any(np.isnan(each.bias) for each in performances)
        if not is_compared or (engine != REFERENCE and sum(each.seconds for each in performances) >= exact_seconds):
            continue
        runs = _runs_for_tolerance(performances, tolerance) if tolerance else _runs_for_budget(performances, budget)
        offer = _offer(engine, performances, runs) if runs else None
        if offer is not None and (tolerance is None or budget is None or offer.seconds <= budget):
            made.append(offer)

    def rank(offer: Offer) -> float:
        return (offer.seconds if tolerance else offer.error) * (1.0 - EQUAL if offer.engine == REFERENCE else 1.0)

    return sorted(made, key=rank)


def _offer(engine: Engine, performances: Sequence[Performance], runs: int) -> Offer:
    """Return the error and cost of so many runs of an engine in each case, in jobs as of `batch: auto`."""
    seconds, size = 0.0, 0.0
    for each in performances:
        cost = engine.forecast(each.scene)._replace(seconds=each.seconds)
        seconds += seconds_of_jobs(cost, runs, len(automatic_batches(range(runs), engine.forecast(each.scene))))
        size += runs * cost.recorded
    error = max(float(np.sqrt(each.bias_square + each.scatter**2 / (runs * each.share_sound))) for each in performances)
    failing = round(runs * (1.0 - min(each.share_sound for each in performances)))
    return Offer(engine, runs, error, seconds, size, failing)


def _runs_for_tolerance(performances: Sequence[Performance], tolerance: float) -> int | None:
    """Return the runs, failing ones included, that the most demanding case needs; None for a bias too large."""
    needed = [runs_for(tolerance, each.bias_square, each.scatter, each.share_sound) for each in performances]
    return None if None in needed or max(needed) > MOST_SEEDS else max(needed)


def _runs_for_budget(performances: Sequence[Performance], budget: float) -> int | None:
    """Return the runs of each case that the budget pays for; None if fewer than FEWEST_RUNS of them do not fail."""
    runs = MOST_SEEDS
    while runs and (spent := _offer(performances[0].engine, performances, runs).seconds) > budget:
        runs = min(runs - 1, int(runs * budget / spent))
    return runs if runs * min(each.share_sound for each in performances) >= FEWEST_RUNS else None


def recommendation(
    cases: Sequence[Sequence[Performance]], target: str, tolerance: float | None, budget: float | None
) -> str:
    """Return the best engine, the runner-up and the excluded engines for each case, then one engine for all cases."""
    limits = [f"to {_percent(tolerance)}"] if tolerance is not None else []
    limits += [f"within {in_time(budget)} of CPU"] if budget is not None else []
    lines = []
    for case in cases:
        lines.append(f"{case_title(case[0].scene)}: {NAMES[target]} {' '.join(limits)}, from pilot runs")
        lines += _choice([case], tolerance, budget / len(cases) if budget is not None else None)
        lines += _excluded(case, tolerance)
    if len(cases) > 1:
        lines += ["the same engine in all cases", *_choice(cases, tolerance, budget)]
    return in_lines(lines)


def _choice(cases: Sequence[Sequence[Performance]], tolerance: float | None, budget: float | None) -> list[str]:
    """Return the best two offers; if there is none, that fact and the most accurate offer within the budget."""
    made = offers(cases, tolerance, budget)
    if made:
        return [f"  {rank:<9}  {_in_words(offer)}" for rank, offer in zip(("use", "runner-up"), made, strict=False)]
    lines = ["  cannot be met" + (f" within {in_time(budget)} of CPU" if budget is not None else "")]
    if tolerance is not None and budget is not None:
        lines += [f"  instead    {_in_words(offer)}" for offer in offers(cases, None, budget)[:1]]
    return lines


def _in_words(offer: Offer) -> str:
    """Return runs, error and cost of an offer."""
    failing = f", of which some {offer.failing:,} fail" if offer.failing else ""
    runs = f"{offer.engine.label}: {offer.runs:,} runs{failing}, error {_percent(offer.error)}"
    return f"{runs}; {in_time(offer.seconds)} of CPU, {in_bytes(offer.size)} of files"


def _excluded(case: Sequence[Performance], tolerance: float | None) -> list[str]:
    """Return the engines that cost more than the exact one, and those whose bias alone may exceed the tolerance."""
    lines = []
    for each in case[1:]:
        if each.seconds >= case[0].seconds:
            ratio = f"{each.seconds / case[0].seconds:.2g}"
            lines.append(f"  no         {each.engine.label}: a run costs {ratio} times as much as an exact one")
        elif tolerance is not None and each.bias_square >= tolerance**2:
            known = f"known to {_percent(each.bias_error)}"
            lines.append(f"  no         {each.engine.label}: its bias is {_percent(each.bias)}, {known}")
    return lines


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
