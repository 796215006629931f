"""What accuracy a CPU time buys: total error of every setting, and which settings are ever the best buy.

A setting that is off by `bias`, whose runs scatter by `spread` and cost `seconds` each, has after a CPU time T the root
mean square error sqrt(bias^2 + spread^2 seconds/T). All relative to the exact value.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np

FEWEST_RUNS = 10  # of a setting, before it is said to have a result


class Setting(NamedTuple):
    """An engine with its settings in one scene."""

    label: str
    bias_square: float  # scatter taken off, `Bias.square`
    spread: float  # of one run: n runs are known to spread/sqrt(n)
    seconds: float  # of CPU for one run


class Stretch(NamedTuple):
    """Between CPU times start and end [s] this setting has the smallest total error."""

    label: str
    start: float
    end: float  # inf for the last


def total_error(setting, cpu_time):
    """The root mean square error after so many seconds of CPU; NaN as long as they do not pay for FEWEST_RUNS."""
    cpu_time = np.asarray(cpu_time, float)
    error = np.sqrt(setting.bias_square + setting.spread**2 * setting.seconds / cpu_time)
    return np.where(cpu_time >= FEWEST_RUNS * setting.seconds, error, np.nan)


def runs_for(tolerance, bias_square, spread):
    """The number of runs that bring the total error down to `tolerance`; None if the bias alone is too large."""
    left = tolerance**2 - bias_square
    return None if left <= 0.0 else max(FEWEST_RUNS, int(np.ceil(spread**2 / left * (1 - 1e-12))))


def pareto_front(settings):
    """The settings with the smallest total error, from the shortest CPU time to the longest: a list of Stretch.

    The square of the error is linear in 1/T. So the best setting changes only where two of these lines cross or where
    a dearer setting gets its first FEWEST_RUNS; of two equal ones the first in `settings` counts.
    Settings of unknown (NaN) bias are left out.
    """
    settings = [one for one in settings if np.isfinite(one.bias_square)]
    starts = {FEWEST_RUNS * one.seconds for one in settings}
    changes = sorted(starts | {time for pair in combinations(settings, 2) if (time := _crossing(*pair)) > min(starts)})
    stretches = []
    for start, end in zip(changes, [*changes[1:], np.inf], strict=True):
        middle = np.sqrt(start * end) if end < np.inf else 2 * start
        errors = [float(total_error(one, middle)) for one in settings]
        best = settings[int(np.nanargmin(errors))].label
        if stretches and stretches[-1].label == best:
            start = stretches.pop().start
        stretches.append(Stretch(best, start, end))
    return stretches


def settings_of(dataset, scene, observable="msd", careful=False):
    """The settings of a scene of the dataset, the exact one first, as they are for `msd`, `d` or `displacement`.

    `careful`: a bias that was not told from 0 is as large as its 95 % interval allows, so that nothing is taken for
    better than it is known to be. Else all are as found, with the scatter taken off.
    """
    of_scene = dataset.sel(scene=scene)
    settings = []
    for label in of_scene.setting.values:
        one = of_scene.sel(setting=label)
        if one.runs > 0:
            square = float(one[f"{observable}_bias_{'careful' if careful else 'square'}"])
            settings.append(Setting(str(label), square, float(one[f"{observable}_spread"]), float(one.seconds)))
    return sorted(settings, key=lambda one: one.label != "exact")


def _crossing(one, other):
    """The CPU time at which two settings are equally good; 0 if there is none."""
    price = one.spread**2 * one.seconds - other.spread**2 * other.seconds
    gain = other.bias_square - one.bias_square
    return price / gain if price * gain > 0.0 else 0.0
