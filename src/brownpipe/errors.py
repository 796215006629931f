"""The exceptions of brownpipe, with the exit status of the command line. Every message is one printable line."""

import errno
import mmap
import resource
from collections.abc import Iterator

from brownpipe.quoting import printable

NO_MEMORY = (  # what libraries say, besides MemoryError, where the address space is too small
    "failed to map segment",
    "cannot allocate memory",
    "Could not find/load shared object",
    "can't start new thread",
    "can't load unicodedata",
    "memory allocation failed",
    "Memory allocation still failed",
    "std::bad_alloc",
    "LLVM ERROR",
)
LAST_SECONDS = 2  # of CPU time; longer than a call of a kernel
SHORT_OF_MEMORY = 32_000_000  # bytes of address space
LEAST_MEMORY = 512 * 2**20  # bytes of address space; with less some libraries crash, or never return (OpenBLAS)
LIMITS = {  # of a process: what is limited, its unit, how many of the system's units that is, and the command
    resource.RLIMIT_AS: ("address space", "MB", 2**20, "ulimit -v"),
    resource.RLIMIT_CPU: ("CPU time", "s", 1, "ulimit -t"),
}

DONE = 0
FAILED = 1
WRONG_REQUEST = 2


class BrownpipeError(Exception):
    """An error in a request, a run or a file. `exit_status` is that of the command line."""

    exit_status = FAILED

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class RequestError(BrownpipeError, ValueError):
    """A scene, study, option or seed is not valid. Nothing is written.

    Raised in a run, it ends the whole batch. RunError and PlacementError end that run alone.
    """

    exit_status = WRONG_REQUEST


class PlacementError(RequestError):
    """Random insertion found no place for a disk: of other seeds, all disks may find one."""


class AnalysisError(BrownpipeError, ValueError):
    """The trajectory files do not belong to one study."""

    exit_status = WRONG_REQUEST


class FigureError(BrownpipeError, ValueError):
    """The dataset or file lacks the data of a figure."""

    exit_status = WRONG_REQUEST


class RunError(BrownpipeError):
    """A run cannot continue."""


class StorageError(BrownpipeError):
    """A file cannot be written, or its contents are damaged; the message names the file and a remedy."""


class WrongFileError(StorageError):
    """The file does not exist or is of another kind; nothing is known to be damaged."""

    exit_status = WRONG_REQUEST


def ran_out_of_memory(error: BaseException) -> bool:
    """Whether an error, or one that led to it, comes from a lack of memory."""
    if isinstance(error, Exception) and _is_short_of_memory():
        return True
    return any(
        isinstance(cause, MemoryError)
        or (isinstance(cause, OSError) and cause.errno == errno.ENOMEM)
        or any(words.lower() in str(cause).lower() for words in NO_MEMORY)
        for cause in _with_causes(error)
    )


def has_limited_memory() -> bool:
    """Whether the address space of this process is limited."""
    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def has_too_little_memory() -> bool:
    """Whether the address space of this process is limited to less than the libraries need to be loaded."""
    return has_limited_memory() and resource.getrlimit(resource.RLIMIT_AS)[0] < LEAST_MEMORY


def _is_short_of_memory(needed: int = SHORT_OF_MEMORY) -> bool:
    """Whether a limit of address space is nearly reached: messages of libraries then need not mention memory."""
    try:
        if has_limited_memory():
            mmap.mmap(-1, needed).close()
    except (OSError, MemoryError):
        return True
    return False


def refuse_lack_of_memory(size: int) -> None:
    """Raise MemoryError if there is no address space for `size` bytes and some more.

    Called before HDF5 is: where it finds no memory it may crash, or call an intact file damaged.
    """
    if _is_short_of_memory(SHORT_OF_MEMORY + size):
        raise MemoryError


def leave_time_for_a_last_line() -> None:
    """Let SIGXCPU come LAST_SECONDS before a process is killed at its limit of CPU time, not only then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_CPU)
    if soft == hard != resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_CPU, (max(hard - LAST_SECONDS, 1), hard))


def _with_causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and the errors that led to it, each once."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__


def limits() -> str:
    """Return the limits of memory and CPU time that are set for this process, in brackets after a blank; or ""."""
    found = []
    for kind, (what, unit, size, command) in LIMITS.items():
        soft, hard = resource.getrlimit(kind)
        limit = hard if hard - soft <= LAST_SECONDS and kind == resource.RLIMIT_CPU else soft
        if limit != resource.RLIM_INFINITY:
            found.append(f"{what} is limited to {limit / size:.4g} {unit} by {command}")
    return f" ({', '.join(found)})" if found else ""
