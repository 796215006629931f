"""Arrays of single runs, for comparisons that take more than means and their errors, such as
covariances of times.
"""

from collections.abc import Iterable

import xarray as xr
from xarray import Dataset, DataTree


def single_runs(study: str, batches: Iterable[DataTree]) -> dict[str, Dataset]:
    """Return the runs of a study that did not fail, (seed, time, ...) for each scene, under
    STUDY/SCENE.
    """
    scenes: dict[str, list[Dataset]] = {}
    for batch in batches:
        runs = batch.to_dataset()
        scenes.setdefault(f"{study}/{runs.scene_name}", []).append(
            runs.isel(seed=runs.failed.values == 0)
        )
    return {
        name: xr.concat(runs, "seed", combine_attrs="override") for name, runs in scenes.items()
    }
