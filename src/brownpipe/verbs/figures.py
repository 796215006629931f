"""`brownpipe figures`: from a dataset to figures, tables and the summary."""

from argparse import Namespace
from collections.abc import Callable
from typing import Literal

from brownpipe.figures.catalogue import FIGURES
from brownpipe.formatting import counted
from brownpipe.verbs.output import PAGE, folder, show, writable
from brownpipe.verbs.values import add_particles, several, typed

EXAMPLE = "small.nc --output figures"


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import AtLeastOne

    add("dataset", metavar="DATASET.nc", help="dataset of `brownpipe aggregate`")
    add("--output", required=True, metavar="FOLDER", help="folder for the figures, tables and the summary")
    add("--page", metavar="FILE.html", help="also write a page with all results, in one file")
    names = f"names joined by commas, some of {', '.join(FIGURES)} (default: all)"
    add("--figures", type=several(typed(Literal[tuple(FIGURES)])), metavar="NAMES", help=names)
    add_particles(add, "show the runs with this many disks (default: the most)")
    add("--panel", type=several(str), metavar="NAMES", help="draw what differs in these labels in panels of its own")
    add("--title", metavar="TEXT", help="of the study, above the answer and the page")
    add("--note", metavar="TEXT", help="what the study is about, at the top of the page")
    cores = "draw so many figures at the same time (default: 1); the files are the same"
    add("--cores", type=typed(AtLeastOne), metavar="N", default=1, help=cores)


def figures(arguments: Namespace) -> None:
    """Draw the figures of a dataset, each with a table of its numbers, and write the summary.

    provenance.json in the folder says what they were made from, and so do the pictures in their metadata. Those of
    an earlier drawing are removed. Files that brownpipe did not make are neither replaced nor removed.
    """
    from brownpipe import progress
    from brownpipe.report.products import read, write

    output = folder(arguments.output)
    given = {name: getattr(arguments, name) for name in ("figures", "particles", "panel", "title", "note")}
    dataset, record = read(arguments.dataset, given)
    page = arguments.page and writable(arguments.page, arguments.dataset, suffixes=PAGE)
    with progress.shown("figures"):
        written = write(dataset, output, record, page=page, cores=arguments.cores)
    show(f"{output}: {counted(len(written), 'file')}" + (f", all on one page: {page}" if page else ""))
