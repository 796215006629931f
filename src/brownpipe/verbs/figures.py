"""`brownpipe figures`: from a dataset to figures, tables and the summary."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.figures.catalogue import FIGURES
from brownpipe.verbs.output import folder, refuse_unwritable
from brownpipe.verbs.values import integer

EXAMPLE = "small.nc --output figures"


def add_arguments(add: Callable) -> None:
    """Add the arguments of the verb; `add` is `add_argument` of its parser."""
    add("dataset", metavar="DATASET.nc")
    add("--output", required=True, metavar="FOLDER")
    names = f"some of {', '.join(FIGURES)} (default: all)"
    add("--figures", nargs="+", choices=FIGURES, metavar="NAME", help=names)
    add("--particles", type=integer, metavar="N", help="show the runs with this many disks (default: 150)")


def figures(arguments: Namespace) -> int:
    """Draw the figures of a dataset, each with a table of its numbers, and write the summary."""
    from brownpipe import progress
    from brownpipe.errors import DONE, FigureError
    from brownpipe.figures import tradeoff
    from brownpipe.figures.render import render
    from brownpipe.figures.summary import summary
    from brownpipe.storage import read_dataset, write_file
    from brownpipe.tradeoff import is_tradeoff

    output = folder(arguments.output)
    dataset = read_dataset(arguments.dataset)
    refuse_unwritable(output, arguments.figures or FIGURES)
    if is_tradeoff(dataset):
        if arguments.figures or arguments.particles is not None:
            raise FigureError(f"{arguments.dataset}: a trade-off; it is shown as a whole")
        with progress.shown("figures"):
            tradeoff.render(dataset, output)
        return DONE
    with progress.shown("figures"):
        render(dataset, output, arguments.figures, arguments.particles)
    write_file(Path(output) / "summary.txt", summary(dataset).encode())
    return DONE
