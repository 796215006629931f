"""The runs that the trade-off compares: all runs of one scene, number of disks and engine that did not fail."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.drift import quarters_of
from brownpipe.analysis.runs import Group, RunBlock, blocks_of, joined, reported, select
from brownpipe.engines import Engine
from brownpipe.errors import AnalysisError
from brownpipe.observables.displacement import displacement
from brownpipe.scene import Scene
from brownpipe.tradeoff.front import REFERENCE_NAME


class EngineRuns(NamedTuple):
    """All runs of one scene, number of disks and engine, in the order of their seeds; failed ones left out."""

    scene: Scene
    engine: Engine
    seeds: np.ndarray  # (S,) int64
    times: np.ndarray  # (T,) [time]
    displacement: np.ndarray  # (S, T, 2) of the tracer from its start [length]
    squared: np.ndarray  # (S, T) its square [length^2]
    worst_overlap: np.ndarray  # (S,) in contact distances; NaN where an engine does not report it
    pair_counts: np.ndarray | None  # (S, P, R) pairs of species by distance, if recorded
    failed: int  # number of runs left out
    quarters: Mapping[str, np.ndarray]  # (S, 4) what may drift within the runs, if they are counted in quarters

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
    found = []
    for group in groups:
        outline = group.outline
        if not outline.tracer:
            raise AnalysisError(f"{group.files[0].path}: holds no tracer; make it again without --record none")
        found.append(runs_of(outline.scene, outline.engine, [*blocks_of(group)]))
    return found


def runs_of(scene: Scene, engine: Engine, blocks: Sequence[RunBlock], squares: str | None = None) -> EngineRuns:
    """Return the runs of blocks; `squares` is an observable that stands for the tracer's squared displacement.

    Without the tracer's track its displacement is NaN.
    """
    every, times = joined(blocks), scene.times
    runs = select(every, reported(every, "failed") == 0)
    moved = np.full((len(runs.seeds), len(times), 2), np.nan)
    if runs.tracer is not None:
        moved = displacement(runs.tracer.position, runs.tracer.image, (scene.box.width, scene.box.height))
        moved = np.ascontiguousarray(moved.transpose(1, 0, 2))
    squared = runs.observables[squares] if squares else (moved**2).sum(axis=-1)
    overlap = reported(runs, "worst_overlap")
    counts, failed = runs.observables.get("pair_counts"), len(every.seeds) - len(runs.seeds)
    quarters = quarters_of(scene, times, runs.observables)
    return EngineRuns(scene, engine, runs.seeds, times, moved, squared, overlap, counts, failed, quarters)
