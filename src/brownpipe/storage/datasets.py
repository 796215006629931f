"""Datasets: the results of an analysis, one netCDF4 (HDF5) file per study, in memory as xarray.Dataset."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.provenance import made_with, versions
from brownpipe.storage.admission import Contents, opened
from brownpipe.storage.files import BLANK_SEAL, PREFIX, SEAL, naming, read_sealed, seal, write_file
from brownpipe.storage.hdf5 import SCALE_ATTRIBUTES, Node, nodes_of, to_bytes
from brownpipe.storage.origin import installation

if TYPE_CHECKING:
    import xarray

NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."  # the name of its scale begins with this
CHECKPOINT = "is the checkpoint of unfinished runs; repeat the command that wrote it, and they continue from there"
MOST_VARIABLES = 1000  # of a dataset; the analysis makes some 150
MOST_DECLARED, MOST_COMPRESSED = 2**28, 16  # bytes of all variables, and more for each byte of the file
NETCDF_ATTRIBUTES = {"_NCProperties", "_Netcdf4Coordinates", "_Netcdf4Dimid"}  # of files written by netCDF libraries


def made_by(step: str) -> dict[str, str]:
    """Return the attributes that say with which source, versions and commit a step of the pipeline makes its output."""
    made = made_with(step)
    numbers = {"brownpipe_version": versions()["brownpipe_version"], "source_digest": made.pop("source")}
    return numbers | {f"{name}_version": version for name, version in made.items()} | installation()


def write_dataset(path: str | Path, dataset: "xarray.Dataset") -> None:
    """Write a dataset with its attributes; encodings left over from another file are dropped.

    Raises StorageError if the file cannot be written, or if another dataset is decoded from its bytes.
    """
    image = seal(_to_bytes(dataset.assign_attrs(seal=BLANK_SEAL)))
    if not _from_bytes(image).equals(dataset):
        raise StorageError(f"{path}: not written: netCDF gives back another dataset; check its types")
    write_file(path, image)


def seal_of(path: str | Path) -> str:
    """Return the SHA-256 that a sealed file states of itself, without verifying it; errors as of `read_dataset`."""
    found = SEAL.search(Path(path).read_bytes())
    return found.group().decode().removeprefix(PREFIX) if found else ""


def read_dataset(path: str | Path) -> "xarray.Dataset":
    """Return the dataset of a file, loaded into memory after its seal is verified.

    Raises StorageError, which says how to make the file again; WrongFileError if it does not exist or is no dataset.
    """
    with naming(path, _remedy):
        return _from_bytes(read_sealed(path))


def read_values(path: str | Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return the values of the named variables that a dataset has, after verifying its seal; nothing else is read.

    Raises StorageError and WrongFileError like `read_dataset`.
    """
    with naming(path, _remedy), opened(read_sealed(path)) as contents:
        present = tuple(name for name in names if not _is_without_coordinates(contents.file, name))
        return {name: node.value for name, node in nodes_of(contents, contents.some(present)).items()}


def _remedy(path: str | Path) -> str:
    """Return how to make a damaged file again, if it is one of brownpipe: other programs write netCDF, too."""
    again = "delete it and run the study, brownpipe aggregate or brownpipe tradeoff again"
    try:
        return again if seal_of(path) else f"if brownpipe wrote it, {again}"
    except OSError:
        return "check that it is there and can be read"


def _to_bytes(dataset: "xarray.Dataset") -> bytes:
    """Return the bytes of the netCDF4 file: HDF5 with a scale for each dimension, and xarray's CF conventions.

    The project's own encoder writes it: the libraries for netCDF look up every scale by its path for each variable,
    which takes five times as long.
    """
    from xarray import conventions

    variables, attributes = conventions.cf_encoder(*conventions.encode_dataset_coordinates(dataset.drop_encoding()))
    nodes = {"/": Node(None, _one_dimensional(attributes))}
    for name, variable in variables.items():
        values = variable.values.astype(h5py.string_dtype()) if variable.dtype.kind in "OU" else variable.values
        nodes[name] = Node(values, _one_dimensional(variable.attrs), variable.dims, scale_name=name)
    for dim, size in dataset.sizes.items():
        if dim not in variables:
            nodes[f"{dim}"] = Node(np.zeros(size, np.float32), {}, (f"{dim}",), scale_name=f"{NO_VARIABLE}{size:10}")
    return to_bytes(nodes, track_order=True)


def _one_dimensional(attributes: dict) -> dict:
    """Return attributes with arrays of one element for numbers: netCDF has no others."""
    return {name: value if isinstance(value, str) else np.atleast_1d(value) for name, value in attributes.items()}


def _from_bytes(image: bytes) -> "xarray.Dataset":
    """Return the dataset without the seal among its attributes."""
    import xarray

    with opened(image) as contents:
        attributes = _attributes(contents, contents.file)
        if attributes.pop("seal", None) is None:
            other = "is a file of brownpipe, but not a dataset (of `brownpipe aggregate`)"
            raise WrongFileError(CHECKPOINT if "checkpoint" in contents.file else other)
        if len(contents.file) > MOST_VARIABLES:
            raise StorageError(f"has {len(contents.file)} variables; must have at most {MOST_VARIABLES}")
        names = tuple(name for name in contents.file if not _is_without_coordinates(contents.file, name))
        items = contents.some(names)
        if not all(isinstance(item, h5py.Dataset) for item in items.values()):  # HDF5 would search them for scales
            raise StorageError("has groups, which no dataset has")
        if sum(contents.admitted.values()) > MOST_DECLARED + MOST_COMPRESSED * len(image):
            raise StorageError("declares more data than a dataset has")
        paths: dict[int, str] = {}
        variables = {name: _variable(contents, item, paths) for name, item in items.items()}
        return xarray.decode_cf(xarray.Dataset(variables, attrs=attributes)).drop_encoding()


def _variable(contents: Contents, item: h5py.Dataset, paths: dict[int, str]) -> "xarray.Variable":
    """Return a variable as it is encoded in the file; `paths` as in `_scales`."""
    import xarray

    scales = [item.name] if item.is_scale else _scales(contents.file, item, paths)
    encoding = {"dtype": str} if h5py.check_string_dtype(item.dtype) else {}
    dims = [path.removeprefix("/") for path in scales]
    return xarray.Variable(dims, contents.value(item), _attributes(contents, item), encoding)


def _scales(file: h5py.File, item: h5py.Dataset, paths: dict[int, str]) -> list[str]:
    """Return the paths of the scales of a dataset. (HDF5's own function crashes if their list is of another type.)

    HDF5 searches the whole file for a path: `paths` keeps those found before, by the addresses of the scales.
    """
    if item.ndim == 0:
        return []
    attribute = h5py.h5a.open(item.id, b"DIMENSION_LIST")
    kind = h5py.check_vlen_dtype(attribute.dtype)
    if kind is None or h5py.check_ref_dtype(kind) is not h5py.Reference or attribute.shape != (item.ndim,):
        raise StorageError(f"has no list of dimensions ({item.name})")
    references = [scales[0] for scales in item.attrs["DIMENSION_LIST"]]
    addresses = [h5py.h5o.get_info(h5py.h5r.dereference(one, file.id)).addr for one in references]
    if len({*addresses}) < len(addresses):  # xarray would warn only
        raise StorageError(f"has a variable with the same dimension twice ({item.name})")
    for address, reference in zip(addresses, references, strict=True):
        if address not in paths:
            paths[address] = file[reference].name
    return [paths[address] for address in addresses]


def _is_without_coordinates(file: h5py.File, name: str) -> bool:
    """Return whether a dataset only stands for a dimension."""
    item = file.get(name) if file.get(name, getclass=True, getlink=True) is h5py.HardLink else None
    return isinstance(item, h5py.Dataset) and item.is_scale and item.attrs["NAME"].startswith(NO_VARIABLE.encode())


def _attributes(contents: Contents, item: h5py.Group | h5py.Dataset) -> dict:
    """Return the attributes that describe the contents; a number for an array of one element, as xarray does."""
    found = contents.attributes(item, SCALE_ATTRIBUTES | NETCDF_ATTRIBUTES)
    return {name: value[0] if np.shape(value) == (1,) else value for name, value in found.items()}
