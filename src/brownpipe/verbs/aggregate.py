"""`brownpipe aggregate`: from trajectory files to one dataset."""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.errors import DONE
from brownpipe.verbs.output import NETCDF, writable
from brownpipe.verbs.values import positive, rings, window

EXAMPLE = "results/small/simulate/*/*/*/*.h5 --output small.nc"


def add_arguments(add: Callable) -> None:
    """Add the arguments of the verb; `add` is `add_argument` of its parser."""
    add("files", nargs="+", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc")
    windows = "where lines are fitted to the MSD (default: the last 90 %% and the last half of the shortest run)"
    add("--fit-windows", nargs="+", type=window, metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=positive, metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", nargs="+", type=positive, metavar="T", help=times)
    add("--rings", type=rings, metavar="COUNT", help="of the displacement distribution, with --ring-width")


def aggregate(arguments: Namespace) -> int:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their errors over runs."""
    from brownpipe import analysis, progress
    from brownpipe.storage import write_dataset

    output = writable(arguments.output, *arguments.files, kinds=NETCDF)
    settings = (arguments.fit_windows, arguments.ring_width, arguments.rings, arguments.displacement_times)
    with progress.shown("aggregate"):
        dataset = analysis.aggregate(arguments.files, *settings)
    write_dataset(output, dataset)
    return DONE
