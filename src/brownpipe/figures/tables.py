"""Plain tables: the numbers of a figure as CSV."""

import csv
import io
import math
from typing import NamedTuple

import numpy as np

EACH = ("scene", "particles", "engine")
PARTS = ("", "_standard_error", "_low", "_high")


class Table(NamedTuple):
    header: tuple  # column names
    rows: list  # of tuples: numbers and texts


def long_table(cases, dims, names):
    """One row per case and point along `dims`, with the variables `names` there; rows without any value are left out.

    The uncertainties of a variable, where the dataset has them, follow it.
    """
    names = [f"{name}{part}" for name in names for part in PARTS if f"{name}{part}" in cases[0]]
    rows = []
    for case in cases:
        label = tuple(case[name].item() for name in EACH)
        columns = [case[name].broadcast_like(case[names].to_array()[0]).transpose(*dims).values for name in names]
        for at in np.ndindex(columns[0].shape):
            values = [column[at] for column in columns]
            if not all(map(_nothing, values)):
                rows.append((*label, *(case[dim].values[k] for dim, k in zip(dims, at, strict=True)), *values))
    return Table((*EACH, *dims, *names), rows)


def _nothing(value):
    return isinstance(value, float) and math.isnan(value)


def to_csv(table):
    """UTF-8 bytes of the table: shortest digits that give the number back, nothing for NaN, lines end in LF."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.header)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def _cell(value):
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(int(value) if value.is_integer() and abs(value) < 1e15 else value)
    return value
