"""A figure that has been drawn: its pictures, and the table of its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from brownpipe.figures.style import image_bytes
from brownpipe.figures.tables import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure


class Drawing(NamedTuple):
    """One figure in all its forms."""

    name: str  # of its files
    images: Mapping[str, bytes]  # PNG and SVG
    table: Table


def drawing_of(name: str, figure: Figure, table: Table, metadata: Mapping[str, str]) -> Drawing:
    """Lay out a figure and make its pictures with these metadata; to be called within `style.drawing()`."""
    return Drawing(name, {suffix: image_bytes(figure, suffix, metadata) for suffix in ("png", "svg")}, table)
