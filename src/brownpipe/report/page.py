"""Web pages from templates (jinja2): one HTML file each, that needs neither network nor other files.

`page.html` is that of all results of a dataset, `replay.html` (`replay.py`) that of one run.
"""

import base64
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from xarray import Dataset

from brownpipe import figures
from brownpipe.figures import tradeoff
from brownpipe.figures.cases import cases_of
from brownpipe.figures.origin import Record
from brownpipe.figures.render import Drawing
from brownpipe.figures.summary import answer
from brownpipe.text import counted, printable

CAPTIONS = Path(figures.__file__).parent
NOTE = "harrison2020"  # the scenes of the note begin with this name
MOST_ROWS = 400  # of a table of numbers
DIGITS = 6  # of a number


def _in_words(value: object) -> object:
    """Return a value that a template shows as one line of text, a number with DIGITS."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.{DIGITS}g}"
    return value if isinstance(value, Markup) else printable(value)


ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=_in_words,
)


def filled(template: str, **contents: Any) -> bytes:
    """Return a page: the template of this name with its contents, which are escaped and shown as one line each."""
    return ENVIRONMENT.get_template(template).render(contents).strip().encode() + b"\n"


def page_of_study(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a study: the answer and its figures, the health of its runs last."""
    found, cases = answer(dataset, record.get("figures") or ()), cases_of(dataset)
    scenes, counts = (dict.fromkeys(str(case[name].item()) for case in cases) for name in ("scene", "particles"))
    runs = counted(sum(int(case.runs) for case in cases), "run")
    of_note = any(scene.startswith(NOTE) for scene in scenes)
    return filled(
        "page.html",
        title=record.get("title") or "Brownian motion of hard disks",
        lead=f"{', '.join(scenes)}; N = {', '.join(counts)}; {runs}",
        note=(record.get("note") or "").strip().split("\n\n"),
        answers=[("", _rows(found.columns))],
        warnings=[*found.drifting, *found.missing],
        legend=found.legend,
        figures=[_figure(one, one.name, of_note) for one in drawings],
        record=record,
    )


def page_of_tradeoff(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a cost-accuracy trade-off: for each scene the answer and its figure."""
    scenes = tradeoff.scenes_of(dataset)
    return filled(
        "page.html",
        title=caption_of("tradeoff")[0],
        lead=", ".join(scenes),
        answers=[(scene, _rows(tradeoff.columns_of(dataset, scene))) for scene in scenes],
        legend=tradeoff.REMARK.splitlines(),
        figures=[_figure(one, "tradeoff") | {"title": scene} for one, scene in zip(drawings, scenes, strict=True)],
        record=record,
    )


def _rows(columns: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    """Return the rows of a table of words, the headings first, given its columns."""
    return [*zip(*columns, strict=True)]


def caption_of(name: str) -> tuple[str, list[str]]:
    """Return title and paragraphs of the caption of a figure, which lies beside its module (reStructuredText)."""
    contents = (CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")
    title, _, rest = contents.removeprefix("**").partition("**")
    return title.strip().removesuffix("."), [" ".join(part.split()) for part in rest.split("\n\n")]


def _figure(drawing: Drawing, caption: str, of_note: bool = False) -> dict[str, Any]:
    """Return a figure with the caption of this name and its numbers, of a long table the first MOST_ROWS rows.

    of_note: with the paragraph on what the note found in its scene.
    The picture is an image of its own, so that ids in its SVG cannot collide with those of other figures.
    """
    title, paragraphs = caption_of(caption)
    parts = [part for part in paragraphs if of_note or not part.startswith("The note ")]
    shown = drawing.table.head(MOST_ROWS)
    image, rows = base64.b64encode(drawing.images["svg"]).decode(), shown.itertuples(index=False, name=None)
    of_table = {"numbers": [[*shown], *rows], "rows": len(drawing.table)}
    return {"name": drawing.name, "title": title, "caption": parts, "image": image} | of_table
