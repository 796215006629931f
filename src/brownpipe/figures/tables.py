"""Plain tables: the numbers behind a figure as CSV, and tables of words and numbers as aligned text."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.analysis.variables import EACH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xarray import Dataset

PARTS = ("", "_standard_error", "_low", "_high")  # a mean and its uncertainties


class Table(NamedTuple):
    """Column names and rows of numbers and texts."""

    header: tuple[str, ...]
    rows: list[tuple]


def long_table(cases: list[Dataset], dims: Sequence[str], names: Sequence[str]) -> Table:
    """Return one row per case and point along `dims` with the variables `names` there; empty rows are left out.

    Each variable is followed by its standard error and the ends of its interval where the dataset has them.
    """
    names = [f"{name}{part}" for name in names for part in PARTS if f"{name}{part}" in cases[0]]
    rows = []
    for case in cases:
        label = tuple(case[name].item() for name in EACH)
        shape = case[names].to_array()[0]
        columns = [case[name].broadcast_like(shape).transpose(*dims).values for name in names]
        places = [case[dim].values for dim in dims]
        for at in np.ndindex(columns[0].shape):
            values = [column[at] for column in columns]
            if not all(map(_is_nan, values)):
                rows.append((*label, *(place[k] for place, k in zip(places, at, strict=True)), *values))
    return Table((*EACH, *dims, *names), rows)


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def aligned(columns: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a text table, given its columns; every column is as wide as its widest cell."""
    widths = [max(map(len, column)) for column in columns]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in zip(*columns, strict=True)]


def to_csv(table: Table) -> bytes:
    """Return the table as UTF-8 text: the shortest digits that give each number back, nothing for NaN, LF line ends."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.header)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def _cell(value: object) -> object:
    """A number as Python prints it, whole numbers without a point."""
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(int(value) if value.is_integer() and abs(value) < 1e15 else value)
    return value
