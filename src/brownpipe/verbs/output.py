"""The files that verbs write: where, under which names, and when not."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from brownpipe.errors import RequestError, StorageError
from brownpipe.storage.files import refuse_foreign
from brownpipe.text import in_bytes

HDF5 = (".h5", ".hdf5", "")  # suffixes of trajectory files
YAML = (".yaml", ".yml")
NETCDF = (".nc", "")  # of datasets
PAGE = (".html",)
PICTURES = (".png", ".gif", *PAGE)  # that have a record of what they were made from
IMAGES = (".png", ".svg", ".pdf", ".jpg", ".jpeg", ".gif")
FILES = (*IMAGES, ".csv", ".txt", ".nc", ".h5", *PAGE)  # no suffixes of folders


def writable(path: str, *inputs: str, suffixes: Sequence[str], size: float = 0.0) -> str:
    """Return the path of an output file, a link resolved, and make its folder.

    suffixes: those that the file may have, with "" if it may have none. size: expected [bytes],
    good to a factor of 2. Called before anything is computed. Raises OSError, RequestError or
    StorageError if the file could not be written afterwards, or is an input.
    """
    path = os.path.realpath(path) if os.path.islink(path) else path
    for file in inputs:
        both_exist = os.path.exists(file) and os.path.exists(path)
        if both_exist and os.path.samefile(path, file):
            raise RequestError(f"{path}: is an input; choose another name for the output")
    if suffix(path) not in suffixes:
        listed = ", ".join(filter(None, suffixes))
        allowed = " or ".join(listed.rsplit(", ", 1))
        raise RequestError(f"{path}: the output must end in {allowed}, not {Path(path).suffix!r}")
    if os.path.exists(path) and not os.path.isfile(path):
        raise RequestError(f"{path}: is not a file; choose another name for the output")
    if suffix(path) in (*HDF5, *NETCDF, *YAML):
        refuse_foreign(path)
    elif suffix(path) in PICTURES and os.path.isfile(path) and not has_record(path):
        raise RequestError(f"{path}: is no file of brownpipe; choose another name for the output")
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(
            f"{path}: its folder cannot be made: {error.strerror}; choose another place"
        ) from error
    if not os.access(Path(path).parent, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written to; choose another place")
    free = shutil.disk_usage(Path(path).parent).free
    if size / 2 > free:
        room = f"some {in_bytes(size)} are expected, and there is room for {in_bytes(free)}"
        raise StorageError(f"{path}: {room}; must be more space, fewer seeds, or less to record")
    return path


def has_record(path: str) -> bool:
    """Return whether a picture or page is brownpipe's own, or is empty."""
    from brownpipe.figures.origin import read_record

    return os.path.getsize(path) == 0 or read_record(path) is not None


def absent(
    path: str | Path, cure: str = "choose another name for the output, or give this one by --output"
) -> str:
    """Return the path of an output that may not be there yet, such as a default name; raise
    RequestError if it is.
    """
    if os.path.lexists(path):
        raise RequestError(f"{path}: exists; {cure}")
    return str(path)


def suffix(path: str) -> str:
    """Return the suffix of a file name in small letters, "" for none; the end of a number is none:
    mass_0.5.
    """
    end = Path(path).suffix.lower()
    return end if end[1:2].isalpha() else ""
