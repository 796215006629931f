"""The page of a cost-accuracy trade-off: for each scene the answer and its figure."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from brownpipe.figures.tradeoff import REMARK, columns_of, off_front, scenes_of
from brownpipe.report.page import caption_of, figure, table
from brownpipe.report.page import page as whole_page

if TYPE_CHECKING:
    from collections.abc import Iterable

    from xarray import Dataset

    from brownpipe.figures.origin import Record
    from brownpipe.figures.render import Drawing

CAPTION = "tradeoff"
NEXT = re.compile(r"\n(?=\w+: )")  # before the explanation of a column


def page(dataset: Dataset, drawings: Iterable[Drawing], record: Record) -> bytes:
    """Return the page of a trade-off and its figures, one for each scene."""
    scenes = scenes_of(dataset)
    answers = [(scene, table(columns_of(dataset, scene), scene), [*off_front(dataset, scene)]) for scene in scenes]
    figures = [figure(drawing, CAPTION, scene) for drawing, scene in zip(drawings, scenes, strict=True)]
    legend = [" ".join(part.split()) for part in NEXT.split(REMARK.strip())]
    title, _ = caption_of(CAPTION)
    return whole_page(title, ", ".join(scenes), record, answers=answers, legend=legend, figures=figures)
