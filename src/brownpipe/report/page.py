"""Web pages from templates (jinja2): one HTML file each, that needs neither network nor other
files.

`page.html` shows all results of a dataset, `replay.html` (`replay.py`) one run.
"""

import base64
import math
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from xarray import Dataset

from brownpipe.figures.origin import Record
from brownpipe.figures.render import Drawing
from brownpipe.figures.summary import Answer, answer
from brownpipe.provenance import PACKAGE
from brownpipe.report.description import setup_in_words
from brownpipe.text import counted, printable


def _in_words(value: object) -> object:
    """Return a value that a template shows as one line of text, a number with six digits."""
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.6g}"
    return value if isinstance(value, Markup) else printable(value)


ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=_in_words,
)
ENVIRONMENT.filters["base64"] = lambda contents: base64.b64encode(contents).decode()


def filled(template: str, **contents: object) -> bytes:
    """Return a page: the template of this name with its contents, which are escaped and shown as
    one line each.
    """
    return ENVIRONMENT.get_template(template).render(contents).strip().encode() + b"\n"


def page_of_results(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a dataset: the answer and its figures."""
    results = answer(dataset, record.get("figures", ()))
    scenes = ", ".join(map(str, dataset.scene.values))
    counts = ", ".join(map(str, dataset.particles.values))
    runs = counted(int(dataset.runs.sum()), "run")
    lead = f"{scenes}; N = {counts}; {runs}"
    rows = [*zip(*results.columns, strict=True)]
    warnings = results.drifting + results.missing
    captioned = [(drawing, *caption_of(drawing.name)) for drawing in drawings]
    return filled(
        "page.html",
        title=record.get("title", dataset.attrs["title"]),
        asked=asked_in_words(results),
        setup=setup_in_words(dataset),
        lead=lead,
        answer=rows,
        warnings=warnings,
        legend=results.legend,
        figures=captioned,
        record=record,
    )


def asked_in_words(results: Answer) -> str:
    """Return the quantities of an answer, each once: `MSD(t = 1), D, eq. (18)`."""
    measured = results.columns[results.labels + 1 :]  # after the runs
    headings = [column[0] for column in measured]
    names = [heading.partition(", ")[0] for heading in headings]
    return ", ".join(dict.fromkeys(names))


def caption_of(name: str) -> tuple[str, list[str]]:
    """Return title and paragraphs of the caption of a figure, which lies beside its module
    (reStructuredText).
    """
    contents = (PACKAGE / "figures" / f"{name}.rst").read_text(encoding="utf-8")
    title, _, rest = contents.removeprefix("**").partition("**")
    paragraphs = [" ".join(paragraph.split()) for paragraph in rest.split("\n\n")]
    return title.strip().removesuffix("."), paragraphs
