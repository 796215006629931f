"""A dataset in words: a table of its cases, or of its variables; and what a figure, page or movie was made from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.variables import EACH
from brownpipe.errors import WrongFileError
from brownpipe.figures import tradeoff
from brownpipe.figures.cases import aligned
from brownpipe.figures.origin import RECORD, installation_in_words, read_record
from brownpipe.figures.summary import summary
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

DIGITS = 12  # of a digest
PRODUCTS = (".png", ".svg", ".csv", ".txt", ".json", ".gif", ".html")  # of `brownpipe figures` and `movie`


def lines(dataset: Dataset) -> list[str]:
    """Return the lines of the report on a dataset: its sizes, and the largest errors of all runs, failed ones too."""
    sizes = {name: np.abs(dataset[name].values) for name in ("energy_drift", "worst_overlap") if name in dataset}
    worst = {name: np.max(values[np.isfinite(values)], initial=0.0) for name, values in sizes.items()}
    words = (f"worst {name.removeprefix('worst_').replace('_', ' ')} {size:.2g}" for name, size in worst.items())
    return [
        f"title        {dataset.attrs.get('title', '-')}",
        f"dimensions   {', '.join(f'{name} {size}' for name, size in dataset.sizes.items())}",
        f"variables    {len(dataset.data_vars)}; --variables lists them with units and meaning",
        *([f"health       {'; '.join(words)}"] if worst else []),
    ]


def table(dataset: Dataset) -> list[str]:
    """Return the results of a dataset of `brownpipe aggregate` or `brownpipe tradeoff` as their summaries show them.

    Of any other dataset return the names of the variables.
    """
    if is_tradeoff(dataset):
        return tradeoff.summary(dataset).splitlines()
    return summary(dataset).splitlines() if set(EACH) <= set(dataset.dims) else [", ".join(map(str, dataset.data_vars))]


def variables(dataset: Dataset) -> list[str]:
    """Return a table of the coordinates and variables of a dataset: dimensions, units and meaning."""
    rows: list[tuple[str, ...]] = [("variable", "dimensions", "units", "meaning")]
    for name in (*dataset.coords, *dataset.data_vars):
        variable = dataset[name]
        attributes = (str(variable.attrs.get(key, "-")) for key in ("units", "long_name"))
        rows.append((str(name), ", ".join(map(str, variable.dims)), *attributes))
    return aligned(list(zip(*rows, strict=True)))


def describe_product(path: str | Path) -> list[str]:
    """Return lines that say what made a figure, page or movie, and by which commands its runs are made again.

    Raises WrongFileError for a file that does not say what it was made from, or that cannot be read.
    """
    try:
        record = read_record(path)
    except OSError as error:
        raise WrongFileError(f"{path}: cannot be read: {error.strerror}") from error
    if record is None:
        raise WrongFileError(f"{path}: does not say what it was made from, and no {RECORD} beside it does")
    dataset = record.get("dataset", {})
    made = [f"dataset      {dataset['sha256'][:DIGITS]}"] if dataset else []
    runs = [*dataset.get("made_from", []), *record.get("made_from", [])]
    begin = f"{path}  made by {installation_in_words(record['made_by'])}"
    return [begin, *made, *(f"runs         {one['command']}" for one in runs)]
