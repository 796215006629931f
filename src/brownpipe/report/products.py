"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.errors import FigureError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.cases import of_whole_dataset
from brownpipe.figures.catalogue import FIGURES
from brownpipe.figures.origin import Record, closing_lines, record_of, stamped, write_record
from brownpipe.figures.summary import summary, summary_table
from brownpipe.figures.tables import to_csv
from brownpipe.report import study as study_page
from brownpipe.report import tradeoff as tradeoff_page
from brownpipe.storage import read_dataset, seal_of, write_file
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xarray import Dataset

    from brownpipe.figures.replay import Fragment

SUMMARY = "summary.txt"
FILE_TYPES = ("png", "svg", "csv")  # of a figure


def read(path: str | Path, names: Sequence[str] | None = None, particles: int | None = None) -> tuple[Dataset, Record]:
    """Return the dataset at `path` and the record of its products, which says what figures there are to be.

    names, particles: as in `render.drawn`. Raises FigureError for a trade-off if either is given, as it is shown as a
    whole, and what `read_dataset` raises.
    """
    dataset = read_dataset(path)
    if is_tradeoff(dataset) and (names or particles is not None):
        raise FigureError(f"{path}: a trade-off; it is shown as a whole")
    step = "tradeoff_figures" if is_tradeoff(dataset) else "figures"
    return dataset, record_of(dataset, step, seal_of(path), names, particles)


@of_whole_dataset
def write(
    dataset: Dataset,
    folder: str | Path,
    record: Record,
    names: Sequence[str] | None = None,
    page: str | Path | None = None,
    replay: Fragment | None = None,
) -> list[Path]:
    """Write the products of a record into a folder; of the figures only `names`, if given. Return the paths.

    page: file of the page with all of them. replay: one run, replayed in the page of a study. Figures of a study that
    are in the folder but not among the products are removed, as they may belong to another dataset. Raises FigureError
    as `render.drawn` does, and for a variable that the dataset lacks.
    """
    folder = Path(folder)
    if is_tradeoff(dataset):
        drawings = tradeoff.drawn(dataset)
        tables = {"tradeoff.csv": tradeoff.table(dataset)}
        texts = {"tradeoff.txt": tradeoff.summary(dataset)}
    else:
        drawings = render.drawn(dataset, names or record["figures"], record["particles"])
        tables = {f"{shown.name}.csv": shown.table for shown in drawings} | {"summary.csv": summary_table(dataset)}
        texts = {SUMMARY: summary(dataset)}
        for name in FIGURES.keys() - {shown.name for shown in drawings}:
            for suffix in FILE_TYPES:
                (folder / f"{name}.{suffix}").unlink(missing_ok=True)
    pictures = {f"{shown.name}.{suffix}": image for shown in drawings for suffix, image in shown.images.items()}
    files = {name: stamped(image, name, record) for name, image in pictures.items()}
    files |= {name: to_csv(table) for name, table in tables.items()}
    files |= {name: (text + closing_lines(record)).encode() for name, text in texts.items()}
    for name, contents in files.items():
        write_file(folder / name, contents)
    paths = [*(folder / name for name in files), write_record(folder, record, files)]
    if page is not None:
        name = Path(page).name
        if is_tradeoff(dataset):
            contents = tradeoff_page.page(dataset, drawings, record, name)
        else:
            record = record | ({} if replay is None else {"replay": replay.run})
            contents = study_page.page(dataset, drawings, record, name, replay and replay.text)
        write_file(page, stamped(contents, name, record))
        paths.append(Path(page))
    return paths
