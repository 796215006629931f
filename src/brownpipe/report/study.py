"""The page of a study: the answer, figures, and the health of its runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brownpipe.figures.cases import cases_of
from brownpipe.figures.summary import QUESTION, TESTS, answer
from brownpipe.report.page import figure, table
from brownpipe.report.page import page as whole_page

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from xarray import Dataset

    from brownpipe.figures.origin import Record
    from brownpipe.figures.render import Drawing


def page(dataset: Dataset, drawings: Iterable[Drawing], record: Record) -> bytes:
    """Return the page of a dataset and its figures; that of health stands with the runs."""
    found, cases = answer(dataset), cases_of(dataset)
    tests = sum(column[0] in TESTS for column in found.columns)
    results = table(found.columns, "Answer", (QUESTION, tests) if tests else None, grouped=True)
    figures = [figure(drawing, drawing.name) for drawing in drawings]
    return whole_page(
        "Brownian motion of hard disks",
        _lead(cases),
        record,
        answers=[("", results, [])],
        drifting=found.drifting,
        missing=found.missing,
        legend=found.legend,
        figures=[one for one in figures if one["name"] != "health"],
        of_runs=[one for one in figures if one["name"] == "health"],
    )


def _lead(cases: Sequence[Dataset]) -> str:
    """Return the scenes, particle counts and number of runs in words."""
    scenes = dict.fromkeys(case.scene.item() for case in cases)
    counts = dict.fromkeys(str(case.particles.item()) for case in cases)
    runs = sum(int(case.runs) for case in cases)
    return f"{', '.join(scenes)}; N = {', '.join(counts)}; {runs:,} run{'' if runs == 1 else 's'}"
