"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their
record.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

# With the backend of PNGs, which it imports: processes that are forked to draw have both
import matplotlib.backends.backend_svg  # noqa: F401
from xarray import Dataset

from brownpipe.errors import WrongFileError
from brownpipe.figures import render
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
from brownpipe.report.page import page_of_results
from brownpipe.storage.files import write_files

# In pictures and texts, and in records and pages; a table has none
MARKS = (b"Made by brownpipe", b'"made_by"')


def write(
    dataset: Dataset,
    folder: str | Path,
    record: Record,
    page: str | Path | None = None,
    cores: int = 1,
) -> list[Path]:
    """Write the products of a dataset, with the options in their record, into a folder. Return the
    paths.

    page: file of the page with all of them. cores: number of figures that are drawn at the same
    time. No file is replaced before all are written; then what an earlier drawing made
    here is removed if it was not drawn again. Raises WrongFileError for a file in the place of a
    product that brownpipe did not make, and FigureError as `cases_shown` does.
    """
    folder = Path(folder)
    drawings = _drawings(dataset, record, cores)
    files = _files(dataset, drawings, record)
    products = {folder / name: data for name, data in files.items()}
    products[folder / RECORD] = record_text(record, files).encode()
    if page is not None:
        products[Path(page)] = page_of_results(dataset, drawings, record)
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


def _drawings(dataset: Dataset, record: Record, cores: int) -> list[Drawing]:
    """Return the figures of a dataset, those in the record or all."""
    cases = cases_shown(dataset, record.get("particles"), record.get("figures", ()))
    draw = partial(render.drawn, cases, metadata(record), record.get("panel", ()))
    return calculated(draw, [*cases], "figures", cores)


def _files(dataset: Dataset, drawings: Sequence[Drawing], record: Record) -> dict[str, bytes]:
    """Return the bytes of pictures, tables and the summary by the names of their files."""
    files = {}
    tables = {"summary": summary_table(dataset)}
    for drawing in drawings:
        tables[drawing.name] = drawing.table
        for suffix, image in drawing.images.items():
            files[f"{drawing.name}.{suffix}"] = image
    for name, table in tables.items():
        files[f"{name}.csv"] = table.to_csv(index=False, lineterminator="\n").encode()
    text = summary(dataset, record.get("figures", ()), record.get("title", ""))
    files["summary.txt"] = (text + closing_lines(record)).encode()
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
