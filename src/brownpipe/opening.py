"""How files are opened: only ordinary files are read, and no symbolic link is followed to a file that is written.

A named pipe, a device or a socket in place of a file may never end, never begin, or react to being opened.
"""

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

KINDS = {  # by the file type in the mode
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
SIZELESS = 1 << 20  # bytes read at most of a file of stated size 0, as those in /proc


@contextmanager
def opened_ordinary(path: str | Path) -> Iterator[BufferedReader]:
    """Open an ordinary file to be read.

    Raises OSError, with a `strerror` for messages, if the path is anything else or cannot be read; ValueError for a
    path that no system allows.
    """
    _refuse_kind(os.stat(path))  # first, as opening can be an action of a device, and waits at a pipe
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOCTTY | os.O_NONBLOCK)
    with open(handle, "rb") as file:
        _refuse_kind(os.fstat(handle))
        yield file


def read_ordinary(path: str | Path, most_bytes: int) -> bytes:
    """Return the contents of an ordinary file, at most the first `most_bytes`; errors as of `opened_ordinary`."""
    with opened_ordinary(path) as file:
        size = os.fstat(file.fileno()).st_size or SIZELESS  # as much memory is taken before anything is read
        return file.read(min(size, most_bytes)) or b""


def _refuse_kind(found: os.stat_result) -> None:
    """Raise OSError unless the file is an ordinary one."""
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        kind = KINDS.get(stat.S_IFMT(found.st_mode), "a special file")
        raise OSError(errno.EINVAL, f"{kind}, not an ordinary file")


def opened_unlinked(path: str, flags: int) -> int:
    """Return a handle of a file that is written; the `opener` of `open`. Raises OSError if the path is a link."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
