"""`brownpipe tradeoff`: cost and bias of the engines of a study."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, RequestError
from brownpipe.quoting import shell_path
from brownpipe.verbs.output import NETCDF, writable
from brownpipe.verbs.values import window

EXAMPLE = "config/tradeoff.yaml"


def add_arguments(add: Callable) -> None:
    """Add the arguments of the verb; `add` is `add_argument` of its parser."""
    add("study", metavar="STUDY", help="study file (YAML)")
    add("--files", nargs="+", metavar="FILE.h5", help="trajectory files (default: those of the study)")
    add("--output", metavar="DATASET.nc", help="(default: results/STUDY/tradeoff/STUDY.nc)")
    fitted = "where the line for D is fitted (default: from a tenth of each run to its end)"
    add("--fit-window", type=window, metavar="T0:T1", help=fitted)


def tradeoff(arguments: Namespace) -> int:
    """Measure the cost-accuracy trade-off: bias and CPU time of every engine of a study, relative to its exact runs.

    Compares the trajectory files of the study, or those given by --files, and runs each engine for some seconds to
    measure its cost. `brownpipe figures` draws the figures and tables of the dataset.
    """
    from brownpipe import progress
    from brownpipe import tradeoff as comparison
    from brownpipe.storage import write_dataset
    from brownpipe.study import read_study

    study = read_study(arguments.study)
    results = f"results/{study.name}"
    files = arguments.files or [f"{results}/simulate/{job.file}" for job in study.jobs()]
    missing = [file for file in files if not Path(file).exists()]
    if missing and not arguments.files:
        first = f"brownpipe run {shell_path(arguments.study)} ({missing[0]} is missing)"
        raise RequestError(f"{arguments.study}: has no results yet; run it first: {first}")
    output = writable(arguments.output or f"{results}/tradeoff/{study.name}.nc", arguments.study, *files, kinds=NETCDF)
    with progress.shown("tradeoff"):
        dataset = comparison.measure(files, dict(study.instead_of), arguments.fit_window)
    write_dataset(output, dataset)
    return DONE
