"""Datasets: the results of an analysis, one netCDF4 (HDF5) file per study, in memory as xarray.Dataset."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.provenance import made_with, versions
from brownpipe.storage.files import BLANK_SEAL, read_sealed, seal, write_file

if TYPE_CHECKING:
    import xarray

FILTERS = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}


def made_by(step: str) -> dict[str, str]:
    """Return the attributes of a dataset that say with which source and versions a step of the pipeline makes it."""
    made = made_with(step)
    numbers = {"brownpipe_version": versions()["brownpipe_version"], "source_digest": made.pop("source")}
    return numbers | {f"{name}_version": version for name, version in made.items()}


def write_dataset(path: str | Path, dataset: "xarray.Dataset") -> None:
    """Write a dataset with its attributes; encodings left over from another file are dropped.

    Raises StorageError if the file cannot be written, or if netCDF decodes another dataset from its bytes.
    """
    image = seal(_to_bytes(dataset.assign_attrs(seal=BLANK_SEAL)))
    if not _from_bytes(image).equals(dataset):
        raise StorageError(f"{path}: not written: netCDF gives back another dataset; check its types")
    write_file(path, image)


def read_dataset(path: str | Path) -> "xarray.Dataset":
    """Return the dataset of a file, loaded into memory after its seal is verified.

    Raises StorageError, which says how to make the file again; WrongFileError if it does not exist or is no dataset.
    """
    try:
        return _from_bytes(read_sealed(path))
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except StorageError as error:
        raise StorageError(f"{path}: {error}; delete it and rerun snakemake, or rerun brownpipe aggregate") from error


def _to_bytes(dataset: "xarray.Dataset") -> bytes:
    """Return the bytes of the netCDF4 file; numbers are compressed and have checksums."""
    dataset = dataset.drop_encoding()
    encoding = {name: FILTERS for name, variable in dataset.variables.items() if _takes_filters(variable)}
    return bytes(dataset.to_netcdf(engine="h5netcdf", encoding=encoding))


def _takes_filters(variable: "xarray.Variable") -> bool:
    return bool(variable.size and variable.ndim and variable.dtype.kind in "biufc")


def _from_bytes(image: bytes) -> "xarray.Dataset":
    """Return the dataset without the seal among its attributes."""
    import xarray

    with xarray.open_dataset(io.BytesIO(image), engine="h5netcdf") as dataset:
        dataset = dataset.load().drop_encoding()
    if dataset.attrs.pop("seal", None) is None:
        raise WrongFileError("is a file of brownpipe, but not a dataset (of `brownpipe aggregate`)")
    return dataset
