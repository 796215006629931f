"""All results that are reproduced, in the order of docs/validation.md."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from xarray import Dataset

from validation import (
    brownian_limit,
    cages,
    contact,
    equation_of_state,
    hexatic_order,
    long_time_tail,
    self_diffusion,
    virial,
    walls,
)
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
# The small versions fail if a published value is wrong by some 0.5 % (B_2), 1 % (B_3, Z, the rate) or 4 % (B_4).
RESULTS = {
    result.name: result
    for result in (
        Result(
            "virial",
            ("virial",),
            virial.compare,
            virial.draw,
            {"virial": {"particles": [80, 160, 320, 480], "seeds": 8}},
        ),
        Result(
            "equation_of_state",
            (*equation_of_state.STUDIES, equation_of_state.SMALL_BOXES),
            equation_of_state.compare,
            equation_of_state.draw,
            {
                "virial": {"particles": [160, 320], "seeds": 8},
                "fluid": {"particles": [960], "seeds": 8},
                "dense_fluid": {"particles": [1440], "seeds": 8},
                "small_boxes": {"seeds": 8},
            },
        ),
        Result(
            "contact",
            ("contact",),
            contact.compare,
            contact.draw,
            {"contact": {"particles": [640], "seeds": 8}},
        ),
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
