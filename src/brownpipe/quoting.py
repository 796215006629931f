"""Text that others have chosen - names, paths, contents of files - as text for the screen and as words of a shell."""

import os
import re
import shlex
from collections.abc import Iterable

# Drawn as nothing at all, although Unicode counts them as letters or marks (Default_Ignorable_Code_Point).
INVISIBLE = re.compile("[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u3164\ufe00-\ufe0f\uffa0\U000e0100-\U000e01ef]")


def printable(text: object) -> str:
    """Return a text as one line without anything that a terminal would act on; all other characters stay as they are.

    Control characters (ESC, line feed, carriage return, C1), characters that change the direction of writing, invisible
    ones, line separators, blanks other than U+0020, and undecodable bytes of file names become escapes: \\x1b, \\u202e.
    """
    text = str(text)
    if text.isprintable() and not INVISIBLE.search(text):
        return text
    return "".join(char if _is_visible(char) else char.encode("unicode_escape").decode() for char in text)


def _is_visible(char: str) -> bool:
    return char.isprintable() and not INVISIBLE.match(char)


def in_lines(lines: Iterable[str]) -> str:
    """Return lines, each made `printable`, as one text; only the line feeds between them are control characters."""
    return "\n".join(map(printable, lines))


def shell_word(text: str) -> str:
    """Return a text as one word of a command for bash, to be shown or run; it has printable characters alone."""
    if printable(text) == text:
        return shlex.quote(text)
    quoted = (f"\\{char}" if char in "\\'" else char if _is_visible(char) else _in_bytes(char) for char in text)
    return f"$'{''.join(quoted)}'"


def _in_bytes(char: str) -> str:
    """Return a character as escapes of its bytes in a file name, in the ANSI-C quotes of bash."""
    surrogates = "surrogateescape" if "\udc80" <= char <= "\udcff" else "surrogatepass"
    return "".join(f"\\x{byte:02x}" for byte in char.encode("utf-8", surrogates))


def shell_path(path: str | os.PathLike) -> str:
    """Return a path as one word of a command for bash, which no program takes for an option."""
    text = os.fspath(path)
    return shell_word(f"./{text}" if text.startswith("-") else text)
