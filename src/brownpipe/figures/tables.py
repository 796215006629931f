"""Tables: the numbers behind a figure (pandas, written as CSV), and words in aligned columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brownpipe.analysis.varied import labels_of_cases
from brownpipe.figures.cases import has

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pandas import DataFrame
    from xarray import Dataset

PARTS = ("", "_standard_error", "_low", "_high")  # a mean and its uncertainties


def frame_of(cases: Iterable[Dataset], dims: Sequence[str], names: Iterable[str]) -> DataFrame:
    """Return one row per case and point along `dims` with the variables `names` there, each with its uncertainties.

    Variables and uncertainties that no case has are left out, and so are empty rows.
    """
    import pandas

    cases = [*cases]
    labels = labels_of_cases(cases[0])
    shown = [name for name in names if name not in labels and any(has(case, name) for case in cases)]
    shown = [f"{name}{part}" for name in shown for part in PARTS if f"{name}{part}" in cases[0]]
    frames = [case[shown].expand_dims(labels).to_dataframe([*labels, *dims])[shown].dropna(how="all") for case in cases]
    return pandas.concat(frames).reset_index()


def label_of(case: Dataset) -> dict[str, str | int]:
    """Return scene, particle count and engine, by which the rows of a case begin."""
    return {name: case[name].item() for name in labels_of_cases(case)}


def to_csv(table: DataFrame) -> bytes:
    """Return a table as UTF-8 text: the shortest digits that give each number back, nothing for NaN, LF line ends."""
    return table.to_csv(index=False, lineterminator="\n").encode()


def aligned(columns: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a text table, given its columns; every column is as wide as its widest cell."""
    widths = [max(map(len, column)) for column in columns]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in zip(*columns, strict=True)]
