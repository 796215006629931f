"""Files that are written completely or not at all, with a seal (checksum) that is verified before they are read.

Four checks protect the contents, each against faults of a different origin:

    fletcher32   HDF5's checksum of each chunk of numbers. For readers other than brownpipe (h5py, xarray, h5dump): they
                 fail at a damaged chunk. Brownpipe verifies the seal first, which covers all of these chunks.
    digest       SHA-256 of names, types, shapes, values and attributes (`hdf5.digest`), taken from the arrays before
                 HDF5 encodes them and compared with what HDF5 decodes, when a file is written and when it is read.
                 Finds faults of memory, HDF5 or zlib between arrays and bytes. (Datasets are instead decoded and
                 compared as xarray.Dataset when they are written.)
    seal         SHA-256 of all bytes of the file but the seal's own digits. Finds damage, truncation and edits after
                 the file was written, before HDF5 parses a byte of it.
    read-back    The bytes are read again before the file gets its name. Finds a file system that returns other bytes
                 than were written, while the runs are still in memory; later the seal finds that, too. After fsync the
                 bytes usually come from the page cache: this is no test of the disk itself.
"""

import errno
import hashlib
import os
import re
import resource
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from zlib import crc32

from brownpipe import interrupts
from brownpipe.errors import StorageError, WrongFileError
from brownpipe.opening import opened_unlinked, read_ordinary

HDF5 = b"\x89HDF\r\n\x1a\n"  # the first bytes of every HDF5 file
PREFIX = "brownpipe-sha256:"
NO_RESULTS = (
    "is YAML, not HDF5; brownpipe simulate makes trajectory files of a scene, brownpipe run the results of a study"
)
READABLE = "trajectory files, datasets, figures and tables can be inspected and verified"
LOG = f"is a log; {READABLE}"
SEALED_TEXT = f"is text that is verified with its study, by brownpipe verify results/STUDY; {READABLE} alone"
WRONG_PATH = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL, errno.ENXIO)
BLANK_SEAL = PREFIX + 64 * "0"
BLOCK = 4096  # bytes that a disk hands out at once
MEMORY = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")  # bytes of this machine
LONGEST_WRITING = 86_400.0  # s; a part that has not changed for so long is abandoned, wherever its process is
SEAL = re.compile(PREFIX.encode() + b"[0-9a-f]{64}")


def write_file(path: str | Path, contents: bytes) -> None:
    """Write a file such that any reader sees the old file or the complete new one, never a part of it.

    The bytes go to a part beside it (`replacing`; its folder is created if missing), are flushed to the disk and read
    back; only then is the part renamed. If anything fails before, the part is removed.

    Raises StorageError if the disk is full, the folder cannot be written to, or the file reads back differently.
    """
    write_files({path: contents})


def write_files(files: Mapping[str | Path, bytes]) -> None:
    """Write files that belong together, as `write_file`; none is replaced before all of them are on the disk."""
    with ExitStack() as parts:
        for path, contents in files.items():
            _write_through(parts.enter_context(replacing(path)), contents)


class _TriedError(Exception):
    """Ends a writing that was only to be tried."""


def try_to_write(path: str | Path) -> None:
    """Write a block to the part of a file and remove it again, before the work whose result the file is to hold.

    Raises StorageError as `write_file` does, also if a folder has the name of the file.
    """
    if Path(path).is_dir():
        raise StorageError(f"{path}: not written: is a folder; choose the name of a file")
    with suppress(_TriedError), replacing(path) as part:
        _write_through(part, bytes(BLOCK))
        raise _TriedError


def free_space(folder: str | Path) -> float:
    """Return the bytes that a new file in a folder may have: the space on the disk or the limit of file sizes."""
    disk, limit = os.statvfs(folder), resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    free = disk.f_bavail * disk.f_frsize
    return free if limit == resource.RLIM_INFINITY else min(free, limit)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Create a part, NAME.<process>-<place>-<random>.part, to write to. It becomes the file, or is removed on an error.

    The part is a new file: a file or link of its name, which another user may have planted, is neither opened nor
    followed. Writers reopen it by `opening.opened_unlinked`. A link in place of the file is replaced, not followed.
    Parts of the same NAME that a killed process has left are removed first.

    Raises StorageError as `write_file` does, and if another process has replaced the part.
    """
    path = Path(path)
    if not path.name:
        raise StorageError(f"{path}: is a folder; choose the name of a file")
    part = path.with_name(f"{path.name}.{os.getpid()}-{_place()}-{os.urandom(4).hex()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned_parts(path)
        handle, may_exist = -1, True
        interrupts.unfinished.add(str(part))  # before: an interrupt may come when there is the part, but no handle yet
        try:
            try:
                handle = opened_unlinked(str(part), os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            except OSError:
                may_exist = False  # or it is another one's
                raise
            yield part
            if not os.path.samestat(os.fstat(handle), os.lstat(part)):
                raise OSError(errno.EIO, "another process has replaced its part; choose a folder of your own")
            os.replace(part, path)
        finally:
            if handle >= 0:
                os.close(handle)
            if may_exist:
                part.unlink(missing_ok=True)
            interrupts.unfinished.discard(str(part))
        sync(path.parent)
    except OSError as error:
        raise StorageError(f"{path}: not written: {_reason(error)}") from error


def remove_abandoned_parts(path: Path) -> None:
    """Remove parts of a file that are a day old, or whose process on this machine has ended without removing them."""
    parts = re.compile(re.escape(path.name) + r"\.([0-9]{1,9})(?:-([0-9a-f]{8})-[0-9a-f]{8})?\.part")
    with suppress(OSError), os.scandir(path.parent) as entries:
        for entry in entries:
            if found := parts.fullmatch(entry.name):
                with suppress(OSError):
                    age = time.time() - entry.stat(follow_symlinks=False).st_mtime
                    if age > LONGEST_WRITING or (found[2] == _place() and not _is_running(int(found[1]))):
                        os.unlink(entry.path)


@cache
def _place() -> str:
    """Return the name of the space in which process numbers are unique: the machine, and its PID namespace."""
    namespace = os.readlink("/proc/self/ns/pid") if os.path.exists("/proc/self/ns/pid") else ""
    return f"{crc32(f'{os.uname().nodename} {namespace}'.encode()):08x}"


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # it belongs to another user, or it is none that can be asked for
        return True
    return True


def _write_through(path: Path, contents: bytes) -> None:
    """Write the bytes to an existing file, wait until they are on the disk, and read them back."""
    with open(path, "wb", opener=opened_unlinked) as file:
        file.write(contents)
        file.flush()
        os.fsync(file.fileno())
    if path.read_bytes() != contents:
        raise OSError(errno.EIO, "it reads back differently; check the disk and rerun")


def sync(path: Path) -> None:
    """Wait until a file is on the disk or, for a folder, the names of its files.

    Nothing is waited for where the file system cannot do this, as some of networks cannot for folders.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):
            raise
    finally:
        os.close(handle)


def _reason(error: OSError) -> str:
    """Return why a file was not written and, where it is known, what to do about it."""
    if error.errno == errno.EFBIG:
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
        return f"{error.strerror}: no file may have more than {limit:,} bytes (ulimit -f); must be a higher limit"
    if error.errno == errno.ENAMETOOLONG:
        return f"{error.strerror}; choose a shorter one"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"{error.strerror}; free some space and rerun"
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS, errno.EEXIST, errno.ENOTDIR, errno.EISDIR):
        return f"{error.strerror}; choose a place that can be written"
    return error.strerror or str(error)


def seal(contents: bytes) -> bytes:
    """Return the contents with their blank seal replaced by their SHA-256.

    HDF5's checksums cover chunks of numbers, not its metadata. Of 3,000 single-bit flips in a small file, 71 went
    unnoticed and changed names, texts or numbers, and 2 crashed the library; the seal covers every byte.
    """
    if contents.count(BLANK_SEAL.encode()) != 1:
        raise ValueError("the contents need exactly one blank seal")
    return contents.replace(BLANK_SEAL.encode(), PREFIX.encode() + hashlib.sha256(contents).hexdigest().encode())


def read_sealed(path: str | Path) -> bytes:
    """Return the bytes of a sealed HDF5 file after verifying its seal.

    Raises StorageError, without the name of the file, if the seal is broken or missing; WrongFileError if there is no
    file, one that is not an ordinary file, or one without any mark of HDF5 and brownpipe.
    """
    try:
        if os.stat(path).st_size > MEMORY:
            raise WrongFileError("is larger than the memory of this machine")
        contents = read_ordinary(path, MEMORY)
    except MemoryError:
        raise WrongFileError("does not fit into memory") from None
    except OSError as error:
        problem = WrongFileError if error.errno in WRONG_PATH else StorageError
        raise problem(f"cannot be read: {error.strerror}") from error
    except ValueError as error:  # a path that no system allows
        raise WrongFileError(f"cannot be read: {error}") from None
    if not contents.startswith(HDF5):
        raise _not_hdf5(contents, Path(path).suffix)
    seals = [*islice(SEAL.finditer(contents), 2)]
    if len(seals) != 1:
        raise StorageError("is cut short, damaged, or not a file of brownpipe")
    first, last = seals[0].span()
    total = hashlib.sha256(memoryview(contents)[:first])
    total.update(BLANK_SEAL.encode())
    total.update(memoryview(contents)[last:])
    if total.hexdigest() != seals[0].group().decode().removeprefix(PREFIX):
        raise StorageError("was damaged or edited after it was written")
    return contents


def _not_hdf5(contents: bytes, suffix: str) -> StorageError:
    """Return the error for a file that is not HDF5; it may have been if it is empty or has a seal outside a comment."""
    if f"# {PREFIX}".encode() in contents:
        return WrongFileError(SEALED_TEXT)
    if suffix == ".log":
        return WrongFileError(LOG)
    if not contents or PREFIX.encode() in contents:
        return StorageError("is not an HDF5 file")
    is_yaml = suffix in (".yaml", ".yml")
    return WrongFileError(NO_RESULTS if is_yaml else "is not an HDF5 file, as trajectory files and datasets are")


@contextmanager
def naming(path: str | Path, remedy: Callable[[str | Path], str]) -> Iterator[None]:
    """Put the name of the file before errors of reading it and, if it is damaged, its remedy behind them."""
    try:
        yield
    except WrongFileError as error:
        raise WrongFileError(f"{path}: {error}") from error
    except StorageError as error:
        raise StorageError(f"{path}: {error}; {remedy(path)}") from error
