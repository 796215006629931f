"""A dataset in words: a table of its cases, or of its variables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.variables import EACH
from brownpipe.figures import tradeoff
from brownpipe.figures.cases import cases_of, has
from brownpipe.figures.summary import drifting, estimates_of, heading_of_msd, legend_of_estimates, missing_runs
from brownpipe.figures.tables import aligned
from brownpipe.inspection.lines import provenance, worst
from brownpipe.provenance import made_with
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

SHOWN_HEALTH = {"energy_drift": "worst energy drift", "worst_overlap": "worst overlap"}  # columns of the table


def describe_dataset(dataset: Dataset) -> list[str]:
    """Return the lines of the report on a dataset: its sizes, and what made it."""
    return [
        f"title        {dataset.attrs.get('title', '-')}",
        f"dimensions   {', '.join(f'{name} {size}' for name, size in dataset.sizes.items())}",
        f"variables    {len(dataset.data_vars)}; --variables lists them with units and meaning",
        *provenance(dataset.attrs, made_with("tradeoff" if is_tradeoff(dataset) else "aggregate")["source_digest"]),
    ]


def table(dataset: Dataset) -> list[str]:
    """Return the results of a dataset of `brownpipe aggregate` or `brownpipe tradeoff`, each kind in its own table.

    Of any other dataset return the names of the variables.
    """
    if is_tradeoff(dataset):
        return tradeoff.summary(dataset).splitlines()
    return list(_of_cases(dataset)) if set(EACH) <= set(dataset.dims) else [", ".join(map(str, dataset.data_vars))]


def _of_cases(dataset: Dataset) -> Iterator[str]:
    """Yield a table with a line for each scene, particle count and engine, its legend, and the seeds that are missing.

    The estimates are those of the summary; health is that of all runs, failed ones included.
    """
    cases = cases_of(dataset)
    diffusion = f"D, t in {dataset.window.values[0]}"
    header = ("scene", "N", "engine", "runs", "failed", heading_of_msd(cases), diffusion, *SHOWN_HEALTH.values())
    yield from aligned(list(zip(header, *map(_row, cases), strict=True)))
    yield from legend_of_estimates(dataset)
    yield from missing_runs(cases)
    yield from drifting(cases)


def _row(case: Dataset) -> tuple[str, ...]:
    """One line of the table, cell by cell."""
    label = (str(case[name].item()) for name in EACH)
    counts = (str(int(case[name])) for name in ("runs", "failed_runs"))
    return (*label, *counts, *estimates_of(case), *(_worst(case, name) for name in SHOWN_HEALTH))


def _worst(case: Dataset, name: str) -> str:
    """The largest absolute value over the runs that have one, with its seed."""
    if not has(case, name):
        return "-"
    finite = np.isfinite(case[name].values)
    return worst(case[name].values[finite], case.seed.values[finite])


def variables(dataset: Dataset) -> list[str]:
    """Return a table of the coordinates and variables of a dataset: dimensions, units and meaning."""
    rows: list[tuple[str, ...]] = [("variable", "dimensions", "units", "meaning")]
    for name in (*dataset.coords, *dataset.data_vars):
        variable = dataset[name]
        attributes = (str(variable.attrs.get(key, "-")) for key in ("units", "long_name"))
        rows.append((str(name), ", ".join(map(str, variable.dims)), *attributes))
    return aligned(list(zip(*rows, strict=True)))
