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
from brownpipe.storage.store import read_stored, seeds_without_file, stored_batches


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
    files = {path for path in paths if path.suffix in (".h5", ".nc")}
    runs, products, damaged = _listed(paths)
    if not (files or runs or damaged):
        raise WrongFileError(
            f"{folder}: has no dataset and no list of runs; must be results, results/STUDY or files"
        )
    listed = {path for path, _ in products}
    drawn = {path for path in listed if path.is_file()}
    missing = [relpath(path) for path in sorted(listed - files - drawn)]
    stored: set[Path] = set()
    for place, seeds in sorted(runs, key=str):
        batches = stored_batches(place, np.asarray(seeds))
        stored |= {place / f"{first}-{last}.h5" for first, last in batches}
        absent = seeds_without_file(np.asarray(seeds), batches)
        if len(absent):
            missing.append(f"{relpath(place)}: seeds {brief_seed_text(absent)}")
    for file in tracked(sorted(files | stored), "files"):
        read = read_stored if file in stored else verified
        try:
            read(file)
        except (OSError, StorageError):
            damaged.add(file)
    for path, digest in products:
        if path in files | drawn and sha256(path.read_bytes()).hexdigest() != digest:
            damaged.add(path)
    intact = (files | drawn | stored) - damaged
    return [*map(relpath, sorted(intact))], [*map(relpath, sorted(damaged))], missing


def _listed(
    paths: Sequence[Path],
) -> tuple[set[tuple[Path, Sequence[int]]], set[tuple[Path, str]], set[Path]]:
    """Return what the lists among these files say must exist: the runs, by folder and seeds, and
    the products, by path and SHA-256; and the lists that cannot be read.
    """
    runs: set[tuple[Path, Sequence[int]]] = set()
    products: set[tuple[Path, str]] = set()
    damaged: set[Path] = set()
    for path in paths:
        try:
            if path.match("made_from_*.txt"):
                runs |= _runs_in(path)
            elif path.match("drawn_from_*.txt"):
                products |= _products_in(path)
        except ValueError:
            damaged.add(path)
    return runs, products, damaged


def _runs_in(path: Path) -> set[tuple[Path, Sequence[int]]]:
    """Return folder and seeds of each line, such as "results/runs/box/N200/exact-1f3a 0-99", of a
    list of runs. Raises ValueError if it has none, or one of another form.
    """
    top = path.parents[3]
    runs = set()
    for line in path.read_text().splitlines() or [""]:
        folder, seeds = line.rsplit(" ", 1)
        runs.add((top / folder, validated(Seeds, seeds)))
    return runs


def _products_in(path: Path) -> set[tuple[Path, str]]:
    """Return path and SHA-256 of each line of a list as `sha256sum` writes it. Raises ValueError if
    it has none, or one of another form.
    """
    top = path.parents[3]
    products = set()
    for line in path.read_text().splitlines() or [""]:
        digest, name = line.split("  ", 1)
        products.add((top / name, digest))
    return products
