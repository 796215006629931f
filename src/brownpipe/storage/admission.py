"""What is decoded of an HDF5 file that anybody may have made: seal and digest are no secret, and bugs can set them.

Every object is checked before it is read. Only what brownpipe writes is admitted: hard links without cycles, numbers
and text, the filters gzip, shuffle and fletcher32. Soft and external links, external storage, virtual datasets and
filters from plugins would read other files or run other code; references and further types have no use here. All values
of a dataset must be stored, and the stored bytes must suffice for its size, so that no small file fills the memory.
"""

import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np

from brownpipe.errors import BrownpipeError, StorageError, WrongFileError, ran_out_of_memory, refuse_lack_of_memory

DEEPEST = 10  # levels of groups; a trajectory file has 4
MOST_EXPANSION = 1100  # of gzip: 1032, at most
SLACK = 2**20  # bytes of a dataset that need not be accounted for
LARGE_CHUNK = 2**18 + 2**10  # stored bytes; a chunk of brownpipe is smaller, and a larger one is decoded with a limit
FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
LAYOUTS = {h5py.h5d.COMPACT, h5py.h5d.CONTIGUOUS, h5py.h5d.CHUNKED}
LARGEST_NUMBER = 8  # bytes
MOST_TEXTS, MOST_TEXTS_OF_ATTRIBUTE = 2**20, 16
TEXT_AT_ONCE = 2**26  # bytes of text that may be decoded without counting
MALFORMED = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError)
Items = dict[str, h5py.Group | h5py.Dataset]  # by path


class Contents:
    """An open HDF5 file, and how many bytes may still be decoded from it."""

    def __init__(self, file: h5py.File, size: int) -> None:
        self.file = file
        self.size = size  # of the file
        self.stored = size  # bytes of datasets, each at a place of its own
        self.repeated = 8 * size + 64 * SLACK  # bytes of datasets at a second path
        self.text = 2 * size + SLACK  # characters; the scene is read twice
        self.admitted: dict[int, int] = {}  # bytes of a dataset, by its address

    def members(self) -> Items:
        """Return all groups and datasets by their paths, each admitted."""
        found: Items = {}
        self._collect(self.file, "", found, {address_of(self.file)})
        return found

    def _collect(self, group: h5py.Group, prefix: str, found: Items, groups: set[int]) -> None:
        for name in group:
            item = _linked(group, name)
            found[prefix + name] = item
            if isinstance(item, h5py.Dataset):
                self._admit(item)
            else:
                if address_of(item) in groups or prefix.count("/") >= DEEPEST:
                    raise StorageError(f"has groups in a cycle or too deep ({name})")
                groups.add(address_of(item))
                self._collect(item, f"{prefix}{name}/", found, groups)

    def some(self, paths: tuple[str, ...]) -> Items:
        """Return the groups and datasets at these paths, as far as the file has them, each admitted."""
        found: Items = {}
        for path in paths:
            item: Any = self.file
            for name in path.split("/"):
                item = _linked(item, name) if isinstance(item, h5py.Group) and name in item else None
            if item is not None:
                found[path] = item
                if isinstance(item, h5py.Dataset):
                    self._admit(item)
        return found

    def _admit(self, item: h5py.Dataset) -> None:
        """Raise StorageError for a dataset that must not be read."""
        address = address_of(item)
        if address in self.admitted:
            self.repeated -= self.admitted[address]
        else:
            self.admitted[address], stored = _sizes(item, self.size)
            self.stored -= stored
        if self.stored < 0 or self.repeated < 0:
            raise StorageError(f"declares more data than it stores ({item.name})")

    def value(self, item: h5py.Group | h5py.Dataset) -> Any:
        """Return the array, number or text of an admitted dataset, None for a group."""
        if isinstance(item, h5py.Group):
            return None
        if not h5py.check_string_dtype(item.dtype):
            return item[()]
        if item.size > min(MOST_TEXTS, self.size):
            raise StorageError(f"has too many texts ({item.name})")
        texts = item.asstr()
        if item.size * self.size <= TEXT_AT_ONCE or item.shape == ():
            values = texts[()]
            self._count_text(item.name, values)
            return values
        values = np.empty(item.shape, object)  # one by one, as all of them may be the same stored text
        for index in np.ndindex(item.shape):
            values[index] = texts[index]
            self._count_text(item.name, values[index])
        return values

    def attributes(self, item: h5py.Group | h5py.Dataset, left_out: set[str]) -> dict[str, Any]:
        """Return the attributes of a group or dataset except those in `left_out`."""
        found = {}
        for name in (name for name in item.attrs if name not in left_out):
            _refuse_attribute(item, name)
            found[name] = item.attrs[name]
            self._count_text(name, found[name])
        return found

    def _count_text(self, name: str, value: Any) -> None:
        """Count decoded text; raise StorageError for more than the file stores, as one text may be read many times."""
        texts = value.ravel().tolist() if isinstance(value, np.ndarray) and value.dtype.kind in "OSU" else [value]
        self.text -= sum(len(text) for text in texts if isinstance(text, str | bytes))
        if self.text < 0:
            raise StorageError(f"declares more text than it stores ({name})")


@contextmanager
def opened(image: bytes) -> Iterator[Contents]:
    """Open the bytes of an HDF5 file. Whatever cannot be decoded or understood raises StorageError."""
    refuse_lack_of_memory(2 * len(image))
    with understood(), h5py.File.in_memory(image) as file:
        yield Contents(file, len(image))


@contextmanager
def understood() -> Iterator[None]:
    """Raise StorageError where contents that were sealed are not those of a file of brownpipe."""
    try:
        yield
    except BrownpipeError:
        raise
    except MemoryError:
        raise WrongFileError("does not fit into memory") from None
    except MALFORMED as error:
        if ran_out_of_memory(error):
            raise MemoryError from error
        cause = " ".join(str(error).split())[:100]
        raise StorageError(f"is sealed, but not laid out as by brownpipe ({type(error).__name__}: {cause})") from error


def _linked(group: h5py.Group, name: str) -> h5py.Group | h5py.Dataset:
    """Return a member of a group; raise StorageError unless it is a group or dataset of the same file."""
    if group.id.links.get_info(name.encode(errors="surrogateescape")).type != h5py.h5l.TYPE_HARD:
        raise StorageError(f"has a link to another place ({name})")
    item = group[name]
    if not isinstance(item, h5py.Group | h5py.Dataset):
        raise StorageError(f"has an object that is neither group nor dataset ({name})")
    return item


def address_of(item: h5py.Group | h5py.Dataset) -> int:
    """Return where in its file an object is; the same for all its paths and references."""
    return h5py.h5o.get_info(item.id).addr


def _sizes(item: h5py.Dataset, most: int) -> tuple[int, int]:
    """Return the bytes of a dataset as decoded and as stored; raise StorageError if these cannot be its values."""
    properties = item.id.get_create_plist()
    if properties.get_layout() not in LAYOUTS or properties.get_external_count():
        raise StorageError(f"has a dataset whose values are elsewhere ({item.name})")
    if item.shape is None:
        raise StorageError(f"has a dataset without values ({item.name})")
    _refuse_type(item.name, item.dtype)
    declared, stored = math.prod(item.shape) * item.id.get_type().get_size(), item.id.get_storage_size()
    filters = [properties.get_filter(k)[0] for k in range(properties.get_nfilters())]
    if not set(filters) <= FILTERS or len(set(filters)) < len(filters):
        raise StorageError(f"has a dataset with filters of another program ({item.name})")
    if item.chunks is not None:
        declared = _bytes_of_chunks(item, most)
    elif not (stored >= declared if item.dtype.kind == "O" else stored == declared):  # of text, references are stored
        declared = math.inf
    if declared > MOST_EXPANSION * stored + SLACK * bool(stored):
        raise StorageError(f"declares more data than it stores ({item.name})")
    return int(declared), stored  # an infinite size has been refused


def _bytes_of_chunks(item: h5py.Dataset, most: int) -> int:
    """Return the bytes of all chunks of a dataset. Raise StorageError if one is missing, or decodes to more."""
    size = math.prod(item.chunks) * item.id.get_type().get_size()
    needed = math.prod(-(-length // chunk) for length, chunk in zip(item.shape, item.chunks, strict=True))
    chunks: list = []
    if needed <= most:
        item.id.chunk_iter(chunks.append)
    if needed != len(chunks):
        raise StorageError(f"declares more data than it stores ({item.name})")
    for chunk in chunks:
        if chunk.size > 1.01 * size + 64 or (chunk.size > LARGE_CHUNK and _expands(item, chunk, size)):
            raise StorageError(f"has a chunk that is too large ({item.name})")
    return size * needed


def _expands(item: h5py.Dataset, chunk: Any, size: int) -> bool:
    """Whether a compressed chunk decodes to more bytes than a chunk has."""
    try:
        _, packed = item.id.read_direct_chunk(chunk.chunk_offset)
        return item.compression == "gzip" and len(zlib.decompressobj().decompress(packed, size + 1)) > size
    except zlib.error:
        return False  # not compressed, or not at all


def _refuse_type(name: str, dtype: np.dtype) -> None:
    """Raise StorageError for anything but text, numbers and tables of numbers."""
    parts = [dtype.fields[field][0].base for field in dtype.names] if dtype.names and dtype.fields else [dtype]
    for part in parts:
        is_number = part.kind in "iufb" and part.isnative and part.itemsize <= LARGEST_NUMBER
        if not is_number and h5py.check_string_dtype(part) is None:
            raise StorageError(f"has values of another type than numbers and text ({name})")


def _refuse_attribute(item: h5py.Group | h5py.Dataset, name: str) -> None:
    """Raise StorageError for an attribute that must not be read."""
    attribute = h5py.h5a.open(item.id, name.encode(errors="surrogateescape"))
    if attribute.get_space().get_simple_extent_type() == h5py.h5s.NULL:
        raise StorageError(f"has an attribute without a value ({name})")
    _refuse_type(name, attribute.dtype)
    if attribute.dtype.kind in "OS" and math.prod(attribute.shape) > MOST_TEXTS_OF_ATTRIBUTE:
        raise StorageError(f"has too many texts ({name})")
