"""The cost-accuracy trade-off: the bias of every engine and setting relative to exact runs, and the cost of a run.

`runs` reads trajectory files, `compare` finds the biases of one setting with the estimators in `bias`, `timing`
measures CPU times, `front` finds the Pareto front, and `dataset` joins all results; `variables` describes them.
"""

from brownpipe.tradeoff.compare import compare, spread_of
from brownpipe.tradeoff.dataset import is_tradeoff, measure
from brownpipe.tradeoff.front import runs_for
from brownpipe.tradeoff.runs import EngineRuns, runs_of

__all__ = ["EngineRuns", "compare", "is_tradeoff", "measure", "runs_for", "runs_of", "spread_of"]
