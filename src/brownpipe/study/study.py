"""The study: scenes x particle counts x engines x seeds, and how their results are analysed and
shown.

Its fields are the keys of study files, with their bounds.
"""

import json
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    StrictBool,
    ValidationInfo,
    create_model,
    model_validator,
)

from brownpipe import observables as measures
from brownpipe.engines import DEFINITIONS, RECORDS, Engine, forecast, settings_section
from brownpipe.engines.definition import REFERENCE_NAME
from brownpipe.engines.units import rms_speed
from brownpipe.engines.windows import default_windows, times_in_window
from brownpipe.errors import RequestError
from brownpipe.needs import DISPLACEMENTS, FIGURES, SPREADING, RunContents
from brownpipe.observables.average import AVERAGES, average_named
from brownpipe.observables.own import is_own, relative_name
from brownpipe.provenance import digest_of
from brownpipe.scene import Scene, reading
from brownpipe.scene.reading import (
    As,
    AtLeastOne,
    Count,
    Name,
    NotNegative,
    Positive,
    Resolved,
    Section,
    YamlValue,
    choice_of,
    key,
    refuse,
)
from brownpipe.scene.seeds import MOST_SEEDS, Seeds
from brownpipe.scene.variation import Vary, combinations, is_number, scene_with
from brownpipe.storage.configurations import read_scene_file
from brownpipe.text import shell_path

REFERENCE = Engine(REFERENCE_NAME)
# Snakemake plans these in half a minute, and needs 0.03 s of CPU time to start each
MOST_JOBS = 10_000
PERCENTAGE = re.compile(r"[0-9.]+ ?%")
PLAIN = re.compile(r"[\w.,-]{1,40}", re.ASCII)  # a value that may be part of the name of a folder
Item = TypeVar("Item")


def refuse_others(values: Iterable[object], allowed: Iterable[object], *path: str | int) -> None:
    """Refuse, at a path of keys and indices, values that are not among those of the study. For
    the scene "dens" in place of "dense" it says "must be dense, not 'dens'".
    """
    others = [value for value in values if value not in allowed]
    if others:
        refuse(f"must be {' or '.join(map(str, allowed))}, not {others[0]!r}", *path)


def one_or_more(kind: Any, min_length: int = 1) -> Any:
    """Return the type of a list of values that differ; a single value stands for a list of one."""
    schema = kind | Annotated[list[kind], Field(min_length=min_length)]
    length = Field(min_length=min_length)
    listed = BeforeValidator(_as_list, json_schema_input_type=schema)
    return Annotated[tuple[kind, ...], length, AfterValidator(_refuse_repeated), listed]


def _as_list(value: object) -> Sequence[object]:
    return value if isinstance(value, list | tuple) else [value]


def _refuse_repeated(values: tuple[Item, ...]) -> tuple[Item, ...]:
    return values if len({*values}) == len(values) else refuse("must be values that differ")


def _number_of_percentage(value: object) -> object:
    """Return the number that a text like "2%" stands for; other values as they are."""
    if isinstance(value, str) and PERCENTAGE.fullmatch(value):
        return float(value[:-1]) / 100
    return value


def _ascending(window: tuple[float, float]) -> tuple[float, float]:
    t0, t1 = window
    if t0 >= t1:
        refuse(f"must be [t0, t1] with t0 < t1, not {[t0, t1]}")
    return window


def _as_average(value: object) -> object:
    """Return a list of words, of what is averaged over, as the one text that stands for them."""
    return average_named(value) if isinstance(value, list | tuple) else value


def _with_tracer(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return what to record, in the order of RECORDS, and the tracer except with `none`."""
    if words == ("none",):
        return words
    if "none" in words:
        refuse("must be none alone, or others")
    return tuple(word for word in RECORDS if word in {"tracer", *words})


def _own_name(name: str) -> str:
    return name if is_own(name) else refuse("must be my_module:my_function")


Text = Annotated[str, Field(min_length=1)]
NUMBER_OR_PERCENTAGE = BeforeValidator(_number_of_percentage, json_schema_input_type=float | str)
# a relative error
Tolerance = Annotated[float, Field(strict=True, ge=MOST_SEEDS**-0.5, lt=1), NUMBER_OR_PERCENTAGE]
Target = Literal["msd", "d", "displacement_distribution"]
EngineSections = [
    create_model(
        name,
        __base__=settings_section(name),
        scenes=(one_or_more(Text) | None, None),
        seeds=(Seeds | None, None),
    )
    for name in DEFINITIONS
]
EngineSection: Any = Annotated[Union[tuple(EngineSections)], Field(discriminator="name")]  # noqa: UP007  # as many as there are
EngineKey: Any = Annotated[
    EngineSection, reading.alone("name", EngineSection | choice_of(DEFINITIONS))
]
Texts = Annotated[tuple[str, ...], As(one_or_more(Text))]
Counts = Annotated[tuple[int, ...], As(one_or_more(Count))]
Engines = Annotated[tuple[Section, ...], As(one_or_more(EngineKey)), Field(validate_default=True)]
OwnName = Annotated[str, AfterValidator(_own_name), Field(json_schema_extra={"pattern": ".:."})]
Measure: Any = choice_of(measures.OBSERVABLES) | OwnName
Observables = Annotated[tuple[str, ...], As(one_or_more(Measure, min_length=0))]
Average = Annotated[
    str,
    As(choice_of(AVERAGES)),
    BeforeValidator(
        _as_average,
        json_schema_input_type=choice_of(AVERAGES) | list[Literal["origins", "disks"]],
    ),
]
Recorded: Any = Annotated[one_or_more(choice_of(RECORDS)), AfterValidator(_with_tracer)]
Record = Annotated[tuple[str, ...], As(Recorded)]
Figures = Annotated[tuple[str, ...], As(one_or_more(choice_of(FIGURES)))]
Times = Annotated[tuple[float, ...], As(one_or_more(Positive, min_length=0))]
Window = Annotated[tuple[NotNegative, NotNegative], AfterValidator(_ascending)]
Windows = Annotated[tuple[Window, ...], Field(min_length=1), AfterValidator(_refuse_repeated)]
Substitutes = dict[str, Annotated[tuple[str, ...], As(one_or_more(Text))]]


class EngineUse(NamedTuple):
    """An engine in one of the cases of a study."""

    engine: Engine
    case: Scene
    seeds: Sequence[int] | None  # None: the seeds of the study


class Rings(Section):
    """The rings of the displacement distribution; runs beyond the last one are counted too."""

    dr: Positive = key("their width [length]")
    count: Annotated[AtLeastOne, Field(le=100_000)] = key("their number")


class Study(Section):
    """What is simulated, with which seeds, and how it is analysed. Read by `read_study`."""

    scenes: Texts = key("scene files, relative to the folder of the study file")
    particles: Counts | None = key(
        "numbers of disks; every scene is run with each (default: its own)", None
    )
    vary: Vary = key(
        "keys of the scenes, such as disks.tracer.mass, and their values: a list, or from, to, "
        "count",
        {},
    )
    vary_together: StrictBool = key(
        "first values of all keys, then second ones, ...; not all combinations", False
    )
    shown_particles: Count | None = key(
        "the number of disks in figures of a single one (default: the largest)", None
    )
    engines: Engines = key("engines, with their settings if any", (REFERENCE_NAME,))
    seeds: Resolved[Seeds] = key(
        "a count (2400: seeds 0 to 2399), a range (100-199), or a list of both", None
    )
    tolerance: Tolerance | None = key(
        "in place of seeds: relative standard error of the target", None
    )
    target: Target = key("the quantity that the tolerance refers to", "msd")
    batch: AtLeastOne | Literal["auto"] = key(
        "seeds per job; auto: from the forecast; results are the same", "auto"
    )
    record: Record = key(
        "trajectory of the tracer, its velocity, tracks of all disks, collisions (events); none: "
        "only the observables",
        ("tracer",),
    )
    observables: Observables = key("quantities measured in each run, from all of its disks", ())
    average: Average = key(
        "average over runs alone, or in each run also over time origins, over disks equal to the "
        "tracer, or both, [origins, disks]",
        "runs",
    )
    title: Text | None = key("of the study, above its answer and its page", None)
    note: Text | None = key("what the study is about, at the top of its page", None)
    figures: Resolved[Figures] = key(
        "figures to draw (default: all that the study has data for)", None
    )
    panel: Texts = key(
        "scene, particles, engine, varied keys: what differs in them is drawn in panels of its own",
        (),
    )
    displacement_times: Times = key(
        "times of the displacement distribution (default: the end of each run)", ()
    )
    fit_windows: Resolved[Windows] = key(
        "[t0, t1] in which lines are fitted to the MSD [time]", None
    )
    rings: Rings | None = key("of the displacement distribution (default: from the data)", None)
    instead_of: Substitutes = key(
        "scenes that may be run in place of others, for brownpipe tradeoff", {}
    )
    allow_failed: Count = key("runs of the study that may fail", 0)
    # no keys: what is read with them
    _name: str = PrivateAttr()
    _cases: tuple[Scene, ...] = PrivateAttr()
    _varied: dict[str, tuple[Path, dict[str, YamlValue]]] = PrivateAttr()
    _uses: tuple[EngineUse, ...] = PrivateAttr()

    @property
    def name(self) -> str:
        """The stem of the study file, with the keys that were replaced."""
        return self._name

    @property
    def cases(self) -> tuple[Scene, ...]:
        """Each scene with each combination of varied keys and each particle count."""
        return self._cases

    @property
    def scene_files(self) -> list[Path]:
        """The paths of the scene files."""
        files = [path for path, values in self.varied.values()]
        return [*dict.fromkeys(files)]

    @property
    def varied(self) -> dict[str, tuple[Path, dict[str, YamlValue]]]:
        """Scene file and values of varied keys, by the scene's name."""
        return self._varied

    @property
    def uses(self) -> tuple[EngineUse, ...]:
        """The engines, case by case."""
        return self._uses

    def engines_of(self, case: Scene) -> list[Engine]:
        """Return the engines of a case, in their order."""
        return [use.engine for use in self.uses if use.case is case]

    def with_uses(self, uses: Sequence[EngineUse]) -> "Study":
        """Return the study with other uses of engines."""
        study = self.model_copy()
        study._uses = tuple(uses)
        return study

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> "Study":
        if info.context is None:
            raise TypeError("a study is read from a file, by read_study")
        self._name, folder = info.context
        observables = tuple(relative_name(folder, observable) for observable in self.observables)
        self._resolve(observables=observables)
        self._read_scenes(folder)
        self._read_engines()
        self._check_seeds()
        self._check_analysis()
        self._check_figures()
        self._check_substitutes()
        return self

    def _read_scenes(self, folder: Path) -> None:
        """Read every scene with all values of varied keys and every particle count, or with its
        own.
        """
        stems: set[str] = set()
        cases: list[Scene] = []
        varied: dict[str, tuple[Path, dict[str, YamlValue]]] = {}
        counts = self.particles or (None,)
        for k, text in enumerate(self.scenes):
            stem = Path(text).stem
            if stem in stems:
                message = f"must be a scene with a name (file stem) of its own, not {text!r}"
                refuse(message, "scenes", k)
            stems.add(stem)
            path = folder / text
            try:
                mapping = read_scene_file(path)
                for values in combinations(self.vary, self.vary_together):
                    sizes = [scene_with(mapping, str(path), values, count) for count in counts]
                    cases += sizes
                    varied[sizes[0].name] = path, values
            except RequestError as error:
                place = ("vary",) if self.vary else ("scenes", k)
                refuse(str(error).removeprefix("vary: "), *place)
        self._cases = tuple(cases)
        self._varied = varied

    def _read_engines(self) -> None:
        """Read the engines, each fit for its scenes; none with the same settings runs a case
        twice.
        """
        uses: list[EngineUse] = []
        for k, entry in enumerate(self.engines):
            keys = dict(entry)
            name = keys.pop("name")
            seeds = keys.pop("seeds")
            scenes = keys.pop("scenes") or tuple(self.varied)
            refuse_others(scenes, self.varied, "engines", k, "scenes")
            engine = Engine(name, tuple(keys.items()))
            for case in self.cases:
                if case.name not in scenes:
                    continue
                try:
                    engine.refuse_unfit(case, self.record)
                    engine.refuse_observables(case, self.observables)
                except RequestError as error:
                    refuse(str(error), "engines", k)
                if any(use.engine == engine and use.case is case for use in uses):
                    refuse("must be engines or settings that differ", "engines")
                uses.append(EngineUse(engine, case, seeds))
        by_case: list[EngineUse] = []
        for case in self.cases:
            by_case += [use for use in uses if use.case is case]
        self._uses = tuple(by_case)

    def _check_seeds(self) -> None:
        """A study has seeds, or a tolerance that says how many.

        Until that is known, their number is that for a standard deviation equal to the mean, as r^2
        has it.
        """
        has_seeds = "seeds" in self.model_fields_set
        if has_seeds == (self.tolerance is not None):
            refuse("must be given, or a tolerance in their place; not both", "seeds")
        if self.tolerance is not None:
            reason = why_no_relative_error(self.cases)
            if reason:
                refuse(f"{reason}; must be seeds: 1", "tolerance")
            reason = why_target_is_not_planned(self.target, self.cases)
            if reason:
                refuse(f"{reason}; must be msd", "target")
            self._resolve(seeds=range(math.ceil(self.tolerance**-2)))
        sizes = [len(use.seeds or self.seeds) for use in self.uses]
        for use, size in zip(self.uses, sizes, strict=True):
            if use.case.has_one_state and size > 1:
                refuse(_repetition(use.case.name, size), "seeds")
        if self.batch == "auto":
            return
        jobs = sum(math.ceil(size / self.batch) for size in sizes)
        if jobs > MOST_JOBS:
            message = f"must be large enough for at most {MOST_JOBS} jobs ({jobs} with this one)"
            refuse(message, "batch")

    def _check_figures(self) -> None:
        """Refuse figures and settings without data; by default there are all figures whose needs
        are met.
        """
        runs = self._contents_of_runs()
        for name, need in (
            ("fit_windows", SPREADING),
            ("rings", DISPLACEMENTS),
            ("displacement_times", DISPLACEMENTS),
        ):
            if name in self.model_fields_set and not need.is_met(runs):
                refuse(f"must go with {need.text}", name)
        unmet = {}
        for name, needs in FIGURES.items():
            unmet[name] = [need.text for need in needs if not need.is_met(runs)]
        for name in self.figures or ():
            if unmet[name]:
                refuse(f"{name} needs {unmet[name][0]}", "figures")
        drawable = tuple(name for name in FIGURES if not unmet[name])
        self._resolve(figures=self.figures or drawable)
        counts = sorted({case.particles for case in self.cases})
        refuse_others(self.panel, ("scene", "particles", "engine", *self.vary), "panel")
        refuse_others({self.shown_particles} - {None}, counts, "shown_particles")

    def _contents_of_runs(self) -> RunContents:
        """Return what the runs have of what figures and settings may need."""
        moves_all = any(use.engine.moves_all_disks for use in self.uses)
        measured = self.observables if moves_all else measures.tracer_observables(self.observables)
        counts_collisions = any(
            use.case.particles and use.engine.moves_all_disks for use in self.uses
        )
        return RunContents(
            observables=frozenset(measured),
            has_own_observable=any(map(is_own, measured)),
            has_disks=any(case.particles for case in self.cases),
            records_tracer="tracer" in self.record,
            averages_over_runs=self.average == "runs",
            counts_collisions=counts_collisions,
            has_walls=any(case.box.has_walls for case in self.cases),
            is_scan=self._is_scan(),
        )

    def _is_scan(self) -> bool:
        """Return whether the cases differ in a number that a figure can have as its axis: particle
        count or varied key.
        """
        counts = {case.particles for case in self.cases} - {0}
        if len(counts) > 1:
            return True
        axes = [*self.vary.values()]
        if self.vary_together:  # the first key alone is the axis
            axes = axes[:1]
        return any(len(values) > 1 and all(map(is_number, values)) for values in axes)

    def _check_analysis(self) -> None:
        """Refuse what cannot be measured, windows with fewer than three samples, and times that are
        no sample times.
        """
        for case in self.cases:
            for wrong, why in measures.problems(case, self.observables, self.average):
                refuse(f"{case.title}: {why}", wrong)
            for k, (t0, t1) in enumerate(self.fit_windows or ()):
                samples = np.count_nonzero(times_in_window(case.times, (t0, t1)))
                if t1 > case.duration or samples < 3:
                    limits = f"t0 < t1 <= {case.duration!r}"
                    allowed = f"{limits} and three samples or more of {case.name}"
                    refuse(f"must be [t0, t1] with {allowed}, not {[t0, t1]}", "fit_windows", k)
        self._resolve(fit_windows=self.fit_windows or default_windows(self.cases, self.average))
        for k, time in enumerate(self.displacement_times):
            matches = [np.isclose(case.times, time, rtol=1e-9, atol=0.0) for case in self.cases]
            if not any(match.any() for match in matches):
                message = f"must be a sample time of some scene, not {time!r}"
                refuse(message, "displacement_times", k)

    def _check_substitutes(self) -> None:
        """Refuse scenes in place of others that do not have their sample times."""
        by_name = {case.name: case for case in self.cases}
        for scene, names in self.instead_of.items():
            refuse_others((scene, *names), by_name, "instead_of", scene)
            times = by_name[scene].times
            for name in names:
                if name == scene or not np.array_equal(by_name[name].times, times):
                    message = f"must be other scenes with the sample times of {scene}"
                    refuse(message, "instead_of", scene)

    @property
    def asked_windows(self) -> Windows | None:
        """The fit windows of the analysis; None for those that it chooses from the runs.

        A tolerance of D is planned, and then stated, in the first window known before any run.
        """
        is_planned = self.tolerance is not None and self.target == "d"
        return self.fit_windows if "fit_windows" in self.model_fields_set or is_planned else None

    @property
    def recording(self) -> tuple[set[str], tuple[str, ...], str]:
        """What each run records, what it measures, and the average: the last arguments of
        `Engine.forecast`.
        """
        return {*self.record}, self.observables, self.average

    @property
    def compared_cases(self) -> list[Scene]:
        """The cases with exact runs and others to compare with them."""
        exact = [use.case for use in self.uses if use.engine == REFERENCE]
        approximate = [use.case for use in self.uses if use.engine != REFERENCE]
        replaced = [use.case for use in self.uses if use.case.name in self.instead_of]
        compared = [*approximate, *replaced]
        return [case for case in exact if case in compared]

    def refuse_tradeoff(self) -> None:
        """Raise RequestError for a study whose runs cannot be compared with exact ones."""
        exact = [use.case for use in self.uses if use.engine == REFERENCE]
        fewest = min(len(use.seeds or self.seeds) for use in self.uses)
        lacks_exact = len(exact) < len(self.cases)
        if "tracer" not in self.record or fewest < 2 or lacks_exact or not self.compared_cases:
            raise RequestError(
                f"the study {self.name}: has no trade-off; must have record: tracer, two seeds or "
                "more, the engine exact in every case, and another one"
            )


def why_no_relative_error(scenes: Sequence[Scene]) -> str | None:
    """Return why a relative error is undefined in one of the scenes; None if it is defined in
    all.
    """
    for scene in scenes:
        if scene.has_one_state or rms_speed(scene) == 0.0:
            return f"{scene.name} leaves nothing to chance"
    return None


def why_target_is_not_planned(target: str, scenes: Sequence[Scene]) -> str | None:
    """Return why no number of runs is planned for a target: for D where walls make the motion along
    x and y differ, and a quarter of the slope is the D of no axis; None if it is.
    """
    for scene in scenes:
        if target != "d" or not scene.box.axes_differ:
            continue
        if scene.box.is_channel:
            return f"{scene.title} is a channel, whose D is along it and not planned"
        return f"{scene.title} has walls of unequal lengths, and D along each, not planned"
    return None


def forecast_of_runs(
    engine: Engine,
    scene: Scene,
    seeds: Sequence[int],
    record: Collection[str],
    names: tuple[str, ...],
    average: str,
) -> forecast.Cost:
    """Return the forecast of one of these runs, before any is made.

    Raises RequestError for runs that would be identical, an engine, record, observable or average
    that does not fit the scene, and for more runs than this machine can hold.
    """
    if scene.has_one_state and len(seeds) > 1:
        raise RequestError(f"seeds: {_repetition(scene.name, len(seeds))}")
    measures.refuse_unfit_observables(scene, names, average)
    engine.refuse_unfit(scene, record)
    engine.refuse_observables(scene, names)
    cost = engine.forecast(scene, record, names, average)
    forecast.refuse_too_large(scene, len(seeds), cost)
    return cost


def _repetition(name: str, runs: int) -> str:
    return (
        f"must be one seed, as the disks of {name} have given velocities and leave nothing to "
        f"chance; found {runs}"
    )


def read_keys(path: str | Path, overrides: Mapping[str, YamlValue]) -> reading.Document:
    """Return the keys given in a study file, as far as `overrides` does not replace them.

    Seeds also replace a tolerance, and a tolerance the seeds. Raises RequestError if it is no
    study.
    """
    mapping = reading.read_yaml(path)
    if "scenes" not in mapping and "box" in mapping:
        cure = f"run it with brownpipe simulate {shell_path(path)}, or list it in a study"
        raise RequestError(f"{path}: is a scene, not a study; {cure}")
    replaced: dict[str, YamlValue] = {}
    if overrides.get("seeds") or overrides.get("tolerance"):
        replaced = {"seeds": None, "tolerance": None}
    replaced |= overrides
    return reading.with_values(mapping, replaced)


def read_study(path: str | Path, overrides: Mapping[str, YamlValue] | None = None) -> Study:
    """Return the study in a YAML file; paths of scenes are relative to the folder of that file.

    `overrides` as in `read_keys`. Raises RequestError, one line, for any mistake in the study, or
    in any of its scenes with any of its particle counts.
    """
    overrides = overrides or {}
    mapping = read_keys(path, overrides)
    name = reading.validated(Name, Path(path).stem, str(path), "name")
    for replaced, value in sorted(overrides.items()):  # the results then have a folder of their own
        text = value if isinstance(value, str) else json.dumps(value)
        word = text if PLAIN.fullmatch(text) else digest_of(text)
        name += f"+{replaced}={word}"
    return reading.validated(Study, mapping, str(path), context=(name, Path(path).parent))
