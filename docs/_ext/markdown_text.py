"""Text and tables as Markdown, for the pages that are made when the site is built."""

import html
import re
from collections.abc import Iterable, Sequence

from brownpipe.text import printable

CODE = re.compile(r"(`[^`]+`)")
SPECIAL = re.compile(r"([\\*_\[\]|$~#])")


def plain(text: str) -> str:
    """Return a text in which nothing but parts between backticks has a meaning for Markdown or
    HTML.
    """
    parts = CODE.split(printable(text))
    return "".join(
        part if CODE.fullmatch(part) else SPECIAL.sub(r"\\\1", html.escape(part, quote=False))
        for part in parts
    )


def code(text: str) -> str:
    """Return a name as code."""
    return f"`{printable(text)}`"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; the cells of its rows are Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
