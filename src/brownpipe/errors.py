"""The exceptions of brownpipe, with the exit status of the command line. Every message is one
printable line.
"""

from brownpipe.text import printable

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

    Raised during a run, it ends the whole batch, but RunError and PlacementError end that run
    alone.
    """

    exit_status = WRONG_REQUEST


class PlacementError(RequestError):
    """Random insertion found no place for a disk; with another seed it may succeed."""


class AnalysisError(BrownpipeError, ValueError):
    """The trajectory files do not belong to one study."""

    exit_status = WRONG_REQUEST


class FigureError(BrownpipeError, ValueError):
    """The dataset or file lacks the data of a figure."""

    exit_status = WRONG_REQUEST


class RunError(BrownpipeError):
    """A run cannot continue."""


class StorageError(BrownpipeError):
    """A file cannot be written, or its contents are damaged; the message names the file and a
    remedy.
    """


class UnsealedError(StorageError):
    """A file has lost its seal, so that its contents can no longer be verified."""


class WrongFileError(StorageError):
    """The file does not exist or is of another kind; nothing is known to be damaged."""

    exit_status = WRONG_REQUEST
