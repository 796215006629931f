"""Whether all that a study has made is there and intact: `brownpipe verify`."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from brownpipe.errors import RequestError, StorageError, WrongFileError
from brownpipe.figures.origin import RECORD
from brownpipe.progress import tracked
from brownpipe.scene.seeds import brief_seed_text, read_seeds
from brownpipe.storage.datasets import read_contents
from brownpipe.storage.store import read_stored, stored_batches, without


def verify_results(folder: str | Path) -> tuple[list[str], list[str], list[str]]:
    """Read every dataset of a study and every file of its runs, and look for figures and runs that are missing.

    What there has to be stands beside the results: the runs in `made_from_*.txt`, the figures in `provenance.json`.
    Returns the paths of intact, damaged and missing files; of missing runs their folder and seeds. A file that holds
    other runs than its name says is damaged. Raises WrongFileError if there is no such folder, or nothing in it that
    can be verified. Nothing is written.
    """
    folder = Path(folder)
    runs, figures, damaged = set[tuple[str, Sequence[int]]](), list[Path](), list[Path]()
    for record in sorted(folder.glob("*/*")):
        try:
            if record.match("made_from_*.txt"):
                lines = (line.rsplit(" ", 1) for line in record.read_text().splitlines())
                runs |= {(where, read_seeds(text)) for where, text in lines}
            elif record.name == RECORD:
                figures += [record.parent / name for name in json.loads(record.read_text())["files"]]
        except (LookupError, RequestError, ValueError):
            damaged.append(record)
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".h5", ".nc"))
    if not (files or runs or damaged):
        raise WrongFileError(f"{folder}: has no results of a study; must be results/STUDY, or files")
    missing, stored = [str(path) for path in figures if not path.is_file()], list[Path]()
    for where, asked in sorted(runs, key=str):
        place, seeds = Path(os.path.relpath(folder.absolute().parents[1] / where)), np.asarray(asked)
        batches = stored_batches(place, seeds)
        stored += [place / f"{first}-{last}.h5" for first, last in batches]
        if len(left := without(seeds, batches)):
            missing.append(f"{where}: seeds {brief_seed_text(left)}")
    files += stored
    for file in tracked(files, "files"):
        try:
            (read_stored if file in stored else read_contents)(file)
        except StorageError:
            damaged.append(file)
    return [str(file) for file in files if file not in damaged], [*map(str, damaged)], missing
