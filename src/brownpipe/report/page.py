"""A page with all results of a dataset: one HTML file that needs neither network nor other files, from `page.html`."""

from __future__ import annotations

import base64
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from brownpipe import figures
from brownpipe.figures.origin import closing_lines
from brownpipe.figures.pages import filled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from brownpipe.figures.origin import Record
    from brownpipe.figures.render import Drawing

CAPTIONS = Path(figures.__file__).parent
MOST_ROWS = 400  # of a table of numbers
DIGITS = 6  # of a number
SVG_SIZE = re.compile(rb'viewBox="0 0 (\S+) (\S+)"')
NUMBERS = tuple("-+<0123456789")  # first characters of the cells of columns that are set right


class Table(NamedTuple):
    """A table of words, as the template takes it."""

    title: str  # says what it shows to those who cannot see it
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    kinds: Sequence[str]  # of its columns: number or nothing
    groups: Sequence[str]  # of its rows, each group below a line of its own, or none
    above: tuple[str, int] | None  # a heading above the last columns, and their number


def table(
    columns: Sequence[Sequence[str]], title: str, above: tuple[str, int] | None = None, grouped: bool = False
) -> Table:
    """Return a table given its columns of words, each with its heading; `grouped`: the first names groups of rows."""
    groups, columns = (columns[0][1:], columns[1:]) if grouped else ((), columns)
    kinds = ["number" if all(cell.startswith(NUMBERS) for cell in cells) else "" for _, *cells in columns]
    header, *rows = zip(*columns, strict=True)
    return Table(title, header, rows, kinds, groups, above)


def page(title: str, lead: str, record: Record, **contents: Any) -> bytes:
    """Return the page: a title, a sentence below it, its contents, and how to make it again from its `record`.

    contents: `answers` (heading, table, lines), `drifting`, `missing` and `legend` (lines), `figures` and `of_runs`
    (`figure`).
    """
    made_by = closing_lines(record).splitlines()[:1]
    return filled(
        Path(__file__).with_suffix(".html"), title=title, lead=lead, record=record, made_by=made_by, **contents
    )


def caption_of(name: str) -> tuple[str, list[str]]:
    """Return title and paragraphs of the caption of a figure, which lies beside its module (reStructuredText)."""
    contents = (CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")
    title, _, rest = contents.removeprefix("**").partition("**")
    return title.strip().removesuffix("."), [" ".join(part.split()) for part in rest.split("\n\n")]


def figure(drawing: Drawing, caption: str, title: str | None = None) -> dict[str, Any]:
    """Return a figure with the caption of this name and its numbers; `title` replaces that of the caption.

    The picture is an image of its own, so that ids in its SVG cannot collide with those of other figures. Of a long
    table the first MOST_ROWS rows are shown.
    """
    own_title, parts = caption_of(caption)
    svg, shown = drawing.images["svg"], drawing.table.head(MOST_ROWS)
    return {
        "name": drawing.name,
        "title": title or own_title,
        "caption": parts,
        "size": [f"{float(size):g}" for size in SVG_SIZE.search(svg).groups()],
        "image": base64.b64encode(svg).decode(),
        "numbers": table([[str(name), *map(_in_digits, shown[name])] for name in shown], f"Numbers: {own_title}"),
        "rows": len(drawing.table),
        "digits": DIGITS,
    }


def _in_digits(value: object) -> str:
    """Return a number or name of a table of numbers in words."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.{DIGITS}g}"
    return str(value)
