"""All results that are reproduced, in the order of docs/validation.md."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from xarray import Dataset

from validation import long_time_tail, self_diffusion, virial
from validation.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Result(NamedTuple):
    """A result: the studies of `config/validation` that it takes, and how their datasets are compared with it."""

    name: str
    studies: tuple[str, ...]
    compare: Callable[[Mapping[str, Dataset]], Sequence[Comparison]]
    draw: Callable[[Mapping[str, Dataset], Sequence[Comparison]], "Figure"]
    small: Mapping[str, Mapping]  # for the tests: by study, keys of the study with other values, such as fewer seeds
    of_single_runs: bool = False  # whether the datasets include the arrays of single runs, as STUDY/SCENE


SMALL_DIFFUSION = {"scenes": ["scenes/diffusion_030_100.yaml", "scenes/diffusion_030_1000.yaml"], "seeds": 40}
SMALL_TAIL = {"scenes": "scenes/tail_030.yaml", "seeds": 4}
RESULTS = {
    result.name: result
    for result in (
        Result("virial", ("virial",), virial.compare, virial.draw, {"virial": {"seeds": 8}}),
        Result(
            "self_diffusion",
            ("self_diffusion",),
            self_diffusion.compare,
            self_diffusion.draw,
            {"self_diffusion": {"engines": "exact", **SMALL_DIFFUSION}},
        ),
        Result(
            "long_time_tail",
            ("long_time_tail",),
            long_time_tail.compare,
            long_time_tail.draw,
            {"long_time_tail": {"engines": "exact", **SMALL_TAIL}},
            of_single_runs=True,
        ),
    )
}
