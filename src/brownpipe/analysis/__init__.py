"""From trajectories to numbers with uncertainties.

`runs` reads the trajectory files of a study block by block; the estimators (`displacement`, `distribution`, ...) take
columns of numbers from each block, one row per run; `resampling` adds them up and is the only place where errors are
estimated; `dataset` joins the results of all cases in one labelled dataset.
"""

from brownpipe.analysis.dataset import aggregate
from brownpipe.analysis.displacement import Line, fit_line, line_weights, squared_displacement
from brownpipe.analysis.distribution import ring_counts, ring_edges
from brownpipe.analysis.goodness import ChiSquare, chi_square
from brownpipe.analysis.resampling import Estimate, resample, wilson_interval
from brownpipe.errors import AnalysisError

__all__ = [
    "AnalysisError",
    "ChiSquare",
    "Estimate",
    "Line",
    "aggregate",
    "chi_square",
    "fit_line",
    "line_weights",
    "resample",
    "ring_counts",
    "ring_edges",
    "squared_displacement",
    "wilson_interval",
]
