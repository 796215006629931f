"""What can go wrong, and the exit status of the command line for it. Every message is one line."""

WRONG_REQUEST, FAILED = 2, 1


class BrownpipeError(Exception):
    """Something is wrong with a request, a run or a file."""

    exit_status = FAILED

    def __init__(self, message: str):
        super().__init__(" ".join(message.splitlines()))


class RequestError(BrownpipeError, ValueError):
    """A scene, a study, an option or a seed is wrong. Nothing has been computed or written."""

    exit_status = WRONG_REQUEST


class AnalysisError(BrownpipeError, ValueError):
    """The trajectory files given do not make one study."""

    exit_status = WRONG_REQUEST


class FigureError(BrownpipeError, ValueError):
    """The dataset or file lacks what a figure is to show."""

    exit_status = WRONG_REQUEST


class RunError(BrownpipeError):
    """A run cannot go on."""


class StorageError(BrownpipeError):
    """A file cannot be written, or what it holds cannot be trusted; the message names the file and the cure."""


class WrongFileError(StorageError):
    """There is no such file, or it is of another kind; nothing is known to be damaged."""

    exit_status = WRONG_REQUEST
