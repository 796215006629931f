"""Whether all that a study has made is there and intact: `brownpipe verify`."""

from collections.abc import Sequence
from hashlib import sha256
from os.path import abspath, relpath
from pathlib import Path

import numpy as np

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.progress import tracked
from brownpipe.scene.reading import validated
from brownpipe.scene.seeds import Seeds, brief_seed_text
from brownpipe.storage.files import verified
from brownpipe.storage.store import read_stored, stored_batches, without


def verify_results(folder: str | Path) -> tuple[list[str], list[str], list[str]]:
    """Verify the seals of a study's datasets, its figures and every file of its runs, and look for
    what is missing.

    Files beside the results, of one or more studies, list what must exist: the runs in
    `made_from_*.txt`, dataset and figures with their SHA-256 in `drawn_from_*.txt`. Returns the
    paths of intact, damaged and missing files; of missing runs their folder and seeds. A file that
    holds other runs than its name says is damaged. Raises WrongFileError if there is no such
    folder, or nothing in it that can be verified. Nothing is written.
    """
    paths = sorted(Path(abspath(folder)).rglob("*"))
    runs, drawn, damaged = set[tuple[Path, Sequence[int]]](), set[tuple[Path, str]](), set[Path]()
    for record in paths:
        try:
            if record.match("made_from_*.txt"):
                lines = (line.rsplit(" ", 1) for line in record.read_text().splitlines() or [""])
                runs |= {
                    (record.parents[3] / where, validated(Seeds, text)) for where, text in lines
                }
            elif record.match("drawn_from_*.txt"):
                lines = (line.split("  ", 1) for line in record.read_text().splitlines() or [""])
                drawn |= {(record.parents[3] / name, digest) for digest, name in lines}
        except ValueError:
            damaged.add(record)
    files, stored = {path for path in paths if path.suffix in (".h5", ".nc")}, set[Path]()
    if not (files or runs or damaged):
        raise WrongFileError(
            f"{folder}: has no dataset and no list of runs; must be results, results/STUDY or files"
        )
    there = files | {path for path, _ in drawn if path.is_file()}
    missing = [relpath(path) for path in sorted({path for path, _ in drawn} - there)]
    for place, asked in sorted(runs, key=str):
        batches = stored_batches(place, seeds := np.asarray(asked))
        stored |= {place / f"{first}-{last}.h5" for first, last in batches}
        if len(left := without(seeds, batches)):
            missing.append(f"{relpath(place)}: seeds {brief_seed_text(left)}")
    for file in tracked(sorted(files | stored), "files"):
        try:
            (read_stored if file in stored else verified)(file)
        except (OSError, StorageError):
            damaged.add(file)
    damaged |= {
        path
        for path, digest in drawn
        if path in there and sha256(path.read_bytes()).hexdigest() != digest
    }
    return (
        [*map(relpath, sorted((there | stored) - damaged))],
        [*map(relpath, sorted(damaged))],
        missing,
    )
