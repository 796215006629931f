"""The page of a cost-accuracy trade-off: for each scene the answer and its figure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from markupsafe import Markup

from brownpipe.figures.tradeoff import REMARK, columns_of, off_front, scenes_of
from brownpipe.quoting import printable
from brownpipe.report.page import Section, caption_of, paragraphs, table
from brownpipe.report.page import page as whole_page

if TYPE_CHECKING:
    from collections.abc import Iterable

    from xarray import Dataset

    from brownpipe.figures.origin import Record

CAPTION = "tradeoff"
NEXT = re.compile(r"\n(?=\w+: )")  # before the explanation of a column


def page(dataset: Dataset, figures: Iterable[str], record: Record) -> bytes:
    """Return the page of a trade-off and its figures.

    figures: their sections of the page (`page.figure`), one for each scene.
    """
    scenes = scenes_of(dataset)
    title, _ = caption_of(CAPTION)
    answers = Markup("").join(_answer(dataset, scene) for scene in scenes)
    legend = paragraphs((" ".join(part.split()) for part in NEXT.split(REMARK.strip())), "legend")
    sections = [
        Section("answer", "Answer", answers + legend),
        Section("figures", "Figures", Markup("").join(figures)),
    ]
    return whole_page(title, ", ".join(scenes), sections, record)


def _answer(dataset: Dataset, scene: str) -> str:
    lines = paragraphs(off_front(dataset, scene))
    return Markup("<h3>{}</h3>\n").format(printable(scene)) + table(columns_of(dataset, scene), scene) + lines
