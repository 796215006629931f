"""All results that are reproduced, in the order of docs/validation.md."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from xarray import Dataset

from validation import cages, hexatic_order, virial
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


RESULTS = {
    result.name: result
    for result in (
        Result("virial", ("virial",), virial.compare, virial.draw, {"virial": {"seeds": 8}}),
        Result(
            "cages",
            ("cages", "cages_short"),
            cages.compare,
            cages.draw,
            {"cages": {"particles": [163], "seeds": 12}, "cages_short": {"seeds": 280}},
        ),
        Result(
            "hexatic_order",
            ("hexatic_order",),
            hexatic_order.compare,
            hexatic_order.draw,
            {"hexatic_order": {"scenes": "scenes/freezing_72_short.yaml", "seeds": 12}},
        ),
    )
}
