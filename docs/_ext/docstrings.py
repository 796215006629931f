"""Docstrings of the package as reStructuredText: lines like `seeds: how many` become descriptions
of parameters.
"""

import inspect
import re
from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PARAMETERS = re.compile(r"(\w+(?:, \w+)*): (.*)")


def with_list(lines: list[str], parameters: Collection[str]) -> list[str]:
    """Return the lines of a docstring, those that describe parameters as a list in
    reStructuredText.

    A description goes on until the next one, or to the end of its paragraph.
    """
    written: list[str] = []
    in_list = False
    for line in lines:
        found = PARAMETERS.match(line)
        names = found[1].split(", ") if found else []
        if found and set(names) <= set(parameters):
            written += [""] if not in_list else []
            written.append(f"* {', '.join(f'**{name}**' for name in names)}: {found[2]}")
            in_list = True
        elif not line.strip():
            written.append("")
            in_list = False
        else:
            written.append(f"  {line.strip()}" if in_list else line)
    return written


def _process(
    app: "Sphinx", what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    if callable(thing) and not inspect.isclass(thing):
        lines[:] = with_list(lines, inspect.signature(thing).parameters)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Let autodoc write docstrings so."""
    app.connect("autodoc-process-docstring", _process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
