"""Trajectory files in, runs to compare out: per scene, number of disks and engine, failed runs left out."""

from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine
from brownpipe.errors import AnalysisError
from brownpipe.scene import Scene
from brownpipe.storage import read_trajectories
from brownpipe.storage.trajectories import Trajectories

OUTCOMES = ("energy_drift", "worst_overlap", "failed")


class Runs(NamedTuple):
    """All runs of one scene, number of disks and engine, in the order of their seeds."""

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,)
    times: np.ndarray  # (T,)
    moved: np.ndarray  # (S, T, 2) displacement of the tracer from its start [length]
    squared: np.ndarray  # (S, T) and its square
    outcomes: dict  # name -> (S,), of OUTCOMES; NaN where an engine has no such thing
    pair_counts: np.ndarray | None  # (S, P, R) pairs of species by distance, where the runs counted them
    failed: int  # runs that were left out

    @property
    def key(self):
        return self.scene.name, self.scene.particles, self.engine.label


def read_runs(paths) -> list[Runs]:
    """The runs of trajectory files, in any order and batches, sorted by scene, number of disks and engine.

    Raises AnalysisError if a seed comes twice, if files of one name have different scenes or sources, or lack a tracer.
    """
    parts = {}
    for path in map(str, paths):
        read = read_trajectories(path)
        if read.ensemble.tracer is None:
            raise AnalysisError(f"{path}: holds no tracer; make it again without --record none")
        key = (read.scene.name, read.scene.particles, read.engine.label)
        parts.setdefault(key, []).append((path, read))
    return [_joined(parts[key]) for key in sorted(parts)]


def runs_of(scene, engine, ensemble) -> Runs:
    """The runs of an ensemble (engines.state.Ensemble), seeds in ascending order."""
    return _joined([("", Trajectories(scene, engine, ensemble))])


def _joined(parts):
    (path, first), *others = parts
    for other, read in others:
        if (read.scene.digest, read.source) != (first.scene.digest, first.source):
            raise AnalysisError(
                f"{other}: of another scene or made by another source than {path}; make one of them again"
            )
    seeds = np.concatenate([read.ensemble.seeds for _, read in parts])
    order = np.argsort(seeds, kind="stable")
    twice = np.flatnonzero(np.diff(seeds[order]) == 0)
    if twice.size:
        raise AnalysisError(f"{path}: seed {seeds[order][twice[0]]} is there twice; each run may count only once")
    outcomes = {name: np.concatenate([_outcome(read, name) for _, read in parts])[order] for name in OUTCOMES}
    kept = outcomes["failed"] == 0
    moved = np.concatenate([_moved(read) for _, read in parts])[order][kept]
    outcomes = {name: values[kept] for name, values in outcomes.items()}
    squared, times = (moved**2).sum(axis=-1), first.ensemble.times
    counts = [read.ensemble.observables.get("pair_counts") for _, read in parts]
    counts = None if any(one is None for one in counts) else np.concatenate(counts)[order][kept]
    failed = np.count_nonzero(~kept)
    return Runs(first.scene, first.engine, seeds[order][kept], times, moved, squared, outcomes, counts, failed)


def _outcome(read, name):
    """An observable (S,); NaN if the engine has no such thing."""
    return read.ensemble.observables.get(name, np.full(len(read.ensemble.seeds), np.nan))


def _moved(read):
    """Displacements (S, T, 2) of the tracers; differences of positions and of images first, for the sake of digits."""
    track, box = read.ensemble.tracer, read.scene.box
    moved = track.position - track.position[0]
    if track.image is not None:
        moved = moved + (track.image - track.image[0]) * np.array([box.width, box.height])
    return np.ascontiguousarray(moved.transpose(1, 0, 2))
