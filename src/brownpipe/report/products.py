"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their
record.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

# With the backend of PNGs, which it imports: processes that are forked to draw have both
import matplotlib.backends.backend_svg  # noqa: F401
from pandas import DataFrame
from xarray import Dataset

from brownpipe.errors import FigureError, WrongFileError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.origin import (
    RECORD,
    Record,
    closing_lines,
    metadata,
    read_record,
    record_text,
)
from brownpipe.figures.render import Drawing, cases_shown
from brownpipe.figures.summary import summary, summary_table
from brownpipe.processes import calculated
from brownpipe.report.page import page_of_study, page_of_tradeoff
from brownpipe.storage.files import write_files
from brownpipe.tradeoff import is_tradeoff

# In pictures and texts, and in records and pages; a table has none
MARKS = (b"Made by brownpipe", b'"made_by"')


class Contents(NamedTuple):
    """What the files of a dataset contain, before its page and record."""

    drawings: Sequence[Drawing]
    tables: dict[str, DataFrame]  # by name of the file
    text: str
    text_file: str
    page_of: Callable[[Dataset, Sequence[Drawing], Record], bytes]


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
        contents = _contents_of_tradeoff(dataset, record)
    else:
        contents = _contents_of_study(dataset, record, cores)
    files = _files(contents, record)
    products = {folder / name: data for name, data in files.items()}
    products[folder / RECORD] = record_text(record, files).encode()
    if page is not None:
        products[Path(page)] = contents.page_of(dataset, contents.drawings, record)
    for path in products:
        if _is_foreign(path):
            raise WrongFileError(
                f"{path}: was not made by brownpipe; move it, or choose another place for the "
                "output"
            )
    drawn_before = _files_of_record(folder / RECORD)
    write_files(products)
    for name in drawn_before:
        path = folder / Path(name).name
        if name not in files and not _is_foreign(path):
            path.unlink(missing_ok=True)
    return [*products]


def _contents_of_study(dataset: Dataset, record: Record, cores: int) -> Contents:
    """Return the figures, tables and summary of a study."""
    figures = record.get("figures", ())
    cases = cases_shown(dataset, record.get("particles"), figures)
    draw = partial(render.drawn, cases, metadata(record), record.get("panel", ()))
    drawings = calculated(draw, [*cases], "figures", cores)
    tables = {drawing.name: drawing.table for drawing in drawings}
    tables["summary"] = summary_table(dataset)
    text = summary(dataset, figures, record.get("title", ""))
    return Contents(drawings, tables, text, "summary.txt", page_of_study)


def _contents_of_tradeoff(dataset: Dataset, record: Record) -> Contents:
    """Return the figures, table and text of a trade-off. Raises FigureError for options."""
    options = sorted(record.keys() - {"made_by", "dataset"})
    if options:
        raise FigureError(
            f"{', '.join(options)}: must not be given for a trade-off, which is shown as a whole"
        )
    drawings = tradeoff.drawn(dataset, metadata(record))
    tables = {"tradeoff": tradeoff.table(dataset)}
    text = tradeoff.summary(dataset)
    return Contents(drawings, tables, text, "tradeoff.txt", page_of_tradeoff)


def _files(contents: Contents, record: Record) -> dict[str, bytes]:
    """Return the bytes of pictures, tables and text by the names of their files."""
    files = {}
    for drawing in contents.drawings:
        for suffix, image in drawing.images.items():
            files[f"{drawing.name}.{suffix}"] = image
    for name, table in contents.tables.items():
        files[f"{name}.csv"] = table.to_csv(index=False, lineterminator="\n").encode()
    files[contents.text_file] = (contents.text + closing_lines(record)).encode()
    return files


def _files_of_record(path: Path) -> list[str]:
    """Return the names of the files that a record in a folder lists; none without a record."""
    if not path.is_file():
        return []
    record = read_record(path)
    return record.get("files", []) if record else []


def _is_foreign(path: Path) -> bool:
    """Whether there is something in a file that neither names brownpipe as its maker nor begins as
    all tables do.
    """
    data = path.read_bytes() if path.is_file() else b""
    is_table = data.startswith(b"scene,")
    is_marked = any(mark in data for mark in MARKS)
    return bool(data) and not is_table and not is_marked
