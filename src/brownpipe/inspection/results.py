"""A dataset in words: a table of its cases, or of its variables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.variables import EACH
from brownpipe.figures import tradeoff
from brownpipe.figures.summary import summary
from brownpipe.figures.tables import aligned
from brownpipe.inspection.lines import provenance
from brownpipe.provenance import made_with
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset


def describe_dataset(dataset: Dataset) -> list[str]:
    """Return the lines of the report on a dataset: its sizes, and what made it."""
    return [
        f"title        {dataset.attrs.get('title', '-')}",
        f"dimensions   {', '.join(f'{name} {size}' for name, size in dataset.sizes.items())}",
        f"variables    {len(dataset.data_vars)}; --variables lists them with units and meaning",
        *_health(dataset),
        *provenance(dataset.attrs, made_with("tradeoff" if is_tradeoff(dataset) else "aggregate")["source_digest"]),
    ]


def table(dataset: Dataset) -> list[str]:
    """Return the results of a dataset of `brownpipe aggregate` or `brownpipe tradeoff` as their summaries show them.

    Of any other dataset return the names of the variables.
    """
    if is_tradeoff(dataset):
        return tradeoff.summary(dataset).splitlines()
    return summary(dataset).splitlines() if set(EACH) <= set(dataset.dims) else [", ".join(map(str, dataset.data_vars))]


def _health(dataset: Dataset) -> list[str]:
    """Return the largest energy drift and overlap of all runs, failed ones included."""
    sizes = {name: np.abs(dataset[name].values) for name in ("energy_drift", "worst_overlap") if name in dataset}
    worst = {name: np.max(values[np.isfinite(values)], initial=0.0) for name, values in sizes.items()}
    words = (f"worst {name.removeprefix('worst_').replace('_', ' ')} {size:.2g}" for name, size in worst.items())
    return [f"health       {'; '.join(words)}"] if worst else []


def variables(dataset: Dataset) -> list[str]:
    """Return a table of the coordinates and variables of a dataset: dimensions, units and meaning."""
    rows: list[tuple[str, ...]] = [("variable", "dimensions", "units", "meaning")]
    for name in (*dataset.coords, *dataset.data_vars):
        variable = dataset[name]
        attributes = (str(variable.attrs.get(key, "-")) for key in ("units", "long_name"))
        rows.append((str(name), ", ".join(map(str, variable.dims)), *attributes))
    return aligned(list(zip(*rows, strict=True)))
