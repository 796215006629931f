"""The study: scenes x particle counts x engines x seeds, and what is made of them."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from brownpipe.engines import Engine
from brownpipe.scene import Scene
from brownpipe.scene.seeds import batches


class Use(NamedTuple):
    """Where an engine is used, and how often."""

    engine: Engine
    scenes: tuple[str, ...]  # names
    seeds: Sequence[int] | None  # None: those of the study


class Job(NamedTuple):
    """One call of `brownpipe simulate`: the seeds first to last (included) of one case."""

    scene: str
    particles: int
    engine: str  # label
    first: int
    last: int

    @property
    def file(self) -> str:
        """Its trajectory file, in the folder `simulate` of the study's results."""
        return f"{self.scene}/N{self.particles}/{self.engine}/{self.first}-{self.last}.h5"


@dataclass(frozen=True)
class Study:
    """What to simulate, how often, and what to make of it. Read by `read_study`."""

    name: str
    scenes: tuple[Path, ...]
    cases: tuple[Scene, ...]  # each scene with each particle count, validated
    uses: tuple[Use, ...]  # of engines
    seeds: Sequence[int]  # ascending; a range where there is no gap. Empty for a tolerance, until `plan.settle`
    batch: int  # seeds per job
    figures: tuple[str, ...]
    displacement_times: tuple[float, ...]  # of the displacement distribution [time]; empty for the end of each run
    fit_windows: tuple[tuple[float, float], ...]  # [time]
    ring_width: float | None  # dr [length]; None: from the data
    rings: int | None
    record: str = "tracer"  # or "none": no trajectories, only what is measured in the runs
    observables: tuple[str, ...] = ()  # measured in each run
    average: str = "runs"  # what displacements and autocorrelations among them are averages over
    tolerance: float | None = None  # relative error that decides how many seeds there are
    observable: str | None = None  # what it is the error of
    instead_of: tuple[tuple[str, tuple[str, ...]], ...] = ()  # scenes that may be run instead of another

    @property
    def engines(self) -> tuple[Engine, ...]:
        """Every engine that is used."""
        return tuple(dict.fromkeys(use.engine for use in self.uses))

    @property
    def batches(self) -> list[tuple[int, int]]:
        """First and last seed of each batch, cut at multiples of `batch`: more seeds leave whole batches alone."""
        return self.batches_of(self.seeds)

    def batches_of(self, seeds: Sequence[int]) -> list[tuple[int, int]]:
        """As `batches`, for other seeds."""
        return batches(seeds, self.batch)

    @property
    def measuring(self) -> str:
        """What to keep of each run and to measure in it, as options of `brownpipe simulate`; nothing if as usual."""
        words = {"record": self.record, "observables": ",".join(self.observables), "average": self.average}
        usual = {"record": "tracer", "observables": "", "average": "runs"}
        return " ".join(f"--{key} {value}" for key, value in words.items() if value != usual[key])

    @property
    def counting(self) -> str:
        """When and in which rings to count the runs, as options of `brownpipe aggregate`; nothing for the usual."""
        times = ["--displacement-times", *self.displacement_times] if self.displacement_times else []
        rings = ["--ring-width", self.ring_width, "--rings", self.rings] if self.rings else []
        return " ".join(map(str, rings + times))

    @property
    def table(self) -> dict[str, dict[str, dict[str, str]]]:
        """For each scene and particle count: the file of the scene (from here), and the digest of its physics."""
        files = {path.stem: os.path.relpath(path) for path in self.scenes}
        table = {name: {} for name in files}
        for case in self.cases:
            table[case.name][str(case.particles)] = {"file": files[case.name], "digest": case.digest}
        return table

    @property
    def compared(self) -> list[str]:
        """The scenes that have exact runs and others to compare with them, as a trade-off names them."""
        others = {name: {use.engine for use in self.uses if name in use.scenes} for name in self.table}
        stand_ins, exact = dict(self.instead_of), Engine("exact")
        names = [
            name
            for name, all_of_it in others.items()
            if exact in all_of_it and (len(all_of_it) > 1 or name in stand_ins)
        ]
        counts = {name: list(self.table[name]) for name in names}
        return [name if len(counts[name]) == 1 else f"{name}_N{n}" for name in names for n in counts[name]]

    def jobs(self) -> list[Job]:
        """Return one record per call of `brownpipe simulate`."""
        return [
            Job(case.name, case.particles, use.engine.label, first, last)
            for case in self.cases
            for use in self.uses
            if case.name in use.scenes
            for first, last in self.batches_of(use.seeds or self.seeds)
        ]
