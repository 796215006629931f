"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their
record.
"""

from functools import partial
from pathlib import Path

import matplotlib.backends.backend_svg  # noqa: F401  # and that of PNGs: processes that are forked to draw have both
from xarray import Dataset

from brownpipe.errors import FigureError, WrongFileError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.cases import cases_shown
from brownpipe.figures.origin import (
    RECORD,
    Record,
    closing_lines,
    metadata,
    read_record,
    record_text,
)
from brownpipe.figures.summary import summary, summary_table
from brownpipe.processes import calculated
from brownpipe.report.page import page_of_study, page_of_tradeoff
from brownpipe.storage.files import write_files
from brownpipe.tradeoff import is_tradeoff

MARKS = (
    b"Made by brownpipe",
    b'"made_by"',
)  # in pictures and texts, and in records and pages; a table has none


def write(
    dataset: Dataset,
    folder: str | Path,
    record: Record,
    page: str | Path | None = None,
    cores: int = 1,
) -> list[Path]:
    """Write the products of a dataset, with the options in their record, into a folder. Return the
    paths.

    page: file of the page with all of them. cores: number of figures of a study that are drawn at
    the same time. No file is replaced before all are written; then what an earlier drawing made
    here is removed if it was not drawn again. Raises WrongFileError for a file in the place of a
    product that brownpipe did not make, FigureError as `cases_shown` does, and for a trade-off with
    options, as it is shown as a whole.
    """
    folder = Path(folder)
    if is_tradeoff(dataset):
        if given := ", ".join(sorted(record.keys() - {"made_by", "dataset"})):
            raise FigureError(
                f"{given}: must not be given for a trade-off, which is shown as a whole"
            )
        drawings, page_of = tradeoff.drawn(dataset, metadata(record)), page_of_tradeoff
        name, text, tables = (
            "tradeoff.txt",
            tradeoff.summary(dataset),
            {"tradeoff": tradeoff.table(dataset)},
        )
    else:
        cases = cases_shown(dataset, record.get("particles"), record.get("figures"))
        draw = partial(render.drawn, cases, metadata(record), record.get("panel", ()))
        drawings, page_of = calculated(draw, [*cases], "figures", cores), page_of_study
        tables = {one.name: one.table for one in drawings} | {"summary": summary_table(dataset)}
        name, text = (
            "summary.txt",
            summary(dataset, record.get("figures", ()), record.get("title", "")),
        )
    files = {
        f"{one.name}.{suffix}": image for one in drawings for suffix, image in one.images.items()
    }
    files |= {
        f"{one}.csv": table.to_csv(index=False, lineterminator="\n").encode()
        for one, table in tables.items()
    }
    files[name] = (text + closing_lines(record)).encode()
    products = {folder / name: contents for name, contents in files.items()}
    products[folder / RECORD] = record_text(record, files).encode()
    if page is not None:
        products[Path(page)] = page_of(dataset, drawings, record)
    for path in products:
        if _is_foreign(path):
            raise WrongFileError(
                f"{path}: was not made by brownpipe; move it, or choose another place for the "
                "output"
            )
    earlier = (read_record(folder / RECORD) if (folder / RECORD).is_file() else None) or {}
    write_files(products)
    for path in (
        folder / Path(name).name for name in earlier.get("files", []) if name not in files
    ):
        if not _is_foreign(path):
            path.unlink(missing_ok=True)
    return [*products]


def _is_foreign(path: Path) -> bool:
    """Whether there is something in a file that neither names brownpipe as its maker nor begins as
    all tables do.
    """
    contents = path.read_bytes() if path.is_file() else b""
    return (
        not contents.startswith(b"scene,")
        and not any(mark in contents for mark in MARKS)
        and bool(contents)
    )
