"""The page of a study: the answer, figures, and the health of its runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brownpipe.figures import health
from brownpipe.figures.cases import cases_of
from brownpipe.figures.summary import QUESTION, TESTS, answer
from brownpipe.figures.tables import label_of
from brownpipe.report.page import Table, figure, table
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
        runs=_runs(cases),
    )


def _lead(cases: Sequence[Dataset]) -> str:
    """Return the scenes, particle counts and number of runs in words."""
    scenes = dict.fromkeys(case.scene.item() for case in cases)
    counts = dict.fromkeys(str(case.particles.item()) for case in cases)
    runs = sum(int(case.runs) for case in cases)
    return f"{', '.join(scenes)}; N = {', '.join(counts)}; {runs:,} run{'' if runs == 1 else 's'}"


def _runs(cases: Sequence[Dataset]) -> Table:
    """Return the numbers of runs of each case, and the greatest deviation of any."""
    measures = (f"{label}, expected below {bound:g}" for label, bound in health.MEASURES.values())
    rows = [("scene", "N", "engine", "runs", "failed", *measures)]
    for case in cases:
        sizes = [health.sizes_of(case, name) for name in health.MEASURES]
        counts = (f"{case[name].item():g}" for name in ("runs", "failed_runs"))
        label = map(str, label_of(case).values())
        rows.append((*label, *counts, *(f"{of.max():.2g}" if of.size else "-" for of in sizes)))
    columns = [column for column in zip(*rows, strict=True) if column[0] != "engine" or len({*column[1:]}) > 1]
    return table(columns, "Largest value of any run", grouped=True)
