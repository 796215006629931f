"""The record of an engine, `Definition`: what brownpipe asks of an engine, its own or a user's."""

import re
from collections.abc import Callable, Collection, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.forecast import Cost, run_cost
from brownpipe.errors import RequestError
from brownpipe.scene import Scene

NAME = re.compile(r"[a-z][a-z0-9_]*")  # of an engine
# Of the engine without bias: the default, with which all others are compared
REFERENCE_NAME = "exact"

# the settings of an engine: a record of the class that its definition names
SettingsRecord = Any
# runs a scene once for every seed: (scene, seeds, record, *, observables, average, and the settings
# of the engine by name); an engine that keeps checkpoints is given `checkpoints`, if some are to be
# kept
Simulation = Callable[..., Ensemble]
Stored = TypeVar("Stored", contravariant=True)


class Checkpoints(NamedTuple, Generic[Stored]):
    """When and how the state of a batch or, within it, of a run is stored, and what to continue
    from.
    """

    due: Callable[[], bool]  # whether to store at the next end of a block of simulated time
    store: Callable[[Stored], None]  # takes views of arrays that change later
    stored: dict[str, np.ndarray] | None = None  # arrays of an earlier call of `store`


BatchCheckpoints = Checkpoints[dict[str, np.ndarray]]  # arrays of `exact.simulation.pack`


class NoSettings(NamedTuple):
    """The settings of an engine that has none."""


def _no_caution(scene: Scene) -> str | None:
    """Return None: the results have no limits worth a line."""
    return None


def _no_refusal(scene: Scene, settings: SettingsRecord, record: frozenset[str]) -> None:
    """Refuse nothing."""


def _cost_of_exact_run(
    scene: Scene,
    settings: SettingsRecord,
    record: Collection[str],
    observables: Collection[str],
    average: str,
) -> Cost:
    """Return the cost of a run of the exact engine, which stands for one that is not known."""
    return run_cost(scene, record, observables, average)


class Definition(NamedTuple):
    """An engine: what makes its runs, and what is known of it before a run.

    The functions take `settings`, a record with a value for each setting of the engine. The guide
    has an engine that moves the disks itself; this one has those of the exact engine moved at
    another temperature:

    >>> from brownpipe.engines.exact.simulation import simulate
    >>> def simulate_hot(scene, seeds, record, *, observables, average):
    ...     hot = scene.replace(**{"velocities.temperature": 4.0})
    ...     return simulate(hot, seeds, record, observables=observables, average=average)
    >>> hot = bp.Definition("hot", "the exact engine at kT = 4", simulate_hot)
    >>> hot_runs = bp.simulate(scene, seeds=20, engine=hot)
    >>> bool(np.allclose(hot_runs.initial_square_speed, 4 * runs.initial_square_speed))
    True
    """

    name: str  # a word of small letters, digits and _
    summary: str  # for the help of the command line
    # the function that makes runs, or the module where it is `simulate`, imported when it runs
    simulation: str | Simulation
    # the class of this record: types, with descriptions for pydantic, and defaults
    settings: type[NamedTuple] = NoSettings
    # (scenes, settings): the model, in a few words
    model: Callable[[Sequence[Scene], SettingsRecord], str] = lambda scenes, settings: ""
    # one line on the limits of its results in the scene, or None
    caution: Callable[[Scene], str | None] = _no_caution
    # (scene, settings, record, observables, average): the cost of one run
    forecast: Callable[[Scene, SettingsRecord, Collection[str], Collection[str], str], Cost] = (
        _cost_of_exact_run
    )
    # (scene, settings, record): raises RequestError for a scene or record that the engine refuses
    refuse_unfit: Callable[[Scene, SettingsRecord, frozenset[str]], None] = _no_refusal
    moves_all_disks: bool = True  # otherwise it moves the tracer alone, and counts no collisions
    keeps_checkpoints: bool = False


class OwnEngine(NamedTuple):
    """What files record of an engine of a user's own, besides its name and settings."""

    module: str  # in which its function stands
    source: str  # SHA-256 of that module's file; of a function without a file a random number
    moves_all_disks: bool


def refuse_name(definition: Definition, names: Collection[str]) -> None:
    """Raise RequestError for a user's definition whose name is no word, or one of `names`."""
    if not NAME.fullmatch(definition.name) or definition.name in names:
        raise RequestError(
            f"engine: {definition.name!r}: must be a word of small letters, digits and _, and none "
            f"of {', '.join(names)}"
        )
