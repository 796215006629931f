"""The failed runs of a study, read from its dataset without loading the rest."""

from pathlib import Path

import numpy as np

from brownpipe.analysis.variables import EACH, FAILED, MISSING
from brownpipe.engines.exact import EXACT
from brownpipe.errors import WrongFileError
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.datasets import read_values


def failed_runs(path: str | Path) -> tuple[int, int, str]:
    """Return how many runs of a dataset failed, how many it has with those, and the cases and seeds in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe aggregate` with
    the labels of its runs.
    """
    values = read_values(path, (*EACH, "seed", "run_status"))
    status = values.get("run_status", np.zeros(0))
    if status.ndim != len(EACH) + 1:
        raise WrongFileError(f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate")
    failed, cases = status == FAILED, []
    for place in zip(*np.nonzero(failed.any(axis=-1)), strict=True):
        scene, particles, engine = (values[name][k] for name, k in zip(EACH, place, strict=True))
        name = f"{scene}, N = {particles}" + ("" if engine == EXACT.name else f", {engine}")
        cases.append(f"{name}: seeds {brief_seed_text(values['seed'][failed[place]])}")
    return int(np.count_nonzero(failed)), int(np.count_nonzero(status != MISSING)), "; ".join(cases)
