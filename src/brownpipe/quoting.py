"""Text that others have chosen - names, paths, contents of files - as text for the screen and as words of a shell."""

import os
import shlex
from collections.abc import Iterable


def printable(text: object) -> str:
    """Return a text as one line; control characters and undecodable bytes of file names become escapes: \\x1b."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in str(text))


def in_lines(lines: Iterable[str]) -> str:
    """Return lines, each made `printable`, as one text; only the line feeds between them are control characters."""
    return "\n".join(map(printable, lines))


def shell_path(path: str | os.PathLike) -> str:
    """Return a path as one word of a command for bash, which no program takes for an option."""
    text = os.fspath(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)
