"""The exact engine: event-driven molecular dynamics of hard disks.

A run is drawn (`initial_state`), equilibrated and run (`simulation`) from collision to collision (`events`).
"""

from collections.abc import Sequence

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition
from brownpipe.scene.scene import Scene


def _model(scenes: Sequence[Scene], settings: dict) -> str:
    return "from collision to collision"


def _refuse_unfit(scene: Scene, settings: dict, record: frozenset) -> None:
    """Every scene can be run."""


def _forecast(scene: Scene, settings: dict, record, observables, average: str) -> forecast.Cost:
    return forecast.of_run(scene, record, observables, average)


def _candidates(scene: Scene) -> list[dict]:
    return [{}]


EXACT = Definition(
    name="exact",
    simulation="brownpipe.engines.exact.simulation",
    settings={},
    model=_model,
    refuse_unfit=_refuse_unfit,
    caution=forecast.few_collisions,
    forecast=_forecast,
    candidates=_candidates,
    keeps_checkpoints=True,
)
