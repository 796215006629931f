"""`brownpipe inspect`: the contents of a file."""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.errors import DONE, FAILED
from brownpipe.verbs.output import say

EXAMPLE = "seed17.h5"


def add_arguments(add: Callable) -> None:
    """Add the arguments of the verb; `add` is `add_argument` of its parser."""
    add("file", metavar="FILE", help="trajectory file or dataset")


def inspect(arguments: Namespace) -> int:
    """Describe the contents of a trajectory file or dataset, and say whether it is intact."""
    from brownpipe.storage import report, verify

    problems = verify(arguments.file)
    for problem in problems:
        say(problem, FAILED)
    if not problems:
        print(report(arguments.file))
    return FAILED if problems else DONE
