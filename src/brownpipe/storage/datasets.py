"""Datasets: the results of an analysis, one netCDF4 (HDF5) file per study, in memory as xarray.Dataset.

A dataset says in its attributes what it was made from. `made_from` (JSON) has an entry for each scene, number of disks
and engine, with all that is needed to make its runs again. Nothing in it depends on batches, folders, machines or
users.
"""

import io
import json
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from brownpipe.errors import WrongFileError
from brownpipe.provenance import NAME, PACKAGE, made_with
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.trajectories import SMALL, Trajectories, runs_record

if TYPE_CHECKING:
    import xarray

CHECKPOINT = "is the checkpoint of unfinished runs; repeat the command that wrote it, and they continue from there"


def write_dataset(path: str | Path, dataset: "xarray.Dataset") -> None:
    """Write a dataset with its attributes; encodings left over from another file are dropped.

    Raises StorageError if the file cannot be written.
    """
    large = [name for name, variable in dataset.variables.items() if variable.nbytes > SMALL]
    encoding = {name: {"zlib": True, "shuffle": True} for name in large if dataset[name].dtype.kind in "iuf"}
    image = dataset.drop_encoding().to_netcdf(engine="h5netcdf", encoding=encoding)
    write_file(path, sealed(bytes(image)))


def read_dataset(path: str | Path) -> "xarray.Dataset":
    """Return the dataset of a file, loaded into memory after its seal is verified.

    Raises StorageError, which says how to make the file again; WrongFileError if it does not exist or is no dataset.
    """
    with naming(path, "aggregate"):
        return dataset_in(read_sealed(path))


def dataset_in(image: bytes) -> "xarray.Dataset":
    """Return the dataset in the bytes of a file. Raises WrongFileError for another file of brownpipe."""
    import xarray

    with h5py.File.in_memory(image) as file:
        if "checkpoint" in file.attrs:
            raise WrongFileError(CHECKPOINT)
        if "runs_digest" in file.attrs:
            raise WrongFileError("is a file of brownpipe, but not a dataset (of `brownpipe aggregate`)")
    with xarray.open_dataset(io.BytesIO(image), engine="h5netcdf") as dataset:
        return dataset.load().drop_encoding()


# -- what a dataset was made from -----------------------------------------------------------------------------------


def origin_attributes(step: str, runs: Iterable[tuple[Trajectories, np.ndarray]], options: dict) -> dict[str, str]:
    """Return the attributes of a dataset that say how a step of the pipeline makes it again.

    runs: of each scene, number of disks and engine the contents of one of its files, and all its seeds (S,).
    """
    records = [runs_record(contents, seeds) for contents, seeds in runs]
    told = {"options": options, "made_from": records}
    return made_by(step) | {name: json.dumps(one, sort_keys=True, allow_nan=False) for name, one in told.items()}


@cache
def made_by(step: str) -> dict[str, str]:
    """Return the source, versions and Python with which a step makes its output, and the commit of a git checkout.

    The commit of a checkout with modified files ends with `, modified`.
    """
    commit = commit_of(PACKAGE)
    python = {"python": sys.version.partition(" ")[0]}
    return made_with(step) | python | ({"git_commit": commit} if commit else {})


def commit_of(package: Path) -> str | None:
    """Return the commit of the checkout that a package lies in; None if it is installed, or if git does not answer."""
    checkout = package.parents[1]
    if package != checkout / "src" / NAME or not (checkout / ".git").exists():
        return None
    command = ["git", "-C", str(checkout), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=, modified"]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return None
