"""The runs that are asked for, in Python or on the command line, whose words are read and checked
there.
"""

from collections.abc import Sequence
from typing import NamedTuple

from brownpipe.engines import Engine, forecast
from brownpipe.engines.definition import BatchCheckpoints
from brownpipe.engines.ensemble import Ensemble
from brownpipe.scene import Scene
from brownpipe.storage.store import runs_digest
from brownpipe.study.study import forecast_of_runs


class Request(NamedTuple):
    """A run of a scene for each seed."""

    scene: Scene
    seeds: Sequence[int]
    engine: Engine
    record: frozenset[str]  # names in engines.RECORDS
    observables: tuple[str, ...]  # names in observables.OBSERVABLES, or of the user's own functions
    average: str  # of observables.average.AVERAGES
    cores: int = 1  # processes that share the seeds

    @property
    def digest(self) -> str:
        """The digest under which studies store runs like these."""
        return runs_digest(self.scene, self.engine, self.record, self.observables, self.average)

    def forecast(self) -> forecast.Cost:
        """Return the forecast of one of the runs. Raises what `forecast_of_runs` raises for runs
        that cannot be made.
        """
        return forecast_of_runs(
            self.engine, self.scene, self.seeds, self.record, self.observables, self.average
        )

    def make(self, seeds: Sequence[int], checkpoints: BatchCheckpoints | None = None) -> Ensemble:
        """Return runs of some of the seeds, made on one core."""
        return self.engine.simulate(
            self.scene, seeds, self.record, self.observables, self.average, checkpoints
        )
