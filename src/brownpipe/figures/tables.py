"""Plain tables: the numbers behind a figure as CSV, and tables of words and numbers as aligned text."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.analysis.variables import EACH
from brownpipe.figures.cases import has

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from xarray import Dataset

PARTS = ("", "_standard_error", "_low", "_high")  # a mean and its uncertainties


class Table(NamedTuple):
    """Column names and rows of numbers and texts."""

    header: tuple[str, ...]
    rows: list[tuple]


def long_table(cases: list[Dataset], dims: Sequence[str], names: Iterable[str]) -> Table:
    """Return one row per case and point along `dims` with the variables `names` there; empty rows are left out.

    So are variables that no case has. Each variable is followed by its standard error and the ends of its interval
    where the dataset has them.
    """
    measured = [name for name in names if any(has(case, name) for case in cases)]
    names = [f"{name}{part}" for name in measured for part in PARTS if f"{name}{part}" in cases[0]]
    rows = []
    for case in cases:
        frame = case[names].expand_dims(EACH).to_dataframe([*EACH, *dims])[names].dropna(how="all")
        rows += frame.reset_index().itertuples(index=False, name=None)
    return Table((*EACH, *dims, *names), rows)


def label_of(case: Dataset) -> tuple[str, int, str]:
    """Return scene, particle count and engine, by which the rows of a case begin."""
    return case.scene.item(), case.particles.item(), case.engine.item()


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
    if isinstance(value, float):
        is_whole = value.is_integer() and abs(value) < 1e15
        return "" if math.isnan(value) else repr(int(value) if is_whole else float(value))
    return value
