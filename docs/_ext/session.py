"""A page with a session in Python, run as it is printed."""

import contextlib
import io
import re
from pathlib import Path

BLOCKS = re.compile(r"^```(python|text)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)


class DriftError(Exception):
    """The session prints something else than the page says."""


def executed(page: str, folder: Path) -> str:
    """Run the Python of a page in a folder; return the page with each PNG picture below the code
    that has made it.

    Raises DriftError if a block `text` is not what the Python before it has printed.
    """
    names: dict = {}
    printed, parts, end = "", [], 0
    with contextlib.chdir(folder):
        for block in BLOCKS.finditer(page):
            kind, text = block.groups()
            parts.append(page[end : block.end()])
            end = block.end()
            if kind == "text":
                if printed != text:
                    raise DriftError(f"the page says\n{text}and the session prints\n{printed}")
                continue
            before = set(folder.glob("*.png"))
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(compile(text, "session", "exec"), names)
            printed = output.getvalue()
            made = sorted(set(folder.glob("*.png")) - before)
            parts += [f"\n![The figure made by this code]({picture.name})\n" for picture in made]
    return "".join([*parts, page[end:]])
