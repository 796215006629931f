"""The runs that the trade-off compares: all runs of one scene, number of disks and engine that did not fail."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.runs import Group, RunBlock, block_of, blocks_of, reported, select
from brownpipe.engines import Engine
from brownpipe.engines.state import Ensemble
from brownpipe.errors import AnalysisError
from brownpipe.observables.displacement import displacement
from brownpipe.scene import Scene
from brownpipe.tradeoff.front import REFERENCE_NAME

OUTCOMES = ("energy_drift", "worst_overlap", "failed")


class EngineRuns(NamedTuple):
    """All runs of one scene, number of disks and engine, in the order of their seeds; failed ones left out."""

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) [time]
    displacement: np.ndarray  # (S, T, 2) of the tracer from its start [length]
    squared: np.ndarray  # (S, T) its square [length^2]
    outcomes: dict[str, np.ndarray]  # name -> (S,), of OUTCOMES; NaN where an engine does not report it
    pair_counts: np.ndarray | None  # (S, P, R) pairs of species by distance, if recorded
    failed: int  # number of runs left out

    @property
    def share_sound(self) -> float:
        """The share of runs that did not fail."""
        return len(self.seeds) / max(len(self.seeds) + self.failed, 1)

    @property
    def is_reference(self) -> bool:
        return self.engine.name == REFERENCE_NAME


def read_runs(groups: Sequence[Group]) -> list[EngineRuns]:
    """Return the runs of groups of trajectory files, `analysis.runs.groups_of`.

    Raises AnalysisError for files without a tracer and what `analysis.runs.blocks_of` raises.
    """
    for group in groups:
        if not group.outline.tracer:
            raise AnalysisError(f"{group.files[0].path}: holds no tracer; make it again without --record none")
    return [
        _joined(group.outline.scene, group.outline.engine, group.outline.times, blocks_of(group)) for group in groups
    ]


def runs_of(scene: Scene, engine: Engine, ensemble: Ensemble) -> EngineRuns:
    """Return the runs of an ensemble with ascending seeds."""
    return _joined(scene, engine, ensemble.times, [block_of(ensemble)])


def _joined(scene: Scene, engine: Engine, times: np.ndarray, blocks: Iterable[RunBlock]) -> EngineRuns:
    """Blocks of ascending seeds as one record."""
    size, failed = (scene.box.width, scene.box.height), 0
    seeds, tracks, outcomes, counts = [], [], [], []
    for runs in blocks:
        good = np.flatnonzero(reported(runs, "failed") == 0)
        failed += len(runs.seeds) - len(good)
        runs = select(runs, good)
        seeds.append(runs.seeds)
        track = displacement(runs.tracer.position, runs.tracer.image, size)
        tracks.append(np.ascontiguousarray(track.transpose(1, 0, 2)))
        outcomes.append([reported(runs, name) for name in OUTCOMES])
        counts.append(runs.observables.get("pair_counts"))
    moved = np.concatenate(tracks)
    return EngineRuns(
        scene,
        engine,
        np.concatenate(seeds),
        times,
        moved,
        (moved**2).sum(axis=-1),
        {name: np.concatenate(parts) for name, parts in zip(OUTCOMES, zip(*outcomes, strict=True), strict=True)},
        None if counts[0] is None else np.concatenate(counts),
        failed,
    )
