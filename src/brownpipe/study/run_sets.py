"""The runs that a study asks for: where they are stored, which are there, the jobs that make the others.

What a step is made from stands as a digest in the name of a file beside its results: a step whose file is missing is
due, whatever times of modification say.
"""

import json
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine, forecast
from brownpipe.provenance import STEPS, digest_of, source_digest
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene
from brownpipe.scene.seeds import ranges, seed_text
from brownpipe.storage.store import DIGITS, StoredFile, folder_of_runs, runs_digest, stored_batches, without
from brownpipe.study.study import Study

SECONDS = 30.0  # CPU time of a job of `batch: auto`: starting one takes 2 % of it
OFTEN = 20.0  # and it is longer by so many times what a job calculates once
LARGEST = 1e9  # bytes of memory of such a job
EQUAL_JOBS = 256  # then their length doubles whenever the number of runs before has doubled


class RunSet(NamedTuple):
    """The runs of one engine in one case of a study."""

    engine: Engine
    case: Scene
    seeds: Sequence[int]  # ascending
    batch: int | None  # seeds of a job; None: by their cost
    cost: forecast.Cost  # of one run
    digest: str  # of all that determines the runs
    folder: Path  # of their files

    @property
    def key(self) -> str:
        """The digits at the end of the folder."""
        return self.digest[:DIGITS]

    def jobs(self, seeds: Sequence[int] | np.ndarray) -> list[tuple[int, int]]:
        """Return first and last seed of each job that makes these seeds."""
        return batches(seeds, self.cost, self.batch)

    @property
    def most_seeds(self) -> int:
        """The largest number of seeds of a job."""
        return max(last - first + 1 for first, last in self.jobs(self.seeds))


def batches(seeds: Sequence[int] | np.ndarray, cost: forecast.Cost, length: int | None = None) -> list[tuple[int, int]]:
    """Return first and last seed of each batch, for ascending seeds of runs of this cost; None: of SECONDS and more.

    Neither the number of cores nor that of seeds enters: a study has the same jobs on every machine, and complete
    batches stay valid when seeds are added. Every range of consecutive seeds is cut from its first seed on.
    """
    most = length or max(1, forecast.most_runs(cost, LARGEST))
    size = length or min(most, _power_of_two((SECONDS + OFTEN * cost.once) / (cost.seconds + cost.storing)))
    found = []
    for first, last in ranges(seeds):
        start = first
        while start <= last:
            following = start + min(most, size * _power_of_two((start - first) / (EQUAL_JOBS * size)))
            found.append((start, min(following - 1, last)))
            start = following
    return found


def _power_of_two(number: float) -> int:
    """Return the largest power of two up to a number; 1 for less."""
    return 1 << max(int(number).bit_length() - 1, 0)


def run_sets(study: Study) -> list[RunSet]:
    """Return the runs of a study, case by case; their seeds must be known, or there are none yet."""
    sets = []
    for case in study.cases:
        for engine, _, seeds in (use for use in study.uses if use.case is case):
            sets.append(run_set(study, case, engine, seeds or study.seeds))
    return sets


def run_set(study: Study, case: Scene, engine: Engine, seeds: Sequence[int]) -> RunSet:
    """Return the runs of these seeds of one engine in one case, recorded and measured as the study says."""
    cost, digest = engine.forecast(case, *study.recording), runs_digest(case, engine, *study.recording)
    return RunSet(engine, case, seeds, study.batch, cost, digest, folder_of_runs(case, engine, digest))


def batches_of(runs: RunSet) -> list[tuple[int, int]]:
    """Return first and last seed of each file: those that are there, and those to be made of the seeds that are not."""
    seeds = np.asarray(runs.seeds, np.int64)
    stored = stored_batches(runs.folder, seeds)
    return sorted([*stored, *runs.jobs(without(seeds, stored))])


def files_of(study: Study) -> list[StoredFile]:
    """Return the files with the runs of a study, relative to the working directory."""
    return [
        StoredFile(runs.folder / f"{first}-{last}.h5", runs.digest, first, last, runs.seeds)
        for runs in run_sets(study)
        for first, last in batches_of(runs)
    ]


def commands(study: Study) -> dict[str, str]:
    """Return the words of `brownpipe simulate` for each set of runs, by the digits at the end of its folder."""
    scenes = {
        name: " ".join([shell_path(os.path.relpath(path)), *(f"--value {_assignment(*one)}" for one in values.items())])
        for name, (path, values) in study.varied.items()
    }
    measured = (
        f" --observables {shell_path(','.join(study.observables))} --average {study.average}"
        if study.observables
        else ""
    )
    return {
        runs.key: f"{scenes[runs.case.name]} --particles {runs.case.particles} --engine {runs.engine.options}"
        f" --record {study.record}{measured} --planned {runs.digest}"
        for runs in run_sets(study)
    }


def _assignment(key: str, value: object) -> str:
    """Return KEY=VALUE for a shell."""
    return shlex.quote(f"{key}={json.dumps(value)}")


def listed_runs(study: Study) -> list[str]:
    """Return a line for each set of runs: its folder and its seeds."""
    return [f"{runs.folder} {seed_text(np.asarray(runs.seeds))}" for runs in run_sets(study)]


def digests(study: Study) -> dict[str, str]:
    """Return the first digits of a SHA-256 over all that each step of the workflow after `simulate` is made from."""
    runs = [*listed_runs(study), study.tolerance, study.target, study.fit_windows[0]]
    rings = study.rings and [study.rings.dr, study.rings.count]
    analysis = [study.fit_windows, study.displacement_times, rings, [*study.vary], study.vary_together]
    found = {step: source_digest(*modules) for step, modules in STEPS.items()}
    aggregate = digest_of(runs, analysis, found["aggregate"])
    tradeoff = digest_of(runs, study.instead_of, found["tradeoff"])
    return {
        "plan": digest_of(runs, found["tradeoff"]),
        "aggregate": aggregate,
        "figures": digest_of(aggregate, study.figures, study.shown_particles, found["figures"]),
        "tradeoff": tradeoff,
        "tradeoff_figures": digest_of(tradeoff, found["figures"]),
    }
