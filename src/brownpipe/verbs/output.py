"""What verbs print, and the files they write: one line for each."""

import os
import sys
from pathlib import Path

from brownpipe.errors import RequestError


def say(message: str, status: int) -> int:
    """Print a message on stderr, in one line; return the exit status."""
    print("brownpipe:", " ".join(message.split()) or "out of memory", file=sys.stderr)
    return status


def number(count: int, name: str) -> str:
    """Return a count and its noun, in the plural unless the count is one."""
    return f"{count:,} {name}{'' if count == 1 else 's'}"


def writable(path: str, *inputs: str) -> str:
    """Return the path of an output file, links resolved, and make its folder.

    Called before anything is computed. Raises OSError or RequestError if the file could not be written afterwards.
    """
    path = os.path.realpath(path) if os.path.islink(path) else path
    _refuse_to_replace(path, inputs)
    if Path(path).is_dir():
        raise IsADirectoryError(f"{path}: is a folder; choose the name of a file")
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"{path}: its folder cannot be made: {error.strerror}; choose another place") from error
    if not os.access(Path(path).parent, os.W_OK):
        raise PermissionError(f"{path}: its folder cannot be written to; choose another place")
    return path


def _refuse_to_replace(path: str, inputs: tuple[str, ...]) -> None:
    """Raise RequestError if the output would replace an input or something that is no ordinary file."""
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise RequestError(f"{path}: is not an ordinary file; choose another name for the output")
    for file in inputs:
        if os.path.exists(path) and os.path.exists(file) and os.path.samefile(path, file):
            raise RequestError(f"{path}: is an input; choose another name for the output")
