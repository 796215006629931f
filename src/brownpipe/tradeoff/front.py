"""Accuracy for a given CPU time: total error of every setting, and the Pareto front.

A setting with a bias b, whose runs spread by s and cost c seconds each, has after a CPU time T the
root mean square error sqrt(b^2 + s^2 c/T). All errors are relative to the exact value.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple, SupportsFloat

import numpy as np

from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.variables import names_of
from brownpipe.tradeoff import bias

if TYPE_CHECKING:
    from xarray import Dataset

FEWEST_RUNS = 10  # with fewer runs of a setting its total error is not stated


class MeasuredSetting(NamedTuple):
    """An engine with its settings in one scene."""

    label: str
    bias_square: float  # variance subtracted, `bias.square`
    # relative standard deviation of a run: the standard error of n runs is spread/sqrt(n)
    spread: float
    seconds: float  # CPU time of one run


class Interval(NamedTuple):
    """Between the CPU times start and end [s] this setting has the smallest total error."""

    label: str
    start: float
    end: float  # inf for the last


class SettingRange(NamedTuple):
    """A setting at both ends of what the runs tell of its bias and of its cost."""

    best: MeasuredSetting  # an unresolved bias is 0, the cost the lowest measured
    worst: MeasuredSetting  # an unresolved bias at its 95 % upper bound, the highest cost


def total_error(setting: MeasuredSetting, cpu_time: np.ndarray | float) -> np.ndarray:
    """Return the root mean square error after a CPU time [s]; NaN if that is less than FEWEST_RUNS
    runs take.
    """
    cpu_time = np.asarray(cpu_time, float)
    error = np.sqrt(setting.bias_square + setting.spread**2 * setting.seconds / cpu_time)
    return np.where(cpu_time >= FEWEST_RUNS * setting.seconds, error, np.nan)


def runs_for(
    tolerance: float,
    bias_square: float,
    spread: float,
    share_sound: float = 1.0,
    pilot: float = np.inf,
) -> int | None:
    """Return the number of runs whose total error is `tolerance`; None if the bias alone is too
    large.

    `share_sound` is the share of runs that do not fail; those expected to fail are added, if more
    than 0.001 of a run. The spread is that of `pilot` runs.
    """
    variance = tolerance**2 - bias_square
    if variance <= 0.0:
        return None
    needed = safe_spread(spread, pilot) ** 2 / variance
    sound = max(FEWEST_RUNS, int(np.ceil(needed * (1 - 1e-12))))
    expected_failures = sound * (1.0 / share_sound - 1.0)
    return sound + max(0, int(np.ceil(expected_failures - 1e-3)))


def error_of(
    runs: int,
    bias_square: float,
    spread: float,
    share_sound: float = 1.0,
    pilot: float = np.inf,
) -> float:
    """Return the total error of a number of runs; `runs_for` of this error is this number.

    2,500 runs with a spread of 1: 0.02.
    """
    sound = runs * share_sound
    return float(np.sqrt(bias_square + safe_spread(spread, pilot) ** 2 / sound))


def safe_spread(spread: float, pilot: float) -> float:
    """Return the spread of `pilot` runs: the fewer they are, the larger it is taken, by Student's
    quantile over the normal one (C. Stein, Ann. Math. Stat. 16, 243 (1945)).
    """
    from scipy.special import stdtrit

    student, normal = stdtrit([pilot - 1, np.inf], 0.975)
    return float(spread * student / normal)


def pareto_front(settings: Sequence[MeasuredSetting]) -> list[Interval]:
    """Return the settings with the smallest total error, from the shortest CPU time to the longest;
    of several settings from the time on that pays FEWEST_RUNS runs of two of them.

    The square of the error is linear in 1/T. So the best setting changes only where two of these
    lines cross or where a more expensive setting reaches FEWEST_RUNS runs; of two equal ones the
    first in `settings` counts. Settings whose bias is NaN, of too few runs, are left out.
    """
    settings = [setting for setting in settings if np.isfinite(setting.bias_square)]
    if not settings:
        return []
    starts = sorted(FEWEST_RUNS * setting.seconds for setting in settings)
    comparison_start = starts[1] if len(starts) > 1 else starts[0]
    crossings = [_crossing(first, second) for first, second in combinations(settings, 2)]
    changes = sorted({time for time in (*starts, *crossings) if time >= comparison_start})
    front: list[Interval] = []
    for start, end in zip(changes, [*changes[1:], np.inf], strict=True):
        middle = np.sqrt(start * end) if end < np.inf else 2 * start
        errors = [float(total_error(setting, middle)) for setting in settings]
        best = settings[int(np.nanargmin(errors))].label
        if front and front[-1].label == best:
            start = front.pop().start
        front.append(Interval(best, start, end))
    return front


def measured_setting(
    label: str, values: "Mapping[str, SupportsFloat] | Dataset", careful: bool = False
) -> MeasuredSetting:
    """Return an engine with its settings, with bias and spread of the MSD at the end, and its cost.

    values: the variables of the trade-off in one case.
    careful: take an unresolved bias at its 95 % upper bound, so that no setting appears better than
    the data show; otherwise take all biases at their estimates, with their variances subtracted.
    """
    msd_bias = _msd_bias(values)
    bias_square = bias.careful_square(msd_bias) if careful else bias.square(msd_bias)
    spread = float(values["msd_spread"])
    seconds = float(values["seconds"])
    return MeasuredSetting(label, float(bias_square), spread, seconds)


def setting_range(label: str, values: "Mapping[str, SupportsFloat] | Dataset") -> SettingRange:
    """Return an engine with its settings, as `measured_setting` does, at its best and at its
    worst.
    """
    worst = measured_setting(label, values, careful=True)
    bias_square = worst.bias_square if bias.is_resolved(_msd_bias(values)) else 0.0
    seconds_of_exact = worst.seconds / float(values["cost_ratio"])
    lowest = seconds_of_exact * float(values["cost_ratio_low"])
    highest = seconds_of_exact * float(values["cost_ratio_high"])
    best = worst._replace(bias_square=bias_square, seconds=lowest)
    return SettingRange(best, worst._replace(seconds=highest))


def _msd_bias(values: "Mapping[str, SupportsFloat] | Dataset") -> Estimate:
    return Estimate(*(np.array(float(values[name])) for name in names_of("msd_bias")))


def possible_spans(ranges: Sequence[SettingRange]) -> dict[str, tuple[float, float]]:
    """Return by label the first and the last CPU time [s] at which a setting may have the smallest
    total error: at its best it is on the Pareto front of all others at their worst.
    """
    worst = [setting.worst for setting in ranges]
    spans: dict[str, tuple[float, float]] = {}
    for number, setting in enumerate(ranges):
        label = setting.best.label
        others = [*worst[:number], *worst[number + 1 :]]
        fronts = front_spans([setting.best, *others])
        if label in fronts:
            spans[label] = fronts[label]
    return spans


def front_spans(settings: Sequence[MeasuredSetting]) -> dict[str, tuple[float, float]]:
    """Return the first and the last CPU time [s] at which each setting of the Pareto front is on
    it, by label.
    """
    spans: dict[str, tuple[float, float]] = {}
    for label, start, end in pareto_front(settings):
        first_start, _ = spans.get(label, (start, end))
        spans[label] = (first_start, end)
    return spans


def _crossing(first: MeasuredSetting, second: MeasuredSetting) -> float:
    """The CPU time [s] at which two settings have the same total error; 0 if there is none."""
    cost = first.spread**2 * first.seconds - second.spread**2 * second.seconds
    gain = second.bias_square - first.bias_square
    return cost / gain if cost * gain > 0.0 else 0.0
