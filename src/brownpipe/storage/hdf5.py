"""HDF5 files as mappings from paths to nodes: encoding to bytes in memory, decoding, and a digest of all nodes."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import h5py
import numpy as np

from brownpipe.errors import refuse_lack_of_memory
from brownpipe.storage.admission import Contents, Items, opened

CHUNK_BYTES = 2**18
CHECKSUMS = {"contents_digest", "seal"}  # attributes that the digest leaves out
CHANGED = "HDF5 gives back other numbers than were written; check memory and the HDF5 library"
SCALE_ATTRIBUTES = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}  # how HDF5 itself stores dimension scales


class Node(NamedTuple):
    """A dataset or, if `value` is None, a group."""

    value: Any  # array, number or text
    attributes: dict
    dims: tuple[str, ...] = ()  # names of its scales, datasets in the same group; a scale is its own dimension
    chunk_axes: tuple[int, ...] | None = None  # order in which axes are filled by a chunk; None: the last axis first
    scale_name: str = ""  # what HDF5 stores as the name of a scale besides that of its dataset


class Link(NamedTuple):
    """A hard link: a second path of the dataset at `target`."""

    target: str


Nodes = dict[str, Node | Link]  # parents stand before their children


def digest(nodes: Mapping[str, Node | Link]) -> str:
    """Return the SHA-256 of all paths, types, shapes, values and attributes.

    Unlike the bytes of a file it does not depend on the versions of HDF5 and zlib.
    """
    total = hashlib.sha256()
    for path in sorted(nodes):
        node = nodes[path]
        while isinstance(node, Link):
            node = nodes[node.target]
        _add(total, path, node.value)
        for name in sorted(node.attributes.keys() - CHECKSUMS):
            _add(total, name, node.attributes[name])
    return total.hexdigest()


def _add(total: "hashlib._Hash", name: str, value: Any) -> None:
    """Add a named value to a hash, with its length, so that no two sets of nodes give the same sequence of bytes."""
    array = np.asarray("group" if value is None else value)
    data: bytes | memoryview
    if array.dtype.kind in "OSTU":
        kind, data = "text", json.dumps(array.tolist(), default=bytes.decode).encode()
    else:
        kind, data = array.dtype.str, np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    total.update(json.dumps([name, kind, array.shape, len(data)]).encode())
    total.update(data)


# -- encoding -------------------------------------------------------------------------------------------------------


def to_bytes(nodes: Mapping[str, Node | Link], compress: bool = True, track_order: bool = False) -> bytes:
    """Return the bytes of an HDF5 file with these nodes. Equal nodes give equal bytes: no time stamps are stored.

    With `track_order`, readers find nodes and attributes in the order given here, otherwise in that of their names.
    Raises MemoryError if the address space is limited to too little for another copy of all values.
    """
    refuse_lack_of_memory(sum(np.asarray(node.value).nbytes for node in nodes.values() if isinstance(node, Node)))
    with h5py.File.in_memory(block_size=2**20, track_order=track_order) as file:
        for path, node in nodes.items():
            _create(file, path, node, compress, track_order)
        for path, node in nodes.items():
            _attach_scales(file, path, node)
        file.flush()
        return file.id.get_file_image()


def _create(file: h5py.File, path: str, node: Node | Link, compress: bool, track_order: bool) -> None:
    if isinstance(node, Link):
        file[path] = file[node.target]
        return
    if node.value is None:
        target = file.require_group(path)
    else:
        filters = _filters(node) if compress else {}
        target = file.create_dataset(path, data=node.value, track_times=False, track_order=track_order, **filters)
    for name, value in node.attributes.items():
        target.attrs[name] = value
    if _is_scale(path, node):
        target.make_scale(node.scale_name)


def _filters(node: Node) -> dict:
    """Return the options of h5py for compression and checksums; none for scalars, empty arrays and text."""
    value = np.asarray(node.value)
    if value.ndim == 0 or value.size == 0 or value.dtype.kind in "OU":  # HDF5 cannot filter these
        return {}
    chunks = _chunks(value.shape, value.itemsize, node.chunk_axes or range(value.ndim)[::-1])
    return {"chunks": chunks, "compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}


def _chunks(shape: tuple[int, ...], itemsize: int, axes: Iterable[int]) -> tuple[int, ...]:
    """Return the shape of a chunk of at most CHUNK_BYTES that extends along the first of `axes` as far as it can."""
    chunks, items = [1] * len(shape), CHUNK_BYTES // itemsize
    for axis in axes:
        chunks[axis] = max(1, min(shape[axis], items))
        items //= chunks[axis]
    return tuple(chunks)


def _is_scale(path: str, node: Node) -> bool:
    """Return whether a dataset is a scale: its only dimension has its own name."""
    return node.dims == (path.rpartition("/")[2],)


def _attach_scales(file: h5py.File, path: str, node: Node | Link) -> None:
    """Name the dimensions of a dataset by its scales, which exist by now."""
    if isinstance(node, Link) or not node.dims or _is_scale(path, node):
        return
    dataset, group = file[path], path.rpartition("/")[0]
    for axis, dim in enumerate(node.dims):
        dataset.dims[axis].attach_scale(file[f"{group}/{dim}"])


# -- decoding -------------------------------------------------------------------------------------------------------


def from_bytes(image: bytes) -> dict[str, Node]:
    """Return all nodes of an HDF5 file, given its bytes. Linked datasets appear at each of their paths.

    Raises StorageError for anything that brownpipe does not write (`admission`).
    """
    with opened(image) as contents:
        return nodes_of(contents, contents.members())


def some_from_bytes(image: bytes, paths: tuple[str, ...]) -> dict[str, Node]:
    """Return the nodes of an HDF5 file at `paths`, as far as it has them; no other dataset is decompressed."""
    with opened(image) as contents:
        return nodes_of(contents, contents.some(paths))


def nodes_of(contents: Contents, items: Items) -> dict[str, Node]:
    """Return the nodes of admitted groups and datasets."""
    return {
        path: Node(contents.value(item), contents.attributes(item, SCALE_ATTRIBUTES)) for path, item in items.items()
    }
