"""The failed runs of a study, read from its dataset without loading the rest."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from brownpipe.analysis.variables import EACH, FAILED, MISSING
from brownpipe.engines.exact import EXACT
from brownpipe.errors import WrongFileError
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.datasets import read_values


class FailedRuns(NamedTuple):
    """The failed runs of all cases of a dataset."""

    failed: int
    runs: int  # with those that failed
    cases: str  # their cases and seeds


def failed_runs(path: str | Path) -> FailedRuns:
    """Return how many runs of a dataset failed, and their cases and seeds in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe aggregate` with
    the labels of its runs.
    """
    values = read_values(path, (*EACH, "seed", "run_status"))
    if np.ndim(values.get("run_status", 0)) != len(EACH) + 1:
        raise WrongFileError(f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate")
    status = values["run_status"]
    failed = int(np.count_nonzero(status == FAILED))
    return FailedRuns(failed, int(np.count_nonzero(status != MISSING)), "; ".join(_cases(values)))


def _cases(values: dict[str, np.ndarray]) -> Iterator[str]:
    """Yield the name and the seeds of each case with failed runs."""
    seeds, status = values["seed"], values["run_status"]
    for place in product(*map(range, status.shape[:-1])):
        failed = seeds[status[place] == FAILED]
        if failed.size:
            scene, particles, engine = (values[name][k] for name, k in zip(EACH, place, strict=True))
            name = f"{scene}, N = {particles}" + ("" if engine == EXACT.name else f", {engine}")
            yield f"{name}: seeds {brief_seed_text(failed)}"
