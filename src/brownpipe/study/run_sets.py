"""The runs that a study asks for: where they are stored, which are there, the jobs that make the others.

What a step is made from stands as a digest in the name of a file beside its results: a step whose file is missing is
due, whatever times of modification say.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.provenance import STEPS, digest_of, source_digest
from brownpipe.quoting import shell_path
from brownpipe.scene import Scene
from brownpipe.scene.seeds import seed_text
from brownpipe.storage.store import DIGITS, StoredFile, folder_of_runs, runs_digest, stored_batches, without
from brownpipe.study.study import EngineUse, Study


class RunSet(NamedTuple):
    """The runs of one engine in one case of a study."""

    use: EngineUse
    case: Scene
    seeds: Sequence[int]  # ascending
    digest: str  # of all that determines the runs
    folder: Path  # of their files

    @property
    def key(self) -> str:
        """The digits at the end of the folder."""
        return self.digest[:DIGITS]


def run_sets(study: Study) -> list[RunSet]:
    """Return the runs of a study, case by case; their seeds must be known, or there are none yet."""
    sets = []
    for case in study.cases:
        for use in (use for use in study.engine_uses if case.name in use.scenes):
            digest = runs_digest(case, use.engine, {study.record}, study.observables, study.average)
            seeds = use.seeds or study.seeds or ()
            sets.append(RunSet(use, case, seeds, digest, folder_of_runs(case, use.engine, digest)))
    return sets


def batches_of(study: Study, runs: RunSet) -> list[tuple[int, int]]:
    """Return first and last seed of each file: those that are there, and those to be made of the seeds that are not."""
    seeds = np.asarray(runs.seeds, np.int64)
    stored = stored_batches(runs.folder, seeds)
    return sorted([*stored, *study.batches_of(runs.use, runs.case, without(seeds, stored))])


def files_of(study: Study) -> list[StoredFile]:
    """Return the files with the runs of a study, relative to the working directory."""
    return [
        StoredFile(runs.folder / f"{first}-{last}.h5", runs.digest, first, last, runs.seeds)
        for runs in run_sets(study)
        for first, last in batches_of(study, runs)
    ]


def commands(study: Study) -> dict[str, dict[str, str]]:
    """Return what `brownpipe simulate` is told, in words of a shell, by the digits at the end of the folder of runs."""
    scenes = {path.stem: shell_path(os.path.relpath(path)) for path in study.scenes}
    return {
        runs.key: {"scene": scenes[runs.case.name], "engine": runs.use.engine.options, "digest": runs.digest}
        for runs in run_sets(study)
    }


def listed_runs(study: Study) -> list[str]:
    """Return a line for each set of runs: its folder and its seeds."""
    return [f"{runs.folder} {seed_text(np.asarray(runs.seeds))}" for runs in run_sets(study)]


def digests(study: Study) -> dict[str, str]:
    """Return the first digits of a SHA-256 over all that each step of the workflow after `simulate` is made from."""
    runs = [*listed_runs(study), study.tolerance, study.target, study.fit_windows[0]]
    analysis = [study.fit_windows, study.displacement_times, study.rings]
    found = {name: source_digest(*STEPS[name]) for name in STEPS if name != "simulate"}
    aggregate = digest_of(runs, analysis, found["aggregate"])
    tradeoff = digest_of(runs, study.instead_of, found["tradeoff"])
    return {
        "plan": digest_of(runs, study.average, study.observables, found["tradeoff"]),
        "aggregate": aggregate,
        "figures": digest_of(aggregate, study.figures, study.shown_particles, found["figures"]),
        "tradeoff": tradeoff,
        "tradeoff_figures": digest_of(tradeoff, found["tradeoff_figures"]),
    }
