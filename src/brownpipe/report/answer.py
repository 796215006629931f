"""The answer of a dataset in sentences, for readers who do not know its quantities: how far the
tracer has moved, and whether that is diffusion; of a trade-off, which engine pays for which CPU
time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis import diffusive
from brownpipe.analysis.variables import average_of
from brownpipe.figures.cases import (
    at_equal_steps,
    cases_of,
    component_of,
    diffusion_name,
    drifts,
    estimate_of,
    fits_of,
    labels_in_words,
    motions_of,
    one_count,
    plus_minus,
    title_of,
    with_value,
)
from brownpipe.figures.marks import fall_found, is_lone, reasons_of_case
from brownpipe.figures.summary import time_shown
from brownpipe.figures.tradeoff import setting_of
from brownpipe.text import counted, in_time
from brownpipe.tradeoff import is_tradeoff
from brownpipe.tradeoff.front import Interval, pareto_front, possible_spans, setting_range

if TYPE_CHECKING:
    from xarray import Dataset

MOST_CASES = 2  # of a scene and an engine with sentences of their own
MOST_SCENES = 6  # with their engines
WHOLE_TRACER = "the tracer"  # `msd_of` of a dataset where no other disk is averaged


def answer_in_words(dataset: Dataset, particles: int | None = None) -> list[str]:
    """Return a paragraph for each case, which begins with its labels if there are several.

    Of a scene and an engine with many cases the first and the last have one, of many scenes the
    first; a line has the number of the others. None of cases without displacements.
    particles: of the cases with this many disks; by default each scene's largest number.
    """
    cases = cases_of(dataset)
    if is_tradeoff(dataset):
        return [*_tradeoffs_in_words(cases)]
    moving = with_value(one_count(cases, particles), "msd")
    shown: list[Dataset] = []
    for cases_of_scene in _by_labels(moving, "scene", "engine")[:MOST_SCENES]:
        shown += at_equal_steps(cases_of_scene, MOST_CASES)
    paragraphs = []
    for case in shown:
        text = " ".join([*_sentences_of(case, cases)])
        paragraphs.append(f"{title_of(case)}: {text}" if len(cases) > 1 else text)
    others = len(cases) - len(shown)
    if shown and others:
        paragraphs.append(f"The table has {counted(others, 'further case')}.")
    return paragraphs


def _by_labels(cases: Sequence[Dataset], *names: str) -> list[list[Dataset]]:
    """Group the cases that have the same labels of these names, in order of appearance."""
    groups: dict[str, list[Dataset]] = {}
    for case in cases:
        groups.setdefault(labels_in_words(case, names), []).append(case)
    return [*groups.values()]


def _sentences_of(case: Dataset, cases: Sequence[Dataset]) -> Iterator[str]:
    """Yield how far the tracer has moved, and its D or why there is none; where the motion along x
    and y differs, for each axis whose D is stated. `cases` are all that are tested with it.
    """
    for motion in motions_of(case):
        yield _distance_in_words(motion)
        fits = fits_of(motion)
        if fits:
            yield _diffusion_in_words(fits[0], cases)
    if drifts(case):
        yield "The runs are found not to be in equilibrium: the numbers are of a changing state."


def _distance_in_words(case: Dataset) -> str:
    """Return the root of the MSD, of motion along an axis of that along it, with its standard
    error, at the time of the summary.
    """
    last = case.isel(time=time_shown(case, "msd"))
    msd = float(last.msd)
    root = np.sqrt(msd)
    error = float(last.msd_standard_error) / (2 * root) if root > 0 else np.nan
    disk = WHOLE_TRACER if case.attrs.get("msd_of") == WHOLE_TRACER else "a disk like the tracer"
    time = float(last.time)
    unit = "time unit" if time == 1 else "time units"
    when = "Within" if average_of(case) == "origins" else "After"
    direction = _direction(case)
    distance = f"{plus_minus(root, error)}{direction}"
    return (
        f"{when} {time:g} {unit} {disk} has moved by {distance} on average "
        f"(root of the MSD{direction})."
    )


def _direction(motion: Dataset) -> str:
    """Return ` along x` or ` along y` of motion along one axis alone; "" of all motion."""
    axis = component_of(motion)
    return f" along {axis}" if axis else ""


def _diffusion_in_words(fit: Dataset, cases: Sequence[Dataset]) -> str:
    """Return D in a fit window, or what speaks against one."""
    mark = fit.diffusion_mark.item()
    window = f"between t = {float(fit.window_start):g} and {float(fit.window_end):g}"
    direction = _direction(fit)
    name = diffusion_name(fit)
    if not mark:
        estimate = estimate_of(fit, "diffusion_coefficient")
        coefficient = f"{name} = {estimate} {window}"
        if fall_found(cases, fit) > 1:
            return f"Nothing found speaks against {coefficient}, but there are few runs to find it."
        return f"It diffuses{direction}: {coefficient}."
    reasons = reasons_of_case(fit, mark & ~diffusive.EARLY)
    if mark & diffusive.EARLY:
        forgets = f"until t = {float(fit.not_diffusive_before):.3g} (3/gamma)"
        end = "for good, as a lone disk" if is_lone(fit) else forgets
        reasons.insert(0, f"it remembers its initial velocity {end}")
    because = "; ".join(reasons)
    if mark == diffusive.UNTESTED:
        return f"Whether it diffuses{direction} {window} cannot be told from these runs: {because}."
    if mark & diffusive.EARLY and not is_lone(fit):
        return f"It is not yet diffusive{direction} {window}, and has no {name} there: {because}."
    return f"It is not diffusive{direction} {window}, and has no {name} there: {because}."


def _tradeoffs_in_words(cases: Sequence[Dataset]) -> Iterator[str]:
    """Yield for each scene and number of disks which engine has the smallest expected error of the
    MSD for which CPU time.
    """
    scenes = _by_labels(cases, "scene", "particles")
    for engines in scenes[:MOST_SCENES]:
        name = labels_in_words(engines[0], ("scene", "particles"))
        front = pareto_front([setting_of(case, careful=True) for case in engines])
        if not front:
            yield f"{name}: there are too few runs to tell which engine has the smallest error."
            continue
        ranges = [setting_range(case.engine.item(), case) for case in engines]
        answer = f"the expected error of the MSD is smallest {front_in_words(front)}"
        rivals = rivals_in_words(front, possible_spans(ranges))
        yield f"{name}: {answer}.{rivals}"
    if len(scenes) > MOST_SCENES:
        yield f"The table has {counted(len(scenes) - MOST_SCENES, 'further scene')}."


def front_in_words(front: Sequence[Interval]) -> str:
    """Return which setting of a Pareto front is the best for which CPU time."""
    if len(front) == 1:
        return f"with {front[0].label}, for any CPU time"
    limited = []
    for interval in front[:-1]:
        limited.append(f"with {interval.label} up to {in_time(interval.end)} of CPU")
    return f"{', '.join(limited)}, then with {front[-1].label}"


def rivals_in_words(front: Sequence[Interval], possible: Mapping[str, tuple[float, float]]) -> str:
    """Return a sentence, after a space, on settings that the runs do not tell apart from those of a
    Pareto front: others that may be the best, and those of the front that may be so for good; empty
    without any.

    possible: CPU times of settings, of `possible_spans`.
    """
    ends = {interval.label: interval.end for interval in front}
    rivals = [f"with {label}" for label in possible if label not in ends]
    for label, end in ends.items():
        _, last = possible.get(label, (0.0, 0.0))
        if last == np.inf > end:
            rivals.append(f"with {label} after {in_time(end)}, too")
    if not rivals:
        return ""
    return f" The runs do not tell whether it is smaller {', or '.join(rivals)}."
