"""What a result consists of: studies, how they are compared with published numbers, small versions
for the tests.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from xarray import Dataset

from validation.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Result(NamedTuple):
    """A result: the studies of `config/validation` that it takes, and how their datasets are
    compared with it.
    """

    name: str
    studies: tuple[str, ...]
    compare: Callable[[Mapping[str, Dataset]], Sequence[Comparison]]
    draw: Callable[[Mapping[str, Dataset], Sequence[Comparison]], "Figure"]
    small: Mapping[
        str, Mapping
    ]  # for the tests: by study, keys of the study with other values, such as fewer seeds
    # whether the datasets include the arrays of single runs, as STUDY/SCENE
    of_single_runs: bool = False
