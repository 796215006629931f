"""Make a dataset, figure, table or summary again from what it says of itself, and compare it byte by byte.

Everything is made in a scratch folder. Runs are read from the trajectory files of the study if all of them are beside
the product, and are made again from scenes and seeds otherwise; datasets of figures likewise. What a product says of
the installation that made it is copied, so that its bytes can be equal; differences of the installation are said first.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from brownpipe import analysis, tradeoff
from brownpipe.engines import forecast
from brownpipe.errors import StorageError, WrongFileError
from brownpipe.figures.catalogue import FIGURES
from brownpipe.figures.origin import RECORD, Record, dataset_attributes, installation_in_words, read_record, record_in
from brownpipe.figures.replay import replay_fragment
from brownpipe.formatting import counted, in_time
from brownpipe.inspection.comparison import differing_variables, first_difference
from brownpipe.inspection.lines import DIGITS
from brownpipe.inspection.runs import seeds_in_words
from brownpipe.provenance import modules_of, source_digest
from brownpipe.quoting import printable, shell_path
from brownpipe.report.products import SUMMARY, write
from brownpipe.stages import tracked
from brownpipe.storage import (
    Origin,
    made_by,
    read_dataset,
    read_options,
    read_origins,
    read_outline,
    read_trajectories,
    seal_of,
    write_dataset,
    write_trajectories,
)
from brownpipe.tradeoff.variables import MEASURED

if TYPE_CHECKING:
    from xarray import Dataset

PAGE = ".html"
SUFFIXES = (".png", ".svg", ".csv", ".txt", ".json", ".gif", PAGE)  # of products of `brownpipe figures` and `movie`
EVERYWHERE = "health"  # the figure that every dataset has
DRAWING = 1.2  # CPU seconds to import matplotlib and draw a figure
BATCH = 2400  # runs in memory at the same time
MOST_BYTES = 2**28  # of a figure or table
TIMED = "CPU times are measured anew whenever a trade-off is made"


class Product(NamedTuple):
    """A dataset, figure, table or summary, and what it says it was made from."""

    path: Path
    record: Record | None  # of a product of `brownpipe figures`; None for a dataset
    dataset: Path | None  # its own file, or that of which a figure was made, if it is there
    attributes: Mapping[str, Any]  # of the dataset
    origins: tuple[Origin, ...]
    files: tuple[tuple[Path, ...], ...]  # trajectory files of each origin; () if its runs have to be made again
    replay: tuple[Origin, ...]  # the run that is replayed in a page, or none
    options: Mapping[str, Any]  # with which the dataset was made

    @property
    def step(self) -> str:
        """The verb that made the dataset."""
        return "tradeoff" if "instead_of" in self.options else "aggregate"

    @property
    def needs_runs(self) -> bool:
        """Whether the dataset has to be made."""
        return self.record is None or self.dataset is None


def is_product(path: str | Path) -> bool:
    """Return whether a file is, by its suffix, one of those that `brownpipe figures` and `movie` write."""
    return Path(path).suffix.lower() in SUFFIXES


def describe_product(path: str | Path) -> str:
    """Return what a product of `brownpipe figures` was made from, as lines of text. Errors as of `read_product`."""
    product = read_product(path)
    assert product.record is not None
    lines = [f"{path}  made by {installation_in_words(product.record['made_by'])}"]
    dataset = "not beside it" if product.dataset is None else str(product.dataset)
    lines.append(f"dataset      {str(product.attributes['sha256'])[:DIGITS]}, {dataset}")
    for origin in product.origins:
        lines.append(f"runs         {_runs(origin)}")
    lines += [f"replay       {_runs(origin)}" for origin in product.replay]
    return "\n".join([*lines, f"run again    brownpipe inspect {shell_path(path)} --reproduce"])


def _runs(origin: Origin) -> str:
    """Return the runs of an origin in words."""
    particles = "" if origin.scene is None else f", N = {origin.scene.particles}"
    runs = counted(len(origin.seeds), "run")
    return f"{runs} of {origin.name}{particles}, {origin.engine.options}, {seeds_in_words(origin.seeds)}"


# -- reading --------------------------------------------------------------------------------------------------------


def read_product(path: str | Path) -> Product:
    """Return a product with what it was made from, and where its dataset and trajectory files are.

    Raises WrongFileError or StorageError for a file that does not say what it was made from, StorageError for a damaged
    one, and RequestError for runs that this installation refuses.
    """
    path = Path(path)
    record = _record_of(path) if is_product(path) else None
    if record is None:
        dataset, attributes = path, read_dataset(path).attrs
    else:
        attributes = dataset_attributes(record)
        dataset = _dataset_beside(path, str(attributes.get("sha256")))
    if "made_from" not in attributes:
        raise WrongFileError(f"{path}: does not say what it was made from; make it again with this brownpipe")
    origins = tuple(read_origins(path, attributes))
    folder = path.parent if dataset is None else dataset.parent
    needed = record is None or dataset is None
    files = tuple(_trajectory_files(folder, origin) if needed else () for origin in origins)
    replay = _replay_of(path, record or {})
    for origin, found in zip(origins, files, strict=True):
        if needed and not found:
            _refuse_unfit(path, origin)
    return Product(path, record, dataset, attributes, origins, files, replay, read_options(path, attributes))


def _replay_of(path: Path, record: Record) -> tuple[Origin, ...]:
    """Return the run that is replayed in a page with this record, or none; errors as of `read_product`."""
    if "replay" not in record:
        return ()
    origins = read_origins(path, {"made_from": json.dumps([record["replay"]])})
    for origin in origins:
        _refuse_unfit(path, origin)
    return tuple(origins)


def _record_of(path: Path) -> Record:
    """Return the record of a figure, table or summary. Raises WrongFileError if there is none."""
    try:
        if path.stat().st_size > MOST_BYTES or not path.is_file():
            raise WrongFileError(f"{path}: cannot be read: is no file, or larger than {MOST_BYTES >> 20} MiB")
        record = read_record(path)
        if record is not None and record_in(path.read_bytes()) is None and path.name not in (*record["files"], RECORD):
            record = None
    except OSError as error:
        raise WrongFileError(f"{path}: cannot be read: {error.strerror}") from error
    except (KeyError, TypeError) as error:
        raise WrongFileError(f"{path}: cannot be read: {error}") from error
    if record is not None and "movie" in record:
        raise WrongFileError(f"{path}: is of brownpipe movie, from a single run; make that again and compare its file")
    if record is None or not _is_valid(record):
        wrong = f"{path}: does not say what it was made from, and no {RECORD} beside it does"
        raise WrongFileError(f"{wrong}; make it again with this brownpipe")
    return record


def _is_valid(record: Record) -> bool:
    """Return whether all parts of a record that are read here have the right form."""
    names, count = record.get("figures"), record.get("particles")
    return (
        all(isinstance(record.get(key), dict) for key in ("dataset", "made_by"))
        and (names is None or (isinstance(names, list) and set(map(str, names)) <= FIGURES.keys()))
        and (count is None or type(count) is int)
        and isinstance(record.get("files", []), list)
        and re.fullmatch("[0-9a-f]{64}", str(record["dataset"].get("sha256"))) is not None
    )


def _dataset_beside(path: Path, digest: str) -> Path | None:
    """Return the dataset with this digest in the folder of a product, the one above it, or `aggregate` in either."""
    above = path.parent.absolute().parent
    others = (above, above / "aggregate", path.parent / "aggregate")
    folders = [path.parent, *(folder for folder in others if folder.is_dir())]
    candidates = (file for folder in folders for file in sorted(folder.glob("*.nc")) if file.is_file())
    return next((Path(os.path.relpath(file)) for file in candidates if seal_of(file) == digest), None)


def _trajectory_files(folder: Path, origin: Origin) -> tuple[Path, ...]:
    """Return the trajectory files with exactly the runs of an origin, in the study of a folder or in the folder itself.

    Return none if runs are missing, or if some are in two files.
    """
    particles = "*" if origin.scene is None else origin.scene.particles
    case = f"simulate/{origin.name}/N{particles}/{origin.engine.label}/*.h5"
    candidates = [*folder.absolute().parent.glob(case), *folder.glob(case), *folder.glob("*.h5")]
    found, seeds = [], []
    for file in sorted(file for file in candidates if file.is_file()):
        try:
            outline = read_outline(file)
        except StorageError:
            continue
        own = (outline.scene.digest, outline.engine, outline.average, outline.source)
        are_measured = outline.observables in (None, origin.observables)
        if are_measured and own == (origin.digest, origin.engine, origin.average, origin.source):
            found.append(file)
            seeds += outline.seeds.tolist()
    return tuple(found) if sorted(seeds) == [*origin.seeds] else ()


def _refuse_unfit(path: Path, origin: Origin) -> None:
    """Raise an error for runs that cannot be made from what a product says."""
    if origin.scene is None:
        raise StorageError(f"{path}: its trajectory files are needed: the scene {origin.name} is too long to be in it")
    origin.engine.refuse_unfit(origin.scene, origin.record)
    cost = origin.engine.forecast(origin.scene, origin.record, origin.observables, origin.average)
    forecast.refuse_too_large(origin.scene, min(BATCH, len(origin.seeds)), cost)


def _changes(product: Product) -> Iterator[str]:
    """Yield what differs between the installation that made a product and this one."""
    for origin, found in zip(product.origins, product.files, strict=True):
        now = source_digest(*modules_of("simulate", origin.engine.name))
        if product.needs_runs and not found and origin.source != now:
            yield f"source of {origin.engine.name} {origin.source[:DIGITS]}, here {now[:DIGITS]}"
    made = [(product.attributes, product.step)] if product.needs_runs else []
    if product.record is not None:
        made.append((product.record["made_by"], "figures" if product.step == "aggregate" else "tradeoff_figures"))
    seen = set()
    for stored, step in made:
        here = made_by(step)
        for name in here:
            before, now = (printable(values.get(name, "unknown")) for values in (stored, here))
            if before != now and (name, before) not in seen and name != "git_commit":
                seen.add((name, before))
                word = f"source of {step}" if name == "source_digest" else name.removesuffix("_version")
                yield f"{word} {before[:DIGITS]}, here {now[:DIGITS]}"


def announcement(product: Product) -> list[str]:
    """Return what will be made, how long it will take, and what may make it differ, as lines of text."""
    lines, seconds = [], forecast.START_UP
    for origin, found in zip(product.origins, product.files, strict=True):
        if product.needs_runs and found:
            lines.append(f"reading {_runs(origin)}: {len(found)} trajectory files, which are not made again")
        elif product.needs_runs:
            assert origin.scene is not None
            cost = origin.engine.forecast(origin.scene, origin.record, origin.observables, origin.average)
            seconds += cost.once + len(origin.seeds) * cost.seconds
            lines.append(f"running again {_runs(origin)}")
    lines += [f"running again {_runs(origin)}, to be replayed" for origin in product.replay]
    if product.record is not None and product.dataset is not None:
        lines.append(f"drawing again from {product.dataset}")
    seconds += 0.0 if product.record is None else DRAWING
    lines[-1] += f": some {in_time(seconds)} of CPU"
    if changes := dict.fromkeys(_changes(product)):
        lines.append(f"results may differ: the file was made with {'; '.join(changes)}")
    return lines


# -- making again ---------------------------------------------------------------------------------------------------


def differences(product: Product) -> list[str]:
    """Make a product again in a scratch folder; return in words what differs, nothing if every byte is the same.

    Raises StorageError for the figure of a trade-off whose dataset is not there, and RunError like the engines.
    """
    if product.record is not None and product.dataset is None and product.step == "tradeoff":
        raise StorageError(f"{product.path}: needs its dataset, which is not beside it: {TIMED}")
    with tempfile.TemporaryDirectory(prefix="brownpipe-") as scratch:
        folder = Path(scratch)
        if product.record is None:
            assert product.dataset is not None
            return _differing_datasets(product, product.dataset, _dataset_again(product, folder), folder / "again.nc")
        if product.dataset is None:
            dataset, path = _dataset_again(product, folder), folder / "dataset.nc"
            write_dataset(path, dataset)
            found = [] if seal_of(path) == product.attributes["sha256"] else ["dataset: is another one, made again"]
        else:
            dataset, found = read_dataset(product.dataset), []
        return found + _differing_figures(product, product.record, dataset, folder / "figures")


def _dataset_again(product: Product, folder: Path) -> Dataset:
    """Return the dataset of a product, from the trajectory files that are there and from new ones in a folder."""
    files = [
        *(file for found in product.files for file in found),
        *_simulate(folder, [origin for origin, found in zip(product.origins, product.files, strict=True) if not found]),
    ]
    options = product.options
    windows = [(start, end) for start, end in options.get("fit_windows") or []]
    if product.step == "tradeoff":
        window = options["fit_window"]
        dataset = tradeoff.measure(files, options["instead_of"], window and tuple(window), lambda *_: 1.0)
    else:
        rings = (options["ring_width"], options["rings"], options["displacement_times"])
        dataset = analysis.aggregate(files, windows or None, *rings)
    return _as_stated(dataset, product)


def _simulate(folder: Path, origins: Sequence[Origin]) -> list[Path]:
    """Make the runs of these origins again; return their trajectory files, which state the source of the original."""
    paths = []
    folder.mkdir(exist_ok=True)
    batches = [(origin, origin.seeds[k : k + BATCH]) for origin in origins for k in range(0, len(origin.seeds), BATCH)]
    for number, (origin, seeds) in enumerate(tracked(batches, "batches")):
        assert origin.scene is not None
        measures: dict[str, Any] = {"observables": origin.observables, "average": origin.average}
        ensemble = origin.engine.simulate(origin.scene, seeds, origin.record, **measures)
        paths.append(folder / f"{number}.h5")
        write_trajectories(paths[-1], origin.scene, origin.engine, ensemble, origin.source)
    return paths


def _as_stated(dataset: Dataset, product: Product) -> Dataset:
    """Return a dataset with source, versions and commit as the product states them."""
    stated, attributes = product.attributes, {}
    for name, value in dataset.attrs.items():
        is_of_installation = name.endswith("_version") or name in ("source_digest", "python")
        if name != "git_commit":
            attributes[name] = stated.get(name, value) if is_of_installation else value
        if name == "python" and "git_commit" in stated:
            attributes["git_commit"] = stated["git_commit"]
    return dataset.drop_attrs(deep=False).assign_attrs(attributes)


# -- comparing ------------------------------------------------------------------------------------------------------


def _differing_datasets(product: Product, path: Path, made: Dataset, again: Path) -> list[str]:
    """Return what differs between the dataset at a path and the one made again, which is written to `again`.

    Measured CPU times are not compared.
    """
    stored = read_dataset(path)
    if product.step == "tradeoff":
        there = [name for name in MEASURED if name in stored and stored[name].shape == made[name].shape]
        made = made.assign({name: stored[name] for name in there})
    write_dataset(again, made)
    if again.read_bytes() == path.read_bytes():
        return []
    made = read_dataset(again)
    lines = [
        f"attribute {name}" for name in {**stored.attrs, **made.attrs} if stored.attrs.get(name) != made.attrs.get(name)
    ]
    for name in dict.fromkeys([*stored.variables, *made.variables]):
        lines += differing_variables(str(name), stored, made)
    return lines or ["bytes of the file, though all numbers and attributes are the same: HDF5 or netCDF differ"]


def _differing_figures(product: Product, record: Record, dataset: Dataset, folder: Path) -> list[str]:
    """Draw products again as their record says, and return a line for each that differs from the original."""
    path, stated = product.path, {key: value for key, value in record.items() if key not in ("file", "files")}
    name = str(record.get("file", path.name))
    page = folder / Path(name).name if path.suffix.lower() == PAGE else None
    shown = _figures_for(Path(name).stem) if page is None else None
    runs = _simulate(folder.with_name("replay"), product.replay)
    (replay,) = [replay_fragment(read_trajectories(run), str(run)) for run in runs] or (None,)
    made = {file.name: file for file in write(dataset, folder, stated, shown, page, replay)}
    lines = []
    wanted = [*map(str, record["files"]), RECORD] if path.name == RECORD else [name]
    for name in wanted:
        if name not in made:
            raise StorageError(f"{path}: says that it is {name!a}, which brownpipe figures does not write")
        original = path.with_name(name) if path.name == RECORD else path
        if not original.is_file():
            lines.append(f"{original.name}: is missing")
        elif difference := first_difference(original.read_bytes(), made[name].read_bytes(), made[name].suffix):
            lines.append(f"{original.name}: {difference}")
    return lines


def _figures_for(stem: str) -> list[str] | None:
    """Return the figures to draw for a file of this name, one for a summary; None for all figures of the record."""
    return [stem] if stem in FIGURES else [EVERYWHERE] if stem == Path(SUMMARY).stem else None


def verdict(product: Product, found: list[str]) -> str:
    """Return whether a product is identical, or what differs."""
    timed = product.step == "tradeoff" and product.record is None
    remark = f"; not compared: {', '.join(MEASURED)}, as {TIMED}" if timed else ""
    if not found:
        return f"identical: every byte of {product.path.name}{remark}"
    return "\n".join([f"different: {product.path.name}{remark}", *(f"  {line}" for line in found)])
