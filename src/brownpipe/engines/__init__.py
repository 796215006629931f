"""The list of engines, and engines with their settings as files, datasets and the command line name them.

A new engine is a package with a `Definition` and its entry in DEFINITIONS. Its simulation is imported when it runs.
"""

from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from typing import NamedTuple

from brownpipe.engines.compiled import KernelCall, seconds_to_compile
from brownpipe.engines.definition import Definition
from brownpipe.engines.exact import EXACT
from brownpipe.engines.forecast import Cost
from brownpipe.engines.langevin import LANGEVIN
from brownpipe.engines.state import Ensemble
from brownpipe.engines.timestep import TIMESTEP
from brownpipe.errors import RequestError
from brownpipe.scene import reading
from brownpipe.scene.reading import Entry
from brownpipe.scene.scene import Scene

DEFINITIONS = {definition.name: definition for definition in (EXACT, TIMESTEP, LANGEVIN)}
TRACER = frozenset({"tracer"})
RECORDS = ("tracer", "all", "events", "none")  # what may be recorded of a run


class Engine(NamedTuple):
    """An engine with a value for each of its settings."""

    name: str
    settings: tuple[tuple[str, object], ...] = ()

    @property
    def definition(self) -> Definition:
        return DEFINITIONS[self.name]

    @property
    def label(self) -> str:
        """The name in folders, datasets and figures, like timestep-0.001-single, without settings at their default."""
        defaults = _defaults(self.definition)
        return "-".join([self.name, *(str(value) for key, value in self.settings if defaults.get(key) != value)])

    @property
    def options(self) -> str:
        """The engine as the value of `brownpipe simulate --engine`, followed by an option for each setting."""
        return " ".join([self.name, *(f"{option(key)} {value}" for key, value in self.settings)])

    def model(self, scenes: Sequence[Scene]) -> str:
        """Return in a few words how the engine models the scenes."""
        return self.definition.model(scenes, dict(self.settings))

    def refuse_unfit(self, scene: Scene, record: Collection[str] = TRACER) -> None:
        """Raise RequestError if the engine cannot run the scene or cannot record `record` of it."""
        self.definition.refuse_unfit(scene, dict(self.settings), frozenset(record))

    def forecast(
        self, scene: Scene, record: Collection[str] = TRACER, observables: Collection[str] = (), average: str = "runs"
    ) -> Cost:
        """Return the forecast for one run of a scene that the engine does not refuse."""
        return self.definition.forecast(scene, dict(self.settings), record, observables, average)

    def seconds_to_compile(self, scene: Scene) -> dict[str, float]:
        """Return the CPU seconds to compile each kernel that has no machine code yet, by its name and types."""
        return seconds_to_compile(self.kernel_calls(scene))

    def kernel_calls(self, scene: Scene) -> list[KernelCall]:
        """Return the calls that compile the kernels for a scene."""
        simulation = import_module(self.definition.simulation)
        return simulation.kernel_calls(scene, **dict(self.settings))

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


def configured(name: str, **settings: object) -> Engine:
    """Return an engine with some settings given, unchecked, and the others at their defaults."""
    definition = DEFINITIONS[name]
    values = _defaults(definition) | settings
    return Engine(name, tuple((key, values[key]) for key in definition.settings))


def _defaults(definition: Definition) -> dict[str, object]:
    """Return the settings that have a default."""
    return {key: setting.default for key, setting in definition.settings.items() if setting.default is not None}


def option(setting: str) -> str:
    """Return the option of the command line for a setting: --time-step for time_step."""
    return f"--{setting.replace('_', '-')}"


def read_engine(entry: Entry) -> Engine:
    """Return the engine of a study: its name, or a mapping with name and settings. Raises RequestError."""
    mapping = entry.value if isinstance(entry.value, dict) else {"name": entry.value}
    name = entry.part("name", mapping.get("name"))
    if "name" not in mapping:
        reading.refuse(name, f"missing; must be given, as in {{name: {next(iter(DEFINITIONS))}}}")
    definition = DEFINITIONS[reading.choice(name, tuple(DEFINITIONS))]
    defaults = _defaults(definition)
    required = tuple(key for key in definition.settings if key not in defaults)
    entries = reading.fields(entry._replace(value=mapping), ("name", *required), defaults)
    settings = tuple((key, setting.read(entries[key])) for key, setting in definition.settings.items())
    return Engine(definition.name, settings)


def recorded(mapping: dict, where: str = "") -> Engine:
    """Return the engine that a file or dataset records as a mapping of name and settings; `where` is for messages.

    A setting that an older file does not record has its `unrecorded` value. Raises RequestError.
    """
    definition = DEFINITIONS.get(str(mapping.get("name")))
    settings = definition.settings if definition else {}
    older = {key: setting.unrecorded for key, setting in settings.items() if setting.unrecorded is not None}
    return read_engine(Entry(older | mapping, where))


def requested(name: str, values: dict[str, object], option: Callable[[str], str] = option) -> Engine:
    """Return the engine that the user asks for; `values` has the settings given.

    `option` returns how a setting is named there: the option of the command line, or the argument in Python.
    Raises RequestError, naming it, for a setting that the engine lacks, that is missing or that is not allowed.
    """
    definition = DEFINITIONS[reading.choice(Entry(name, "", (option("engine"),)), tuple(DEFINITIONS))]
    settings = definition.settings
    defaults = _defaults(definition)
    for key in values.keys() - settings.keys():
        owners = [other.name for other in DEFINITIONS.values() if key in other.settings]
        if not owners:
            own = ", ".join(map(option, settings)) or "no settings"
            raise RequestError(f"{option(key)} {values[key]}: no engine has such a setting; {name} has {own}")
        wrong = f"the {name} engine has no such setting; must go with {' or '.join(owners)}"
        raise RequestError(f"{option(key)} {values[key]}: {wrong}")
    for key in settings.keys() - values.keys() - defaults.keys():
        raise RequestError(f"{option(key)}: missing; must be given with {option('engine')} {name}")
    entries = {key: Entry(value, "", (option(key),)) for key, value in (defaults | values).items()}
    return Engine(name, tuple((key, setting.read(entries[key])) for key, setting in settings.items()))
