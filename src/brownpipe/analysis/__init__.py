"""From trajectories to numbers with uncertainties.

`displacement` has the measures, pure functions on arrays; `resampling` the one place where an error is estimated;
`dataset` reads the trajectory files of a study and puts the results into one labelled dataset.
"""

from brownpipe.analysis.dataset import AnalysisError, aggregate
from brownpipe.analysis.displacement import (
    ChiSquare,
    Line,
    chi_square,
    fit_line,
    line_weights,
    ring_counts,
    ring_edges,
    squared_displacement,
)
from brownpipe.analysis.resampling import Estimate, resample, resample_each, wilson_interval

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
    "resample_each",
    "ring_counts",
    "ring_edges",
    "squared_displacement",
    "wilson_interval",
]
