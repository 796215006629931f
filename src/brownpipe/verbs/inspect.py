"""`brownpipe inspect`: the contents of a file."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, FAILED, RequestError
from brownpipe.verbs.output import say, show
from brownpipe.verbs.values import add_seed, typed

EXAMPLE = "seed17.h5 --seed 17"


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import Count

    add("file", metavar="FILE", help="trajectory file, dataset, figure, table, page or movie")
    add_seed(add, "all about this run of a trajectory file")
    again = "make the runs of a trajectory file again, or with --seed one of them, and compare every bit"
    add("--reproduce", action="store_true", help=again)
    add("--scene", action="store_true", help="print the scene of a trajectory file, as a scene file (YAML)")
    allowed = "of a dataset, say only which runs failed; exit status 1 if they are more than N"
    add("--allow-failed", type=typed(Count), metavar="N", help=allowed)
    add("--variables", action="store_true", help="list the variables of a dataset with dimensions, units and meaning")


def inspect(arguments: Namespace) -> int:
    """Describe the contents of a trajectory file or dataset, and say whether it is intact.

    Of a figure, table, summary, page or movie it says what they were made from. `--reproduce` takes scene, engine,
    seeds and all settings from a trajectory file, makes its runs again, and ends with exit status 1 if a bit differs.
    `--allow-failed N` names the failed runs of a dataset and ends with exit status 1 if they are more than N. A study
    ends with this step.
    """
    _refuse_together(arguments)
    if arguments.allow_failed is not None:
        return _failed(arguments.file, arguments.allow_failed)

    from brownpipe import inspection
    from brownpipe.inspection.reports import PRODUCTS

    if arguments.reproduce:
        return _reproduce(arguments)
    if arguments.scene:
        lines = inspection.scene_text(arguments.file).splitlines()
    elif arguments.variables:
        lines = inspection.variables(arguments.file).split("\n")
    elif arguments.seed is None and Path(arguments.file).suffix.lower() in PRODUCTS:
        lines = inspection.describe_product(arguments.file)
    else:
        lines = inspection.report(arguments.file, arguments.seed).split("\n")
    show(*lines)
    return DONE


def _refuse_together(arguments: Namespace) -> None:
    """Raise RequestError for options that exclude each other."""
    options = ("scene", "variables", "reproduce", "allow_failed", "seed")
    given = [name for name in options if getattr(arguments, name) not in (None, False)]
    if len(given) > 1 and given != ["reproduce", "seed"]:
        raise RequestError(f"--{given[0]}: must not be given with --{given[1]}".replace("_", "-"))


def _failed(path: str, allowed: int) -> int:
    """Say which runs of a dataset failed, if any."""
    from brownpipe.analysis.varied import failed_runs

    failed, runs, cases = failed_runs(path)
    if not failed:
        return DONE
    status = FAILED if failed > allowed else DONE
    limit = f"allow_failed: {allowed} accepts no more" if status else f"accepted by allow_failed: {allowed}"
    which = f"{failed:,} of {runs:,} runs failed and are in no average, {limit}"
    return say(f"{path}: {which}: {cases}", status)


def _reproduce(arguments: Namespace) -> int:
    """Make runs of a trajectory file again and print whether they are the same."""
    from brownpipe import progress
    from brownpipe.inspection import reproduction

    original = reproduction.read_original(arguments.file, arguments.seed)
    show(*reproduction.announcement(original), flush=True)
    with progress.shown("inspect"):
        found = reproduction.differences(original)
    show(*reproduction.verdict(original, found).split("\n"))
    return FAILED if found else DONE
