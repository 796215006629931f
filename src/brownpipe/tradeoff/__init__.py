"""The cost-accuracy trade-off: the bias of every engine and setting relative to exact runs, and the
cost of a run.

`compare` reads trajectory files and finds the biases of one setting with the estimators in `bias`,
`timing` measures CPU times, `front` finds the Pareto front, and `dataset` joins all results.
"""

from brownpipe.tradeoff.compare import EngineRuns, compare, diffusion_of, runs_of
from brownpipe.tradeoff.dataset import is_tradeoff, measure
from brownpipe.tradeoff.front import error_of, runs_for

__all__ = [
    "EngineRuns",
    "compare",
    "diffusion_of",
    "error_of",
    "is_tradeoff",
    "measure",
    "runs_for",
    "runs_of",
]
