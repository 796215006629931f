"""The list of engines, and engines with their settings as files, datasets and the command line name
them.

A new engine is a package with a `Definition` and its entry in DEFINITIONS. Its simulation is
imported when it runs.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple, get_type_hints

from pydantic import create_model

from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.exact import EXACT
from brownpipe.engines.forecast import Cost, Definition
from brownpipe.engines.langevin import LANGEVIN
from brownpipe.engines.timestep import TIMESTEP
from brownpipe.errors import RequestError
from brownpipe.observables import own, tracer_observables
from brownpipe.scene.reading import Section, validated
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
        """The name in folders, datasets and figures, like timestep-0.001-collisions=late: the
        settings that must be given, in their order, then those not at their default by name.

        Engines with different settings have different labels.
        """
        defaults = self.definition.settings._field_defaults
        required = []
        chosen = []
        for key, value in self.settings:
            if key not in defaults:
                required.append(str(value))
            elif value != defaults[key]:
                chosen.append(f"{key}={value}")
        return "-".join([self.name, *required, *chosen])

    @property
    def options(self) -> str:
        """The engine as the value of `brownpipe simulate --engine`, followed by an option for each
        setting.
        """
        settings = [f"{option(key)} {value}" for key, value in self.settings]
        return " ".join([self.name, *settings])

    @property
    def values(self) -> Any:
        """The settings as the engine's own record."""
        return self.definition.settings(**dict(self.settings))

    def model(self, scenes: Sequence[Scene]) -> str:
        """Return in a few words how the engine models the scenes."""
        return self.definition.model(scenes, self.values)

    def cautions(self, scene: Scene, observables: Collection[str] = ()) -> list[str]:
        """Return a line on the limits of the results in a scene, and one on observables that are
        not measured.
        """
        lines = []
        caution = self.definition.caution(scene)
        if caution:
            lines.append(caution)
        lacking = set(observables) - set(tracer_observables(observables))
        if lacking and not self.definition.moves_all_disks:
            names = ", ".join(sorted(map(own.title_of, lacking)))
            lines.append(f"{self.name} moves the tracer alone, and does not measure {names}")
        return lines

    def refuse_unfit(self, scene: Scene, record: Collection[str] = TRACER) -> None:
        """Raise RequestError if the engine cannot run the scene or cannot record `record` of it."""
        self.definition.refuse_unfit(scene, self.values, frozenset(record))

    def forecast(
        self, scene: Scene, record: Collection[str], observables: Collection[str], average: str
    ) -> Cost:
        """Return the forecast for one run of a scene that the engine does not refuse."""
        return self.definition.forecast(scene, self.values, record, observables, average)

    def simulate(
        self,
        scene: Scene,
        seeds: Sequence[int],
        record: Collection[str],
        *saving: Any,
        **measured: Any,
    ) -> Ensemble:
        """Run a scene once for every seed.

        `saving`: Checkpoints, for an engine that keeps them; `measured`: `observables` and
        `average`.
        """
        simulation = import_module(self.definition.simulation)
        return simulation.simulate(scene, seeds, record, *saving, **measured, **dict(self.settings))


def read_record(text: str, option: str) -> frozenset[str]:
    """Return what to record: names of RECORDS, separated by commas, and the tracer except with
    `none`.

    Raises RequestError, naming `option`, for other names.
    """
    names = frozenset(text.split(","))
    is_contradictory = "none" in names and len(names) > 1
    if is_contradictory or not names <= set(RECORDS):
        allowed = f"one or several of {', '.join(RECORDS)}, with commas; none alone"
        raise RequestError(f"{option} {text}: must be {allowed}")
    return names if "none" in names else names | TRACER


def option(setting: str) -> str:
    """Return the option of the command line for a setting: --time-step for time_step."""
    return f"--{setting.replace('_', '-')}"


@cache
def settings_section(name: str) -> type[Section]:
    """Return the record of the settings of an engine in a file, after its name."""
    definition = DEFINITIONS[name]
    defaults = definition.settings._field_defaults
    keys: dict[str, Any] = {"name": (Literal[name], name)}
    for key, kind in get_type_hints(definition.settings, include_extras=True).items():
        keys[key] = (kind, defaults.get(key, ...))
    return create_model(name, __base__=Section, __doc__=definition.summary, **keys)


def engine_of_record(mapping: dict, where: str = "") -> Engine:
    """Return the engine that a file or dataset records as a mapping of name and settings; `where`
    is for messages.

    Raises RequestError.
    """
    name = validated(Literal[tuple(DEFINITIONS)], mapping.get("name"), where, "name")
    record = validated(settings_section(name), mapping, where)
    settings = [(key, value) for key, value in record if key != "name"]
    return Engine(name, tuple(settings))


def engine_of_request(
    name: str, values: dict[str, object], option: Callable[[str], str] = option
) -> Engine:
    """Return the engine that the user asks for; `values` has the settings given.

    `option` returns how a setting is named there: the option of the command line, or the argument
    in Python. Raises RequestError, naming it, for a setting that the engine lacks, that is missing
    or that is not allowed.
    """
    definition = DEFINITIONS[validated(Literal[tuple(DEFINITIONS)], name, key=option("engine"))]
    kinds = get_type_hints(definition.settings, include_extras=True)
    defaults = definition.settings._field_defaults
    for key in values.keys() - kinds.keys():
        owners = [other.name for other in DEFINITIONS.values() if key in other.settings._fields]
        reason = f"the {name} engine has no such setting; must go with {' or '.join(owners)}"
        raise RequestError(f"{option(key)} {values[key]}: {reason}")
    for key in kinds.keys() - values.keys() - defaults.keys():
        raise RequestError(f"{option(key)}: missing; must be given with {option('engine')} {name}")
    chosen = defaults | values
    settings = []
    for key, kind in kinds.items():
        value = validated(kind, chosen[key], key=option(key))
        settings.append((key, value))
    return Engine(name, tuple(settings))
