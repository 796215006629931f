"""Bond-orientational order: means over runs of abs(psi_6) and abs(psi_6)^2. See docs/theory.md, section 3."""

from brownpipe.analysis.estimator import Columns, Estimator
from brownpipe.analysis.variables import EACH, Mean

VARIABLES = {
    "orientational_order": Mean(EACH, "1", "bond-orientational order abs(psi_6) of all disks"),
    "orientational_order_squared": Mean(EACH, "1", "abs(psi_6)^2 of all disks"),
}

ESTIMATOR = Estimator(
    lambda case, runs: Columns({name: runs.observables[name] for name in VARIABLES if name in runs.observables}),
    VARIABLES,
)
