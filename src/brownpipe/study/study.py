"""The study: scenes x particle counts x engines x seeds, and how their results are analysed and shown."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from brownpipe.engines import Engine
from brownpipe.engines.exact import EXACT
from brownpipe.engines.request import Request
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene
from brownpipe.scene.seeds import batches
from brownpipe.study.batches import automatic_batches

REFERENCE = Engine(EXACT.name)  # without bias: all other engines are compared with it


class EngineUse(NamedTuple):
    """An engine of a study, the scenes it is used in, and its seeds."""

    engine: Engine
    scenes: tuple[str, ...]  # names
    seeds: Sequence[int] | None  # None: the seeds of the study


class SimulationJob(NamedTuple):
    """One call of `brownpipe simulate`: the seeds first to last (included) of one case."""

    scene: str
    particles: int
    engine: str  # label
    first: int
    last: int

    @property
    def file(self) -> str:
        """Its trajectory file, relative to the folder `simulate` of the study's results."""
        return f"{self.scene}/N{self.particles}/{self.engine}/{self.first}-{self.last}.h5"


@dataclass(frozen=True)
class Study:
    """What is simulated, with which seeds, and how it is analysed. Read by `read_study`."""

    name: str
    scenes: tuple[Path, ...]
    cases: tuple[Scene, ...]  # each scene with each particle count, validated
    engine_uses: tuple[EngineUse, ...]
    seeds: Sequence[int]  # ascending; a range if there is no gap. Empty for a tolerance, until `run_count.settle`
    batch: int | None  # seeds per job; None: from the forecast of each case
    figures: tuple[str, ...]
    displacement_times: tuple[float, ...]  # of the displacement distribution [time]; empty for the end of each run
    fit_windows: tuple[tuple[float, float], ...]  # [time]
    ring_width: float | None  # dr [length]; None: from the data
    rings: int | None
    record: str = "tracer"  # or "none": no trajectories, only the observables measured in the runs
    observables: tuple[str, ...] = ()  # measured in each run
    average: str = "runs"  # what displacements and autocorrelations are averaged over, of observables.AVERAGES
    tolerance: float | None = None  # relative error that determines the number of seeds
    target: str | None = None  # the quantity with this error, one of study_file.TARGETS
    instead_of: tuple[tuple[str, tuple[str, ...]], ...] = ()  # (scene, scenes that may be run in its place)
    allow_failed: int = 0  # runs that may fail: with more, the study ends with exit status 1

    @property
    def engines(self) -> tuple[Engine, ...]:
        """The engines of the study, each once."""
        return tuple(dict.fromkeys(use.engine for use in self.engine_uses))

    def cases_of(self, use: EngineUse) -> list[Scene]:
        """Return the cases that an engine is used in, scene by scene."""
        return [case for name in use.scenes for case in self.cases if case.name == name]

    def batches_of(self, use: EngineUse, case: Scene) -> list[tuple[int, int]]:
        """Return first and last seed of each batch of an engine in a case; more seeds leave complete ones."""
        seeds = use.seeds or self.seeds
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
    def aggregate_options(self) -> str:
        """Times and rings of the displacement distribution, as options of `brownpipe aggregate`; empty for defaults."""
        times = ["--displacement-times", *self.displacement_times] if self.displacement_times else []
        rings = ["--ring-width", self.ring_width, "--rings", self.rings] if self.rings else []
        return " ".join(map(str, rings + times))

    @property
    def case_table(self) -> dict[str, dict[str, dict[str, str]]]:
        """Scene file, relative to the working directory, and digest of the physics: [scene][particle count].

        The file is a word of a shell command.
        """
        files = {path.stem: shell_path(os.path.relpath(path)) for path in self.scenes}
        table: dict[str, dict[str, dict[str, str]]] = {name: {} for name in files}
        for case in self.cases:
            table[case.name][str(case.particles)] = {"file": files[case.name], "digest": case.digest}
        return table

    @property
    def tradeoff_cases(self) -> list[str]:
        """The cases with exact runs and others to compare with them, by their names in the trade-off."""
        replaced = {scene for scene, _ in self.instead_of}
        names = []
        for scene, cases in self.case_table.items():
            engines = {use.engine for use in self.engine_uses if scene in use.scenes}
            if REFERENCE in engines and (len(engines) > 1 or scene in replaced):
                names += [scene] if len(cases) == 1 else [f"{scene}_N{particles}" for particles in cases]
        return names

    def jobs(self) -> list[SimulationJob]:
        """Return the calls of `brownpipe simulate`."""
        return [
            SimulationJob(case.name, case.particles, use.engine.label, first, last)
            for case in self.cases
            for use in self.engine_uses
            if case.name in use.scenes
            for first, last in self.batches_of(use, case)
        ]

    def request_of(self, job: SimulationJob) -> Request:
        """Return the runs that a job makes, with what is recorded and measured in them."""
        case = next(case for case in self.cases if (case.name, case.particles) == (job.scene, job.particles))
        engine = next(engine for engine in self.engines if engine.label == job.engine)
        seeds = range(job.first, job.last + 1)
        measured = engine.definition.measured(self.observables, self.average)
        return Request(case, engine, seeds, frozenset({self.record}), *measured)
