"""The tables of docs/validation.md, each between two comments with the name of its result."""

import math
import re
from collections.abc import Sequence

from brownpipe.text import in_time
from validation.comparison import Comparison


def with_table(page: str, name: str, comparisons: Sequence[Comparison], seconds: float) -> str:
    """Return the page with a new table of a result; raise KeyError if it has no place for it."""
    return with_text(page, name, f"{table(comparisons)}\n{closing(comparisons, seconds)}\n\n")


def with_text(page: str, name: str, text: str) -> str:
    """Return the page with a new text between the two comments of this name; raise KeyError if it
    has none.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    place = re.compile(f"(?<={re.escape(begin)}).*?(?={re.escape(end)})", re.DOTALL)
    if not place.search(page):
        raise KeyError(f"the page has no {begin.strip()} with its {end}")
    return place.sub(lambda _: text, page, count=1)


def table(comparisons: Sequence[Comparison]) -> str:
    """Return the comparisons as a table in Markdown; a source that all have in common is the head
    of its column.
    """
    sources = {one.source for one in comparisons}
    if len(sources) == 1:
        head = f"| quantity | {sources.pop()} | brownpipe | difference |\n|---|---|---|---|\n"
        return head + "".join(f"{_row(one)}\n" for one in comparisons)
    head = "| quantity | reference | brownpipe | difference | source |\n|---|---|---|---|---|\n"
    return head + "".join(f"{_row(one)} {one.source} |\n" for one in comparisons)


def _row(one: Comparison) -> str:
    """Return a row without its source."""
    difference = f"{100 * one.departure:+.2g} %" if one.approximate else f"{one.z:+.1f} s.e."
    remark = f" ({one.remark})" if one.remark else ""
    values = f"{value(one.published, one.published_error)} | {value(one.ours, one.error)}"
    return f"| {one.quantity} | {values} | {difference}{remark} |"


def value(number: float, error: float) -> str:
    """Return a number with its standard error in the last two digits: 1.35485(21); without it if
    NaN or 0.
    """
    if not error > 0:
        return f"{number:.6g}"
    digits = max(
        0, 1 - int(f"{error:.1e}".split("e")[1])
    )  # the exponent of the rounded error: 0.0996 is 0.10
    if digits == 0:
        return f"{number:.0f}({error:.0f})"
    if error >= 1:
        return f"{number:.{digits}f}({error:.{digits}f})"
    return f"{number:.{digits}f}({round(error * 10**digits)})"


def closing(comparisons: Sequence[Comparison], seconds: float) -> str:
    """Return the sentence below a table: how many values, the largest difference, the time."""
    tested = [one for one in comparisons if not one.approximate]
    took = f"All jobs together took {in_time(seconds)}."
    if not tested:
        return took
    most = max(abs(one.z) for one in tested)
    chance = 1 - math.erf(most / math.sqrt(2)) ** len(tested)
    return (
        f"{len(tested)} values tested; largest difference {most:.1f} s.e., probability "
        f"{chance:.2g}. {took}"
    )
