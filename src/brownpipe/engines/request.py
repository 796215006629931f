"""The runs that a trajectory file is to hold: those of one call of `brownpipe simulate`."""

from collections.abc import Sequence
from typing import NamedTuple

from brownpipe.engines import TRACER, Engine
from brownpipe.scene.scene import Scene


class Request(NamedTuple):
    """A batch of runs, and what is recorded and measured in each of them."""

    scene: Scene
    engine: Engine
    seeds: Sequence[int]  # ascending
    record: frozenset[str] = TRACER  # of engines.RECORDS
    observables: tuple[str, ...] = ()  # names out of observables.OBSERVABLES, in their order
    average: str = "runs"  # of observables.AVERAGES
