"""Bond-orientational order: means over runs of abs(psi_6) and abs(psi_6)^2. See docs/theory.md, section 3."""

from brownpipe.analysis.estimator import Columns, Estimator
from brownpipe.analysis.variables import EACH, INTERVAL, Variable

VARIABLES = {
    "orientational_order": Variable(EACH, "1", "bond-orientational order abs(psi_6) of all disks", INTERVAL),
    "orientational_order_squared": Variable(EACH, "1", "abs(psi_6)^2 of all disks", INTERVAL),
}

ESTIMATOR = Estimator(
    lambda case, runs: Columns({name: runs.observables[name] for name in VARIABLES if name in runs.observables}),
    VARIABLES,
)
