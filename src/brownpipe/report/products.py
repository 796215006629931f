"""Everything that `brownpipe figures` writes of a dataset: figures, tables, text, a page, and their record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.errors import FigureError, StorageError
from brownpipe.figures import render, tradeoff
from brownpipe.figures.cases import of_whole_dataset
from brownpipe.figures.catalogue import FIGURES
from brownpipe.figures.origin import RECORD, Record, closing_lines, record_of, record_text, stamped
from brownpipe.figures.style import import_libraries
from brownpipe.figures.summary import summary, summary_table
from brownpipe.figures.tables import to_csv
from brownpipe.parallel import calculated
from brownpipe.report import study as study_page
from brownpipe.report import tradeoff as tradeoff_page
from brownpipe.report.parts import figure
from brownpipe.report.tradeoff import CAPTION
from brownpipe.storage import read_dataset, seal_of, write_files
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from xarray import Dataset

    from brownpipe.figures.drawing import Drawing
    from brownpipe.figures.replay import Fragment

SUMMARY = "summary.txt"
FILE_TYPES = ("png", "svg", "csv")  # of a figure


class FigureProducts(NamedTuple):
    """What is made of one figure."""

    name: str
    pictures: Mapping[str, bytes]  # by the name of the file, with the record
    table: bytes  # CSV
    section: str  # of the page, HTML; "" without a page


def read(path: str | Path, names: Sequence[str] | None = None, particles: int | None = None) -> tuple[Dataset, Record]:
    """Return the dataset at `path` and the record of its products, which says what figures there are to be.

    names, particles: as in `render.cases_shown`. Raises FigureError for a trade-off if either is given, as it is shown
    as a whole, StorageError for a dataset that does not say what it was made from, and what `read_dataset` raises.
    """
    dataset = read_dataset(path)
    if is_tradeoff(dataset) and (names or particles is not None):
        raise FigureError(f"{path}: a trade-off; it is shown as a whole")
    step = "tradeoff_figures" if is_tradeoff(dataset) else "figures"
    try:
        return dataset, record_of(dataset, step, seal_of(path), names, particles)
    except StorageError as error:
        raise StorageError(f"{path}: {error}") from error


@of_whole_dataset
def write(
    dataset: Dataset,
    folder: str | Path,
    record: Record,
    names: Sequence[str] | None = None,
    page: str | Path | None = None,
    replay: Fragment | None = None,
    cores: int = 1,
) -> list[Path]:
    """Write the products of a record into a folder; of the figures only `names`, if given. Return the paths.

    page: file of the page with all of them. replay: one run, replayed in the page of a study. cores: on which figures
    of a study are drawn at the same time. No file is replaced before all are written; then figures of a study that are
    in the folder but not among the products are removed, as they may belong to another dataset. Raises FigureError as
    `render.cases_shown` does, and for a variable that the dataset lacks.
    """
    folder = Path(folder)
    if is_tradeoff(dataset):
        drawings = zip(tradeoff.drawn(dataset), tradeoff.scenes_of(dataset), strict=True)
        shown = [_made_of(drawing, record, figure(drawing, CAPTION, scene)) for drawing, scene in drawings]
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
        name, sections = Path(page).name, {one.name: one.section for one in shown}
        if is_tradeoff(dataset):
            contents = tradeoff_page.page(dataset, sections.values(), record, name)
        else:
            record = record | ({} if replay is None else {"replay": replay.run})
            contents = study_page.page(dataset, sections, record, name, replay and replay.text)
        products[Path(page)] = stamped(contents, name, record)
    write_files(products)
    if not is_tradeoff(dataset):
        for name in FIGURES.keys() - {one.name for one in shown}:
            for suffix in FILE_TYPES:
                (folder / f"{name}.{suffix}").unlink(missing_ok=True)
    return [Path(path) for path in products]


def _figures(cases: Mapping[str, list[Dataset]], record: Record, on_page: bool, cores: int) -> list[FigureProducts]:
    """Draw figures, given the cases that each shows, on so many cores; `on_page`: they have a section of a page."""

    def drawn(name: str, _: object) -> FigureProducts:
        drawing = render.drawn(name, cases[name])
        return _made_of(drawing, record, figure(drawing, name) if on_page else "")

    if cores > 1:
        import_libraries()  # here and not in every process
    return calculated(drawn, [*cases], [1] * len(cases), "figures", cores)


def _made_of(drawing: Drawing, record: Record, section: str) -> FigureProducts:
    """Return what is made of a drawing, given its section of a page."""
    images = {f"{drawing.name}.{suffix}": image for suffix, image in drawing.images.items()}
    pictures = {name: stamped(image, name, record) for name, image in images.items()}
    return FigureProducts(drawing.name, pictures, to_csv(drawing.table), section)
