"""The engines there are, and how one of them is asked for with its settings.

A new engine is a package with a `Definition`, listed in DEFINITIONS. Its simulation is imported when it runs.
"""

from importlib import import_module
from typing import NamedTuple

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

DEFINITIONS = {one.name: one for one in (EXACT, TIMESTEP, LANGEVIN)}


class Engine(NamedTuple):
    """An engine and its settings, all of them."""

    name: str
    settings: tuple[tuple[str, object], ...] = ()

    @property
    def definition(self) -> Definition:
        return DEFINITIONS[self.name]

    @property
    def label(self) -> str:
        """Its name in folders, datasets and figures: the engine, and the settings that are not the defaults."""
        defaults = _defaults(self.definition)
        return "-".join([self.name, *(str(value) for key, value in self.settings if defaults.get(key) != value)])

    @property
    def options(self) -> str:
        """Name and settings as the value of `brownpipe simulate --engine` and the options after it."""
        return " ".join([self.name, *(f"{option(key)} {value}" for key, value in self.settings)])

    @property
    def model(self):
        """The function from scenes to what is modelled of them, in words."""
        return lambda scenes: self.definition.model(scenes, dict(self.settings))

    def refuse_unfit(self, scene: Scene, record=frozenset({"tracer"})) -> None:
        """Raise RequestError if the engine cannot run the scene, or not record what is asked for."""
        self.definition.refuse_unfit(scene, dict(self.settings), frozenset(record))

    def forecast(self, scene: Scene, record=frozenset({"tracer"}), observables=(), average: str = "runs") -> Cost:
        """Return what one run of a scene that the engine is fit for is expected to cost."""
        return self.definition.forecast(scene, dict(self.settings), record, observables, average)

    def simulate(self, scene: Scene, seeds, record, *more, observables=(), average: str = "runs") -> Ensemble:
        """Run a scene once for every seed; `more` is what this engine alone takes."""
        simulation = import_module(self.definition.simulation)
        measures = {"observables": observables, "average": average}
        return simulation.simulate(scene, seeds, record, *more, **measures, **dict(self.settings))


def configured(name: str, **settings) -> Engine:
    """Return an engine with some of its settings, the others by default, without checking them."""
    definition = DEFINITIONS[name]
    values = _defaults(definition) | settings
    return Engine(name, tuple((key, values[key]) for key in definition.settings))


def _defaults(definition: Definition) -> dict[str, object]:
    return {key: one.default for key, one in definition.settings.items() if one.default is not None}


def option(setting: str) -> str:
    """Return the option of the command line for a setting: time_step is --time-step."""
    return f"--{setting.replace('_', '-')}"


def read_engine(entry: Entry) -> Engine:
    """Return the engine of a study: its name, or a mapping with name and settings. Raises RequestError."""
    mapping = entry.value if isinstance(entry.value, dict) else {"name": entry.value}
    which = Entry(mapping.get("name"), entry.file, (*entry.path, "name"))
    definition = DEFINITIONS[reading.choice(which, tuple(DEFINITIONS))]
    defaults = _defaults(definition)
    needed = tuple(key for key in definition.settings if key not in defaults)
    given = reading.fields(Entry(mapping, entry.file, entry.path), ("name", *needed), defaults)
    return Engine(which.value, tuple((key, one.read(given[key])) for key, one in definition.settings.items()))


def recorded(mapping: dict, where: str = "") -> Engine:
    """Return the engine that a file or a dataset names. Where time steps do not say how they collide, it was late."""
    before = {"collisions": "late"} if mapping.get("name") == "timestep" else {}
    return read_engine(Entry(before | mapping, where))


def requested(name: str, given: dict[str, object]) -> Engine:
    """Return the engine of a command line; `given` has a value for each setting that was given.

    Raises RequestError, naming the option, for one that the engine lacks, one that is missing and one that is wrong.
    """
    definition = DEFINITIONS[reading.choice(Entry(name, "", ("--engine",)), tuple(DEFINITIONS))]
    settings, defaults = definition.settings, _defaults(definition)
    for key in given.keys() - settings.keys():
        owners = " or ".join(one.name for one in DEFINITIONS.values() if key in one.settings)
        raise RequestError(f"{option(key)} {given[key]}: the {name} engine has no such setting; must go with {owners}")
    for key in settings.keys() - given.keys() - defaults.keys():
        raise RequestError(f"{option(key)}: missing; must be given with --engine {name}")
    values = defaults | given
    return Engine(name, tuple((key, one.read(Entry(values[key], "", (option(key),)))) for key, one in settings.items()))
