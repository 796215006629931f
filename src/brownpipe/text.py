"""Times, sizes and counts as text; names and paths that others have chosen as text for the screen
and for a shell.
"""

import json
import os
import shlex
from collections.abc import Iterable
from contextlib import suppress


def printable(text: object) -> str:
    """Return a text as one line; control characters and undecodable bytes of file names become
    escapes: \\x1b.
    """
    line = str(text)
    return line if line.isprintable() else "".join(map(_printable_character, line))


def _printable_character(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode()


def in_lines(lines: Iterable[str]) -> str:
    """Return lines, each made `printable`, as one text; only the line feeds between them are
    control characters.
    """
    return "\n".join(map(printable, lines))


def shell_path(path: str | os.PathLike) -> str:
    """Return a path as one word of a command for bash, which no program takes for an option."""
    text = os.fspath(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def in_ascii(text: str) -> str:
    """Return a text as it is or, if it has letters beyond ASCII, in JSON: "\\u03b7"."""
    return text if text.isascii() else json.dumps(text)


def from_ascii(text: str) -> str:
    """Return the text of `in_ascii`; other texts as they are."""
    with suppress(ValueError):
        if text.startswith('"'):
            return str(json.loads(text))
    return text


def in_time(seconds: float) -> str:
    """Return a time [s] with two digits in the largest unit of which it has two: 90 s, 2.5 min, 700
    ms, 3 days.
    """
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0), ("s", 1.0)):
        least = size if unit == "s" else 2 * size
        if seconds >= least:
            number = seconds / size
            has_two_digits = seconds < 100 * size
            return f"{number:.2g} {unit}" if has_two_digits else f"{number:,.0f} {unit}"
    return f"{1e3 * seconds:.0f} ms" if seconds >= 0.01 else f"{1e3 * seconds:.2g} ms"


def in_bytes(count: float) -> str:
    """Return a size in bytes: 512 B, 1.4 kB, 23 MB."""
    for unit, size in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            two_digits = float(f"{count / size:.2g}")
            return f"{two_digits:g} {unit}"
    return f"{count:.0f} B"


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: 1 run, 2,400 runs."""
    plural = noun if number == 1 else f"{noun}s"
    return f"{number:,} {plural}"
