"""The page of a cost-accuracy trade-off: for each scene the answer and its figure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from brownpipe.figures.tradeoff import REMARK, columns_of, off_front, scenes_of
from brownpipe.report.page import HINT, Section
from brownpipe.report.page import page as whole_page
from brownpipe.report.parts import caption_of, paragraphs, table, text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from xarray import Dataset

    from brownpipe.figures.origin import Record

CAPTION = "tradeoff"
NEXT = re.compile(r"\n(?=\w+: )")  # before the explanation of a column


def page(dataset: Dataset, figures: Iterable[str], record: Record, name: str) -> bytes:
    """Return the page of a trade-off and its figures; `name` is that of its file.

    figures: their sections of the page (`parts.figure`), one for each scene.
    """
    scenes = scenes_of(dataset)
    title, _ = caption_of(CAPTION)
    answers = "".join(_answer(dataset, scene) for scene in scenes)
    legend = paragraphs((" ".join(part.split()) for part in NEXT.split(REMARK.strip())), "legend")
    sections = [
        Section("answer", "Answer", answers + legend),
        Section("figures", "Figures", paragraphs([HINT], "hint") + "".join(figures)),
    ]
    return whole_page(title, ", ".join(scenes), sections, record, name)


def _answer(dataset: Dataset, scene: str) -> str:
    heading = f"{scene}, N = {int(dataset.sel(scene=scene).particles)}"
    lines = paragraphs(off_front(dataset, scene))
    return f"<h3>{text(heading)}</h3>\n{table(columns_of(dataset, scene), heading)}{lines}"
