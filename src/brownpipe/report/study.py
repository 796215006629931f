"""The page of a study: the answer, figures, and the health of its runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markupsafe import Markup

from brownpipe.figures import health
from brownpipe.figures.cases import cases_of
from brownpipe.figures.summary import QUESTION, TESTS, answer
from brownpipe.figures.tables import label_of
from brownpipe.report.page import Section, paragraphs, table
from brownpipe.report.page import page as whole_page

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from xarray import Dataset

    from brownpipe.figures.origin import Record
    from brownpipe.figures.summary import Answer

TITLE = "Brownian motion of hard disks"
SEE_ANSWER = Markup('<p>Runs failed or are missing: see <a href="#answer">the answer</a>.</p>\n')


def page(dataset: Dataset, figures: Mapping[str, str], record: Record) -> bytes:
    """Return the page of a dataset and its figures.

    figures: their sections of the page by name (`page.figure`).
    """
    found, cases = answer(dataset), cases_of(dataset)
    sections = [Section("answer", "Answer", _answer(found))]
    shown = dict(figures)
    of_runs = shown.pop("health", Markup())  # stands in a section of its own
    if shown:
        sections.append(Section("figures", "Figures", Markup("").join(shown.values())))
    sections.append(Section("runs", "Health of the runs", _health(cases, found) + of_runs))
    return whole_page(TITLE, _lead(cases), sections, record)


def _lead(cases: Sequence[Dataset]) -> str:
    """Return the scenes, particle counts and number of runs in words."""
    scenes = dict.fromkeys(case.scene.item() for case in cases)
    counts = sorted({int(case.particles) for case in cases})
    runs = sum(int(case.runs) for case in cases)
    return f"{', '.join(scenes)}; N = {', '.join(map(str, counts))}; {runs:,} run{'' if runs == 1 else 's'}"


def _answer(found: Answer) -> str:
    """Return the table of results, with its legend and the runs that are left out."""
    tests = sum(column[0] in TESTS for column in found.columns)
    above = (QUESTION, tests) if tests else None
    lines = paragraphs(found.missing, "warning") + paragraphs(found.legend, "legend")
    return table(found.columns, "Answer", above, grouped=True) + lines


def _health(cases: Sequence[Dataset], found: Answer) -> str:
    """Return failed and missing runs, and the greatest deviation of any run of each case."""
    measures = (f"{label}, expected below {bound:g}" for label, bound in health.MEASURES.values())
    rows = [("scene", "N", "engine", "runs", "failed", *measures)]
    for case in cases:
        sizes = [health.sizes_of(case, name) for name in health.MEASURES]
        counts = (f"{case[name].item():g}" for name in ("runs", "failed_runs"))
        rows.append((*map(str, label_of(case)), *counts, *(f"{of.max():.2g}" if of.size else "-" for of in sizes)))
    columns = [column for column in zip(*rows, strict=True) if column[0] != "engine" or len({*column[1:]}) > 1]
    title = "Largest value of any run"
    fate = SEE_ANSWER if found.missing else paragraphs(["No run failed, and no seed is missing."])
    return fate + paragraphs([f"{title}:"]) + table(columns, title, grouped=True)
