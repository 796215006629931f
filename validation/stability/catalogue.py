"""All experiments, in the order of docs/stability.md."""

from collections.abc import Mapping
from types import ModuleType
from typing import NamedTuple

from validation.stability import clocks, conservation, packings, pi_digits, reversal, speeds


class Experiment(NamedTuple):
    """An experiment: a module with `measure`, `rows` and `draw`."""

    name: str
    module: ModuleType
    small: Mapping  # arguments of `measure` in the tests
    large: Mapping  # and of the option --large; without any, the experiment is the same


LARGE_CONSERVATION = {"long": conservation.LONG | {"equal disks": (1e8, 1e9)}}

EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            "reversal", reversal, {"times": (0.1, 0.5), "seeds": 2, "pairs": 2, "games": ()}, {}
        ),
        Experiment(
            "conservation",
            conservation,
            {
                "events": (1e5,),
                "others": (1e4,),
                "long": {},
                "scenes": ("masses 1 : 1e12",),
                "steps": 100,
            },
            LARGE_CONSERVATION,
        ),
        Experiment(
            "packings", packings, {"gaps": (1e-2, 1e-12), "crossings": 1000.0, "steps": 10}, {}
        ),
        Experiment("clocks", clocks, {"durations": (1e5, 1e6), "near": 0.25}, {}),
        Experiment("speeds", speeds, {"powers": (-531, 0, 565), "duration": 1.0}, {}),
        Experiment("pi_digits", pi_digits, {"digits": 4, "games": 0}, {"digits": 8}),
    )
}
