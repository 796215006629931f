"""What is known of an engine before it runs: its settings, what it models and refuses, and what a run will cost."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from brownpipe.engines.forecast import Cost
from brownpipe.scene.reading import Entry
from brownpipe.scene.scene import Scene


class Setting(NamedTuple):
    """One setting of an engine."""

    read: Callable[[Entry], object]  # raises RequestError for a value that is not allowed
    default: object = None  # None: it must be given


class Definition(NamedTuple):
    """One engine. `settings` of the functions is a mapping with a value for each of its settings."""

    name: str
    simulation: str  # module with `simulate(scene, seeds, record, *, observables, average, **settings) -> Ensemble`
    settings: dict[str, Setting]
    model: Callable[[Sequence[Scene], dict], str]  # (scenes, settings): what is modelled, in words
    refuse_unfit: Callable[[Scene, dict, frozenset], None]  # (scene, settings, record): raises RequestError
    caution: Callable[[Scene], str | None]  # one line on the limits of its results in this scene, None if there is none
    forecast: Callable[..., Cost]  # (scene, settings, record, observables, average): what one run costs
    candidates: Callable[[Scene], list[dict]]  # settings worth a trial where a scene is planned; the first is typical
    keeps_checkpoints: bool = False
