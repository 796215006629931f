"""Write the figures of a dataset, each as PNG, SVG and CSV."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.errors import FigureError
from brownpipe.figures.cases import cases_of, check_count, check_names, has, one_count
from brownpipe.figures.catalogue import FIGURES, SEVERAL_COUNTS
from brownpipe.figures.catalogue import Figure as Entry
from brownpipe.figures.drawing import Drawing, drawing_of
from brownpipe.figures.origin import Record, stamped
from brownpipe.figures.style import drawing
from brownpipe.figures.summary import summary_table
from brownpipe.figures.tables import to_csv
from brownpipe.stages import tracked
from brownpipe.storage import write_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from matplotlib.figure import Figure
    from xarray import Dataset

FILE_TYPES = ("png", "svg", "csv")


def render(
    dataset: Dataset,
    folder: str | Path,
    names: Sequence[str] | None = None,
    particles: int | None = None,
    record: Record | None = None,
) -> list[Path]:
    """Write figures of a dataset and `summary.csv` into a folder; return the paths. Arguments and errors: see `drawn`.

    With a `record` of what they were made from, the pictures state it.
    """
    return write_drawings(drawn(dataset, names, particles), dataset, folder, record)


def drawn(dataset: Dataset, names: Sequence[str] | None = None, particles: int | None = None) -> list[Drawing]:
    """Draw figures of a dataset.

    `names` selects the figures; the default is every figure that the dataset has data for. Most figures show one
    particle count of each scene: `particles`, or by default the 2020 note's 150 if the scene has it, or else its
    largest.

    Raise FigureError for a figure of `names` that the dataset has no data for, and for a particle count that it lacks.
    """
    shown = cases_shown(dataset, particles, names)
    for name in names or ():
        _refuse_lacking(name, shown)
    drawings = []
    with drawing():
        for name in tracked(names or [name for name, cases in shown.items() if cases], "figures"):
            module, cases = module_of(name), shown[name]
            drawings.append(drawing_of(name, module.draw(cases), module.table(cases)))
    return drawings


def write_drawings(
    drawings: Sequence[Drawing], dataset: Dataset, folder: str | Path, record: Record | None = None
) -> list[Path]:
    """Write drawings of a dataset and then `summary.csv` into a folder; return the paths.

    Figures in the folder that are not among the drawings are removed, as they may belong to another dataset.
    """
    files: dict[str, bytes] = {}
    for shown in drawings:
        for suffix, image in shown.images.items():
            files[f"{shown.name}.{suffix}"] = stamped(image, f"{shown.name}.{suffix}", record)
        files[f"{shown.name}.csv"] = to_csv(shown.table)
    files["summary.csv"] = to_csv(summary_table(dataset))
    for path in (Path(folder) / f"{name}.{suffix}" for name in FIGURES for suffix in FILE_TYPES):
        if path.name not in files:
            path.unlink(missing_ok=True)
    for name, contents in files.items():
        write_file(Path(folder) / name, contents)
    return [Path(folder) / name for name in files]


def draw(dataset: Dataset, name: str, particles: int | None = None) -> Figure:
    """Return one figure of a dataset, as `render` writes it; the same errors."""
    shown = cases_shown(dataset, particles, [name])
    _refuse_lacking(name, shown)
    with drawing():
        return module_of(name).draw(shown[name])


def _refuse_lacking(name: str, shown: dict[str, list[Dataset]]) -> None:
    if not shown[name]:
        raise FigureError(f"{name}: cannot be drawn from this dataset: {module_of(name).LACKING}")


def module_of(name: str) -> ModuleType:
    """Return the module that draws the figure of this name."""
    return import_module(f"brownpipe.figures.{name}")


def cases_shown(
    dataset: Dataset, particles: int | None = None, names: Sequence[str] | None = None
) -> dict[str, list[Dataset]]:
    """Return for each figure, or each of `names`, the cases it shows: those with data for it, of one particle count
    or of all.
    """
    check_names(dataset)
    cases = cases_of(dataset)
    check_count(cases, particles)
    return {name: _selected(FIGURES[name], cases, particles) for name in names or FIGURES}


def _selected(figure: Entry, cases: list[Dataset], particles: int | None) -> list[Dataset]:
    cases = [case for case in cases if has(case, *module_of(figure.name).VARIABLES)]
    if not figure.every_count:
        return one_count(cases, particles)
    too_few = SEVERAL_COUNTS in figure.needs and len({int(case.particles) for case in cases}) < 2
    return [] if too_few else cases
