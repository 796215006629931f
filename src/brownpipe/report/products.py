"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.errors import FigureError, WrongFileError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.origin import (
    RECORD,
    Record,
    closing_lines,
    metadata,
    read_record,
    record_of,
    record_text,
    recorded_page,
)
from brownpipe.figures.style import import_libraries
from brownpipe.figures.summary import summary, summary_table
from brownpipe.figures.tables import to_csv
from brownpipe.parallel import calculated
from brownpipe.report import study as study_page
from brownpipe.report import tradeoff as tradeoff_page
from brownpipe.report.page import figure
from brownpipe.report.tradeoff import CAPTION
from brownpipe.storage import read_dataset, seal_of, write_files
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from xarray import Dataset

    from brownpipe.figures.drawing import Drawing

SUMMARY = "summary.txt"
MARKS = (b"Made by brownpipe", b'"made_by"')  # in pictures and texts, and in records and pages
HEADING = b"scene,particles,"  # of every table


class FigureProducts(NamedTuple):
    """What is made of one figure."""

    name: str
    pictures: Mapping[str, bytes]  # by the name of the file, with the record
    table: bytes  # CSV
    section: str  # of the page, HTML; "" without a page


def read(path: str | Path, names: Sequence[str] | None = None, particles: int | None = None) -> tuple[Dataset, Record]:
    """Return the dataset at `path` and the record of its products, which says what figures there are to be.

    names, particles: as in `render.cases_shown`. Raises FigureError for a trade-off if either is given, as it is shown
    as a whole, and what `read_dataset` raises.
    """
    dataset = read_dataset(path)
    if is_tradeoff(dataset) and (names or particles is not None):
        raise FigureError(f"{path}: a trade-off; it is shown as a whole")
    step = "tradeoff_figures" if is_tradeoff(dataset) else "figures"
    return dataset, record_of(dataset, step, seal_of(path), names, particles)


def write(
    dataset: Dataset,
    folder: str | Path,
    record: Record,
    names: Sequence[str] | None = None,
    page: str | Path | None = None,
    cores: int = 1,
) -> list[Path]:
    """Write the products of a record into a folder; of the figures only `names`, if given. Return the paths.

    page: file of the page with all of them. cores: on which figures of a study are drawn at the same time. No file is
    replaced before all are written; then what an earlier drawing made here is removed if it was not drawn again. Raises
    WrongFileError for a file in the place of a product that brownpipe did not make, FigureError as `render.cases_shown`
    does, and for a variable that the dataset lacks.
    """
    folder = Path(folder)
    if is_tradeoff(dataset):
        drawings = zip(tradeoff.drawn(dataset, metadata(record)), tradeoff.scenes_of(dataset), strict=True)
        shown = [_made_of(drawing, figure(drawing, CAPTION, scene)) for drawing, scene in drawings]
        tables = {"tradeoff.csv": to_csv(tradeoff.table(dataset))}
        texts = {"tradeoff.txt": tradeoff.summary(dataset)}
    else:
        cases = render.cases_shown(dataset, record["particles"], names or record["figures"])
        shown = _figures(cases, record, page is not None, cores)
        tables = {f"{one.name}.csv": one.table for one in shown} | {"summary.csv": to_csv(summary_table(dataset))}
        texts = {SUMMARY: summary(dataset)}
    files = {name: picture for one in shown for name, picture in one.pictures.items()} | tables
    files |= {name: (text + closing_lines(record)).encode() for name, text in texts.items()}
    products: dict[str | Path, bytes] = {folder / name: contents for name, contents in files.items()}
    products[folder / RECORD] = record_text(record, files).encode()
    if page is not None:
        sections = {one.name: one.section for one in shown}
        if is_tradeoff(dataset):
            contents = tradeoff_page.page(dataset, sections.values(), record)
        else:
            contents = study_page.page(dataset, sections, record)
        products[Path(page)] = recorded_page(contents, record)
    for path in map(Path, products):
        if path.is_file() and not _is_own(path.read_bytes()):
            raise WrongFileError(f"{path}: was not made by brownpipe; move it, or choose another place for the output")
    earlier = _listed(folder)
    write_files(products)
    for name in earlier - files.keys():
        if (folder / name).is_file() and _is_own((folder / name).read_bytes()):
            (folder / name).unlink()
    return [Path(path) for path in products]


def _listed(folder: Path) -> set[str]:
    """Return the names of the files that an earlier drawing in a folder made, as its record there says."""
    record = read_record(folder / RECORD) if (folder / RECORD).is_file() else None
    return {Path(name).name for name in (record or {}).get("files", [])}


def _is_own(contents: bytes) -> bool:
    """Whether a file has nothing in it, names brownpipe as its maker, or begins as all tables do."""
    return not contents or contents.startswith(HEADING) or any(mark in contents for mark in MARKS)


def _figures(cases: Mapping[str, list[Dataset]], record: Record, on_page: bool, cores: int) -> list[FigureProducts]:
    """Draw figures, given the cases that each shows, on so many cores; `on_page`: they have a section of a page."""

    def drawn(name: str) -> FigureProducts:
        drawing = render.drawn(name, cases[name], metadata(record))
        return _made_of(drawing, figure(drawing, name) if on_page else "")

    if cores > 1:
        import_libraries()  # here and not in every process
    return calculated(drawn, [*cases], "figures", cores)


def _made_of(drawing: Drawing, section: str) -> FigureProducts:
    """Return what is made of a drawing, given its section of a page."""
    pictures = {f"{drawing.name}.{suffix}": image for suffix, image in drawing.images.items()}
    return FigureProducts(drawing.name, pictures, to_csv(drawing.table), section)
