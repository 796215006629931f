"""Machine code on disk: one file for each variant of an entry point, in a folder that nobody else can write to.

Machine code is executed without further questions. A file is therefore loaded only if

- it was made from this source: its folder is named after a digest of the module and of all that it imports. Numba's own
  disk cache, which is never used, checks one file alone and would execute outdated code after an edit of another;
- this user or root wrote it, and nobody else could have replaced it or a folder above it (`why_unsafe`);
- it is undamaged: it begins with the SHA-256 of its name and contents.

Any other file counts as missing and is replaced. A variant is an entry point, the types of its arguments, the
processor, and the versions and settings of the compiler.
"""

import fcntl
import hashlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from brownpipe.engines.inlining import is_tested
from brownpipe.provenance import PACKAGE, sources

MARK = "compiling"  # a file in each folder of machine code; its modification time is that of the last use
UNUSED = 86_400.0  # seconds without use after which machine code of another source version is removed
ROOT = 0  # the user who can write everywhere
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
VERSIONS = (numba.__version__, llvmlite.__version__, np.__version__, sys.version)
SETTINGS = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE")  # of Numba

on_compile: list[Callable[[str], object]] = []  # called with a line of text when this process compiles or waits
remarks: list[str] = []  # to be told when kernels are next needed
remarks_at_compiling: list[str] = []  # to be told only if they must be compiled
_noted: set[str] = set()  # what has been in one of these lists


def tell(*lines: str) -> None:
    """Tell the listeners lines of text."""
    for line in lines:
        for listener in on_compile:
            listener(line)


def tell_all(lines: list[str]) -> None:
    """Tell the listeners what is in a list, and empty it, so that each line is told once."""
    tell(*lines)
    lines.clear()


class DiskCache:
    """The files with the machine code of one entry point, in place of Numba's own cache: it calls `load_overload`..."""

    def __init__(self, folder: Path, function: Callable, digest: str = "") -> None:
        self.folder = folder
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.digest = digest  # of the source, if the folder is not named after it
        self.cache_path = str(folder)  # shown by Numba

    def file(self, signature: tuple, codegen: Any) -> Path:
        """Return the file of the variant for these Numba types of arguments."""
        settings = [getattr(numba.config, name, None) for name in SETTINGS]
        names = [kind.name for kind in signature]
        text = repr((self.name, self.digest, names, codegen.magic_tuple(), VERSIONS, settings))
        return self.folder / f"{self.name}-{hashlib.sha256(text.encode()).hexdigest()[:24]}.nbc"

    def holds(self, file: Path) -> bool:
        """Whether a variant can be loaded from its file."""
        return read(file) is not None

    def load_overload(self, signature: tuple, target_context: Any) -> CompileResult | None:
        """Return a variant, ready to be called; None if there is no good file of it.

        Numba's own cache first calls `refresh`, which makes all functions known that compiled code may call: 0.12 s of
        CPU. In our machine code they are inlined. Whatever is compiled in this process later calls `refresh` itself.
        """
        if not is_tested():
            target_context.refresh()
        contents = read(self.file(signature, target_context.codegen()))
        return None if contents is None else CompileResult._rebuild(target_context, *pickle.loads(contents))

    def save_overload(self, signature: tuple, result: Any) -> None:
        """Write a variant to its file. If that fails, it is kept in memory only, and compiled again by others."""
        if result.lifted or result.library.has_dynamic_globals:  # addresses of this process
            return
        file = self.file(signature, result.library.codegen)
        try:
            write(file, dumps(result._reduce()))
        except OSError as error:
            tell(f"machine code is not kept: {file.parent}: {error.strerror}")

    def flush(self) -> None:
        """Called by Numba to recompile: forget all variants."""
        for file in self.folder.glob(f"{self.name}-*.nbc"):
            file.unlink(missing_ok=True)

    def touch(self) -> None:
        """Note that the folder is in use, so that it is not removed."""
        with suppress(OSError):
            os.close(os.open(self.folder / MARK, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600))
            os.utime(self.folder / MARK)


def read(file: Path) -> bytes | None:
    """Return the contents of a file of machine code; None if it is missing, damaged, or not safe to be executed."""
    try:
        with open(os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as opened:
            status = os.fstat(opened.fileno())
            if not stat.S_ISREG(status.st_mode) or _writers(status) is not None:
                return None
            seal, contents = opened.read(32), opened.read()
    except OSError:
        return None
    return contents if seal == _seal(file, contents) else None


def write(file: Path, contents: bytes) -> None:
    """Write a file of machine code such that other processes see all of it or nothing. Raises OSError."""
    file.parent.mkdir(mode=0o700, exist_ok=True)  # it may have been removed meanwhile
    part = file.parent / f"{os.urandom(8).hex()}.part"
    try:  # the name is known before the file is there: a signal may come as soon as it is
        with open(part, "xb", opener=_opened_private) as opened:
            opened.write(_seal(file, contents) + contents)
        os.replace(part, file)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def _opened_private(path: str, flags: int) -> int:
    """Return a handle of a new file that this user alone may read and write; the `opener` of `open`."""
    return os.open(path, flags, 0o600)


def _seal(file: Path, contents: bytes) -> bytes:
    return hashlib.sha256(file.name.encode() + contents).digest()


@cache
def folder_of(module: str) -> Path | None:
    """Return the folder for the machine code of a module, named after the source of the module and all it imports.

    The first of `_candidates` that can be written to, by nobody but this user; None if there is none.
    """
    text = b"".join(path.read_bytes() for path in sources(module))
    name = f"kernels-{hashlib.sha256(text).hexdigest()[:16]}"
    for place, lines in _candidates():
        try:
            folder = Path(os.path.realpath(place)) / name
            is_new = _make(folder)
        except (OSError, ValueError):
            continue
        why = why_unsafe(folder)
        if why is None and os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            if is_new:
                _prune(folder.parent)
            return folder
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        if why is not None:
            _note(f"machine code is not kept in {place}: {why}", lines)
    cure = "set NUMBA_CACHE_DIR to a private folder"
    _note(f"machine code cannot be kept anywhere, so that every process compiles; {cure}", remarks_at_compiling)
    return None


def _note(line: str, lines: list[str]) -> None:
    """Append a line to what is to be told, unless it has been noted before."""
    if line not in _noted:
        _noted.add(line)
        lines.append(line)


def _candidates() -> Iterator[tuple[Path, list[str]]]:
    """Yield the folders in which machine code may be kept, best first, and where it is noted if one is not safe."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen), remarks
    yield PACKAGE / "engines" / "__pycache__", remarks_at_compiling
    home = Path(os.path.expanduser("~"))
    of_user = home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache"
    if sys.platform != "darwin" and os.path.isabs(chosen := os.environ.get("XDG_CACHE_HOME", "")):
        of_user = Path(chosen)
    if of_user.is_absolute():
        yield of_user / "brownpipe", remarks_at_compiling
    with suppress(OSError):
        yield Path(tempfile.gettempdir()) / f"brownpipe-{os.geteuid()}", remarks_at_compiling


def _make(folder: Path) -> bool:
    """Make a folder of this user alone, and those above it, whatever the umask; return whether it is new."""
    if folder.is_dir():
        return False
    missing = [path for path in folder.parents if not path.exists()]
    for path in reversed(missing):
        with suppress(FileExistsError):
            path.mkdir(mode=0o755)
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    return True


def why_unsafe(folder: Path) -> str | None:
    """Return why others could change what is in a folder (an absolute path without links), or None.

    Nobody but this user and root may own it or a folder above it, or be allowed to write to them. In folders such as
    /tmp, where only the owner of a file may remove it, others may write: they cannot replace what is this user's.
    """
    for path in (folder, *folder.parents):
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode):
            return f"{path} is not a folder"
        is_sticky = path != folder and status.st_mode & stat.S_ISVTX
        why = _writers(status, OTHERS_WRITE * (not is_sticky))
        if why is not None:
            return f"{path} {why}"
    return None


def _writers(status: os.stat_result, forbidden: int = OTHERS_WRITE) -> str | None:
    """Return which others may write to a file or folder, or None; `forbidden` are bits of its mode."""
    if status.st_uid not in (os.geteuid(), ROOT):
        return f"belongs to user {status.st_uid}"
    if status.st_mode & forbidden:
        return f"can be written to by others (mode {stat.S_IMODE(status.st_mode):o}; chmod go-w cures it)"
    return None


def _prune(base: Path) -> None:
    """Remove machine code of other source versions that no process has used for a day."""
    for folder in base.glob("kernels-*"):
        with suppress(OSError):
            if folder.lstat().st_uid != os.geteuid():
                continue
            mark = os.open(folder / MARK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            with open(mark, "rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if time.time() - os.fstat(file.fileno()).st_mtime > UNUSED:
                    shutil.rmtree(folder, ignore_errors=True)
