"""Read trajectory files: which files belong together, and their runs block by block, in bounded
memory.

The only reader of studies: `analysis.dataset` and `tradeoff.compare` both take their runs from
here.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.resampling import SEEDS_PER_BLOCK
from brownpipe.engines.ensemble import Ensemble, join_ensembles, select
from brownpipe.errors import AnalysisError
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.sections import Mixture
from brownpipe.scene.variation import PACKING_FRACTION
from brownpipe.storage.store import StoredFile, read_stored
from brownpipe.storage.trajectories import Trajectories, open_runs, read_trajectories

# Of runs: a file, perhaps with its required seeds, or runs in memory.
Source = str | Path | StoredFile | Trajectories

# Runs of a case, or all that it has, from which its default rings and windows are chosen.
RUNS_FOR_DEFAULTS = 200


class RunFile(NamedTuple):
    """A trajectory file, or runs in memory."""

    path: str
    seeds: np.ndarray  # (n,) int64 of the runs that are wanted
    contents: Trajectories  # for a file only the outline, without its runs
    is_in_memory: bool


class Group(NamedTuple):
    """All files of one scene, particle count and engine."""

    files: tuple[RunFile, ...]  # in the order of the paths
    seeds: np.ndarray  # (S,) int64, ascending
    pattern: RunFile  # the first file, if possible one with a run that came to its end


def group_by_case(sources: Iterable[Source]) -> list[Group]:
    """Return trajectory files and runs in memory by scene, particle count and engine label, in
    order of appearance.

    Raises AnalysisError for files that do not belong together (two scenes or sources under one
    name, a seed in two files) or hold other runs than expected, and what `read_trajectories`
    raises.
    """
    groups: dict[tuple[str, int, str], list[RunFile]] = {}
    for number, source in enumerate(tracked([*sources], "files verified")):
        if isinstance(source, Trajectories):
            file = RunFile(f"runs[{number}]", source.ensemble.seeds, source, True)
        elif isinstance(source, StoredFile):
            contents = read_stored(source.path, outline=True)
            seeds = contents.ensemble.seeds
            file = RunFile(str(source.path), seeds[np.isin(seeds, source.seeds)], contents, False)
        else:
            contents = read_trajectories(source, outline=True)  # not its runs
            file = RunFile(str(source), contents.ensemble.seeds, contents, False)
        scene = file.contents.scene
        labels = (scene.name, scene.particles, file.contents.engine.label)
        groups.setdefault(labels, []).append(file)
    if not groups:
        raise AnalysisError("no trajectory files: nothing to analyse")
    _refuse_namesakes([files[0].contents.scene for files in groups.values()])
    return [_group(files) for files in groups.values()]


def _group(files: Sequence[RunFile]) -> Group:
    """Return files as a group. Raises AnalysisError if they differ in more than their seeds, or
    have one in common.
    """
    kind_of_first = _kind(files[0].contents)
    for file in files:
        for name, value in _kind(file.contents).items():
            if value != kind_of_first[name]:
                raise AnalysisError(
                    f"{file.path}: has another {name} than {files[0].path}; make one again, or "
                    "call its scene otherwise"
                )
    seeds = np.sort(np.concatenate([file.seeds for file in files]))
    repeated = seeds[1:][seeds[1:] == seeds[:-1]]
    if repeated.size:
        *_, first, last = (file.path for file in files if repeated[0] in file.seeds)
        raise AnalysisError(
            f"{last}: seed {repeated[0]} is already in {first}; each run may count only once"
        )
    if files[0].contents.scene.has_one_state and len(seeds) > 1:
        alike = "its velocities are given: all its runs are the same; give one seed"
        raise AnalysisError(f"{files[-1].path}: {alike}")
    ended = [file for file in files if file.contents.measured is not None]
    pattern = next(iter(ended), files[0])
    expected = pattern.contents.ensemble.observables.keys()
    for file in ended:
        unlike = file.contents.ensemble.observables.keys() ^ expected
        if unlike:
            names = ", ".join(sorted(unlike))
            raise AnalysisError(
                f"{file.path}: has other observables than {pattern.path} ({names}); make one of "
                "the two again"
            )
    return Group(tuple(files), seeds, pattern)


def _kind(contents: Trajectories) -> dict[str, object]:
    """Return what all files of a group must have in common, by its name."""
    return {
        f"scene {contents.scene.name!r}": contents.scene.digest,
        "setting of the engine": contents.engine.settings,
        "source of the engine": contents.engine.own,
        "--record": contents.record & {"tracer", "velocity"},
        "source code": contents.source,
        "average": contents.ensemble.average,
    }


def _refuse_namesakes(scenes: Sequence[Scene]) -> None:
    """Refuse scenes of one name that differ in anything but their particle counts, and boxes scaled
    for these.
    """
    known: dict[str, dict[str, object]] = {}
    for scene in scenes:
        uncounted: dict[str, object] = {**scene.as_mapping()}
        if isinstance(scene.disks, Mixture):
            counts = {"species": {"__all__": {"count"}}}
            uncounted.update(particles=0, disks=scene.disks.model_dump(exclude=counts))
        if f"{PACKING_FRACTION}=" in scene.name:
            position = scene.tracer_position or ()
            lengths = [*scene.box.x, *scene.box.y, *position]
            scaled = (scene.box.boundary, *np.divide(lengths, scene.box.width).round(9))
            disks = [(species.name, species.radius, species.mass) for species in scene.species]
            uncounted.update(box=scaled, disks=disks)
        if known.setdefault(scene.name, uncounted) != uncounted:
            raise AnalysisError(
                f"two different scenes are called {scene.name!r}; give one of them another name"
            )


def first_good_runs(group: Group) -> list[Ensemble]:
    """Return the first blocks of runs that have not failed, of RUNS_FOR_DEFAULTS runs or more.

    All runs of a smaller group. Default rings and windows are chosen from them.
    """
    blocks: list[Ensemble] = []
    for runs in _blocks(group, block_numbers(group)):
        good_runs = without_failed(runs)
        if len(good_runs.seeds):
            blocks.append(good_runs)
        if sum(len(block.seeds) for block in blocks) >= RUNS_FOR_DEFAULTS:
            break
    return blocks


def without_failed(runs: Ensemble) -> Ensemble:
    """Return the runs that have not failed."""
    return select(runs, runs.observables["failed"] == 0)


def blocks_of(group: Group) -> Iterator[Ensemble]:
    """Yield the runs of a group in blocks of seeds between multiples of SEEDS_PER_BLOCK, ascending.

    The blocks do not depend on how the runs are distributed over files; blocks read from files have
    no whole runs and no collisions. Raises AnalysisError as `_refuse_gaps`.
    """
    yield from _blocks(group, tracked(block_numbers(group), "blocks of runs"))


def block_numbers(group: Group) -> np.ndarray:
    """Return the numbers of the blocks that the seeds of a group lie in, ascending."""
    return np.unique(group.seeds // SEEDS_PER_BLOCK)


def _blocks(group: Group, numbers: Iterable[int]) -> Iterator[Ensemble]:
    """Yield the runs of some blocks of a group, as `blocks_of` does."""
    # Enough to open each batch of consecutive seeds only once.
    opened = lru_cache(maxsize=2)(open_runs)
    files = sorted(group.files, key=lambda file: file.seeds.min())
    for block in numbers:
        parts = []
        for file in files:
            seeds = file.seeds[file.seeds // SEEDS_PER_BLOCK == block]
            if len(seeds):
                runs = file.contents.ensemble if file.is_in_memory else opened(file.path)
                rows = np.flatnonzero(np.isin(runs.seeds, seeds))
                consecutive = select(runs, slice(rows[0], rows[-1] + 1))
                parts.append(select(consecutive, rows - rows[0]))
        runs = join_ensembles(parts)
        _refuse_gaps(group, runs)
        yield runs


def _refuse_gaps(group: Group, runs: Ensemble) -> None:
    """Refuse a run that did not fail and yet has no number for where its tracer is: no engine makes
    such a run, but somebody may have edited it.

    Raises AnalysisError, which names the run, the variable and the first time. In arrays of the
    user's own NaN may mean something.
    """
    tracks = runs.tracer._asdict() if runs.tracer is not None else {}
    sampled: dict[str, np.ndarray] = {  # (n, T, ...)
        name: values.swapaxes(0, 1) for name, values in tracks.items() if values is not None
    }
    if "square_displacement" in runs.observables:
        sampled["square_displacement"] = runs.observables["square_displacement"]
    is_good = runs.observables["failed"] == 0
    for name, values in sampled.items():
        is_gap = ~np.isfinite(values).reshape(*values.shape[:2], -1).all(axis=2)
        gaps = np.argwhere(is_gap & is_good[:, None])
        if len(gaps):
            row, sample = gaps[0]
            seed = runs.seeds[row]
            path = next(file.path for file in group.files if seed in file.seeds)
            problem = f"{name} is not a number at t = {runs.times[sample]:g}"
            cure = "take the run as it was made, or select the others"
            raise AnalysisError(
                f"{path}: seed {seed}: {problem}, though the run did not fail; {cure}"
            )


def reported(runs: Ensemble, name: str) -> np.ndarray:
    """Return a number of every run (n,), NaN if the engine does not report it."""
    return runs.observables.get(name, np.full(len(runs.seeds), np.nan))
