"""From trajectories to numbers with uncertainties.

`runs` reads the trajectory files of a study block by block; the estimators (`displacement`,
`distribution`, ...) take columns of numbers from each block, one row per run; `resampling` adds
them up and is the only place where errors are estimated; `dataset` joins the results of all cases
in one labelled dataset.
"""

from brownpipe.analysis.dataset import aggregate

__all__ = ["aggregate"]
