"""Bond-orientational order: means over runs of abs(psi_6) and abs(psi_6)^2. See docs/theory.md, section 3."""

from brownpipe.analysis.estimator import Case, Columns, Estimator, intervals
from brownpipe.analysis.runs import RunBlock
from brownpipe.analysis.variables import EACH, estimate_of

ARRAYS = {
    "orientational_order": "bond-orientational order abs(psi_6) of all disks",
    "orientational_order_squared": "abs(psi_6)^2 of all disks",
}


def _columns(case: Case, runs: RunBlock) -> Columns:
    return Columns({name: runs.observables[name] for name in ARRAYS if name in runs.observables})


ESTIMATOR = Estimator(
    _columns,
    lambda case, averages: intervals(averages, ARRAYS),
    {key: one for name, text in ARRAYS.items() for key, one in estimate_of(name, EACH, "1", text).items()},
)
