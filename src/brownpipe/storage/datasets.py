"""Datasets: the results of an analysis, one netCDF4 (HDF5) file per study, in memory as
xarray.Dataset.

A dataset says in its attributes what it was made from. `made_from` (JSON) has an entry for each
scene, number of disks and engine, with all that is needed to make its runs again. Nothing in it
depends on batches, folders, machines or users.
"""

import json
import platform
import subprocess
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from brownpipe.provenance import PACKAGE, made_with
from brownpipe.storage.files import DATASET, TRAJECTORIES, reading, writing
from brownpipe.storage.trajectories import SMALL, Trajectories, runs_record, trajectories_in

if TYPE_CHECKING:
    import xarray


def write_dataset(path: str | Path, dataset: "xarray.Dataset") -> None:
    """Write a dataset with its attributes; encodings left over from another file are dropped.

    Raises StorageError if the file cannot be written.
    """
    encoding = {}
    for name, variable in dataset.variables.items():
        if variable.nbytes > SMALL and variable.dtype.kind in "iuf":
            encoding[name] = {"zlib": True, "shuffle": True}
    with writing(path, LookupCachingFile, track_order=True) as file:  # netCDF4 wants the order
        dataset.drop_encoding().to_netcdf(file, engine="h5netcdf", encoding=encoding)


def read_dataset(path: str | Path) -> "xarray.Dataset":
    """Return the dataset of a file, loaded into memory after its seal is verified.

    Raises StorageError, which says how to make the file again; WrongFileError if it does not exist
    or is no dataset.
    """
    with reading(path, DATASET) as file:
        return _dataset_in(file)


def read_contents(path: str | Path) -> "Trajectories | xarray.Dataset":
    """Return the contents of a trajectory file or a dataset; errors as in `read_dataset`."""
    with reading(path, TRAJECTORIES, DATASET) as file:
        return trajectories_in(file) if TRAJECTORIES in file.attrs else _dataset_in(file)


class LookupCachingFile(h5py.File):
    """An HDF5 file without groups: h5netcdf looks up each array some fifty times, half of the CPU
    time.

    While it is written it is its own root group, and so knows of arrays that h5netcdf deletes, to
    write others there: `file["/"]["time"]` is `file["time"]`.
    """

    def __getitem__(self, name: str) -> h5py.Group | h5py.Dataset:
        items = self.__dict__.setdefault("items_by_name", {} if self.mode == "r" else {"/": self})
        if name not in items:
            items[name] = super().__getitem__(name)
        return items[name]

    def __delitem__(self, name: str) -> None:
        self.__dict__.pop("items_by_name", None)
        super().__delitem__(name)


def _dataset_in(file: h5py.File) -> "xarray.Dataset":
    import xarray

    return xarray.load_dataset(LookupCachingFile(file.id), engine="h5netcdf").drop_encoding()


# -- what a dataset was made from ------------------------------------------------------------------


def origin_attributes(
    step: str, runs: Iterable[tuple[Trajectories, np.ndarray]], options: Mapping[str, object]
) -> dict[str, str]:
    """Return the attributes of a dataset that say how a step of the pipeline makes it again.

    runs: of each scene, number of disks and engine the contents of one of its files, and all its
    seeds (S,).
    """
    records = [runs_record(contents, seeds) for contents, seeds in runs]
    origin: dict[str, object] = {"options": options, "made_from": records}
    texts = {
        name: json.dumps(value, sort_keys=True, allow_nan=False) for name, value in origin.items()
    }
    return made_by(step) | texts


@cache
def made_by(step: str) -> dict[str, str]:
    """Return the source, versions, Python and commit with which a step makes its output."""
    return made_with(step) | {"python": platform.python_version(), "git_commit": commit_of(PACKAGE)}


def commit_of(package: Path) -> str:
    """Return the commit of the checkout that a package lies in; empty if it is installed, or if git
    does not answer.

    That of a checkout with modified files ends with `, modified`.
    """
    folder = package.parents[1]
    command = ["git", f"--git-dir={folder}/.git", f"--work-tree={folder}", "describe"]
    command += ["--always", "--abbrev=40", "--exclude=*", "--dirty=, modified"]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return ""
