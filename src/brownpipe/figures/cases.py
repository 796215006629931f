"""The parts of a dataset that figures and tables show.

A case is one scene with one particle count and one engine: the dataset without these three dimensions.
"""

from __future__ import annotations

import re
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from traceback import extract_tb
from typing import TYPE_CHECKING, Concatenate, ParamSpec, SupportsFloat, TypeVar

import numpy as np

from brownpipe.analysis.dataset import ALL_COORDINATES, ALL_VARIABLES
from brownpipe.errors import BrownpipeError, FigureError, RequestError, StorageError
from brownpipe.provenance import PACKAGE
from brownpipe.scene.reading import NAME
from brownpipe.storage.origin import read_origins
from brownpipe.tradeoff import is_tradeoff
from brownpipe.tradeoff.variables import COORDINATES, VARIABLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from xarray import DataArray, Dataset

    from brownpipe.scene import Scene

LABEL = re.compile(r"[ -#%-~]{1,200}")  # of engines, windows, models, ...: ASCII without $, by which formulae begin
NOTE_PARTICLES = 150  # of the 2020 note
P = ParamSpec("P")
R = TypeVar("R")
OF_DATASETS = {*ALL_VARIABLES, *ALL_COORDINATES, *VARIABLES, *COORDINATES}  # names of variables and coordinates
OF_DIMENSIONS = ALL_COORDINATES.keys() | COORDINATES.keys()
DIMENSIONS = {dim for variable in (*ALL_VARIABLES.values(), *VARIABLES.values()) for dim in variable.dims}
LONGEST_CAUSE = 120  # characters of another library's message within ours
MISSING_PART = "{}: is missing in the dataset; make it again"


def cases_of(dataset: Dataset) -> list[Dataset]:
    """Return every case that has runs, ordered by scene, particle count and engine."""
    labels = [(s, n, e) for s in dataset.scene.values for n in dataset.particles.values for e in dataset.engine.values]
    cases = [dataset.sel(scene=s, particles=n, engine=e) for s, n, e in labels]
    return [case for case in cases if int(case.runs) + int(case.failed_runs) > 0]


def of_whole_dataset(function: Callable[Concatenate[Dataset, P], R]) -> Callable[Concatenate[Dataset, P], R]:
    """Let a function of a dataset raise FigureError, not an error of a library, if the dataset is not as it was made.

    What is seen before the function is called: an empty dimension, one without its coordinate, in place of which xarray
    would count, and a coordinate whose values are not those of an axis. A missing variable or dimension is seen by the
    error that the function ends with. Any other error is given with its place in the source: it may come from a wrong
    value anywhere in the dataset.
    """

    @wraps(function)
    def naming(dataset: Dataset, *arguments: P.args, **options: P.kwargs) -> R:
        for name in sorted(DIMENSIONS.intersection(dataset.dims)):
            if dataset.sizes[name] == 0 or (name in OF_DIMENSIONS and name not in dataset.coords):
                raise FigureError(MISSING_PART.format(name))
            if name in dataset.coords:
                _check_axis(dataset[name])
        try:
            return function(dataset, *arguments, **options)
        except BrownpipeError:
            raise
        except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
            name = _missing_variable(dataset, error) or _missing_dimension(dataset)
            raise FigureError(_other_error(error) if name is None else MISSING_PART.format(name)) from error

    return naming


@contextmanager
def of_file(path: str | Path) -> Iterator[None]:
    """Put the name of the dataset's file before what it is refused for."""
    try:
        yield
    except (FigureError, RequestError) as error:
        raise type(error)(f"{path}: {error}") from error


def _check_axis(coordinate: DataArray) -> None:
    """Raise FigureError unless numbers are finite and increase along a coordinate, or labels differ."""
    values = coordinate.values
    if values.dtype.kind in "fiu":
        is_axis, allowed = np.isfinite(values).all() and (values[1:] > values[:-1]).all(), "increasing numbers"
    else:
        is_axis, allowed = len({*values.tolist()}) == len(values), "labels that differ"
    if not is_axis:
        raise FigureError(f"{coordinate.name}: must have {allowed} in the dataset; make it again")


def _other_error(error: Exception) -> str:
    """Return the message for an error that neither a missing variable nor a missing dimension explains."""
    *_, place = (frame for frame in extract_tb(error.__traceback__) if Path(frame.filename).is_relative_to(PACKAGE))
    cause = f"{type(error).__name__}: {str(error)[:LONGEST_CAUSE]}"
    return (
        f"{cause} ({Path(place.filename).relative_to(PACKAGE)}, line {place.lineno}); a value in the dataset may be "
        "wrong: make it again, and if the error remains, please report it"
    )


def _missing_variable(dataset: Dataset, error: Exception) -> str | None:
    """Return the variable whose lack caused an error; None for other errors.

    xarray's KeyError is a text that lists variables; the name alone is in the KeyError that caused it.
    """
    names: list[object] = [getattr(error, "name", None), *error.args, *getattr(error.__cause__, "args", ())]
    missing = OF_DATASETS.difference(dataset.variables)
    return next((name for name in names if isinstance(name, str) and name in missing), None)


def _missing_dimension(dataset: Dataset) -> str | None:
    """Return the first dimension that a variable lacks, as where one point of it was selected."""
    table = VARIABLES if is_tradeoff(dataset) else ALL_VARIABLES
    missing = set[str]()
    for name in table.keys() & dataset.variables.keys():
        missing.update(set(table[str(name)].dims).difference(map(str, dataset[name].dims)))
    return min(missing, default=None)


def check_names(dataset: Dataset) -> None:
    """Raise FigureError for a name that no scene, engine, window, ... has; names are in figures and names of files."""
    for dim, coordinate in dataset.coords.items():
        allowed = NAME if dim == "scene" else LABEL
        for name in coordinate.values.ravel() if coordinate.dtype.kind in "OSU" else ():
            if not allowed.fullmatch(str(name)):
                raise FigureError(f"{dim}: {str(name)[:80]!r} is no name that brownpipe gives; make the dataset again")


def has(case: Dataset, *names: str) -> bool:
    """Return whether the case has a finite value of every one of these variables."""
    return all(name in case and bool(np.isfinite(case[name].values).any()) for name in names)


def check_count(cases: list[Dataset], particles: int | None) -> None:
    """Raise FigureError for a requested particle count that no case has."""
    available = sorted({int(case.particles) for case in cases})
    if particles is not None and particles not in available:
        raise FigureError(f"particles: {particles} is not in the dataset; choose one of {available}")


def one_count(cases: list[Dataset], particles: int | None = None) -> list[Dataset]:
    """Return the cases with one particle count per scene: the requested one, or else the note's, or else the largest.

    A scene that lacks the requested count is left out.
    """
    selected = []
    for in_scene in _grouped(cases, lambda case: case.scene.item()).values():
        count = particles or shown_count([int(case.particles) for case in in_scene])
        selected += [case for case in in_scene if case.particles == count]
    return selected


def shown_count(counts: Sequence[int]) -> int:
    """Return which of the particle counts of a scene is shown: the note's, or else the largest."""
    return NOTE_PARTICLES if NOTE_PARTICLES in counts else max(counts)


def by_series(cases: list[Dataset]) -> dict[str, list[Dataset]]:
    """Group the cases that differ in particle count alone, under the name of their scene and engine."""
    return _grouped(cases, lambda case: case.scene.item() + _engine_suffix(case))


def _grouped(cases: list[Dataset], name: Callable[[Dataset], str]) -> dict[str, list[Dataset]]:
    """Group the cases by name; names and cases keep their order."""
    groups: dict[str, list[Dataset]] = {}
    for case in cases:
        groups.setdefault(name(case), []).append(case)
    return groups


def over_time(case: Dataset, name: str = "msd") -> Dataset:
    """Return the case at the times where it has a value of `name`: scenes of other durations leave gaps."""
    return defined(case, name, "time")


def defined(case: Dataset, name: str, dim: str) -> Dataset:
    """Return the case restricted along `dim` to the points where `name` has a value."""
    values: DataArray = np.isfinite(case[name])  # type: ignore[assignment]  # an array in NumPy's stubs
    kept = values.any([other for other in values.dims if other != dim]).values
    return case if kept.all() else case.isel({dim: kept})


def parts_of(case: Dataset, dim: str, name: str) -> list[Dataset]:
    """Return the case at each point along `dim`, such as each species, where it has a finite value of `name`."""
    parts = [case.isel({dim: k}) for k in range(case.sizes[dim])]
    return [part for part in parts if has(part, name)]


def distributions_of(case: Dataset) -> list[Dataset]:
    """Return the case at each time of its displacement distribution, with the rings used at that time."""
    at_times = parts_of(case, "displacement_time", "displacement_overflow")
    return [defined(at_time, "displacement_counts", "r") for at_time in at_times]


def at_last_distribution(case: Dataset) -> Dataset:
    """Return the case at the last time of its displacement distribution, or without one at the dataset's last."""
    return (distributions_of(case) or [case.isel(displacement_time=-1)])[-1]


def fits_of(case: Dataset) -> list[Dataset]:
    """Return the case at each fit window in which a line could be fitted to the MSD."""
    return parts_of(case, "window", "slope")


def title_of(case: Dataset) -> str:
    """Return scene, particle count and, unless it is the exact one, the label of the engine."""
    return f"{case.scene.item()}, N = {case.particles.item()}{_engine_suffix(case)}"


def _engine_suffix(case: Dataset) -> str:
    return "" if case.engine == "exact" else f", {case.engine.item()}"


def scene_of(case: Dataset) -> Scene | None:
    """Return the scene of a case, by the attributes of its dataset; None if they do not have it."""
    with suppress(StorageError):
        for origin in read_origins("", case.attrs):
            if origin.scene is not None and (origin.name, origin.scene.particles) == (case.scene, case.particles):
                return origin.scene
    return None


def plus_minus(value: SupportsFloat, error: SupportsFloat) -> str:
    """Return `0.974 ± 0.022`: the value rounded to the two leading digits of its standard error.

    Without a positive error return the value alone, and `-` if it is not finite.
    """
    value, error = float(value), float(error)
    if not np.isfinite(error) or error <= 0.0:
        return f"{value:.4g}" if np.isfinite(value) else "-"
    decimals = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"
