"""An HDF5 file as a plain mapping from path to node: made into bytes, read back, and summed up in one digest."""

import hashlib
import json
from typing import NamedTuple

import h5py
import numpy as np

CHUNK_BYTES = 2**18
SUMS = {"contents_digest", "seal"}  # attributes that sum up the rest
SCALE_ATTRIBUTES = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}  # how HDF5 itself stores dimension scales


class Node(NamedTuple):
    """A dataset, or a group if `value` is None. Its dimensions are named after the scales, its siblings."""

    value: np.ndarray | str | None
    attributes: dict
    dims: tuple = ()
    chunk_axes: tuple | None = None  # which axes a chunk spans first; default the last ones


class Link(NamedTuple):
    """A second name of the dataset at `target`."""

    target: str


def digest(nodes: dict) -> str:
    """The sha256 over all paths, types, shapes, values and attributes of a tree.

    Unlike the bytes of the file it does not depend on the versions of HDF5 and zlib.
    """
    total = hashlib.sha256()
    for path in sorted(nodes):
        node = nodes[path]
        while isinstance(node, Link):
            node = nodes[node.target]
        _add(total, path, node.value)
        for name in sorted(node.attributes.keys() - SUMS):
            _add(total, name, node.attributes[name])
    return total.hexdigest()


def _add(total, name, value):
    """Add a named value; lengths go in as well, so that no two trees give the same sequence of bytes."""
    array = np.asarray("group" if value is None else value)
    if array.dtype.kind in "OSTU":
        kind, data = "text", json.dumps(array.tolist(), default=bytes.decode).encode()
    else:
        kind, data = array.dtype.str, np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    total.update(json.dumps([name, kind, array.shape, len(data)]).encode())
    total.update(data)


def to_bytes(nodes: dict, compress: bool = True) -> bytes:
    """The bytes of the HDF5 file that holds `nodes`; parents come before children in the mapping."""
    with h5py.File.in_memory(block_size=2**20) as file:
        for path, node in nodes.items():
            _create(file, path, node, compress)
        for path, node in nodes.items():
            _attach_scales(file, path, node)
        file.flush()
        return file.id.get_file_image()


def _create(file, path, node, compress):
    if isinstance(node, Link):
        file[path] = file[node.target]
        return
    if node.value is None:
        target = file.require_group(path)
    else:
        target = file.create_dataset(path, data=node.value, track_times=False, **(_filters(node) if compress else {}))
    for name, value in node.attributes.items():
        target.attrs[name] = value
    if _is_scale(path, node):
        target.make_scale()


def _filters(node):
    value = np.asarray(node.value)
    if value.ndim == 0 or value.size == 0 or value.dtype.kind in "OU":  # HDF5 cannot filter these
        return {}
    chunks = _chunks(value.shape, value.itemsize, node.chunk_axes or range(value.ndim)[::-1])
    return {"chunks": chunks, "compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}


def _chunks(shape, itemsize, axes):
    chunks, left = [1] * len(shape), CHUNK_BYTES // itemsize
    for axis in axes:
        chunks[axis] = max(1, min(shape[axis], left))
        left //= chunks[axis]
    return tuple(chunks)


def _is_scale(path, node):
    return node.dims == (path.rpartition("/")[2],)


def _attach_scales(file, path, node):
    if isinstance(node, Link) or not node.dims or _is_scale(path, node):
        return
    dataset, folder = file[path], path.rpartition("/")[0]
    for axis, dim in enumerate(node.dims):
        dataset.dims[axis].attach_scale(file[f"{folder}/{dim}"])


def from_bytes(image: bytes) -> dict:
    """All nodes of an HDF5 file, given its bytes."""
    nodes = {}
    with h5py.File.in_memory(image) as file:
        _walk(file, "", nodes)
    return nodes


def some_from_bytes(image: bytes, paths) -> dict:
    """The nodes of an HDF5 file at `paths`, those that are there; nothing else is unpacked."""
    with h5py.File.in_memory(image) as file:
        return {path: Node(_value(file[path]), _attributes(file[path])) for path in paths if path in file}


def _walk(group, prefix, nodes):
    for name, item in group.items():
        nodes[prefix + name] = Node(_value(item), _attributes(item))
        if isinstance(item, h5py.Group):
            _walk(item, f"{prefix}{name}/", nodes)


def _value(item):
    if isinstance(item, h5py.Group):
        return None
    if h5py.check_string_dtype(item.dtype):
        return item.asstr()[()]
    return item[()]


def _attributes(item):
    return {name: item.attrs[name] for name in item.attrs if name not in SCALE_ATTRIBUTES}
