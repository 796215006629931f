"""The parts of a page as HTML: text, tables, and figures with caption, values and numbers."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe import figures
from brownpipe.figures.origin import in_script
from brownpipe.quoting import printable
from brownpipe.report.points import points_of

if TYPE_CHECKING:
    from brownpipe.figures.drawing import Drawing
    from brownpipe.figures.tables import Table

CAPTIONS = Path(figures.__file__).parent
MOST_ROWS = 400  # of a table of numbers
DIGITS = 6  # of a number
NUMBER = re.compile(r"-|[<+-]?[ 0-9.e+-]+( ± [0-9.e-]+)?( ?%)?( \([0-9.e-]+\))?")  # cells that are set right
WHOLE = re.compile(r"(±|p =|below) \S+")  # not to be divided at the end of a line


def text(words: object) -> str:
    """Return words of others as HTML, in one line."""
    return html.escape(printable(words))


def paragraphs(lines: Iterable[str], kind: str = "") -> str:
    """Return lines, each as a paragraph; all in a division of the class `kind`, if there are any."""
    shown = "".join(f"<p>{text(line)}</p>\n" for line in lines)
    return f'<div class="{kind}">\n{shown}</div>\n' if kind and shown else shown


def table(
    columns: Sequence[Sequence[str]], title: str, above: tuple[str, int] | None = None, grouped: bool = False
) -> str:
    """Return a table given its columns of words, each with its heading; the cells of the first name the rows.

    `title` says what the table shows, to those who cannot see it. `above`: a heading above the last columns, and their
    number. `grouped`: the first column names groups of rows, and has a line of its own above each.
    """
    groups, columns = (columns[0][1:], columns[1:]) if grouped else ((), columns)
    kinds = [' class="number"' if all(map(NUMBER.fullmatch, cells)) else "" for _, *cells in columns]
    header, *rows = zip(*columns, strict=True)
    names = "".join(f'<th scope="col"{kind}>{_cell_text(name)}</th>' for name, kind in zip(header, kinds, strict=True))
    lines = []
    if above is not None:
        name, wide = above
        rest = len(columns) - wide
        lines.append(f'<tr><td colspan="{rest}"></td><th scope="colgroup" colspan="{wide}">{text(name)}</th></tr>')
    lines += [f"<tr>{names}</tr>", "</thead>", "<tbody>"]
    for k, row in enumerate(rows):
        if groups and (k == 0 or groups[k] != groups[k - 1]):
            lines.append(f'<tr><th scope="rowgroup" colspan="{len(columns)}">{text(groups[k])}</th></tr>')
        lines.append(_row(row, kinds))
    return (
        f'<div class="wide" tabindex="0" role="group" aria-label="{text(title)}">\n<table>\n<thead>\n'
        + "\n".join(lines)
        + "\n</tbody>\n</table>\n</div>\n"
    )


def _cell_text(words: str) -> str:
    return WHOLE.sub(r'<span class="whole">\g<0></span>', text(words))


def _row(cells: Sequence[str], kinds: Sequence[str]) -> str:
    """Return a row of a table; verdicts that begin with yes stand out."""
    first, *others = (re.sub("^yes,", "<strong>yes</strong>,", _cell_text(cell)) for cell in cells)
    further = "".join(f"<td{kind}>{cell}</td>" for cell, kind in zip(others, kinds[1:], strict=True))
    return f'<tr><th scope="row"{kinds[0]}>{first}</th>{further}</tr>'


def details(summary: str, contents: str) -> str:
    """Return contents that are shown on request."""
    return f"<details>\n<summary>{text(summary)}</summary>\n{contents}</details>\n"


def caption_of(name: str) -> tuple[str, list[str]]:
    """Return title and paragraphs of the caption of a figure, which lies beside its module (reStructuredText)."""
    contents = (CAPTIONS / f"{name}.rst").read_text(encoding="utf-8")
    title, _, rest = contents.removeprefix("**").partition("**")
    return title.strip().removesuffix("."), [" ".join(part.split()) for part in rest.split("\n\n")]


def figure(drawing: Drawing, caption: str, title: str | None = None) -> str:
    """Return a figure with the caption of this name, the values of its points, and its numbers.

    `title` replaces that of the caption. The picture is an image of its own, so that ids in its SVG cannot
    collide with those of other figures.
    """
    points = points_of(drawing.figure)
    width, height = points["size"]
    own_title, parts = caption_of(caption)
    title = title or own_title
    image = base64.b64encode(drawing.images["svg"]).decode()
    data = in_script(json.dumps(points, ensure_ascii=False, separators=(",", ":")))
    return (
        f'<section class="result" id="{text(drawing.name)}" style="--width: {width:g}">\n<h3>{text(title)}</h3>\n'
        f'<figure>\n<div class="wide">\n<div class="plot" tabindex="0" role="application"'
        f' aria-label="{text(title)}: values; arrow keys step through the points">\n'
        f'<img alt="{text(title)}" width="{width:g}" height="{height:g}" src="data:image/svg+xml;base64,{image}">\n'
        f'<span class="mark" hidden></span>\n<p class="value" aria-live="polite"></p>\n'
        f'<script type="application/json">{data}</script>\n</div>\n</div>\n'
        f"<figcaption>\n{paragraphs(parts)}</figcaption>\n</figure>\n{numbers(drawing.table, title)}</section>\n"
    )


def numbers(shown: Table, title: str) -> str:
    """Return a table of numbers, shown on request; of a long one the first MOST_ROWS rows."""
    count = len(shown.rows)
    cells = [[_cell(value) for value in row] for row in shown.rows[:MOST_ROWS]]
    columns = [list(column) for column in zip(shown.header, *cells, strict=True)]
    is_cut = count > MOST_ROWS
    which = f"the first {MOST_ROWS} of {count:,} rows" if is_cut else "1 row" if count == 1 else f"{count:,} rows"
    remark = f"Rounded to {DIGITS} digits. The CSV file of this figure has all{' rows and' if is_cut else ''} digits."
    return details(f"The numbers: {which}", paragraphs([remark], "remark") + table(columns, f"Numbers: {title}"))


def _cell(value: object) -> str:
    """Return a number or name of a table of numbers in words."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.{DIGITS}g}"
    return str(value)
