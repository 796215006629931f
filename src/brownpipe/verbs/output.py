"""What verbs print, and the files they write: one line for each."""

import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from brownpipe.errors import RequestError, StorageError
from brownpipe.formatting import in_bytes
from brownpipe.quoting import in_lines, printable

HDF5 = (".h5", ".hdf5", "")  # suffixes of trajectory files
YAML = (".yaml", ".yml")
NETCDF = (".nc", "")  # of datasets
PAGE = (".html",)
FILES = (".png", ".svg", ".pdf", ".jpg", ".jpeg", ".gif", ".csv", ".txt", ".nc", ".h5", *PAGE)  # no suffixes of folders


def show(*lines: str, flush: bool = False) -> None:
    """Print each line on standard output; control characters in it are escaped."""
    print(in_lines(lines), flush=flush)


def say(message: str, status: int) -> int:
    """Print a message on stderr, in one line; return the exit status."""
    with suppress(OSError):  # nobody reads it
        print("brownpipe:", printable(message) or "out of memory", file=sys.stderr)
    return status


def writable(path: str, *inputs: str, suffixes: Sequence[str]) -> str:
    """Return the path of an output file, links of this user resolved, and make its folder.

    suffixes: those that the file may have, with "" if it may have none. Called before anything is computed.
    Raises OSError, StorageError or RequestError if the file could not be written afterwards.
    """
    from brownpipe.storage import try_to_write

    if os.path.islink(path):
        if os.lstat(path).st_uid not in (os.getuid(), 0):
            raise RequestError(f"{path}: is a link that another user has made; choose another name for the output")
        path = os.path.realpath(path)
    _refuse_to_replace(path, inputs)
    if suffix(path) not in suffixes:
        allowed = " or ".join(", ".join(filter(None, suffixes)).rsplit(", ", 1))
        raise RequestError(f"{path}: the output must end in {allowed}, not {Path(path).suffix!r}")
    if Path(path).is_dir():
        raise IsADirectoryError(f"{path}: is a folder; choose the name of a file")
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"{path}: its folder cannot be made: {error.strerror}; choose another place") from error
    if not os.access(Path(path).parent, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written to; choose another place")
    try_to_write(path)
    return path


def refuse_if_too_large(path: str, size: float) -> None:
    """Raise StorageError if the disk or the limit of file sizes has no room for half of an expected size [bytes]."""
    from brownpipe.storage import free_space

    free = free_space(Path(path).parent)
    if size / 2 > free:
        room = f"some {in_bytes(size)} are expected, and there is room for {in_bytes(free)}"
        raise StorageError(f"{path}: {room}; must be more space, fewer seeds, or less to record")


def suffix(path: str) -> str:
    """Return the suffix of a file name in small letters, "" for none; the end of a number is none: mass_0.5."""
    end = Path(path).suffix.lower()
    return end if end[1:2].isalpha() else ""


def folder(path: str) -> str:
    """Return the path of an output folder; raise RequestError for a path that is meant as a file."""
    if suffix(path) in FILES and not Path(path).is_dir():
        raise RequestError(f"{path}: the output must be a folder, not a name that ends in {suffix(path)}")
    if Path(path).exists() and not Path(path).is_dir():
        raise RequestError(f"{path}: is a file; choose the name of a folder")
    return path


def refuse_unwritable(output: str, names: Iterable[str]) -> None:
    """Raise StorageError if a folder cannot be written to, or has folders with the names of the files of figures."""
    from brownpipe.storage import try_to_write

    files = ["summary.txt", "summary.csv", *(f"{name}{end}" for name in names for end in (".png", ".svg", ".csv"))]
    for file in (Path(output) / name for name in files):
        if file.is_dir():
            raise StorageError(f"{file}: not written: is a folder; choose another --output")
    try_to_write(Path(output) / files[0])


def _refuse_to_replace(path: str, inputs: tuple[str, ...]) -> None:
    """Raise RequestError if the output would replace an input or something that is no ordinary file."""
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise RequestError(f"{path}: is not an ordinary file; choose another name for the output")
    for file in inputs:
        if os.path.exists(path) and os.path.exists(file) and os.path.samefile(path, file):
            raise RequestError(f"{path}: is an input; choose another name for the output")
