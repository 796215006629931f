"""Rows of the tables of docs/stability.md."""

import math
from collections.abc import Sequence
from typing import NamedTuple

HEAD = "| experiment | promised | brownpipe | note's loop | plain event-driven | pymunk |\n|---|---|---|---|---|---|\n"
ABSENT = "not installed"


class Row(NamedTuple):
    """An experiment, what is promised of it, and what each program did; texts in Markdown."""

    experiment: str
    promised: str
    brownpipe: str
    note_loop: str
    plain: str
    pymunk: str
    is_kept: bool = True  # whether brownpipe keeps the promise


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a table in Markdown."""
    return HEAD + "".join("| " + " | ".join((*row[:2], _of_ours(row), *row[3:6])) + " |\n" for row in rows)


def _of_ours(row: Row) -> str:
    return row.brownpipe if row.is_kept else f"**{row.brownpipe}: broken**"


def shown(*values: float) -> str:
    """Return sizes with one digit, such as 3e-14, without their signs; 0 as it is."""
    return ", ".join("0" if value == 0 else f"{abs(value):.0e}".replace("e-0", "e-") for value in values)


def count(value: float) -> str:
    """Return a large number as a power of ten if it is one: 1e8."""
    power = math.log10(value) if value > 0 else 0.5
    return f"1e{power:.0f}" if power == round(power) and power >= 4 else f"{value:,.0f}"
