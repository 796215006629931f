"""Everything that `brownpipe figures` writes of a dataset: figures, tables and text, and what they were made from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.errors import FigureError
from brownpipe.figures import tradeoff
from brownpipe.figures.origin import Record, closing_lines, record_of, write_record
from brownpipe.figures.render import render
from brownpipe.figures.summary import summary
from brownpipe.storage import read_dataset, seal_of, write_file
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xarray import Dataset

SUMMARY = "summary.txt"


def read(path: str | Path, names: Sequence[str] | None = None, particles: int | None = None) -> tuple[Dataset, Record]:
    """Return the dataset at `path` and what is to be written of it.

    names, particles: as in `render`; a trade-off is shown as a whole, otherwise FigureError is raised. Raises what
    `read_dataset` raises.
    """
    dataset = read_dataset(path)
    if is_tradeoff(dataset) and (names or particles is not None):
        raise FigureError(f"{path}: a trade-off; it is shown as a whole")
    step = "tradeoff_figures" if is_tradeoff(dataset) else "figures"
    return dataset, record_of(dataset, step, seal_of(path), names, particles)


def write(dataset: Dataset, folder: str | Path, record: Record, names: Sequence[str] | None = None) -> list[Path]:
    """Write the products of a record into a folder; of the figures only `names`, if given. Return the paths.

    Raises FigureError as `render` does.
    """
    if is_tradeoff(dataset):
        paths = tradeoff.render(dataset, folder, record)
    else:
        paths = render(dataset, folder, names or record["figures"], record["particles"], record)
        write_file(Path(folder) / SUMMARY, (summary(dataset) + closing_lines(record)).encode())
        paths.append(Path(folder) / SUMMARY)
    return [*paths, write_record(folder, record, [path.name for path in paths])]
