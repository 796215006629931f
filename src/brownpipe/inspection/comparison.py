"""Where two datasets, figures or tables differ first."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.quoting import printable

if TYPE_CHECKING:
    from xarray import Dataset

LONGEST_LINE = 60  # characters of a line that is shown


def differing_variables(name: str, stored: Dataset, made: Dataset) -> list[str]:
    """Return in a line where a variable differs first and how often; nothing if it is identical."""
    if name not in stored.variables or name not in made.variables:
        return [f"{name}: only in {'the file' if name in stored.variables else 'the dataset made again'}"]
    one, other = stored[name], made[name]
    if one.dims != other.dims or one.shape != other.shape or one.dtype != other.dtype:
        return [f"{name}: of another shape or type"]
    values = one.values, other.values
    differing = values[0] != values[1]
    if one.dtype.kind == "f":
        differing &= ~(np.isnan(values[0]) & np.isnan(values[1]))
    if not np.any(differing):
        return [] if one.identical(other) else [f"{name}: attributes or coordinates"]
    first = tuple(int(places[0]) for places in np.nonzero(differing))
    where = ", ".join(
        f"{dim} {stored[dim].values[k]}" if dim in stored.coords else f"{dim} {k}"
        for dim, k in zip(one.dims, first, strict=True)
    )
    pair = f"{values[0][first]!s:.40} in the file, {values[1][first]!s:.40} made again"
    return [f"{name}: {np.count_nonzero(differing)} of {differing.size} values; first at {where}: {pair}"]


def first_difference(one: bytes, other: bytes, suffix: str) -> str:
    """Return where two files differ first, the original and the one made again; nothing if they are the same."""
    if one == other:
        return ""
    if suffix == ".png":
        return _differing_pictures(one, other)
    lines = [contents.decode(errors="replace").splitlines() for contents in (one, other)]
    number = next((k for k, pair in enumerate(zip(*lines, strict=False)) if pair[0] != pair[1]), min(map(len, lines)))
    shown = [printable(text[number])[:LONGEST_LINE] if number < len(text) else "(its end)" for text in lines]
    return f"line {number + 1}: {shown[0]} in the file, {shown[1]} made again"


def _differing_pictures(one: bytes, other: bytes) -> str:
    """Return how two PNG files differ: in size, in pixels or in metadata alone."""
    from PIL import Image

    try:
        pictures = [np.asarray(Image.open(io.BytesIO(contents))) for contents in (one, other)]
    except (OSError, ValueError, Image.DecompressionBombError):
        return "the file is damaged"
    if pictures[0].shape != pictures[1].shape:
        return f"{pictures[0].shape[1]} x {pictures[0].shape[0]} pixels in the file, another size made again"
    differing = np.any(pictures[0] != pictures[1], axis=-1)
    if not differing.any():
        return "metadata, or compression of the same pixels"
    y, x = np.argwhere(differing)[0]
    return f"{np.count_nonzero(differing):,} of {differing.size:,} pixels; first at x = {x}, y = {y}"
