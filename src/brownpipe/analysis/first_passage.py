"""First passage of the tracer: how many tracers are still inside the circle, and their median.

n runs of a block, S runs, T sample times. See docs/theory.md, section 5.
"""

import warnings
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.variables import CASE_DIMS, ENDS, TIME, Variable
from brownpipe.engines.ensemble import Ensemble

LEVEL = 0.95  # of the intervals


def passage_columns(case: Case, runs: Ensemble) -> Columns:
    """Return the first passage times (n,), if they are measured."""
    name = "first_passage_time"
    if name not in runs.observables:
        return Columns()
    return Columns(run_values={name: runs.observables[name]})


def passage_results(case: Case, averages: Averages) -> Mapping[str, ArrayLike]:
    """Return the probability that the tracer is inside at the sample times (T,), with its interval,
    and the median of the first passage time.

    It is the estimate of E. L. Kaplan & P. Meier, J. Am. Stat. Assoc. 53, 457 (1958): runs that end
    before the tracer leaves are censored at their end. Its interval is that of log(-log S), which
    stays between 0 and 1; NaN where no tracer has left or none is left inside. The interval of the
    median has the times at which those of the curve reach 1/2 (R. Brookmeyer & J. Crowley,
    Biometrics 38, 29 (1982)). A time that the runs do not reach is NaN.
    """
    times = averages.run_values.get("first_passage_time")
    if times is None:
        return {}
    from scipy.stats import CensoredData, ecdf

    has_left = np.isfinite(times)
    ends = np.full(np.count_nonzero(~has_left), case.times[-1])
    survival = ecdf(CensoredData(times[has_left], right=ends)).sf
    with warnings.catch_warnings():  # of ends that are not defined
        warnings.simplefilter("ignore", RuntimeWarning)
        interval = survival.confidence_interval(LEVEL, method="log-log")
    curves = {"": survival, "_low": interval.low, "_high": interval.high}
    has_begun = case.times >= np.min(times[has_left], initial=np.inf)
    results: dict[str, ArrayLike] = {}
    for ending, curve in curves.items():
        inside = curve.evaluate(case.times)
        is_known = has_begun if ending else True
        results[f"first_passage_survival{ending}"] = np.where(is_known, inside, np.nan)
        passages = curve.quantiles[curve.probabilities <= 0.5]
        results[f"first_passage_median{ending}"] = passages[0] if len(passages) else np.nan
    return results


ESTIMATOR = Estimator(
    name="first_passage",
    variables={
        "first_passage_survival": Variable(
            TIME, "1", "probability that the tracer has not left the circle of its radius", ENDS
        ),
        "first_passage_median": Variable(
            CASE_DIMS,
            "time",
            "median of when the tracer first leaves the circle of its radius, if within the runs",
            ENDS,
        ),
    },
    columns=passage_columns,
    results=passage_results,
)
