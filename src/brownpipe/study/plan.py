"""The report of `brownpipe plan`: engine and number of runs to use, the runner-up, and why others are excluded.

An engine is excluded if a run costs at least as much as an exact one, or if its bias, or the standard error of an
unresolved bias, is at least as large as the tolerance.
"""

from brownpipe.formatting import in_bytes, in_time
from brownpipe.quoting import in_lines
from brownpipe.scene.reading import Entry
from brownpipe.study.offers import Offer, cores, offers
from brownpipe.study.performance import CasePerformance, EnginePerformance
from brownpipe.study.run_count import case_title
from brownpipe.study.study import REFERENCE
from brownpipe.study.study_file import read_tolerance

NAMES = {
    "msd": "MSD at the end",
    "d": "D in the first fit window",
    "displacement_distribution": "displacement distribution at the end",
}
RESOLVED = 2.0  # standard errors


def tolerance_of(text: str) -> float:
    """Return the tolerance of a command line, 2% or 0.02. Raises RequestError."""
    try:
        value: float | str = float(text)
    except ValueError:
        value = text
    return read_tolerance(Entry(value, "", ("--tolerance",)))


def recommendation(cases: list[CasePerformance], target: str, tolerance: float | None, budget: float | None) -> str:
    """Return the best engine, the runner-up and the excluded engines for each case, then one engine for all cases."""
    limits = [f"to {_percent(tolerance)}"] if tolerance is not None else []
    limits += [f"within {in_time(budget)} of CPU"] if budget is not None else []
    lines = []
    for case in cases:
        lines.append(f"{case_title(case.scene)}: {NAMES[target]} {' '.join(limits)}, from {case.source}")
        lines += _choice([case], tolerance, budget / len(cases) if budget is not None else None)
        lines += _excluded(case, tolerance)
    if len(cases) > 1:
        lines += ["the same engine in all cases", *_choice(cases, tolerance, budget)]
    return in_lines(lines)


def _choice(cases: list[CasePerformance], tolerance: float | None, budget: float | None) -> list[str]:
    """Return the best two offers; if there is none, that fact and the most accurate offer within the budget."""
    made = offers(cases, tolerance, budget)
    if made:
        return [f"  {rank:<9}  {_offer(offer)}" for rank, offer in zip(("use", "runner-up"), made, strict=False)]
    lines = ["  cannot be met" + (f" within {in_time(budget)} of CPU" if budget is not None else "")]
    if tolerance is not None and budget is not None:
        lines += [f"  instead    {_offer(offer)}" for offer in offers(cases, None, budget)[:1]]
    return lines


def _offer(offer: Offer) -> str:
    """Return runs, error and cost of an offer."""
    failing = f", of which some {offer.failing:,} fail" if offer.failing else ""
    runs = f"{offer.engine.label}: {offer.runs:,} runs{failing}, error {_percent(offer.error)}"
    wall = f"{in_time(offer.wall_seconds)} on {cores()} cores"
    return f"{runs}; {in_time(offer.seconds)} of CPU, {wall}, {in_bytes(offer.size)} of files"


def _excluded(case: CasePerformance, tolerance: float | None) -> list[str]:
    """Return the engines that cost more than the exact one, and those whose bias alone may exceed the tolerance."""
    lines, exact = [], case.engines[REFERENCE]
    for performance in case.engines.values():
        label = performance.engine.label
        if performance.seconds >= exact.seconds and performance is not exact:
            ratio = f"{performance.seconds / exact.seconds:.2g}"
            lines.append(f"  no         {label}: a run costs {ratio} times as much as an exact one")
        elif tolerance is not None and performance.bias_square >= tolerance**2:
            lines.append(f"  no         {label}: {_bias(performance)}")
    return lines


def _bias(performance: EnginePerformance) -> str:
    """Return the bias of an engine, or that it is not resolved, with its standard error."""
    if abs(performance.bias) > RESOLVED * performance.bias_error:
        return f"its bias is {_percent(performance.bias)}, with a standard error of {_percent(performance.bias_error)}"
    return f"its bias is not resolved, with a standard error of {_percent(performance.bias_error)}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
