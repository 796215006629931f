"""Non-Gaussian parameter of the displacement at each time: the kurtosis minus 1, with all averages within the runs.

n runs of a block, T sample times. See docs/theory.md, section 4.
"""

from numpy.typing import ArrayLike

from brownpipe.analysis.displacement import squared_of
from brownpipe.analysis.distribution import kurtosis
from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator, with_interval
from brownpipe.analysis.resampling import Estimate
from brownpipe.analysis.runs import RunBlock
from brownpipe.analysis.variables import TIME, estimate_of

COLUMNS = ("msd", "quartic_displacement", "square_times_quartic")  # r^2, r^4 and their product; `displacement` has msd


def _columns(case: Case, runs: RunBlock) -> Columns:
    seen, squared = runs.observables, squared_of(case, runs)
    alike = "square_displacement" in seen or case.average == "runs"  # whether r^2 and r^4 are averaged alike
    if "quartic_displacement" not in seen or squared is None or not alike:
        return Columns()
    quartic = seen["quartic_displacement"]
    return Columns({"quartic_displacement": quartic}, {"square_times_quartic": squared * quartic})


def _estimate(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    if "quartic_displacement" not in averages:
        return {}
    mean, error, low, high = kurtosis(averages, COLUMNS)
    return {**with_interval("non_gaussian_parameter", Estimate(mean - 1, error, low - 1, high - 1))}


ESTIMATOR = Estimator(
    _columns,
    _estimate,
    estimate_of(
        "non_gaussian_parameter",
        TIME,
        "1",
        "non-Gaussian parameter <r^4>/(2 <r^2>^2) - 1 of the displacement, 0 for a normal distribution",
    ),
)
