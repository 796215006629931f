"""A site that needs no network: the build fails if a page loads a script, style, font or picture
from elsewhere.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

LOADED = re.compile(
    r"""<(?:script|img|iframe|source|link(?![^>]*rel="canonical"))[^>]*?(?:src|href)=["'](?:https?:)?(//[^"']+)"""
    r"""|(?:url\(|@import )["']?(?:https?:)?(//[^"')]+)"""
)


def loaded_from_elsewhere(text: str) -> list[str]:
    """Return the addresses in a page or style sheet from which a browser would load something by
    itself.
    """
    return [page or style for page, style in LOADED.findall(text)]


def _check(app: "Sphinx", error: Exception | None) -> None:
    if error is not None:
        return
    from sphinx.errors import ExtensionError

    for file in sorted([*Path(app.outdir).rglob("*.html"), *Path(app.outdir).rglob("*.css")]):
        if found := loaded_from_elsewhere(file.read_text()):
            raise ExtensionError(f"{file}: loads {found[0]}")


def setup(app: "Sphinx") -> dict[str, bool]:
    """Check all pages and style sheets when they are written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
