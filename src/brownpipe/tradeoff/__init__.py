"""The cost-accuracy trade-off: how far every engine and setting is from the exact one, and what a run of it costs.

`runs` takes trajectory files, `compare` finds the biases of one setting with the estimators in `bias`, `timing`
measures CPU times, `front` finds the Pareto front, `dataset` puts all of it together; `variables` says what is in it.
"""

from brownpipe.tradeoff.compare import compare, spread_of
from brownpipe.tradeoff.dataset import is_tradeoff, measure
from brownpipe.tradeoff.front import Interval, Setting, pareto_front, runs_for, settings_of, total_error
from brownpipe.tradeoff.runs import EngineRuns, read_runs, runs_of

__all__ = [
    "EngineRuns",
    "Interval",
    "Setting",
    "compare",
    "is_tradeoff",
    "measure",
    "pareto_front",
    "read_runs",
    "runs_for",
    "runs_of",
    "settings_of",
    "spread_of",
    "total_error",
]
