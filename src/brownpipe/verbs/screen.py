"""What verbs print: lines on standard output, and one on stderr for an error.

The command line imports this before anything else of a verb, so it may not import NumPy: `main`
limits the threads of its linear algebra first.
"""

import sys
from contextlib import suppress

from brownpipe.errors import DONE
from brownpipe.progress import give_reason
from brownpipe.text import in_lines, printable


def show(*lines: str, flush: bool = False) -> None:
    """Print each line on standard output; control characters in it are escaped."""
    print(in_lines(lines), flush=flush)


def say(message: str, status: int) -> int:
    """Print a message on stderr, in one line; return the exit status."""
    if status != DONE:
        give_reason(message)
    with suppress(OSError):  # nobody reads it
        print("brownpipe:", printable(message), file=sys.stderr)
    return status
