"""Trajectory files to runs: which files belong together, and their runs block by block, in bounded memory."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.resampling import BLOCK
from brownpipe.engines.state import Track
from brownpipe.errors import AnalysisError
from brownpipe.storage import read_outline, read_trajectories

LOADED = 2  # files kept in memory: batches of consecutive seeds are then read once each


class File(NamedTuple):
    """One trajectory file: the path it was given by, and what `storage.read_outline` says of it."""

    path: str
    outline: object  # brownpipe.storage.Outline

    @property
    def key(self):
        """Scene, particle count and engine."""
        scene = self.outline.scene
        return scene.name, scene.particles, self.outline.engine.label


class Group(NamedTuple):
    """All files of one scene, particle count and engine."""

    files: tuple[File, ...]  # as given
    seeds: np.ndarray  # (S,) ascending

    @property
    def outline(self):
        return self.files[0].outline

    @property
    def key(self):
        return self.files[0].key


class Runs(NamedTuple):
    """Some runs of one group, in the order of their seeds."""

    seeds: np.ndarray  # (n,)
    tracer: Track | None  # (T, n, 2)
    observables: dict  # name -> (n, ...)


def groups_of(paths):
    """The groups of the trajectory files `paths`, by scene, particle count and engine.

    Raises AnalysisError for files that do not belong together, and what `storage.read_outline` raises.
    """
    files = [File(str(path), read_outline(path)) for path in paths]
    if not files:
        raise AnalysisError("no trajectory files: nothing to aggregate")
    groups = [_group([file for file in files if file.key == key]) for key in sorted({file.key for file in files})]
    _refuse_namesakes(groups)
    return groups


def _group(files):
    _refuse_differing(files)
    seeds = np.sort(np.concatenate([file.outline.seeds for file in files]))
    _refuse_duplicates(files, seeds)
    return Group(tuple(files), seeds)


def _refuse_differing(files):
    path, first = files[0]
    for other, outline in files[1:]:
        if outline.scene.digest != first.scene.digest or outline.tracer != first.tracer:
            raise AnalysisError(
                f"{other}: its scene {outline.scene.name!r} is not the one in {path}; aggregate one of the two"
            )
        if outline.average != first.average:
            raise AnalysisError(f"{other}: averages over {outline.average}, {path} over {first.average}; aggregate one")
        if outline.source != first.source:
            raise AnalysisError(f"{other}: made by another source code than {path}; make one of the two again")


def _refuse_duplicates(files, ordered):
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if twice.size:
        holders = [file.path for file in files if twice[0] in file.outline.seeds]
        raise AnalysisError(f"{holders[-1]}: seed {twice[0]} is already in {holders[0]}; each run may count only once")
    if files[0].outline.scene.disks and len(ordered) > 1:
        raise AnalysisError(
            f"{files[-1].path}: its disks are listed one by one: all its runs are the same; give one seed"
        )


def _refuse_namesakes(groups):
    """One name, one physics: scenes of the same name may differ in their particle counts alone."""
    known = {}
    for scene in (group.outline.scene for group in groups):
        uncounted = replace(scene, species=tuple(replace(species, count=0) for species in scene.species))
        if known.setdefault(scene.name, uncounted) != uncounted:
            raise AnalysisError(f"two different scenes are called {scene.name!r}; give one of them another name")


def blocks_of(group):
    """The runs of a group, in blocks of seeds between multiples of BLOCK, ascending: the same for whatever files.

    Raises AnalysisError for a file that changes meanwhile or lacks observables that another has, and what
    `storage.read_trajectories` raises.
    """
    load = lru_cache(maxsize=LOADED)(_load)
    files = sorted(group.files, key=lambda file: file.outline.seeds.min())
    spans = [(file, set(np.unique(file.outline.seeds // BLOCK).tolist())) for file in files]
    names = load(files[0].path).observables.keys()
    for block in np.unique(group.seeds // BLOCK).tolist():
        mine = [(file, load(file.path)) for file, span in spans if block in span]
        for file, runs in mine:
            _refuse_unlike(file, runs, files[0], names)
        yield _joined([chosen(runs, runs.seeds // BLOCK == block) for _, runs in mine])


def _load(path):
    """The part of a trajectory file that the measures need."""
    ensemble = read_trajectories(path).ensemble
    return Runs(ensemble.seeds, ensemble.tracer, ensemble.observables)


def _refuse_unlike(file, runs, first, names):
    if not np.array_equal(runs.seeds, file.outline.seeds):
        raise AnalysisError(f"{file.path}: was replaced while it was read; aggregate again")
    if runs.observables.keys() != names:
        unlike = ", ".join(sorted(runs.observables.keys() ^ names))
        raise AnalysisError(
            f"{file.path}: has other observables than {first.path} ({unlike}); make one of the two again"
        )


def chosen(runs, rows):
    """The runs of the given rows: indices, or truth values (n,)."""
    tracer = runs.tracer and Track(*(track if track is None else track[:, rows] for track in runs.tracer))
    return Runs(runs.seeds[rows], tracer, {name: values[rows] for name, values in runs.observables.items()})


def _joined(parts):
    """Runs of several files as one record, seeds ascending."""
    seeds = np.concatenate([runs.seeds for runs in parts])
    tracer = parts[0].tracer and Track(*map(_beside, zip(*(runs.tracer for runs in parts), strict=True)))
    observables = {name: np.concatenate([runs.observables[name] for runs in parts]) for name in parts[0].observables}
    return chosen(Runs(seeds, tracer, observables), np.argsort(seeds, kind="stable"))


def _beside(tracks):
    return None if tracks[0] is None else np.concatenate(tracks, axis=1)
