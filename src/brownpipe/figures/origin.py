"""What a figure, table or summary was made from: a record (JSON) in its metadata and in `provenance.json` beside it.

The record has the options of `brownpipe figures`, the source and versions that drew, and all that the dataset says of
itself: runs, seeds, options, source and versions. It is deterministic: no date, folder, machine or user.

    PNG    text chunks `Description` and `Source` (the record)
    SVG    Dublin Core elements `description` and `source`
    GIF    a comment block
    MP4    the comment
    HTML   a script element of class `brownpipe-record`, which is no program but JSON
    CSV    nothing, so that every program reads it: the record is in `provenance.json`
    txt    the last two lines name version, source, commit and dataset
"""

from __future__ import annotations

import html
import json
import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brownpipe.errors import StorageError
from brownpipe.quoting import printable
from brownpipe.storage import made_by, runs_record
from brownpipe.storage.origin import UNSAID
from brownpipe.storage.trajectories import whole_seed

if TYPE_CHECKING:
    from xarray import Dataset

    from brownpipe.storage import Trajectories

RECORD = "provenance.json"
AGAIN = "`brownpipe inspect FILE --reproduce` makes it again and compares; FILE is this file."
DESCRIBING = {"Conventions", "title", "comment", "rerun"}  # attributes of every dataset
IN_JSON = {"made_from", "options"}
PNG, GIF = b"\x89PNG\r\n\x1a\n", (b"GIF87a", b"GIF89a")
HEAD = 33  # bytes of a PNG before its second chunk
END_OF_GIF = b"\x3b"
IN_SVG = "<dc:format>image/svg+xml</dc:format>"
HTML, IN_HTML = b"<!DOCTYPE html>", '<script type="application/json" class="brownpipe-record">'
Record = dict[str, Any]


def record_of(
    dataset: Dataset, step: str, digest: str, names: Sequence[str] | None = None, particles: int | None = None
) -> Record:
    """Return the record of the figures of a dataset: `step` draws them, `digest` is the seal of the dataset's file.

    names, particles: the options of `brownpipe figures`. Raises StorageError for a dataset with other attributes than
    brownpipe writes.
    """
    return {
        "figures": None if names is None else [*names],
        "particles": particles,
        "made_by": made_by(step),
        "dataset": {"sha256": digest} | _stated(dataset.attrs),
    }


def movie_record(
    trajectories: Trajectories,
    path: str,
    seed: int | None,
    frames: int | None = None,
    fps: float | None = None,
    recorded: str = "all",
) -> Record:
    """Return the record of a picture or movie of one run; the options are those of `brownpipe movie`.

    `path` is the file of the trajectories, for messages; `recorded` is what the picture needs, as `--record` takes it.
    Raises RequestError for a file without this run.
    """
    shown = whole_seed(trajectories, path, seed)
    return {
        "movie": {"seed": shown, "frames": frames, "fps": fps},
        "made_by": made_by("figures"),
        "made_from": [runs_record(trajectories.outline, [shown], recorded)],
    }


def _stated(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the attributes that say what a dataset was made from; those in JSON as what they mean."""
    stated = {str(name): value for name, value in attributes.items() if name not in DESCRIBING}
    try:
        parsed = {name: json.loads(stated[name]) for name in IN_JSON & stated.keys()}
        named = [origin[key] for origin in parsed.get("made_from", []) for key in ("command", "scene_digest")]
        if all(isinstance(value, str) for value in (*stated.values(), *named)):
            return stated | parsed
    except (KeyError, RecursionError, TypeError, ValueError) as error:
        raise StorageError(UNSAID) from error
    raise StorageError(UNSAID)


def dataset_attributes(record: Record) -> dict[str, Any]:
    """Return what a record says of its dataset, as the dataset's own attributes."""
    stated = record["dataset"]
    return {key: json.dumps(stated[key]) if key in IN_JSON else stated[key] for key in stated}


def record_text(record: Record, names: Iterable[str]) -> str:
    """Return the text of `provenance.json`: the record, and the files in the folder that it belongs to."""
    return json.dumps({"files": sorted(names)} | record, indent=1, sort_keys=True) + "\n"


def closing_lines(record: Record) -> str:
    """Return the lines at the end of a text file: what made it, and where all the rest is said."""
    what = installation_in_words(record["made_by"])
    return f"Made by {what} from the dataset {record['dataset']['sha256'][:12]}.\nScenes, seeds, versions: {RECORD}\n"


def installation_in_words(made: Mapping[str, Any]) -> str:
    """Return version, source, commit and Python of what made a product, in one line."""
    words = [f"brownpipe {made.get('brownpipe_version')}", f"source {str(made.get('source_digest'))[:12]}"]
    if commit := str(made.get("git_commit", "")):
        words.append(f"commit {commit[:12]}{commit[40:]}")
    return printable(", ".join([*words, f"Python {made.get('python')}"]))


# -- pictures -------------------------------------------------------------------------------------------------------


def stamped(image: bytes, name: str, record: Record) -> bytes:
    """Return the picture of a file (png, svg, gif or html) with its record in its metadata."""
    text, kind = json.dumps({"file": name} | record, sort_keys=True), name.rpartition(".")[2].lower()
    again = f" {AGAIN}" if "dataset" in record else ""
    if kind == "png":
        chunks = _png_text("Description", f"Made by brownpipe.{again}") + _png_text("Source", text)
        return image[:HEAD] + chunks + image[HEAD:]
    if kind == "svg":
        says = f"<dc:description>Made by brownpipe.{again}</dc:description>"
        stated = f"<dc:source>{html.escape(text, quote=False)}</dc:source>"
        return image.replace(IN_SVG.encode(), "\n    ".join([IN_SVG, says, stated]).encode(), 1)
    if kind == "gif":
        return image.removesuffix(END_OF_GIF) + _gif_comment(text.encode()) + END_OF_GIF
    if kind == "html":
        return image.replace(b"</head>", f"{IN_HTML}{in_script(text)}</script>\n</head>".encode(), 1)
    return image  # a video, whose comment ffmpeg writes


def in_script(text: str) -> str:
    """Return JSON as it may stand in a script element of a page, which nothing in it can end."""
    return text.replace("<", "\\u003c")


def _png_text(keyword: str, text: str) -> bytes:
    contents = b"tEXt" + keyword.encode() + b"\0" + text.encode()
    return struct.pack(">I", len(contents) - 4) + contents + struct.pack(">I", zlib.crc32(contents))


def _gif_comment(text: bytes) -> bytes:
    blocks = (text[start : start + 255] for start in range(0, len(text), 255))
    return b"\x21\xfe" + b"".join(bytes([len(block)]) + block for block in blocks) + b"\0"


def record_in(image: bytes) -> Record | None:
    """Return the record in a picture, video or page; None if there is none."""
    return next((record for record in map(_record, _texts(image)) if record is not None), None)


def _texts(image: bytes) -> Iterator[bytes]:
    """Yield the texts in a picture or page that may be its record."""
    if image.startswith(PNG):
        at = len(PNG)
        while at + 8 <= len(image):
            size, kind = struct.unpack(">I4s", image[at : at + 8])
            if kind == b"tEXt":
                yield image[at + 8 : at + 8 + size].partition(b"\0")[2]
            at += size + 12
    elif image.startswith(GIF):
        start, text = image.rfind(b'\x21\xfe\xff{"'), b""
        at = start + 2
        while 2 <= at < len(image) and image[at]:
            text, at = text + image[at + 1 : at + 1 + image[at]], at + 1 + image[at]
        yield text
    elif image.startswith(HTML):
        yield image.partition(IN_HTML.encode())[2].partition(b"</script>")[0]
    else:
        found = re.search(rb"<dc:source>([^<]*)</dc:source>", image)
        yield html.unescape(found[1].decode(errors="replace")).encode() if found else b""


def _record(text: bytes) -> Record | None:
    """Return the record that a text states, None if it is none."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) and "made_by" in record else None


def read_record(path: str | Path) -> Record | None:
    """Return the record of a product of `brownpipe figures`: its own, or that in `provenance.json` beside it.

    None if there is none.
    """
    path = Path(path)
    record = record_in(path.read_bytes()) if path.suffix not in (".csv", ".txt", ".json") else None
    beside = path.with_name(RECORD)
    return record if record is not None or not beside.is_file() else _record(beside.read_bytes())
