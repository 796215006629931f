"""`brownpipe tradeoff`: cost and bias of the engines of a study."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import RequestError
from brownpipe.quoting import shell_path
from brownpipe.verbs.output import NETCDF, show, writable
from brownpipe.verbs.values import add_runs_of_study, list_runs, study_of, window

EXAMPLE = "config/tradeoff.yaml"


def add_arguments(add: Callable) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    add("--files", nargs="+", metavar="FILE.h5", help="trajectory files (default: those of the study)")
    add_runs_of_study(add)
    add("--output", metavar="DATASET.nc", help="dataset to write (default: results/STUDY/tradeoff/STUDY.nc)")
    fitted = "where the line for D is fitted (default: from a tenth of each run to its end)"
    add("--fit-window", type=window, metavar="T0:T1", help=fitted)


def tradeoff(arguments: Namespace) -> None:
    """Measure the cost-accuracy trade-off: bias and CPU time of every engine of a study, relative to its exact runs.

    Compares the trajectory files of the study, or those given by --files, and runs each engine for some seconds to
    measure its cost. A file of the study that holds other runs than the study asks for is refused by name.
    `brownpipe figures` draws the figures and tables of the dataset.
    """
    from brownpipe import progress
    from brownpipe import tradeoff as comparison
    from brownpipe.storage import write_dataset
    from brownpipe.study.run_sets import files_of

    study = study_of(arguments)
    expected = files_of(study)
    inputs = arguments.files or [file.path for file in expected]
    missing = [path for path in inputs if not Path(path).exists()]
    if missing and not arguments.files:
        first = f"brownpipe run {shell_path(arguments.study)} ({missing[0]} is missing)"
        raise RequestError(f"{arguments.study}: has no results yet; run it first: {first}")
    default = f"results/{study.name}/tradeoff/{study.name}.nc"
    output = writable(arguments.output or default, arguments.study, *inputs, suffixes=NETCDF)
    with progress.shown("tradeoff"):
        dataset = comparison.measure(arguments.files or expected, dict(study.instead_of), arguments.fit_window)
    write_dataset(output, dataset)
    list_runs(study, arguments)
    show(f"{output}: figures and tables by brownpipe figures {shell_path(output)} --output FOLDER")
