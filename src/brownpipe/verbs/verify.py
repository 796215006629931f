"""`brownpipe verify`: whether results are as they were written."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, FAILED, StorageError
from brownpipe.verbs.output import say, show

EXAMPLE = "results/small"


def add_arguments(add: Callable) -> None:
    what = "folder with the results of a study or of several, or single files: trajectories, datasets, figures, tables"
    add("paths", nargs="+", metavar="RESULTS", help=what)


def verify(arguments: Namespace) -> int:
    """Verify all that a study has made, byte by byte, and that each file holds what the study asks for.

    Names every file that is missing, damaged or exchanged, and the command that makes them again; then the exit status
    is 1. It is 1, too, if the study file is not found or not valid: then nobody knows what else is missing. Files of
    another version of brownpipe and files that it did not make are named, too, and do not change the exit status.
    Nothing is written. `brownpipe run STUDY --verify` does the same after a run.
    """
    from brownpipe import progress
    from brownpipe.study.verification import results_in, verify_file

    statuses: set[int] = set()
    with progress.shown("verify"):
        for path in arguments.paths:
            try:
                if Path(path).is_dir():
                    statuses.update(map(report, results_in(path)))
                else:
                    verify_file(path)
                    show(f"{path}: intact")
            except StorageError as error:
                statuses.add(say(str(error), error.exit_status))
    return FAILED if FAILED in statuses else max(statuses, default=DONE)


def report(path: str | Path) -> int:
    """Verify the results of a study and print what is found; return the exit status."""
    from brownpipe.study.verification import verify_results

    folder = Path(path)
    verdict = verify_results(folder)
    for file, what in verdict.problems:
        show(f"{folder / file}: {what}")
    for remark in verdict.remarks:
        show(f"{folder}: {remark}")
    if verdict.unknown is not None:
        show(f"{folder}: completeness was not checked: {verdict.unknown}")
    others = f", {len(verdict.problems)} not" if verdict.problems else ""
    show(f"{folder}: {verdict.intact} files intact{others}{'' if verdict.cure is None else '; to make these again:'}")
    if verdict.cure is not None:
        show(verdict.cure)
    return FAILED if verdict.problems or verdict.unknown is not None else DONE
