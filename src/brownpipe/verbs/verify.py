"""`brownpipe verify`: whether results are as they were written."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, FAILED, StorageError
from brownpipe.verbs.output import say, show

EXAMPLE = "results/small"


def add_arguments(add: Callable) -> None:
    what = "folder with the results of a study, or single trajectory files and datasets"
    add("paths", nargs="+", metavar="RESULTS", help=what)


def verify(arguments: Namespace) -> int:
    """Read every trajectory file and dataset of a study and verify its checksum.

    Names every file that is damaged, and runs and figures that are missing; then the exit status is 1. To make damaged
    files again, delete them and run the study. Nothing is written.
    """
    from brownpipe import progress
    from brownpipe.inspection import read_contents
    from brownpipe.study.verification import verify_results

    statuses: set[int] = {DONE}
    with progress.shown("verify"):
        for path in arguments.paths:
            try:
                if Path(path).is_dir():
                    intact, damaged, missing = verify_results(path)
                    wrong = [f"{file}: is damaged; delete it and run the study again" for file in damaged]
                    wrong += [f"{file}: is missing; run the study again" for file in missing]
                    show(*wrong, f"{path}: {len(intact)} intact, {len(damaged)} damaged, {len(missing)} missing")
                    statuses.add(FAILED if damaged or missing else DONE)
                else:
                    read_contents(path)
                    show(f"{path}: intact")
            except StorageError as error:
                statuses.add(say(str(error), error.exit_status))
    return FAILED if FAILED in statuses else max(statuses)
