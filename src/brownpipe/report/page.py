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
from brownpipe.figures.origin import Record, closing_lines
from brownpipe.figures.render import Drawing
from brownpipe.figures.summary import answer
from brownpipe.text import printable

CAPTIONS = Path(figures.__file__).parent
NOTE = "harrison2020"  # the scenes of the note begin with this name
MOST_ROWS = 400  # of a table of numbers
DIGITS = 6  # of a number
NUMBERS = tuple("-+<0123456789")  # first characters of the cells of columns that are set right
ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=lambda value: value if isinstance(value, Markup) else printable(value),
)


def filled(template: str, **contents: Any) -> bytes:
    """Return a page: the template of this name with its contents, which are escaped and shown as one line each."""
    return ENVIRONMENT.get_template(template).render(contents).strip().encode() + b"\n"


def page_of_study(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a study: the answer, its figures, and the health of its runs."""
    found, cases = answer(dataset, record.get("figures") or ()), cases_of(dataset)
    scenes, counts = (dict.fromkeys(str(case[name].item()) for case in cases) for name in ("scene", "particles"))
    runs = sum(int(case.runs) for case in cases)
    of_note = any(scene.startswith(NOTE) for scene in scenes)
    return _page(
        record.get("title") or "Brownian motion of hard disks",
        f"{', '.join(scenes)}; N = {', '.join(counts)}; {runs:,} run{'' if runs == 1 else 's'}",
        record,
        note=(record.get("note") or "").strip().split("\n\n"),
        answers=[("", _table(found.columns, "Answer", grouped=True), [])],
        drifting=found.drifting,
        missing=found.missing,
        legend=found.legend,
        figures=[_figure(one, one.name, of_note) for one in drawings if one.name != "health"],
        of_runs=[_figure(one, one.name) for one in drawings if one.name == "health"],
    )


def page_of_tradeoff(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a cost-accuracy trade-off: for each scene the answer and its figure."""
    scenes, (title, _) = tradeoff.scenes_of(dataset), caption_of("tradeoff")
    return _page(
        title,
        ", ".join(scenes),
        record,
        answers=[
            (scene, _table(tradeoff.columns_of(dataset, scene), scene), [*tradeoff.off_front(dataset, scene)])
            for scene in scenes
        ],
        legend=tradeoff.REMARK.splitlines(),
        figures=[_figure(one, "tradeoff") | {"title": scene} for one, scene in zip(drawings, scenes, strict=True)],
    )


def _page(title: str, lead: str, record: Record, **contents: Any) -> bytes:
    """Return the page: a title, a sentence below it, its contents, and how to make it again from its `record`.

    contents: `answers` (heading, table, lines), `drifting`, `missing` and `legend` (lines), `figures` and `of_runs`.
    """
    made_by = closing_lines(record).splitlines()[:1]
    return filled("page.html", title=title, lead=lead, record=record, made_by=made_by, digits=DIGITS, **contents)


def _table(columns: Sequence[Sequence[str]], title: str, grouped: bool = False) -> dict[str, Any]:
    """Return a table of words as the template takes it, given its columns, each with its heading.

    title: says what it shows to those who cannot see it. grouped: the first column names groups of rows, each of which
    stands below a line of its own.
    """
    groups, columns = (columns[0][1:], columns[1:]) if grouped else ((), columns)
    kinds = ["number" if all(cell.startswith(NUMBERS) for cell in cells) else "" for _, *cells in columns]
    header, *rows = zip(*columns, strict=True)
    return {"title": title, "header": header, "rows": rows, "kinds": kinds, "groups": groups}


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
    title, parts = caption_of(caption)
    shown = drawing.table.head(MOST_ROWS)
    return {
        "name": drawing.name,
        "title": title,
        "caption": [part for part in parts if of_note or not part.startswith("The note ")],
        "image": base64.b64encode(drawing.images["svg"]).decode(),
        "numbers": _table([[str(name), *map(_in_digits, shown[name])] for name in shown], f"Numbers: {title}"),
        "rows": len(drawing.table),
    }


def _in_digits(value: object) -> str:
    """Return a number or name of a table of numbers in words."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.{DIGITS}g}"
    return str(value)
