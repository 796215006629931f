"""Non-Gaussian parameter of the displacement at each time: the kurtosis minus 1, with all averages within the runs.

n runs of a block, T sample times. See docs/theory.md, section 4.
"""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis import resampling
from brownpipe.analysis.displacement import squared_of
from brownpipe.analysis.distribution import kurtosis
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.resampling import FEWEST_FOR_INTERVAL, Estimate
from brownpipe.analysis.runs import RunBlock
from brownpipe.analysis.variables import ERROR, TIME, Mean, Variable

COLUMNS = ("msd", "quartic_displacement", "square_times_quartic")  # r^2, r^4 and their product; `displacement` has msd


def _columns(case: Case, runs: RunBlock) -> Columns:
    seen, squared = runs.observables, squared_of(case, runs)
    alike = "square_displacement" in seen or case.average == "runs"  # whether r^2 and r^4 are averaged alike
    if "quartic_displacement" not in seen or squared is None or not alike:
        return Columns()
    quartic = seen["quartic_displacement"]
    return Columns({"quartic_displacement": quartic, "square_times_quartic": squared * quartic})


def _derived(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    if "quartic_displacement" not in averages:
        return {}
    mean, error, low, high = kurtosis(averages, COLUMNS)
    return {"non_gaussian_parameter": Estimate(mean - 1, error, low - 1, high - 1), **_controlled(averages, mean - 1)}


def _controlled(averages: Averages, value: np.ndarray) -> dict[str, np.ndarray]:
    """Non-Gaussian parameter (T,) with its value at the first sample after t = 0 as control variate.

    That value is the one of the initial velocities if the sample is well within the mean free time: 0 for velocities
    drawn from a normal distribution, but for their scatter, which is subtracted. {} with few runs or samples, or if
    nothing moves. Coefficient and standard error are those of the replicates of the bootstrap.
    """
    if averages.runs < FEWEST_FOR_INTERVAL or len(value) < 2 or not np.isfinite(value[1:]).all():
        return {}
    drawn = (resampling.drawn_mean(averages.of(name)) for name in COLUMNS[:2])
    r2, r4 = (means[np.isfinite(means).all(axis=1), 1:] for means in drawn)  # a replicate may have no runs
    change = r4 / (2 * r2**2) - 1 - value[1:]
    first = change[:, :1]
    b = (change * first).mean(axis=0) / (first**2).mean()
    error = np.sqrt(((change - b * first) ** 2).mean(axis=0))
    name = "non_gaussian_parameter_controlled"
    return {
        name: np.append(np.nan, value[1:] - b * value[1]),
        f"{name}_standard_error": np.append(np.nan, error),
    }


MEANING = "non-Gaussian parameter <r^4>/(2 <r^2>^2) - 1 of the displacement, 0 for a normal distribution"

VARIABLES = {
    "non_gaussian_parameter": Mean(TIME, "1", MEANING),
    "non_gaussian_parameter_controlled": Variable(TIME, "1", f"{MEANING}; control variate: the first after 0", ERROR),
}
ESTIMATOR = Estimator(_columns, VARIABLES, _derived)
