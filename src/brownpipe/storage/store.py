"""Where runs are stored that studies share: folders named after what determines the runs in them.

    results/runs/harrison2020/N150/exact-1a2b3c4d/0-2399.h5

The last digits are those of a SHA-256 over the scene, the engine with its settings, what is
recorded and measured, and the source of brownpipe that runs it. A file holds the seeds of its name.
So studies share equal runs, and never find other runs in their place, whatever was edited, copied
or lost. Jobs of studies write them; Python reads them, too.
"""

import re
from collections.abc import Iterable, Sequence, Set
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble
from brownpipe.errors import StorageError
from brownpipe.observables.own import identity
from brownpipe.progress import tracked
from brownpipe.provenance import digest_of, source_digest
from brownpipe.scene import Scene
from brownpipe.storage.trajectories import Trajectories, read_trajectories

RUNS = Path("results/runs")
FILE = re.compile(r"(\d{1,19})-(\d{1,19})\.h5")
DIGITS = 8  # of the digest in the name of a folder


class StoredFile(NamedTuple):
    """A file of runs, and what it is to hold."""

    path: Path
    seeds: Sequence[int]  # the wanted ones, also those in other files


def runs_digest(
    scene: Scene, engine: Engine, record: Set[str], observables: Iterable[str], average: str
) -> str:
    """Return the digest of all that determines runs besides their seeds, and of the scene's name,
    which they carry.
    """
    source = source_digest("simulate", engine.name)
    names = sorted(map(identity, observables))
    return digest_of(
        scene.name, scene.digest, engine.options, sorted(record), names, average, source
    )


def folder_of_runs(scene: Scene, engine: Engine, digest: str) -> Path:
    """Return the folder of runs with this digest, relative to the folder of the studies."""
    return RUNS / scene.name / f"N{scene.particles}" / f"{engine.label}-{digest[:DIGITS]}"


def read_stored(path: Path, outline: bool = False) -> Trajectories:
    """Return the runs of a file of the store, as `read_trajectories`.

    Raises StorageError if the file is damaged or holds other runs than its folder and name say.
    """
    runs = read_trajectories(path, outline)
    first, last = map(int, path.stem.split("-"))
    digits = runs.header["runs_digest"][:DIGITS]
    is_of_folder = path.parent.name.endswith(f"-{digits}")
    if not is_of_folder or not np.array_equal(runs.ensemble.seeds, range(first, last + 1)):
        raise StorageError(
            f"{path}: holds other runs than its name says; delete it and run the study again"
        )
    return runs


def stored_runs(scene: Scene, engine: Engine, digest: str, seeds: np.ndarray) -> list[Ensemble]:
    """Return the files of the store in the current folder that hold some of these runs; `seeds`
    (S,) ascend.

    Raises StorageError as `read_stored`.
    """
    folder = folder_of_runs(scene, engine, digest)
    batches = tracked(stored_batches(folder, seeds), "files")
    return [read_stored(folder / f"{first}-{last}.h5").ensemble for first, last in batches]


def stored_batches(folder: str | Path, seeds: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last seed of the files in a folder that hold some of `seeds` (ascending), no
    seed twice.
    """
    batches = []
    for path in Path(folder).glob("*.h5"):
        if match := FILE.fullmatch(path.name):
            batches.append((int(match[1]), int(match[2])))
    batches.sort(key=lambda batch: (batch[0], -batch[1]))  # of equal first seeds the longest
    chosen: list[tuple[int, int]] = []
    for first, last in batches:
        is_wanted = np.searchsorted(seeds, last, "right") > np.searchsorted(seeds, first)
        if is_wanted and (not chosen or first > chosen[-1][1]):
            chosen.append((first, last))
    return chosen


def seeds_without_file(seeds: np.ndarray, batches: Iterable[tuple[int, int]]) -> np.ndarray:
    """Return the seeds (ascending) that are in none of the batches (first, last)."""
    is_left = np.ones(len(seeds), bool)
    for first, last in batches:
        is_left[np.searchsorted(seeds, first) : np.searchsorted(seeds, last, "right")] = False
    return seeds[is_left]
