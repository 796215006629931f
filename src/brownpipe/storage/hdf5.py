"""HDF5 files as mappings from paths to nodes: encoding to bytes in memory, and decoding."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import h5py
import numpy as np

CHUNK_BYTES = 2**18
SCALE_ATTRIBUTES = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}  # how HDF5 itself stores dimension scales


class Node(NamedTuple):
    """A dataset or, if `value` is None, a group."""

    value: Any  # array, number or text
    attributes: dict
    dims: tuple[str, ...] = ()  # names of its scales, datasets in the same group; a scale is its own dimension
    chunk_axes: tuple[int, ...] | None = None  # order in which axes are filled by a chunk; None: the last axis first


class Link(NamedTuple):
    """A hard link: a second path of the dataset at `target`."""

    target: str


Nodes = dict[str, Node | Link]  # parents stand before their children


# -- encoding -------------------------------------------------------------------------------------------------------


def to_bytes(nodes: Mapping[str, Node | Link], compress: bool = True) -> bytes:
    """Return the bytes of an HDF5 file with these nodes. Equal nodes give equal bytes: no time stamps are stored."""
    with h5py.File.in_memory(block_size=2**20) as file:
        for path, node in nodes.items():
            _create(file, path, node, compress)
        for path, node in nodes.items():
            _attach_scales(file, path, node)
        file.flush()
        return file.id.get_file_image()


def _create(file: h5py.File, path: str, node: Node | Link, compress: bool) -> None:
    if isinstance(node, Link):
        file[path] = file[node.target]
        return
    if node.value is None:
        target = file.require_group(path)
    else:
        filters = _filters(node) if compress else {}
        target = file.create_dataset(path, data=node.value, track_times=False, **filters)
    for name, value in node.attributes.items():
        target.attrs[name] = value
    if _is_scale(path, node):
        target.make_scale()


def _filters(node: Node) -> dict:
    """Return the options of h5py for compression; none for scalars, empty arrays and text."""
    value = np.asarray(node.value)
    if value.ndim == 0 or value.size == 0 or value.dtype.kind in "OU":  # HDF5 cannot filter these
        return {}
    chunks = _chunks(value.shape, value.itemsize, node.chunk_axes or range(value.ndim)[::-1])
    return {"chunks": chunks, "compression": "gzip", "compression_opts": 4, "shuffle": True}


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
    """Return all nodes of an HDF5 file, given its bytes. Linked datasets appear at each of their paths."""
    with h5py.File.in_memory(image) as file:
        return dict(_nodes(file, ""))


def some_from_bytes(image: bytes, paths: Iterable[str]) -> dict[str, Node]:
    """Return the nodes of an HDF5 file at `paths`, as far as it has them, and the names in groups among them.

    Nothing else is decompressed. The value of a group is the tuple of these names.
    """
    with h5py.File.in_memory(image) as file:
        found = {path: file[path] for path in paths if path in file}
        return {
            path: _node(item)._replace(value=tuple(item)) if isinstance(item, h5py.Group) else _node(item)
            for path, item in found.items()
        }


def _nodes(group: h5py.Group, prefix: str) -> Iterator[tuple[str, Node]]:
    for name, item in group.items():
        yield prefix + name, _node(item)
        if isinstance(item, h5py.Group):
            yield from _nodes(item, f"{prefix}{name}/")


def _node(item: h5py.Group | h5py.Dataset) -> Node:
    attributes = {name: value for name, value in item.attrs.items() if name not in SCALE_ATTRIBUTES}
    if isinstance(item, h5py.Group):
        return Node(None, attributes)
    return Node(item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()], attributes)
