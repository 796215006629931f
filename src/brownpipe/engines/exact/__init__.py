"""The exact engine: event-driven molecular dynamics of hard disks.

`simulation` makes a batch of runs: each is drawn, equilibrated (`equilibration`), run (`run`) and measured. Its kernels
advance the disks from collision to collision (`events`) on the arrays of a `workspace`.
"""

from collections.abc import Collection, Sequence

from brownpipe.engines import forecast
from brownpipe.engines.definition import Definition
from brownpipe.scene.scene import Scene


def _model(scenes: Sequence[Scene], settings: dict) -> str:
    """Return what the engine models, for `brownpipe check`."""
    return "from collision to collision"


def _refuse_unfit(scene: Scene, settings: dict, record: frozenset) -> None:
    """Refuse nothing: every valid scene can be run and recorded."""


def _forecast(
    scene: Scene, settings: dict, record: Collection[str], observables: Collection[str], average: str
) -> forecast.Cost:
    """Return the expected cost of one run."""
    return forecast.of_run(scene, record, observables, average)


def _candidates(scene: Scene) -> list[dict]:
    """Return the settings that `brownpipe plan` compares: the engine has none."""
    return [{}]


EXACT = Definition(
    name="exact",
    summary="event by event",
    simulation="brownpipe.engines.exact.simulation",
    settings={},
    model=_model,
    refuse_unfit=_refuse_unfit,
    caution=forecast.few_collisions,
    forecast=_forecast,
    candidates=_candidates,
    keeps_checkpoints=True,
)
