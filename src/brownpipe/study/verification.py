"""Whether all that a study has made is there and intact: `brownpipe verify`."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.figures.origin import RECORD
from brownpipe.inspection import read_contents
from brownpipe.scene.seeds import brief_seed_text, read_seeds
from brownpipe.stages import tracked
from brownpipe.storage.store import stored_batches, without


class Verdict(NamedTuple):
    """What was found of the results of a study: paths of files, and of missing runs their folder and seeds."""

    intact: list[str]
    damaged: list[str]
    missing: list[str]


def verify_results(folder: str | Path) -> Verdict:
    """Read every dataset of a study and every file of its runs, and look for files and runs that are missing.

    What there has to be stands beside the results: the runs in `made_from_*.txt`, the figures in `provenance.json`.
    Raises WrongFileError if there is no such folder, or nothing in it that can be verified. Nothing is written.
    """
    folder = Path(folder)
    runs = [line.rsplit(" ", 1) for path in folder.glob("*/made_from_*.txt") for line in path.read_text().splitlines()]
    files = sorted(str(path) for path in folder.rglob("*") if path.suffix in (".h5", ".nc"))
    if not files and not runs:
        raise WrongFileError(f"{folder}: has no results of a study; must be results/STUDY, or files")
    missing = list(_missing_figures(folder))
    for where, text in dict.fromkeys(map(tuple, runs)):
        place, seeds = folder.absolute().parents[1] / where, np.asarray(read_seeds(text), np.int64)
        place = Path(os.path.relpath(place))
        stored = stored_batches(place, seeds)
        files += [str(place / f"{first}-{last}.h5") for first, last in stored]
        if len(left := without(seeds, stored)):
            missing.append(f"{where}: seeds {brief_seed_text(left)}")
    damaged = [file for file in tracked(files, "files") if not _is_intact(file)]
    return Verdict([file for file in files if file not in damaged], damaged, missing)


def _missing_figures(folder: Path) -> Iterator[str]:
    for record in folder.glob(f"*/{RECORD}"):
        for name in json.loads(record.read_text())["files"]:
            if not (record.parent / name).is_file():
                yield str(record.parent / name)


def _is_intact(path: str) -> bool:
    try:
        read_contents(path)
    except StorageError:
        return False
    return True
