"""Plain tables: the numbers of a figure as CSV."""

import csv
import io
import math
from typing import NamedTuple


class Table(NamedTuple):
    header: tuple  # column names
    rows: list  # of tuples: numbers and texts


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
