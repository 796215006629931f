"""The labels of the cases of a dataset: dimensions over keys of the scenes that were varied, and failed runs."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.analysis.variables import EACH, FAILED, MISSING
from brownpipe.engines.exact import EXACT
from brownpipe.errors import WrongFileError
from brownpipe.scene import Scene
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.scene.variation import short_name, unit_of, value_of
from brownpipe.storage.datasets import read_dataset

if TYPE_CHECKING:
    from xarray import Dataset

VARIED = "varied"  # attribute of a dataset: the names of these dimensions


def labels_of_cases(dataset: "Dataset") -> list[str]:
    """Return the dimensions whose coordinates tell the cases of a dataset apart: scene, varied keys, count, engine."""
    return [EACH[0], *str(dataset.attrs.get(VARIED, "")).split(), *EACH[1:]]


def over_keys(dataset: "Dataset", scenes: Iterable[Scene], paths: Sequence[str], together: bool) -> "Dataset":
    """Return a dataset with a dimension for each varied key in place of one scene for each of their combinations.

    With `together`, keys beyond the first are coordinates along the dimension of the first. A variable with the name of
    a key, such as the packing fraction, is the coordinate then.
    """
    import pandas as pd
    import xarray

    if not paths:
        return dataset
    by_name = {scene.name: scene for scene in scenes}
    of_scenes = [by_name[name] for name in dataset.scene.values.tolist()]
    values = {short_name(path): [value_of(scene, path) for scene in of_scenes] for path in paths}
    dims = [*values][: 1 if together else None]
    columns = [[scene.name.partition(",")[0] for scene in of_scenes], *(values[dim] for dim in dims)]
    index = pd.MultiIndex.from_arrays(columns, names=["file", *dims])
    order = {dim: list(dict.fromkeys(column)) for dim, column in zip(index.names, columns, strict=True)}
    single = dataset.drop_vars([EACH[0], *values], errors="ignore")
    indexed = single.assign_coords(xarray.Coordinates.from_pandas_multiindex(index, EACH[0]))
    spread = indexed.unstack(EACH[0]).reindex(order).rename(file=EACH[0])
    further = {
        name: (dims[0], list(dict(zip(values[dims[0]], column, strict=True)).values()))
        for name, column in values.items()
        if name not in dims
    }
    spread = spread.assign_coords(further).assign_attrs({VARIED: " ".join(dims)})
    for path in paths:
        spread[short_name(path)].attrs = {"units": unit_of(path), "long_name": path}
    return spread.transpose(EACH[0], *dims, *EACH[1:], ...)


def failed_runs(path: str | Path) -> tuple[int, int, str]:
    """Return how many runs of a dataset failed, how many it has with those, and the cases and seeds in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe aggregate` with the
    labels of its runs.
    """
    status = read_dataset(path).get("run_status")
    if status is None or not {*EACH, "seed"} <= set(status.dims):
        raise WrongFileError(f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate")
    cases = []
    for place in zip(*np.nonzero((status == FAILED).any("seed").values), strict=True):
        case = status[place]
        scene, *keys, particles, engine = ((dim, case[dim].item()) for dim in status.dims if dim != "seed")
        words = [scene[1], *(f"{name} = {value}" for name, value in keys), f"N = {particles[1]}"]
        words += [] if engine[1] == EXACT.name else [engine[1]]
        cases.append(f"{', '.join(words)}: seeds {brief_seed_text(case.seed.values[case.values == FAILED])}")
    return int((status == FAILED).sum()), int((status != MISSING).sum()), "; ".join(cases)
