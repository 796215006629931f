"""The page of a dataset: what is simulated, in words and in motion, the answer, all figures, and
how to make it again.
"""

from collections.abc import Sequence

from xarray import Dataset

from brownpipe.figures.origin import Record
from brownpipe.figures.render import Drawing
from brownpipe.figures.summary import Answer, answer
from brownpipe.provenance import PACKAGE
from brownpipe.report.answer import answer_in_words
from brownpipe.report.description import setup_in_words
from brownpipe.report.templates import filled
from brownpipe.report.typical_run import scenes_in_motion
from brownpipe.text import counted


def page_of_results(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> bytes:
    """Return the page of a dataset: what is simulated, the answer and its figures."""
    particles = record.get("particles")
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
        in_motion=scenes_in_motion(dataset, particles),
        sentences=answer_in_words(dataset, particles),
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
