"""The list of engines, and engines with their settings as files, datasets and the command line name
them.

A new engine is a package with a `Definition` and its entry in DEFINITIONS. Its simulation is
imported when it runs. A user's own `Definition` may be passed in Python: files of its runs describe
it as an `OwnEngine`, and are read without it.
"""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import Any, Literal, NamedTuple, get_type_hints

from pydantic import create_model

from brownpipe.engines.definition import (
    BatchCheckpoints,
    Definition,
    OwnEngine,
    SettingsRecord,
    Simulation,
    refuse_name,
)
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.exact import EXACT
from brownpipe.engines.forecast import Cost
from brownpipe.engines.langevin import LANGEVIN
from brownpipe.engines.timestep import TIMESTEP
from brownpipe.errors import RequestError
from brownpipe.observables import needs_events, own, tracer_observables
from brownpipe.provenance import module_of
from brownpipe.scene.reading import Section, YamlValue, choice_of, validated
from brownpipe.scene.scene import Scene

DEFINITIONS = {definition.name: definition for definition in (EXACT, TIMESTEP, LANGEVIN)}
TRACER = frozenset({"tracer"})
# by engine, the definitions that a user has passed; none is ever removed
_own_definitions: dict["Engine", Definition] = {}
RECORDS = ("tracer", "all", "events", "velocity", "none")  # what may be recorded of a run


class Engine(NamedTuple):
    """An engine with a value for each of its settings."""

    name: str
    settings: tuple[tuple[str, YamlValue], ...] = ()
    own: OwnEngine | None = None  # of a user's own engine

    @property
    def definition(self) -> Definition:
        """Raises RequestError for a user's own engine that has not been passed in this process."""
        if self.own is None:
            return DEFINITIONS[self.name]
        if self in _own_definitions:
            return _own_definitions[self]
        raise RequestError(
            f"{self.name}: is an engine of module {self.own.module}, which this needs; only "
            "brownpipe.simulate takes it: engine=..."
        )

    @property
    def moves_all_disks(self) -> bool:
        """Whether it moves all disks, and not the tracer alone."""
        return self.definition.moves_all_disks if self.own is None else self.own.moves_all_disks

    @property
    def label(self) -> str:
        """The name in folders, datasets and figures, like timestep-0.001-collisions=late: the
        settings that must be given, in their order, then those not at their default by name; of a
        user's own engine all by name, as its defaults may not be known.

        Engines with different settings have different labels.
        """
        if self.own is not None:
            return "-".join([self.name, *(f"{key}={value}" for key, value in self.settings)])
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
        setting; a user's own engine with its module and the digest of that, in brackets.
        """
        if self.own is not None:
            values = [self.name, *(f"{key}={value}" for key, value in self.settings)]
            return f"{' '.join(values)} [{self.own.module} {self.own.source[:12]}]"
        settings = [f"{option(key)} {value}" for key, value in self.settings]
        return " ".join([self.name, *settings])

    @property
    def values(self) -> SettingsRecord:
        """The settings as the engine's own record."""
        record = self.definition.settings
        values = dict(self.settings)
        return record._make(values[field] for field in record._fields)

    def model(self, scenes: Sequence[Scene]) -> str:
        """Return in a few words how the engine models the scenes."""
        return self.definition.model(scenes, self.values)

    def cautions(self, scene: Scene, observables: Collection[str] = ()) -> list[str]:
        """Return a line on the limits of the results in a scene, one on disks that are pushed
        apart, and one on observables that are not measured.
        """
        from brownpipe.engines.start.initial_state import separation_in_words  # imports Numba

        remarks = (self.definition.caution(scene), separation_in_words(scene))
        lines = [remark for remark in remarks if remark]
        lacking = set(observables) - set(tracer_observables(observables))
        if lacking and not self.moves_all_disks:
            names = ", ".join(sorted(map(own.title_of, lacking)))
            lines.append(f"{self.name} moves the tracer alone, and does not measure {names}")
        return lines

    def refuse_unfit(self, scene: Scene, record: Collection[str] = TRACER) -> None:
        """Raise RequestError if the engine cannot run the scene or cannot record `record` of it."""
        self.definition.refuse_unfit(scene, self.values, frozenset(record))

    def refuse_observables(self, scene: Scene, names: Collection[str]) -> None:
        """Raise RequestError if some of these observables need collisions, and the engine cannot
        record them.
        """
        for name in names:
            if not needs_events([name]):
                continue
            try:
                self.refuse_unfit(scene, {"events"})
            except RequestError as error:
                raise RequestError(f"{name} needs collisions: {error}") from None

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
        observables: Collection[str] = (),
        average: str = "runs",
        checkpoints: BatchCheckpoints | None = None,
    ) -> Ensemble:
        """Run a scene once for every seed; `checkpoints` are for an engine that keeps them.

        Raises RequestError for a user's own engine that has not been passed, or that returns
        anything else than an ensemble of the seeds.
        """
        simulation = self.definition.simulation
        if isinstance(simulation, str):
            simulation = _simulation_in(simulation)
        options: dict[str, object] = dict(self.settings)
        if checkpoints is not None:
            options["checkpoints"] = checkpoints
        ensemble = simulation(
            scene, seeds, record, observables=observables, average=average, **options
        )
        if not isinstance(ensemble, Ensemble) or [*ensemble.seeds] != [*seeds]:
            raise RequestError(f"engine: {self.name}: must return an Ensemble with a run per seed")
        return ensemble


def _simulation_in(module: str) -> Simulation:
    """Return the function `simulate` of a module, which is imported."""
    return import_module(module).simulate


def read_record(text: str, option: str) -> frozenset[str]:
    """Return what to record: names of RECORDS, separated by commas, and the tracer except with
    `none`.

    Raises RequestError, naming `option`, for other names.
    """
    names = frozenset(text.split(","))
    is_contradictory = "none" in names and len(names) > 1
    if is_contradictory or not names <= set(RECORDS):
        combined = ", ".join(name for name in RECORDS if name != "none")
        allowed = f"none, or one or several of {combined}, with commas"
        raise RequestError(f"{option}: must be {allowed}, not {text!r}")
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


def engine_of_record(
    name: str, settings: Mapping[str, YamlValue], own: OwnEngine | None = None
) -> Engine:
    """Return the engine that a file records by name and settings.

    A user's own engine, which the file describes by `own`, need not be there. Raises RequestError.
    """
    if own is not None:
        return Engine(name, tuple(sorted(settings.items())), own)
    validated(choice_of(DEFINITIONS), name, key="name")
    record = validated(settings_section(name), {"name": name, **settings})
    values = tuple((key, value) for key, value in record if key != "name")
    return Engine(name, values)


def engine_of_request(
    engine: str | Definition,
    values: Mapping[str, object],
    option: Callable[[str], str] = option,
) -> Engine:
    """Return the engine that the user asks for, by name or as a definition of her own; `values` has
    the settings given.

    `option` returns how a setting is named there: the option of the command line, or the argument
    in Python. Raises RequestError, naming it, for a setting that the engine lacks, that is missing
    or that is not allowed.
    """
    if isinstance(engine, Definition):
        refuse_name(engine, DEFINITIONS)
        definition = engine
    else:
        name = validated(choice_of(DEFINITIONS), engine, key=option("engine"))
        definition = DEFINITIONS[name]
    settings = _chosen_settings(definition, values, option)
    if definition.name in DEFINITIONS:
        return Engine(definition.name, settings)
    chosen = Engine(definition.name, tuple(sorted(settings)), _own_engine(definition))
    _own_definitions[chosen] = definition
    return chosen


def _chosen_settings(
    definition: Definition, values: Mapping[str, object], option: Callable[[str], str]
) -> tuple[tuple[str, YamlValue], ...]:
    """Return a value for each setting of an engine: that in `values`, or its default."""
    kinds = get_type_hints(definition.settings, include_extras=True)
    defaults = definition.settings._field_defaults
    for key in values.keys() - kinds.keys():
        owners = [other.name for other in DEFINITIONS.values() if key in other.settings._fields]
        reason = f"the {definition.name} engine has no such setting"
        if owners:
            reason = f"{reason}; must go with {' or '.join(owners)}"
        raise RequestError(f"{option(key)} {values[key]}: {reason}")
    for key in kinds.keys() - values.keys() - defaults.keys():
        with_engine = f"{option('engine')} {definition.name}"
        raise RequestError(f"{option(key)}: missing; must be given with {with_engine}")
    chosen = {**defaults, **values}
    settings = []
    for key, kind in kinds.items():
        value = validated(kind, chosen[key], key=option(key))
        settings.append((key, value))
    return tuple(settings)


@cache  # the file as it is when the engine is passed first
def _own_engine(definition: Definition) -> OwnEngine:
    """Return what files record of a user's engine; its source is a random number if it has no file,
    as in a notebook.
    """
    module, source = module_of(definition.simulation)
    return OwnEngine(module, source or os.urandom(32).hex(), definition.moves_all_disks)
