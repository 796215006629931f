"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their record."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.backends.backend_agg  # at the head, so that processes that are forked to draw have it
import matplotlib.backends.backend_svg  # noqa: F401
from xarray import Dataset

from brownpipe.errors import FigureError, WrongFileError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.cases import cases_shown
from brownpipe.figures.origin import RECORD, Record, closing_lines, metadata, read_record, record_of, record_text
from brownpipe.figures.summary import summary, summary_table
from brownpipe.processes import calculated
from brownpipe.report.page import page_of_study, page_of_tradeoff
from brownpipe.storage.datasets import read_dataset
from brownpipe.storage.files import seal_of, write_files
from brownpipe.tradeoff import is_tradeoff

MARKS = (b"Made by brownpipe", b'"made_by"')  # in pictures and texts, and in records and pages
HEADING = b"scene,"  # of every table


def read(path: str | Path, options: Mapping[str, Any]) -> tuple[Dataset, Record]:
    """Return the dataset at `path` and the record of its products, which says what figures there are to be.

    options: `figures`, `particles` and `panel` (`render`), `title` and `note`. Raises FigureError for a trade-off with
    any of them, as it is shown as a whole, and what `read_dataset` raises.
    """
    dataset = read_dataset(path)
    if is_tradeoff(dataset) and any(value is not None for value in options.values()):
        raise FigureError(f"{path}: a trade-off; it is shown as a whole")
    return dataset, record_of(dataset, seal_of(path), options)


def write(
    dataset: Dataset, folder: str | Path, record: Record, page: str | Path | None = None, cores: int = 1
) -> list[Path]:
    """Write the products of a dataset, with the options in their record, into a folder. Return the paths.

    page: file of the page with all of them. cores: on which figures of a study are drawn at the same time. No file is
    replaced before all are written; then what an earlier drawing made here is removed if it was not drawn again. Raises
    WrongFileError for a file in the place of a product that brownpipe did not make, FigureError as `cases_shown`
    does.
    """
    folder = Path(folder)
    if is_tradeoff(dataset):
        drawings = tradeoff.drawn(dataset, metadata(record))
        tables, page_of = {"tradeoff": tradeoff.table(dataset)}, page_of_tradeoff
        name, text = "tradeoff.txt", tradeoff.summary(dataset)
    else:
        cases = cases_shown(dataset, record["particles"], record["figures"])
        draw = partial(render.drawn, cases, metadata(record), record["panel"] or ())
        drawings = calculated(draw, [*cases], "figures", cores)
        tables = {one.name: one.table for one in drawings} | {"summary": summary_table(dataset)}
        page_of = page_of_study
        name, text = "summary.txt", summary(dataset, record["figures"] or (), record["title"] or "")
    files = {f"{one.name}.{suffix}": image for one in drawings for suffix, image in one.images.items()}
    files |= {f"{one}.csv": table.to_csv(index=False, lineterminator="\n").encode() for one, table in tables.items()}
    files[name] = (text + closing_lines(record)).encode()
    products: dict[str | Path, bytes] = {folder / name: contents for name, contents in files.items()}
    products[folder / RECORD] = record_text(record, files).encode()
    if page is not None:
        products[Path(page)] = page_of(dataset, drawings, record)
    for path in map(Path, products):
        if path.is_file() and not _is_own(path.read_bytes()):
            raise WrongFileError(f"{path}: was not made by brownpipe; move it, or choose another place for the output")
    earlier = (read_record(folder / RECORD) if (folder / RECORD).is_file() else None) or {}
    write_files(products)
    for path in (folder / Path(name).name for name in earlier.get("files", []) if name not in files):
        if path.is_file() and _is_own(path.read_bytes()):
            path.unlink()
    return [Path(path) for path in products]


def _is_own(contents: bytes) -> bool:
    """Whether a file has nothing in it, names brownpipe as its maker, or begins as all tables do."""
    return not contents or contents.startswith(HEADING) or any(mark in contents for mark in MARKS)
