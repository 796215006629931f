"""The study: scenes x particle counts x engines x seeds, and how their results are analysed and shown.

Its fields are the keys of study files, with their bounds.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    PrivateAttr,
    Tag,
    ValidationInfo,
    create_model,
    model_validator,
)

from brownpipe import observables as measures
from brownpipe.engines import DEFINITIONS, Engine, settings_of
from brownpipe.engines.exact import EXACT
from brownpipe.engines.units import rms_speed
from brownpipe.errors import RequestError
from brownpipe.figures.catalogue import COLLISIONS, FIGURES, FOLLOWED, SEVERAL_COUNTS, SPREADING, TRACKED
from brownpipe.scene import Scene, parse_scene
from brownpipe.scene.reading import As, Count, NotNegative, Positive, Record, key, refuse, shown
from brownpipe.scene.sample_times import default_fit_windows
from brownpipe.scene.seeds import MOST_SEEDS, Seeds, batches
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study.batches import automatic_batches

REFERENCE = Engine(EXACT.name)  # without bias: all other engines are compared with it
SMALLEST_TOLERANCE = MOST_SEEDS**-0.5  # a relative error
MOST_RINGS = 100_000
MOST_JOBS = 10_000  # Snakemake plans these in half a minute, and needs 0.03 s of CPU time to start each
PERCENTAGE = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?%")
TARGETS = ("msd", "d", "displacement_distribution")  # quantities that a tolerance can be given for


def one_or_more(kind: Any, least: int = 1) -> Any:
    """Return the type of a list of values; a single value stands for a list of one."""
    listed = BeforeValidator(
        lambda value: value if isinstance(value, list | tuple) else [value],
        json_schema_input_type=kind | Annotated[list[kind], Field(min_length=least)],
    )
    return Annotated[tuple[kind, ...], Field(min_length=least), listed]


def _relative(value: Any) -> float:
    """Return a relative error: a number, or a text like "2%"."""
    text = PERCENTAGE.fullmatch(value) if isinstance(value, str) else None
    number = float(text[1]) / 100 if text else value
    if isinstance(number, bool) or not isinstance(number, int | float) or not SMALLEST_TOLERANCE <= number < 1:
        allowed = f"a relative error from {SMALLEST_TOLERANCE:.2g} to below 1, like 0.02 or 2%"
        refuse(f"must be {allowed}, not {shown(value)}")
    return float(number)


def _engine_name(value: Any) -> str:
    return f"{{{value.get('name', 'null') if isinstance(value, dict) else value}}}"


def _engine_kind(name: str) -> Any:
    """Return the type of an engine of a study: its name, its settings, the scenes it is used in and its seeds."""
    keys: dict[str, Any] = {"scenes": (one_or_more(Text) | None, None), "seeds": (Seeds | None, None)}
    record = create_model(name, __base__=settings_of(name), **keys)
    named = BeforeValidator(
        lambda value: {"name": value} if isinstance(value, str) else value,
        json_schema_input_type=record | Literal[name],
    )
    return Annotated[record, named, Tag(f"{{{name}}}")]


Text = Annotated[str, Field(min_length=1)]
Tolerance = Annotated[float, PlainValidator(_relative, json_schema_input_type=float | str)]
Target = Annotated[str, As(Literal[TARGETS])]
Batch = Annotated[
    Annotated[int, Field(strict=True, ge=1, le=MOST_SEEDS)] | None,
    BeforeValidator(lambda value: None if value == "auto" else value, json_schema_input_type=int | Literal["auto"]),
]
EngineKey: Any = Annotated[Union[tuple(map(_engine_kind, DEFINITIONS))], Discriminator(_engine_name)]  # noqa: UP007  # as many as there are
Texts = Annotated[tuple[Any, ...], As(one_or_more(Text))]
Counts = Annotated[tuple[int, ...], As(one_or_more(Count))]
Engines = Annotated[tuple[Any, ...], As(one_or_more(EngineKey)), Field(validate_default=True)]
Observables = Annotated[tuple[str, ...], As(one_or_more(Literal[tuple(measures.OBSERVABLES)], least=0))]
Average = Annotated[str, As(Literal[tuple(measures.AVERAGES)])]
Figures = Annotated[tuple[str, ...], As(one_or_more(Literal[tuple(FIGURES)]))]
Times = Annotated[tuple[float, ...], As(one_or_more(Positive, least=0))]
Windows = Annotated[tuple[tuple[NotNegative, NotNegative], ...], Field(min_length=1)]
Substitutes = dict[str, Annotated[tuple[str, ...], As(one_or_more(Text, least=0))]]
Failures = Annotated[int, Field(strict=True, ge=0, le=MOST_SEEDS)]


class EngineUse(NamedTuple):
    """An engine of a study, the scenes it is used in, and its seeds."""

    engine: Engine
    scenes: tuple[str, ...]  # names
    seeds: Sequence[int] | None  # None: the seeds of the study


class Rings(Record):
    """The rings of the displacement distribution; runs beyond the last one are counted too."""

    dr: Positive = key("their width [length]")
    count: Annotated[int, Field(strict=True, ge=1, le=MOST_RINGS)] = key("their number")


class Study(Record):
    """What is simulated, with which seeds, and how it is analysed. Read by `read_study`."""

    scenes: Texts = key("scene files, relative to the folder of the study file")
    particles: Counts | None = key("numbers of disks; every scene is run with each (default: its own)", None)
    shown_particles: Count | None = key("the number of disks in figures of a single one (default: the largest)", None)
    engines: Engines = key("engines, with their settings if any", ("exact",))
    seeds: Seeds | None = key("a count (2400: seeds 0 to 2399), a range (100-199), or a list of both", None)
    tolerance: Tolerance | None = key("in place of seeds: relative standard error of the target", None)
    target: Target | None = key("the quantity that the tolerance refers to (default: msd)", None)
    batch: Batch = key("seeds per job (default: auto, from the forecast); results do not depend on it", None)
    record: Literal["tracer", "none"] = key("the trajectory of the tracer, or only the observables", "tracer")
    observables: Observables = key("quantities measured in each run, from all of its disks", ())
    average: Average = key("average over runs alone, or also over time origins or equal disks", "runs")
    figures: Figures | None = key("figures to draw (default: all that the study has data for)", None)
    displacement_times: Times = key("times of the displacement distribution (default: the end of each run)", ())
    fit_windows: Windows | None = key("[t0, t1] in which lines are fitted to the MSD [time]", None)
    rings: Rings | None = key("of the displacement distribution (default: from the data)", None)
    instead_of: Substitutes = key("scenes that may be run in place of others, for brownpipe tradeoff", {})
    allow_failed: Failures = key("runs of the study that may fail", 0)
    _name: str = PrivateAttr("study")
    _cases: tuple[Scene, ...] = PrivateAttr(())
    _uses: tuple[EngineUse, ...] = PrivateAttr(())

    @model_validator(mode="before")
    @classmethod
    def _keys_of_scenes(cls, value: Any) -> Any:
        given = value.keys() if isinstance(value, dict) else set()
        for name in given & Scene.model_fields.keys() - cls.model_fields.keys():
            cure = "write it in a scene file, and list that file under scenes"
            refuse(f"unknown key; it is a key of scenes: {cure}", name)
        return value

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> "Study":
        given = info.context or {}
        self._name = given.get("name", "study")
        self._read_scenes(given.get("folder", Path()))
        self._read_engines()
        self._check_seeds()
        self._check_observables()
        self._check_figures()
        self._check_shown_particles()
        self._check_times()
        self._check_substitutes()
        uses = ((use, case) for use in self.engine_uses for case in self.cases_of(use))
        jobs = sum(len(self.batches_of(use, case, use.seeds or self.seeds)) for use, case in uses)
        if jobs > MOST_JOBS:
            refuse(f"must be large enough for at most {MOST_JOBS} jobs ({jobs} with this one)", "batch")
        return self

    def _read_scenes(self, folder: Path) -> None:
        """Read every scene with every particle count, or with its own."""
        paths: dict[str, Path] = {}
        cases: list[Scene] = []
        if len(set(self.particles or ())) < len(self.particles or ()):
            refuse("must be particle counts that differ", "particles")
        for k, text in enumerate(self.scenes):
            if Path(text).stem in paths:
                refuse(f"must be a scene with a name (file stem) of its own, not {text!r}", "scenes", k)
            path = paths[Path(text).stem] = folder / text
            try:
                mapping = read_yaml(path)
                cases += [parse_scene(mapping, str(path), count) for count in self.particles or (None,)]
            except RequestError as error:
                refuse(str(error), "scenes", k)
        self._resolve(scenes=tuple(paths.values()))
        self._cases = tuple(cases)

    def _read_engines(self) -> None:
        """Read the engines, each fit for its scenes; none with the same settings runs a scene twice."""
        names, uses = tuple(dict.fromkeys(case.name for case in self.cases)), []
        for k, entry in enumerate(self.engines):
            for j, name in enumerate(entry.scenes or ()):
                self._refuse_unknown(name, "engines", k, "scenes", j)
            keys = dict(entry)
            scenes, seeds, name = keys.pop("scenes") or names, keys.pop("seeds"), keys.pop("name")
            uses.append(EngineUse(Engine(name, tuple(keys.items())), scenes, seeds))
            for case in self.cases:
                try:
                    if case.name in scenes:
                        uses[-1].engine.refuse_unfit(case)
                except RequestError as error:
                    refuse(str(error), "engines", k)
        pairs = [(use.engine, scene) for use in uses for scene in use.scenes]
        if len(set(pairs)) < len(pairs):
            refuse("must be engines or settings that differ", "engines")
        self._uses = tuple(uses)
        self._resolve(engines=tuple(dict.fromkeys(use.engine for use in uses)))

    def _refuse_unknown(self, name: str, *path: str | int) -> None:
        """Refuse a name that is not one of the study's scenes."""
        names = list(dict.fromkeys(case.name for case in self.cases))
        if name not in names:
            refuse(f"must be a scene of the study, {' or '.join(names)}, not {name!r}", *path)

    def _check_seeds(self) -> None:
        """A study has seeds, or a tolerance that says how many."""
        if self.tolerance is None and self.seeds is None:
            refuse("missing; must be given, or a tolerance instead", "seeds")
        if self.tolerance is None and self.target is not None:
            refuse("must not be given without a tolerance, which is for it", "target")
        if self.tolerance is not None and self.seeds is not None:
            refuse("must not be given with a tolerance, which says how many", "seeds")
        if self.tolerance is not None and (reason := why_no_relative_error(self.cases)):
            refuse(f"{reason}; must be seeds: 1", "tolerance")
        self._resolve(seeds=self.seeds or (), target=(self.target or TARGETS[0]) if self.tolerance else None)
        listed = [case.name for case in self.cases if case.listed]
        longest = max(len(seeds) for seeds in (self.seeds, *(use.seeds for use in self.engine_uses if use.seeds)))
        if listed and longest > 1:
            refuse(_repetition(listed[0], longest), "seeds")

    def _check_observables(self) -> None:
        for case in self.cases:
            refusal = measures.problem(case, self.observables, self.average)
            if refusal is not None:
                refuse(f"{case.name}, N = {case.particles}: {refusal[1]}", refusal[0])

    def _check_figures(self) -> None:
        """Refuse figures without data; by default there are all whose needs are met."""
        counts = {case.particles for case in self.cases} - {0}
        counting = {name for use in self.engine_uses if use.engine.definition.counts_collisions for name in use.scenes}
        measured = {
            name for use in self.engine_uses for name in use.engine.definition.measured(self.observables, "runs")[0]
        }
        met = {f"the observable {name}" for name in measured}
        met |= {FOLLOWED} if counts else set()
        met |= {COLLISIONS} if any(case.particles and case.name in counting for case in self.cases) else set()
        met |= {SEVERAL_COUNTS} if len(counts) > 1 else set()
        met |= {TRACKED} if self.record == "tracer" else set()
        met |= {SPREADING} if self.record == "tracer" or "square_displacement" in measured else set()
        unmet = {name: [need for need in figure.needs if need not in met] for name, figure in FIGURES.items()}
        for name in self.figures or ():
            if unmet[name]:
                refuse(f"{name} needs {unmet[name][0]}", "figures")
        if len(set(self.figures or ())) < len(self.figures or ()):
            refuse("must be figures that differ", "figures")
        self._resolve(figures=self.figures or tuple(name for name in FIGURES if not unmet[name]))

    def _check_shown_particles(self) -> None:
        counts, shown_count = sorted({case.particles for case in self.cases}), self.shown_particles
        if shown_count is not None and shown_count not in counts:
            refuse(f"must be one of the study's numbers of disks, {counts}, not {shown_count}", "shown_particles")

    def _check_times(self) -> None:
        """Refuse windows with fewer than three samples of a scene, and times that are no sample times."""
        for k, (t0, t1) in enumerate(self.fit_windows or ()):
            for case in self.cases:
                inside = np.count_nonzero((case.times >= t0) & (case.times <= t1))
                if not t0 < t1 <= case.duration or inside < 3:
                    allowed = f"t0 < t1 <= {case.duration!r} and three samples or more of {case.name}"
                    refuse(f"must be [t0, t1] with {allowed}, not {[t0, t1]}", "fit_windows", k)
        if len({f"{t0:g} {t1:g}" for t0, t1 in self.fit_windows or ()}) < len(self.fit_windows or ()):
            refuse("must be windows that differ in their first six digits", "fit_windows")
        shortest = min(case.duration for case in self.cases)
        self._resolve(fit_windows=self.fit_windows or default_fit_windows(shortest))
        for k, time in enumerate(self.displacement_times):
            if not any(np.isclose(case.times, time, rtol=1e-9, atol=0.0).any() for case in self.cases):
                refuse(f"must be a sample time of some scene, not {time!r}", "displacement_times", k)
            if np.isclose(self.displacement_times[:k], time, rtol=1e-9, atol=0.0).any():
                refuse(f"must be given once, not {time!r} again", "displacement_times", k)

    def _check_substitutes(self) -> None:
        """Refuse scenes in place of others that do not have their sample times."""
        by_name = {case.name: case for case in self.cases}
        for scene, names in self.instead_of.items():
            for name in (scene, *names):
                self._refuse_unknown(name, "instead_of", scene)
            for name in names:
                if name == scene or not np.array_equal(by_name[name].times, by_name[scene].times):
                    refuse(f"must be other scenes with the sample times of {scene}", "instead_of", scene)
        self._resolve(instead_of={scene: names for scene, names in self.instead_of.items() if names})

    @property
    def name(self) -> str:
        """The stem of the study file."""
        return self._name

    @property
    def cases(self) -> tuple[Scene, ...]:
        """Each scene with each particle count."""
        return self._cases

    @property
    def engine_uses(self) -> tuple[EngineUse, ...]:
        """The engines, in the order of the study file."""
        return self._uses

    def cases_of(self, use: EngineUse) -> list[Scene]:
        """Return the cases that an engine is used in, scene by scene."""
        return [case for name in use.scenes for case in self.cases if case.name == name]

    def batches_of(self, use: EngineUse, case: Scene, seeds: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
        """Return first and last seed of each batch of these seeds of an engine in a case."""
        if self.batch is not None:
            return batches(seeds, self.batch)
        return automatic_batches(seeds, use.engine.forecast(case, *self.recording))

    @property
    def recording(self) -> tuple[set[str], tuple[str, ...], str]:
        """What each run records, what it measures, and the average: the last arguments of `Engine.forecast`."""
        return {self.record}, self.observables, self.average

    @property
    def simulate_options(self) -> str:
        """What each run records and measures, as options of `brownpipe simulate`; empty for the defaults."""
        values = {"record": self.record, "observables": ",".join(self.observables), "average": self.average}
        defaults = {"record": "tracer", "observables": "", "average": "runs"}
        return " ".join(f"--{key} {value}" for key, value in values.items() if value != defaults[key])

    @property
    def tradeoff_cases(self) -> list[str]:
        """The cases with exact runs and others to compare with them, by their names in the trade-off."""
        labels = []
        for case in self.cases:
            engines = {use.engine for use in self.engine_uses if case.name in use.scenes}
            if REFERENCE in engines and (len(engines) > 1 or case.name in self.instead_of):
                labels.append(case.label)
        return labels


def why_no_relative_error(scenes: Sequence[Scene]) -> str | None:
    """Return why no number of runs has a relative error in one of the scenes; None if each has one."""
    for scene in scenes:
        if scene.listed or not scene.particles:
            return f"{scene.name} leaves nothing to chance"
        if rms_speed(scene) == 0.0:
            return f"in {scene.name} nothing moves"
    return None


def refuse_repetition(scene: Scene, seeds: Sequence[int]) -> None:
    """Raise RequestError for several seeds of a scene that lists its disks: all runs would be identical."""
    if scene.listed and len(seeds) > 1:
        raise RequestError(f"seeds: {_repetition(scene.name, len(seeds))}")


def _repetition(name: str, runs: int) -> str:
    why = f"as the disks of {name} are listed one by one and leave nothing to chance"
    return f"must be one seed, {why}; found {runs}"
