"""Checksums of files that carry no seal of their own: figures, tables and texts.

A folder of them has a file SHA256SUMS, which `sha256sum --check SHA256SUMS` reads, too. The last line of SHA256SUMS,
and of other texts that brownpipe writes for itself, is the seal of the lines above it, a comment.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from brownpipe.errors import StorageError, WrongFileError
from brownpipe.opening import opened_ordinary, read_ordinary
from brownpipe.storage.files import PREFIX, write_file

NAME = "SHA256SUMS"
MOST_BYTES = 2**20  # of a sealed text; larger files are refused
SEAL_LENGTH = len(f"# {PREFIX}\n") + 64
LINE = re.compile(r"\\?[0-9a-f]{64}  .+")
ESCAPES = {"\\": "\\\\", "\n": "\\n", "\r": "\\r"}  # in names, as `sha256sum` writes them


def write_sealed_text(path: str | Path, text: str) -> None:
    """Write lines of text and their seal, all or nothing. Raises StorageError as `write_file` does."""
    write_file(path, (text + _seal_line(text)).encode())


def read_sealed_text(path: str | Path) -> str:
    """Return the lines of a sealed text without the seal.

    Raises StorageError, without the name of the file, if the seal is broken or missing; WrongFileError without a file.
    """
    try:
        text = read_ordinary(path, MOST_BYTES + 1).decode(errors="replace")
    except OSError as error:
        raise WrongFileError(f"cannot be read: {error.strerror}") from error
    lines, seal = text[:-SEAL_LENGTH], text[-SEAL_LENGTH:]
    if seal != _seal_line(lines):
        raise StorageError("was damaged or edited after it was written, or has no seal")
    return lines


def _seal_line(text: str) -> str:
    return f"# {PREFIX}{hashlib.sha256(text.encode()).hexdigest()}\n"


def write_checksums(folder: str | Path, files: Iterable[str | Path]) -> Path:
    """Write SHA256SUMS of files, named relative to the folder, in the order of their names; return its path."""
    digests = {os.path.relpath(file, folder): digest_of(file) for file in files}
    path = Path(folder) / NAME
    write_sealed_text(path, "".join(_line(name, digests[name]) for name in sorted(digests)))
    return path


def read_checksums(folder: str | Path) -> Mapping[str, str]:
    """Return the SHA-256 of each file listed in SHA256SUMS of a folder, by name.

    Errors as of `read_sealed_text`; StorageError, too, for a sealed text that is no list of checksums.
    """
    lines = read_sealed_text(Path(folder) / NAME).split("\n")[:-1]
    if not all(map(LINE.fullmatch, lines)):
        raise StorageError("is sealed, but is no list of checksums")
    pairs = (line.removeprefix("\\").split("  ", 1) for line in lines)
    names = {escape: character for character, escape in ESCAPES.items()}
    return {re.sub(r"\\[\\nr]", lambda found: names[found[0]], name): digest for digest, name in pairs}


def _line(name: str, digest: str) -> str:
    """Return a line of SHA256SUMS; one with escapes begins with a backslash."""
    escaped = "".join(ESCAPES.get(character, character) for character in name)
    mark = "" if escaped == name else "\\"
    return f"{mark}{digest}  {escaped}\n"


def digest_of(path: str | Path) -> str:
    """Return the SHA-256 of an ordinary file, read in blocks. Raises OSError if it cannot be read."""
    with opened_ordinary(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
