"""Read trajectory files: which files belong together, and their runs block by block, in bounded memory.

The only reader of studies: `analysis.dataset` and `tradeoff.runs` both take their runs from here.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.resampling import SEEDS_PER_BLOCK
from brownpipe.engines.ensemble import NONE_STOPPED, Ensemble, Track, blank
from brownpipe.errors import AnalysisError
from brownpipe.stages import tracked
from brownpipe.storage.store import StoredFile
from brownpipe.storage.trajectories import Outline, Trajectories, read_outline, read_trajectories

Source = str | Path | StoredFile | Trajectories  # of runs: a file, perhaps with what it is to hold, or runs in memory
LOADED = 2  # files kept in memory; enough to read each batch of consecutive seeds only once


class TrajectoryFile(NamedTuple):
    """One trajectory file, without its runs, or runs in memory."""

    path: str
    outline: Outline
    runs: "RunBlock | None" = None  # if in memory

    @property
    def key(self) -> tuple[str, int, str]:
        """Scene, particle count and engine label."""
        return self.outline.scene.name, self.outline.scene.particles, self.outline.engine.label


class Group(NamedTuple):
    """All files of one scene, particle count and engine."""

    files: tuple[TrajectoryFile, ...]  # in the order of the paths
    seeds: np.ndarray  # (S,) int64, ascending

    @property
    def outline(self) -> Outline:
        """That of the first file, if possible of one with a run that came to its end."""
        outlines = [file.outline for file in self.files]
        return next((outline for outline in outlines if outline.observables is not None), outlines[0])


class RunBlock(NamedTuple):
    """Consecutive runs of one group, seeds ascending."""

    seeds: np.ndarray  # (n,) int64
    tracer: Track | None  # (T, n, 2)
    observables: dict[str, np.ndarray]  # name -> (n, ...)
    stopped: Mapping[int, str] = NONE_STOPPED  # seed -> why its run could not go on


def groups_of(sources: Iterable[Source]) -> list[Group]:
    """Return trajectory files and runs in memory by scene, particle count and engine label, in order of appearance.

    Raises AnalysisError for files that do not belong together (two scenes or sources under one name, a seed in two
    files) or hold other runs than are expected of them, and what `read_outline` raises.
    """
    files = [_described(number, source) for number, source in enumerate(tracked([*sources], "files verified"))]
    if not files:
        raise AnalysisError("no trajectory files: nothing to analyse")
    groups = [_group([file for file in files if file.key == key]) for key in dict.fromkeys(file.key for file in files)]
    _refuse_namesakes(groups)
    return groups


def _described(number: int, source: Source) -> TrajectoryFile:
    if isinstance(source, Trajectories):
        return TrajectoryFile(f"runs[{number}]", source.outline, block_of(source.ensemble))
    if not isinstance(source, StoredFile):
        return TrajectoryFile(str(source), read_outline(source))
    path, outline = str(source.path), read_outline(source.path)
    if outline.digest != source.digest or not np.array_equal(outline.seeds, range(source.first, source.last + 1)):
        raise AnalysisError(f"{path}: holds other runs than its name says; delete it and run the study again")
    return TrajectoryFile(path, outline._replace(seeds=outline.seeds[np.isin(outline.seeds, source.seeds)]))


def _group(files: Sequence[TrajectoryFile]) -> Group:
    _refuse_differing(files)
    seeds = np.sort(np.concatenate([file.outline.seeds for file in files]))
    _refuse_duplicates(files, seeds)
    return Group(tuple(files), seeds)


def _refuse_differing(files: Sequence[TrajectoryFile]) -> None:
    path, first = files[0][:2]
    for other, outline, _ in files[1:]:
        if outline.scene.digest != first.scene.digest:
            raise AnalysisError(
                f"{other}: its scene {outline.scene.name!r} is not the one in {path}; use one of the two"
            )
        if outline.tracer != first.tracer:
            raise AnalysisError(f"{other}: recorded with another --record than {path}; make one of the two again")
        if outline.own and first.own and outline.own != first.own:
            raise AnalysisError(f"{other}: measured by other functions than {path}; make one of the two again")
        if outline.average != first.average:
            raise AnalysisError(f"{other}: averages over {outline.average}, {path} over {first.average}; use one")
        if outline.source != first.source:
            raise AnalysisError(f"{other}: made by another source code than {path}; make one of the two again")


def _refuse_duplicates(files: Sequence[TrajectoryFile], seeds: np.ndarray) -> None:
    repeated = seeds[1:][seeds[1:] == seeds[:-1]]
    if repeated.size:
        holders = [file.path for file in files if repeated[0] in file.outline.seeds]
        raise AnalysisError(
            f"{holders[-1]}: seed {repeated[0]} is already in {holders[0]}; each run may count only once"
        )
    if files[0].outline.scene.listed and len(seeds) > 1:
        raise AnalysisError(
            f"{files[-1].path}: its disks are listed one by one: all its runs are the same; give one seed"
        )


def _refuse_namesakes(groups: Sequence[Group]) -> None:
    """Refuse scenes of one name that differ in anything but their particle counts."""
    known: dict[str, dict] = {}
    for scene in (group.outline.scene for group in groups):
        uncounted = scene.as_mapping()
        for counted in (uncounted, *uncounted["disks"]["species"]) if scene.species else ():
            counted.update(particles=0, count=0)
        if known.setdefault(scene.name, uncounted) != uncounted:
            raise AnalysisError(f"two different scenes are called {scene.name!r}; give one of them another name")


def blocks_of(group: Group) -> Iterator[RunBlock]:
    """Yield the runs of a group in blocks of seeds between multiples of SEEDS_PER_BLOCK, ascending.

    The blocks do not depend on how the runs are distributed over files. Raises AnalysisError for a file that changes
    meanwhile or lacks observables that another has, and what `read_trajectories` raises.
    """
    read = lru_cache(maxsize=LOADED)(lambda path: block_of(read_trajectories(path).ensemble))

    def load(file: TrajectoryFile) -> RunBlock:
        runs, wanted = read(file.path) if file.runs is None else file.runs, file.outline.seeds
        return runs if len(runs.seeds) == len(wanted) else select(runs, np.isin(runs.seeds, wanted))

    files = sorted(group.files, key=lambda file: file.outline.seeds.min())
    blocks = [set(np.unique(file.outline.seeds // SEEDS_PER_BLOCK).tolist()) for file in files]
    first = next((file for file in files if not _is_without_results(load(file))), files[0])
    pattern = load(first).observables
    for block in np.unique(group.seeds // SEEDS_PER_BLOCK).tolist():
        parts = []
        for file in (file for file, own in zip(files, blocks, strict=True) if block in own):
            runs = _with_every_name(load(file), pattern)
            _refuse_unlike(file, runs, first, pattern.keys())
            parts.append(select(runs, runs.seeds // SEEDS_PER_BLOCK == block))
        yield joined(parts)


def block_of(ensemble: Ensemble) -> RunBlock:
    """Return the part of an ensemble that the estimators need."""
    return RunBlock(ensemble.seeds, ensemble.tracer, ensemble.observables, ensemble.stopped)


def _is_without_results(runs: RunBlock) -> bool:
    """Whether none of the runs came to its end, so that nothing was measured and reported."""
    return len(runs.stopped) == len(runs.seeds)


def _with_every_name(runs: RunBlock, pattern: dict[str, np.ndarray]) -> RunBlock:
    """Return runs without results with the observables that the runs of another file have, without values."""
    if not _is_without_results(runs):
        return runs
    absent = {name: blank((len(runs.seeds), *values.shape[1:]), values.dtype) for name, values in pattern.items()}
    return runs._replace(observables=absent | runs.observables)


def _refuse_unlike(file: TrajectoryFile, runs: RunBlock, first: TrajectoryFile, names: Set[str]) -> None:
    if not np.array_equal(runs.seeds, file.outline.seeds):
        raise AnalysisError(f"{file.path}: was replaced while it was read; start again")
    if runs.observables.keys() != names:
        unlike = ", ".join(sorted(runs.observables.keys() ^ names))
        raise AnalysisError(
            f"{file.path}: has other observables than {first.path} ({unlike}); make one of the two again"
        )


def select(runs: RunBlock, rows: np.ndarray) -> RunBlock:
    """Return the runs at `rows`: indices, or a mask (n,)."""
    tracer = runs.tracer and runs.tracer.of(rows)
    seeds = runs.seeds[rows]
    stopped = {seed: runs.stopped[seed] for seed in seeds.tolist() if seed in runs.stopped} if runs.stopped else {}
    return RunBlock(seeds, tracer, {name: values[rows] for name, values in runs.observables.items()}, stopped)


def reported(runs: RunBlock, name: str) -> np.ndarray:
    """Return a number of every run (n,), NaN if the engine does not report it."""
    return runs.observables.get(name, np.full(len(runs.seeds), np.nan))


def joined(parts: Sequence[RunBlock]) -> RunBlock:
    """Return several blocks of runs as one, seeds ascending."""
    seeds = np.concatenate([runs.seeds for runs in parts])
    tracer = parts[0].tracer and Track(*map(_beside, zip(*(runs.tracer for runs in parts), strict=True)))
    observables = {name: np.concatenate([runs.observables[name] for runs in parts]) for name in parts[0].observables}
    stopped = {seed: reason for runs in parts for seed, reason in runs.stopped.items()}
    return select(RunBlock(seeds, tracer, observables, stopped), np.argsort(seeds, kind="stable"))


def _beside(arrays: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Tracks (T, n, 2) of several files side by side."""
    return None if arrays[0] is None else np.concatenate(arrays, axis=1)
