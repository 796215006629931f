"""Web pages from templates (jinja2): one HTML file each, that needs neither network nor other files."""

from pathlib import Path
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from brownpipe.text import printable


def filled(template: Path, **contents: Any) -> bytes:
    """Return a page: the template with its contents, which are escaped and shown as one line each.

    The files of the same name with the suffixes `.css` and `.js` are `style` and `script` in it.
    """
    environment = Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: value if isinstance(value, Markup) else printable(value),
    )
    beside = {"style": template.with_suffix(".css"), "script": template.with_suffix(".js")}
    contents |= {name: Markup(file.read_text(encoding="utf-8")) for name, file in beside.items() if file.is_file()}
    text = environment.from_string(template.read_text(encoding="utf-8")).render(contents)
    return text.strip().encode() + b"\n"
