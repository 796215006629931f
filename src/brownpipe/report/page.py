"""A page with all results of a dataset: one HTML file that needs neither network nor other files, from `page.html`."""

from __future__ import annotations

import base64
import json
import math
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from jinja2 import Environment, Template
from markupsafe import Markup, escape

from brownpipe import figures
from brownpipe.figures.origin import closing_lines
from brownpipe.quoting import printable

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from brownpipe.figures.drawing import Drawing
    from brownpipe.figures.origin import Record
    from brownpipe.figures.tables import Table

CAPTIONS = Path(figures.__file__).parent
FROM_DATASET = ("sha256", "source_digest", "git_commit", "python")
MOST_ROWS = 400  # of a table of numbers
DIGITS = 6  # of a number
SVG_SIZE = re.compile(rb'viewBox="0 0 (\S+) (\S+)"')
NUMBER = re.compile(r"-|[<+-]?[ 0-9.e+-]+( ± [0-9.e-]+)?( ?%)?( \([0-9.e-]+\))?")  # cells that are set right
WHOLE = re.compile(r"(±|p =|below) \S+")  # not to be divided at the end of a line


class Section(NamedTuple):
    """A part of a page with a heading."""

    name: str  # by which links find it
    heading: str
    contents: str  # HTML


@cache
def _template() -> Template:
    """Return the page and its parts; what is filled in is escaped, and shown as one line."""
    environment = Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: value if isinstance(value, Markup) else printable(value),
    )
    environment.filters["cell"] = _cell
    return environment.from_string(Path(__file__).with_suffix(".html").read_text(encoding="utf-8"))


def _part(name: str, *contents: object) -> Markup:
    """Return a part of a page, made by the macro of this name."""
    return getattr(_template().module, name)(*contents)


def page(title: str, lead: str, sections: Sequence[Section], record: Record) -> bytes:
    """Return the page: a title, a sentence below it, its sections, and how to make it again from its `record`."""
    sections = [*sections, Section("again", "Make it again", _again(record))]
    style = Markup(Path(__file__).with_suffix(".css").read_text(encoding="utf-8"))
    return _template().render(title=title, lead=lead, sections=sections, style=style).strip().encode() + b"\n"


def _again(record: Record) -> Markup:
    """Return the commands that make the runs again, versions and digests, and the record."""
    made_from = record["dataset"].get("made_from", [])
    return _part(
        "again",
        [origin["command"] for origin in made_from],
        closing_lines(record).splitlines()[:1],
        table(_versions(record), "Versions and digests"),
        json.dumps(record, sort_keys=True, indent=1).splitlines(),
    )


def _versions(record: Record) -> list[list[str]]:
    """Return what made the dataset and the figures, by columns."""
    made, dataset = record["made_by"], record["dataset"]
    names = sorted(name for name in {**dataset, **made} if name.endswith("_version"))
    names = [*(name for name in FROM_DATASET if name in dataset), *names]
    return [
        ["", *(name.removesuffix("_version").replace("sha256", "SHA-256").replace("_", " ") for name in names)],
        ["dataset", *(str(dataset.get(name, "-")) for name in names)],
        ["figures", *(str(made.get(name, "-")) for name in names)],
    ]


def paragraphs(lines: Iterable[str], kind: str = "") -> Markup:
    """Return lines, each as a paragraph, in a division of the class `kind`, if there are any."""
    return _part("paragraphs", list(lines), kind)


def table(
    columns: Sequence[Sequence[str]], title: str, above: tuple[str, int] | None = None, grouped: bool = False
) -> Markup:
    """Return a table given its columns of words, each with its heading; the cells of the first name the rows.

    `title` says what the table shows, to those who cannot see it. `above`: a heading above the last columns, and their
    number. `grouped`: the first column names groups of rows, and has a line of its own above each.
    """
    groups, columns = (columns[0][1:], columns[1:]) if grouped else ((), columns)
    kinds = ["number" if all(map(NUMBER.fullmatch, cells)) else "" for _, *cells in columns]
    header, *rows = zip(*columns, strict=True)
    return _part("table", title, header, rows, kinds, above, groups)


def _cell(words: str) -> Markup:
    """Return the words of a cell: numbers with errors in one piece, and verdicts that begin with yes stand out."""
    whole = WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(printable(words))))
    return Markup(re.sub("^yes,", "<strong>yes</strong>,", whole))


def caption_of(name: str) -> tuple[str, list[str]]:
    """Return title and paragraphs of the caption of a figure, which lies beside its module (reStructuredText)."""
    contents = (CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")
    title, _, rest = contents.removeprefix("**").partition("**")
    return title.strip().removesuffix("."), [" ".join(part.split()) for part in rest.split("\n\n")]


def figure(drawing: Drawing, caption: str, title: str | None = None) -> Markup:
    """Return a figure with the caption of this name and its numbers; `title` replaces that of the caption.

    The picture is an image of its own, so that ids in its SVG cannot collide with those of other figures. Of a long
    table the first MOST_ROWS rows are shown.
    """
    own_title, parts = caption_of(caption)
    svg, shown = drawing.images["svg"], drawing.table
    width, height = (float(size) for size in SVG_SIZE.search(svg).groups())
    image, count = base64.b64encode(svg).decode(), len(shown.rows)
    which = f"the first {MOST_ROWS} of {count:,} rows" if count > MOST_ROWS else f"{count:,} row{'s' * (count != 1)}"
    remark = (
        f"Rounded to {DIGITS} digits. The CSV file of this figure has all {'rows and ' * (count > MOST_ROWS)}digits."
    )
    numbers = _numbers(shown, f"Numbers: {title or own_title}")
    size = f"{width:g}", f"{height:g}"
    return _part("figure", drawing.name, title or own_title, parts, *size, image, which, remark, numbers)


def _numbers(shown: Table, title: str) -> Markup:
    """Return the first MOST_ROWS rows of a table of numbers and names."""
    cells = [[_in_digits(value) for value in row] for row in shown.rows[:MOST_ROWS]]
    return table([list(column) for column in zip(shown.header, *cells, strict=True)], title)


def _in_digits(value: object) -> str:
    """Return a number or name of a table of numbers in words."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.{DIGITS}g}"
    return str(value)
