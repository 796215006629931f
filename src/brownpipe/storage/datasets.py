"""Datasets: the results of an analysis, one netCDF4 (HDF5) file per study, in memory as xarray.Dataset."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from brownpipe.errors import WrongFileError
from brownpipe.storage.files import naming, read_sealed, sealed, write_file
from brownpipe.storage.trajectories import SMALL, values_of

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


def read_variable(path: str | Path, name: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the coordinates of a variable along its dimensions, in order, and its values; nothing if it is not there.

    Nothing else is read. Raises StorageError and WrongFileError like `read_dataset`.
    """
    with naming(path, "aggregate"), h5py.File.in_memory(read_sealed(path)) as file:
        if name not in file:
            return {}, np.zeros(0)
        along = [dim[0] for dim in file[name].dims]
        return {scale.name.strip("/"): values_of(scale) for scale in along}, values_of(file[name])
