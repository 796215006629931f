"""The engines there are: what can be set of each, how it is asked for, and where it may be used.

An engine is the module or package of its name, with
`simulate(scene, seeds, record, observables=(), average="runs", **settings) -> Ensemble`. It is imported when it is run.
"""

from importlib import import_module
from typing import NamedTuple

from brownpipe import reading
from brownpipe.reading import Entry, SceneError


def _time_step(entry: Entry) -> float:
    return reading.number(entry, above=0)


def _precision(entry: Entry) -> str:
    return reading.choice(entry, ("double", "single"))


def _collisions(entry: Entry) -> str:
    return reading.choice(entry, ("at_contact", "late"))


def _friction(entry: Entry) -> str:
    return reading.choice(entry, ("enskog", "boltzmann", "measured"))


ENGINES = {  # name: {setting: how an Entry of it is read}
    "exact": {},
    "timestep": {"time_step": _time_step, "precision": _precision, "collisions": _collisions},
    "langevin": {"friction": _friction},
}
USUAL = {"precision": "double", "collisions": "at_contact"}  # settings that need not be given


class Engine(NamedTuple):
    """An engine and its settings, all of them."""

    name: str
    settings: tuple[tuple[str, object], ...] = ()

    @property
    def label(self) -> str:
        """Its folder: the name, followed by the settings that are not the usual ones."""
        return "-".join([self.name, *(str(value) for key, value in self.settings if USUAL.get(key) != value)])

    @property
    def words(self) -> str:
        """Name and settings in the words of `brownpipe simulate --engine`."""
        return " ".join([self.name, *(f"{option(key)} {value}" for key, value in self.settings)])

    def simulate(self, scene, seeds, record, *more, observables=(), average="runs"):
        """Run a scene once for every seed; `more` is what this engine alone takes."""
        measures = {"observables": observables, "average": average}
        return import_module(f"brownpipe.{self.name}").simulate(
            scene, seeds, record, *more, **measures, **dict(self.settings)
        )


def option(setting: str) -> str:
    """Return the option of the command line for a setting: time_step is --time-step."""
    return f"--{setting.replace('_', '-')}"


def read_engine(entry: Entry) -> Engine:
    """Return the engine of a study: its name, or a mapping with name and settings. Raises SceneError."""
    mapping = entry.value if isinstance(entry.value, dict) else {"name": entry.value}
    which = Entry(mapping.get("name"), entry.file, (*entry.path, "name"))
    settings = ENGINES[reading.choice(which, tuple(ENGINES))]
    needed = tuple(key for key in settings if key not in USUAL)
    usual = {key: USUAL[key] for key in settings if key in USUAL}
    given = reading.fields(Entry(mapping, entry.file, entry.path), ("name", *needed), usual)
    return Engine(which.value, tuple((key, read(given[key])) for key, read in settings.items()))


def recorded(mapping: dict, where: str = "") -> Engine:
    """Return the engine that a file or a dataset names. Where time steps do not say how they collide, it was late."""
    before = {"collisions": "late"} if mapping.get("name") == "timestep" else {}
    return read_engine(Entry(before | mapping, where))


def asked_for(name: str, given: dict[str, object]) -> Engine:
    """Return the engine of a command line; `given` has a value for each setting that was given.

    Raises SceneError, naming the option, for one that the engine lacks, one that is missing and one that is wrong.
    """
    settings = ENGINES[reading.choice(Entry(name, "", ("--engine",)), tuple(ENGINES))]
    for key in given.keys() - settings.keys():
        owners = " or ".join(engine for engine in ENGINES if key in ENGINES[engine])
        raise SceneError(f"{option(key)} {given[key]}: the {name} engine has no such setting; must go with {owners}")
    for key in settings.keys() - given.keys() - USUAL.keys():
        raise SceneError(f"{option(key)}: missing; must be given with --engine {name}")
    values = USUAL | given
    return Engine(name, tuple((key, read(Entry(values[key], "", (option(key),)))) for key, read in settings.items()))


def refuse_unfit(engine: Engine, scene, record=frozenset({"tracer"})) -> None:
    """Raise SceneError if the engine cannot do the scene, or not record what is asked for."""
    if engine.name == "langevin":
        from brownpipe import friction

        friction.refuse_unfit(scene, dict(engine.settings)["friction"], record)
    if engine.name == "timestep":
        from brownpipe.timestep.setup import refuse_bad_step

        refuse_bad_step(scene, **dict(engine.settings))
        if "events" in record:
            raise SceneError(
                "--record events: the timestep engine knows no instants of collisions; must be tracer or all"
            )
