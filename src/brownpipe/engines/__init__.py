"""The list of engines, and engines with their settings as files, datasets and the command line name them.

A new engine is a package with a `Definition` and its entry in DEFINITIONS. Its simulation is imported when it runs.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

from pydantic import Field, create_model

from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.exact import EXACT
from brownpipe.engines.forecast import Cost, Definition
from brownpipe.engines.langevin import LANGEVIN
from brownpipe.engines.timestep import TIMESTEP
from brownpipe.errors import RequestError
from brownpipe.observables import of_tracer
from brownpipe.scene.reading import Record, validated
from brownpipe.scene.scene import Scene

DEFINITIONS = {definition.name: definition for definition in (EXACT, TIMESTEP, LANGEVIN)}
TRACER = frozenset({"tracer"})
RECORDS = ("tracer", "all", "events", "velocity", "none")  # what may be recorded of a run


class Engine(NamedTuple):
    """An engine with a value for each of its settings."""

    name: str
    settings: tuple[tuple[str, object], ...] = ()

    @property
    def definition(self) -> Definition:
        return DEFINITIONS[self.name]

    @property
    def label(self) -> str:
        """The name in folders, datasets and figures, like timestep-0.001-late, without settings at their default."""
        defaults = _defaults(self.definition)
        return "-".join([self.name, *(str(value) for key, value in self.settings if defaults.get(key) != value)])

    @property
    def options(self) -> str:
        """The engine as the value of `brownpipe simulate --engine`, followed by an option for each setting."""
        return " ".join([self.name, *(f"{option(key)} {value}" for key, value in self.settings)])

    def model(self, scenes: Sequence[Scene]) -> str:
        """Return in a few words how the engine models the scenes."""
        return self.definition.model(scenes, dict(self.settings))

    def cautions(self, scene: Scene, observables: Collection[str] = ()) -> list[str]:
        """Return a line on the limits of the results in a scene, and one on observables that are not measured."""
        lines = [self.definition.caution(scene) or ""]
        if not self.definition.moves_all_disks and (lacking := {*observables} - {*of_tracer(observables)[0]}):
            lines.append(f"{self.name} moves the tracer alone, and does not measure {', '.join(sorted(lacking))}")
        return [line for line in lines if line]

    def refuse_unfit(self, scene: Scene, record: Collection[str] = TRACER) -> None:
        """Raise RequestError if the engine cannot run the scene or cannot record `record` of it."""
        self.definition.refuse_unfit(scene, dict(self.settings), frozenset(record))

    def forecast(
        self, scene: Scene, record: Collection[str] = TRACER, observables: Collection[str] = (), average: str = "runs"
    ) -> Cost:
        """Return the forecast for one run of a scene that the engine does not refuse."""
        return self.definition.forecast(scene, dict(self.settings), record, observables, average)

    def simulate(
        self,
        scene: Scene,
        seeds: Sequence[int],
        record: Collection[str],
        *checkpoints: object,
        observables: Collection[str] = (),
        average: str = "runs",
    ) -> Ensemble:
        """Run a scene once for every seed; `checkpoints` go to an engine that keeps checkpoints."""
        simulation = import_module(self.definition.simulation)
        measured = {"observables": observables, "average": average}
        return simulation.simulate(scene, seeds, record, *checkpoints, **measured, **dict(self.settings))


def read_record(text: str, option: str) -> frozenset[str]:
    """Return what to record: names of RECORDS, separated by commas, and the tracer except with `none`.

    Raises RequestError, naming `option`, for other names.
    """
    names = frozenset(text.split(","))
    if not names <= set(RECORDS) or ("none" in names and len(names) > 1):
        raise RequestError(f"{option} {text}: must be one or several of {', '.join(RECORDS)}, with commas; none alone")
    return names if "none" in names else names | TRACER


def _defaults(definition: Definition) -> dict[str, object]:
    """Return the settings that have a default."""
    return {key: setting.default for key, setting in definition.settings.items() if setting.default is not None}


def option(setting: str) -> str:
    """Return the option of the command line for a setting: --time-step for time_step."""
    return f"--{setting.replace('_', '-')}"


@cache
def settings_of(name: str) -> type[Record]:
    """Return the record of the settings of an engine, after its name."""
    keys: dict[str, Any] = {"name": (Literal[name], name)}
    for key, setting in DEFINITIONS[name].settings.items():
        default = ... if setting.default is None else setting.default
        keys[key] = (setting.kind, Field(default, description=setting.help))
    return create_model(name, __base__=Record, __doc__=DEFINITIONS[name].summary, **keys)


def recorded(mapping: dict, where: str = "") -> Engine:
    """Return the engine that a file or dataset records as a mapping of name and settings; `where` is for messages.

    Raises RequestError.
    """
    name = validated(Literal[tuple(DEFINITIONS)], mapping.get("name"), where, "name")
    _, *values = validated(settings_of(name), mapping, where)
    return Engine(name, tuple(values))


def requested(name: str, values: dict[str, object], option: Callable[[str], str] = option) -> Engine:
    """Return the engine that the user asks for; `values` has the settings given.

    `option` returns how a setting is named there: the option of the command line, or the argument in Python.
    Raises RequestError, naming it, for a setting that the engine lacks, that is missing or that is not allowed.
    """
    definition = DEFINITIONS[validated(Literal[tuple(DEFINITIONS)], name, key=option("engine"))]
    settings = definition.settings
    defaults = _defaults(definition)
    for key in values.keys() - settings.keys():
        owners = [other.name for other in DEFINITIONS.values() if key in other.settings]
        wrong = f"the {name} engine has no such setting; must go with {' or '.join(owners)}"
        raise RequestError(f"{option(key)} {values[key]}: {wrong}")
    for key in settings.keys() - values.keys() - defaults.keys():
        raise RequestError(f"{option(key)}: missing; must be given with {option('engine')} {name}")
    given = defaults | values
    return Engine(name, tuple((key, validated(s.kind, given[key], key=option(key))) for key, s in settings.items()))
