"""The failed runs of a study, read from its dataset without loading the rest."""

from pathlib import Path

import numpy as np

from brownpipe.analysis.variables import EACH, FAILED, MISSING
from brownpipe.engines.exact import EXACT
from brownpipe.errors import WrongFileError
from brownpipe.scene.seeds import brief_seed_text
from brownpipe.storage.datasets import read_variable


def failed_runs(path: str | Path) -> tuple[int, int, str]:
    """Return how many runs of a dataset failed, how many it has with those, and the cases and seeds in words.

    Raises StorageError if the file is damaged, WrongFileError if it is no dataset of `brownpipe aggregate` with
    the labels of its runs.
    """
    labels, status = read_variable(path, "run_status")
    if not labels.keys() >= {*EACH, "seed"}:
        raise WrongFileError(f"{path}: has no runs with their labels; must be a dataset of brownpipe aggregate")
    failed, cases = status == FAILED, []
    for place in zip(*np.nonzero(failed.any(axis=-1)), strict=True):
        scene, *keys, particles, engine = ((name, labels[name][k]) for name, k in zip(labels, place, strict=False))
        words = [str(scene[1]), *(f"{name} = {value}" for name, value in keys), f"N = {particles[1]}"]
        words += [] if engine[1] == EXACT.name else [str(engine[1])]
        cases.append(f"{', '.join(words)}: seeds {brief_seed_text(labels['seed'][failed[place]])}")
    return int(np.count_nonzero(failed)), int(np.count_nonzero(status != MISSING)), "; ".join(cases)
