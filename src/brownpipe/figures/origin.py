"""What a figure, table or page was made from: a record (JSON) in its metadata and in
`provenance.json` beside it.

The record has the options of `brownpipe figures`, the source and versions that drew, and all that
the dataset says of
itself: runs, seeds, options, source and versions. It is deterministic: no date, folder, machine or
user.

    PNG    text chunks `Description` and `Source` (the record)
    SVG    Dublin Core elements `description` and `source`
    GIF    a comment block
    HTML   a script element of class `brownpipe-record`, which is no program but JSON
    CSV    nothing, so that every program reads it: the record is in `provenance.json`
    txt    the last two lines name version, source, commit and dataset
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from brownpipe.storage.datasets import made_by
from brownpipe.storage.trajectories import RunsRecord, Trajectories, runs_record
from brownpipe.text import printable

if TYPE_CHECKING:
    from xarray import Dataset

RECORD = "provenance.json"
DESCRIBING = {"Conventions", "title", "comment"}  # attributes of every dataset
IN_JSON = {"made_from", "options"}
IN_TEXT = re.compile(rb'(?:<dc:source>|class="brownpipe-record">)([^<]*)<')


class Record(TypedDict, total=False):
    """What a product was made from, as JSON."""

    made_by: dict[str, str]  # source, versions and commit of the step that drew
    dataset: dict[str, Any]  # the seal of a dataset, and what it says of itself
    # the options of `brownpipe figures` that were given
    figures: list[str]
    particles: int
    panel: list[str]
    title: str
    note: str
    movie: dict[str, float | None]  # the seed, and the options of `brownpipe movie`
    made_from: list[RunsRecord]  # of a movie: its run
    files: list[str]  # of `provenance.json`: in its folder


def record_of(dataset: Dataset, digest: str, options: Record) -> Record:
    """Return the record of the figures of a dataset.

    digest: the seal of the dataset's file. options: those of `brownpipe figures` that are given.
    """
    of_dataset: dict[str, Any] = {"sha256": digest}
    for name, value in dataset.attrs.items():
        if name not in DESCRIBING:
            of_dataset[str(name)] = json.loads(value) if name in IN_JSON else str(value)
    return {**options, "made_by": made_by("figures"), "dataset": of_dataset}


def movie_record(
    trajectories: Trajectories, recorded: str, seed: int, **options: float | None
) -> Record:
    """Return the record of a picture or movie of the run of a seed, with the options of `brownpipe
    movie`.

    `recorded` is what the picture needs, as `--record` takes it.
    """
    return {
        "movie": {"seed": seed, **options},
        "made_by": made_by("figures"),
        "made_from": [runs_record(trajectories, [seed], recorded)],
    }


def metadata(record: Record) -> dict[str, str]:
    """Return the metadata of a PNG or SVG with this record, as matplotlib takes them."""
    return {"Description": "Made by brownpipe.", "Source": json.dumps(record, sort_keys=True)}


def record_text(record: Record, names: Iterable[str]) -> str:
    """Return the text of `provenance.json`: the record, and the files in the folder that it belongs
    to.
    """
    complete: Record = {"files": sorted(names), **record}
    return json.dumps(complete, indent=1, sort_keys=True) + "\n"


def closing_lines(record: Record) -> str:
    """Return the lines at the end of a text file: what made it, and where all the rest is said."""
    installation = installation_in_words(record["made_by"])
    digest = record["dataset"]["sha256"][:12]
    return f"Made by {installation} from the dataset {digest}.\nScenes, seeds, versions: {RECORD}\n"


def installation_in_words(made: Mapping[str, str]) -> str:
    """Return version, source, commit and Python of what made a product, in one line.

    The source is that of the step: other steps have digests of their own.
    """
    commit = str(made.get("git_commit", ""))
    commit = f", commit {commit[:12]}{commit[40:]}" if commit else ""
    source = str(made.get("source_digest"))[:12]
    version = made.get("brownpipe_version")
    python = made.get("python")
    return printable(f"brownpipe {version}, source of figures {source}{commit}, Python {python}")


def read_record(path: str | Path) -> Record | None:
    """Return the record in a picture or page, that in `provenance.json` beside a table or text,
    None without one.

    Raises OSError if the file cannot be read.
    """
    from PIL import Image, UnidentifiedImageError

    path = Path(path)
    text = path.read_bytes()
    record_file = path.with_name(RECORD)
    try:
        if path.suffix in (".png", ".gif"):
            with Image.open(path) as picture:
                text = picture.info.get("Source") or picture.info["comment"]
        elif element := IN_TEXT.search(text):
            text = html.unescape(element[1].decode()).encode()
        elif record_file.is_file():
            text = record_file.read_bytes()
        record = json.loads(text)
        if "made_by" not in record:
            return None
        files = (*record.get("files", [path.name]), RECORD)
        return record if path.name in files else None
    except (KeyError, TypeError, UnidentifiedImageError, ValueError):
        return None
