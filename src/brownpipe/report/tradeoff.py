"""The page of a cost-accuracy trade-off: for each scene the answer and its figure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from brownpipe.figures.tradeoff import REMARK, columns_of, off_front, scenes_of
from brownpipe.report.page import HINT, Section
from brownpipe.report.page import page as whole_page
from brownpipe.report.parts import caption_of, figure, paragraphs, table, text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xarray import Dataset

    from brownpipe.figures.drawing import Drawing
    from brownpipe.figures.origin import Record

CAPTION = "tradeoff"
NEXT = re.compile(r"\n(?=\w+: )")  # before the explanation of a column


def page(dataset: Dataset, drawings: Sequence[Drawing], record: Record, name: str) -> bytes:
    """Return the page of a trade-off and its drawings, one for each scene; `name` is that of its file."""
    scenes = scenes_of(dataset)
    title, _ = caption_of(CAPTION)
    answers = "".join(_answer(dataset, scene) for scene in scenes)
    legend = paragraphs((" ".join(part.split()) for part in NEXT.split(REMARK.strip())), "legend")
    shown = [figure(drawing, CAPTION, scene) for drawing, scene in zip(drawings, scenes, strict=True)]
    sections = [
        Section("answer", "Answer", answers + legend),
        Section("figures", "Figures", paragraphs([HINT], "hint") + "".join(shown)),
    ]
    return whole_page(title, ", ".join(scenes), sections, record, name)


def _answer(dataset: Dataset, scene: str) -> str:
    heading = f"{scene}, N = {int(dataset.sel(scene=scene).particles)}"
    lines = paragraphs(off_front(dataset, scene))
    return f"<h3>{text(heading)}</h3>\n{table(columns_of(dataset, scene), heading)}{lines}"
