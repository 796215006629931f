"""Datasets: what an analysis found, one netCDF4 (HDF5) file per study, for xarray."""

import io

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.storage.files import BLANK_SEAL, read_sealed, seal, write_file

FILTERS = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}


def write_dataset(path, dataset):
    """Write an xarray.Dataset; its attributes stay as given, encodings left from another file are dropped.

    Raises StorageError if the file cannot be written or does not read back as what was given.
    """
    image = seal(_to_bytes(dataset.assign_attrs(seal=BLANK_SEAL)))
    if not _from_bytes(image).equals(dataset):
        raise StorageError(f"{path}: not written: netCDF gives back another dataset; check its types")
    write_file(path, image)


def read_dataset(path):
    """The xarray.Dataset in the file at `path`, in memory, after every byte is verified.

    Raises StorageError naming the file and how to make it again, WrongFileError if it is another file or none.
    """
    try:
        return _from_bytes(read_sealed(path))
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except StorageError as error:
        raise StorageError(f"{path}: {error}; delete it and rerun snakemake, or rerun brownpipe aggregate") from error


def _to_bytes(dataset):
    dataset = dataset.drop_encoding()
    encoding = {name: FILTERS for name, variable in dataset.variables.items() if _takes_filters(variable)}
    return bytes(dataset.to_netcdf(engine="h5netcdf", encoding=encoding))


def _takes_filters(variable):
    return variable.size and variable.ndim and variable.dtype.kind in "biufc"


def _from_bytes(image):
    import xarray

    with xarray.open_dataset(io.BytesIO(image), engine="h5netcdf") as dataset:
        dataset = dataset.load().drop_encoding()
    if dataset.attrs.pop("seal", None) is None:
        raise WrongFileError("is a file of brownpipe, but not a dataset (of `brownpipe aggregate`)")
    return dataset
