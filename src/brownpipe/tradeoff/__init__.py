"""The cost-accuracy trade-off: the bias of every engine and setting relative to exact runs, and the cost of a run.

`runs` reads trajectory files, `compare` finds the biases of one setting with the estimators in `bias`, `timing`
measures CPU times, `front` finds the Pareto front, and `dataset` joins all results; `variables` describes them.
"""

from brownpipe.tradeoff.compare import compare, spread_of
from brownpipe.tradeoff.dataset import is_tradeoff, measure
from brownpipe.tradeoff.front import FEWEST_RUNS, pareto_front, runs_for, settings_of
from brownpipe.tradeoff.runs import EngineRuns, read_runs, runs_of

__all__ = [
    "FEWEST_RUNS",
    "EngineRuns",
    "compare",
    "is_tradeoff",
    "measure",
    "pareto_front",
    "read_runs",
    "runs_for",
    "runs_of",
    "settings_of",
    "spread_of",
]
