"""Rows of the tables of docs/stability.md."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from validation.stability.game import IS_INSTALLED
from validation.stability.programs import COLUMNS

HEAD = f"| experiment | promised | {' | '.join(COLUMNS)} |\n|---|---|---|---|---|---|\n"


class Row(NamedTuple):
    """An experiment, what is promised of it, and what each program did; texts in Markdown."""

    experiment: str
    promised: str
    cells: Sequence[str]  # of the programs, in the order of COLUMNS
    is_kept: bool = True  # whether brownpipe keeps the promise


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a table in Markdown."""
    return HEAD + "".join("| " + " | ".join(_cells(row)) + " |\n" for row in rows)


def _cells(row: Row) -> tuple[str, ...]:
    ours, *others, game = row.cells
    ours = ours if row.is_kept else f"**{ours}: broken**"
    return row.experiment, row.promised, ours, *others, game if IS_INSTALLED else "not installed"


def shown(*values: float) -> str:
    """Return sizes with one digit, such as 3e-14, without their signs; 0 as it is, - for NaN."""
    return ", ".join(_size(abs(value)) for value in values)


def _size(value: float) -> str:
    if math.isnan(value):
        return "-"
    digit, power = f"{value:.0e}".split("e")
    return "0" if value == 0 else f"{digit}e{int(power)}".removesuffix("e0")


def count(value: float) -> str:
    """Return a large number as a power of ten if it is one: 1e8."""
    power = math.log10(value) if value > 0 else 0.5
    return f"1e{power:.0f}" if power == round(power) and power >= 4 else f"{value:,.0f}"
