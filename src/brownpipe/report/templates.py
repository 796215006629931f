"""Web pages from templates (jinja2): one HTML file each, that needs neither network nor other
files.

`page.html` shows all results of a dataset (`page.py`), `replay.html` one run (`replay.py`).
"""

import base64
import math
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

from brownpipe.text import printable


def _in_words(value: object) -> object:
    """Return a value that a template shows as one line of text, a number with six digits."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.6g}"
    return value if isinstance(value, Markup) else printable(value)


ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=_in_words,
)
ENVIRONMENT.filters["base64"] = lambda contents: base64.b64encode(contents).decode()


def filled(template: str, **contents: object) -> bytes:
    """Return a page: the template of this name with its contents, which are escaped and shown as
    one line each.
    """
    return ENVIRONMENT.get_template(template).render(contents).strip().encode() + b"\n"
