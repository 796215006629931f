"""What is known of an engine before it runs: its settings, its model, the scenes it refuses, and the cost of a run."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

from brownpipe.engines.forecast import Cost
from brownpipe.scene.scene import Scene


class Setting(NamedTuple):
    """A setting of an engine."""

    kind: Any  # the type of its values, for pydantic
    metavar: str  # of the command line's option
    help: str  # of the option: the values, in a few words
    default: object = None  # None: it must be given
    words: tuple[str, ...] = ()  # those allowed, if it takes a word


def one_of(words: tuple[str, ...], metavar: str, help: str, **more: Any) -> Setting:
    """Return a setting whose value is one of the words."""
    return Setting(Literal[words], metavar, help, words=words, **more)


class Definition(NamedTuple):
    """An engine. The functions take `settings`, a mapping with a value for each setting of the engine."""

    name: str
    summary: str  # for the help of the command line
    simulation: str  # module with `simulate(scene, seeds, record, *, observables, average, **settings) -> Ensemble`
    settings: dict[str, Setting]
    model: Callable[[Sequence[Scene], dict], str]  # (scenes, settings): the model, in a few words
    caution: Callable[[Scene], str | None]  # one line on the limits of its results in the scene, or None
    forecast: Callable[..., Cost]  # (scene, settings, record, observables, average): the cost of one run
    # (scene, settings, record): raises RequestError for a scene or record that the engine refuses
    refuse_unfit: Callable[[Scene, dict, frozenset[str]], None] = lambda scene, settings, record: None
    # (scene, settings): the scene whose disks are placed and moved; None if the engine needs no disk but the tracer
    scene_with_disks: Callable[[Scene, dict], Scene | None] = lambda scene, settings: scene
    # (observables, average): what it can measure of these, and the average; by default all
    measured: Callable[[tuple[str, ...], str], tuple[tuple[str, ...], str]] = lambda *asked: asked
    counts_collisions: bool = True  # whether its runs have the rates of collisions among their observables
    keeps_checkpoints: bool = False
