"""Why a quarter of the slope of the MSD is no diffusion coefficient, in words: the lines below the
summary that explain its rings.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis import diffusive
from brownpipe.analysis.drift import in_percent
from brownpipe.analysis.goodness import change_found_with_power
from brownpipe.engines.friction import DECAY_TIMES
from brownpipe.figures.cases import (
    axis_of_diffusion,
    component_of,
    diffusion_name,
    has,
    motions_of,
    scene_of,
)
from brownpipe.text import counted

if TYPE_CHECKING:
    from xarray import Dataset

LINE = 100  # characters of a line of words
POWER = 0.9


class Reason(NamedTuple):
    """A reason of `diffusive.REASONS` in words: what holds, in numbers of a case in one window, and
    what is needed.
    """

    statement: str
    number: Callable[[Dataset], str]
    size: Callable[[Dataset], float]  # by which the worst case is found
    cure: Callable[[Dataset], str]


def _change(fit: Dataset) -> str:
    share = float(fit.slope_change / abs(fit.slope))
    error = float(fit.slope_change_standard_error / abs(fit.slope))
    return f"by {in_percent(share, error)}"


def _of_limit(fit: Dataset) -> str:
    at_end = np.interp(float(fit.window_end), fit.time, fit.msd)
    reduction = 100 * float(fit.wall_reduction)
    return f"by {reduction:.0f} % where the MSD is {at_end:.3g} of at most {fit.msd_limit:.3g}"


def is_lone(fit: Dataset) -> bool:
    """Return whether a case has a single disk, which never forgets its velocity."""
    return float(fit.not_diffusive_before) == np.inf


def _decay(fit: Dataset) -> str:
    return "infinite for a lone disk" if is_lone(fit) else f"{fit.not_diffusive_before:.3g}"


def _cure_of_early(fit: Dataset) -> str:
    return "other disks" if is_lone(fit) else "a later window, or longer runs"


def _cure_of_untested(fit: Dataset) -> str:
    if int(fit.runs) < diffusive.FEWEST_RUNS:
        return f"more runs ({diffusive.FEWEST_RUNS} at least)"
    if not has(fit, "slope_change_p_value"):
        return "three samples in the window, and runs that differ"
    return "more runs"


WORDS = {
    diffusive.EARLY: Reason(
        f"the window begins before {DECAY_TIMES:g}/gamma of the tracer",
        _decay,
        lambda fit: float(fit.not_diffusive_before),
        _cure_of_early,
    ),
    diffusive.CHANGES: Reason(
        "the slope changes from its first half to its second",
        _change,
        lambda fit: float(abs(fit.slope_change / fit.slope)),
        lambda fit: "a later window, or longer runs, if there is a D",
    ),
    diffusive.PLATEAU: Reason(
        "the MSD hardly grows at its end",
        lambda fit: f"as t^{fit.growth_exponent:.2g}",
        lambda fit: -float(fit.growth_exponent),
        lambda fit: "longer runs, if it leaves its place at all",
    ),
    diffusive.WALLS: Reason(
        "walls reduce the slope at its end",
        _of_limit,
        lambda fit: float(fit.wall_reduction),
        lambda fit: "an earlier window, or a larger box",
    ),
    diffusive.DRIFT: Reason(
        "all disks drift together",
        lambda fit: f"which adds {fit.window_drift_diffusion:.2g} to D",
        lambda fit: float(fit.window_drift_diffusion),
        lambda fit: "velocities without total momentum, `zero_momentum: true`",
    ),
    diffusive.UNTESTED: Reason(
        "the runs do not tell the slope from zero, or whether it is constant",
        lambda fit: counted(int(fit.runs), "run"),
        lambda fit: -float(fit.runs),
        _cure_of_untested,
    ),
}


def reasons_of_case(fit: Dataset, bits: int) -> list[str]:
    """Return reasons against the D of a case in one fit window in words, those with these bits."""
    return [
        f"{reason.statement}, {reason.number(fit)}" for bit, reason in WORDS.items() if bits & bit
    ]


def reasons_in_words(cases: Sequence[Dataset]) -> Iterator[str]:
    """Yield lines that say why D in the first fit window is marked, with the worst case of each
    reason and what to do about it; none without a mark.

        ° D over [0.1, 1] is not that of diffusion, or not yet:
        - the window begins before 3/gamma of the tracer in 8 of 8 fits, 1.48 for ..., N = 50;
          needed: a later window, or longer runs.
    """
    fits = [fit for fit in _first_fits(cases) if has(fit, "diffusion_coefficient")]
    names = dict.fromkeys(diffusion_name(fit) for fit in fits if fit.diffusion_mark.item())
    if not names:
        return
    name = " or ".join(names)
    yield f"° {name} over {fits[0].window.item()} is not that of diffusion, or not yet:"
    for bit, reason in WORDS.items():
        marked = [fit for fit in fits if fit.diffusion_mark.item() & bit]
        if not marked:
            continue
        worst = max(marked, key=reason.size)
        share = f" in {len(marked)} of {len(fits)} fits" if len(fits) > 1 else ""
        title = _title_of_fit(worst)
        statement = f"{reason.statement}{share}, {reason.number(worst)} for {title}"
        text = f"- {statement}; needed: {reason.cure(worst)}."
        yield from textwrap.wrap(text, LINE, subsequent_indent="  ")


def _first_fits(cases: Sequence[Dataset]) -> list[Dataset]:
    """Return the motions of cases (`cases.motions_of`) in their first fit windows."""
    fits: list[Dataset] = []
    for case in cases:
        fits += [motion.isel(window=0) for motion in motions_of(case)]
    return fits


def _title_of_fit(fit: Dataset) -> str:
    """Return scene and number of disks of a fit, and the axis along which it is, if it is along
    one.
    """
    title = f"{scene_of(fit)}, N = {fit.particles.item()}"
    axis = component_of(fit)
    return f"{title}, along {axis}" if axis else title


def power_in_words(cases: Sequence[Dataset]) -> Iterator[str]:
    """Yield what a D without a mark means: level and power of the test for a change of the
    slope.
    """
    fits = _first_fits(cases)
    plain = [fit for fit in fits if has(fit, "slope") and not fit.diffusion_mark.item()]
    if not plain:
        return
    falls = []
    families = []
    for fit in plain:
        falls.append(fall_found(cases, fit))
        families.append(counted(_tests_in_family(cases, fit), "test"))
    names = " or ".join(dict.fromkeys(map(diffusion_name, plain)))
    limits = (
        f"fall by more than {diffusive.SMALL_FALL:.0%}, or to grow by more than "
        f"{diffusive.SMALL_GROWTH:.0%}, from the first half of the window to the second"
    )
    in_families = " or ".join(dict.fromkeys(families))
    level_in_words = f"a level of {diffusive.LEVEL:.0%} for {in_families} (Holm)"
    unseen = sum(fall > 1 for fall in falls)
    power = f"{POWER:.0%} of falls by {100 * max(falls):.0f} % are found"
    if unseen:
        power = f"too few runs to find even a fall to zero in {unseen} of {len(falls)}"
    text = f"{names} without °: the slope is not found to {limits}, at {level_in_words}; {power}."
    yield from textwrap.wrap(text, LINE)


def fall_found(cases: Sequence[Dataset], fit: Dataset) -> float:
    """Return the fall of the slope in a fit window, from its first half to its second, that is
    found with a probability of POWER: above 1 if not even a fall to zero is.

    cases: all that are tested with the fit.
    """
    error = (fit.slope_change_standard_error / abs(fit.slope)).values
    level = diffusive.LEVEL / _tests_in_family(cases, fit)
    beyond = change_found_with_power(error, int(fit.runs), level, POWER)
    return diffusive.SMALL_FALL + float(beyond)


def _tests_in_family(cases: Sequence[Dataset], fit: Dataset) -> int:
    """Return the number of tests for a change of the slope that are one family with that of a fit:
    of all motion, or along x and y.
    """
    name = "slope_change_p_value"
    if axis_of_diffusion(fit):
        name = f"component_{name}"
    return sum(int(case[name].notnull().sum()) for case in cases)
