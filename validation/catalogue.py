"""All results that are reproduced, in the order of docs/validation.md."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from xarray import Dataset

from validation import brownian_limit, virial, walls
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
            "brownian_limit",
            ("brownian_limit", "brownian_box", "brownian_hot"),
            brownian_limit.compare,
            brownian_limit.draw,
            {
                # fails if the slope at 0 is 30 % off; all else is compared with theory that is approximate
                "brownian_limit": {"scenes": "scenes/tracer_100_10.yaml", "seeds": 16},
                "brownian_box": {"seeds": 2},
                "brownian_hot": {"seeds": 10},
            },
        ),
        # the small version fails if the force is 5 % off
        Result("walls", ("walls",), walls.compare, walls.draw, {"walls": {"seeds": 10}}),
    )
}
