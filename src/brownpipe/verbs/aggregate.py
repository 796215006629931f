"""`brownpipe aggregate`: from trajectory files to one dataset."""

from argparse import Namespace
from collections.abc import Callable
from functools import partial

from brownpipe.errors import DONE, RequestError
from brownpipe.verbs.output import NETCDF, writable
from brownpipe.verbs.values import integer, key_value, positive, window

EXAMPLE = "results/small/simulate/*/*/*/*.h5 --output small.nc"


def add_arguments(add: Callable) -> None:
    add("files", nargs="*", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc", help="dataset to write (netCDF4)")
    add("--study", metavar="STUDY", help="study file (YAML): analyse its files, and refuse any that holds other runs")
    replaced = "with --study: other values of its keys, as for `snakemake --config`"
    add("--config", nargs="+", type=key_value, default=[], metavar="KEY=VALUE", help=replaced)
    windows = "where lines are fitted to the MSD (default: the last 90 %% and the last half of the shortest run)"
    add("--fit-windows", nargs="+", type=window, metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=positive, metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", nargs="+", type=positive, metavar="T", help=times)
    count = "of the displacement distribution, with --ring-width"
    add("--rings", type=partial(integer, least=1, most=100_000), metavar="COUNT", help=count)
    cores = "analyse so many scenes, particle counts and engines at the same time (default: 1); the dataset is the same"
    add("--cores", type=partial(integer, least=1), metavar="N", default=1, help=cores)


def aggregate(arguments: Namespace) -> int:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their errors over runs.

    With `--study` instead of files, those in `results` of this folder are analysed as the study says. A file that holds
    other seeds, another scene or engine, or other records than the study asks for is refused by name.
    """
    from brownpipe.parallel import limit_threads

    limit_threads(arguments.cores)
    from brownpipe import analysis, progress
    from brownpipe.storage import write_dataset

    _refuse_together(arguments)
    files, windows = arguments.files, arguments.fit_windows
    width, count, times = arguments.ring_width, arguments.rings, arguments.displacement_times
    if arguments.study is not None:
        from brownpipe.study.expectation import expected_files, read_settled

        study = read_settled(arguments.study, dict(arguments.config))
        files, windows, times = expected_files(study), windows or study.fit_windows, times or study.displacement_times
        width, count = (width, count) if width or count else (study.ring_width, study.rings)
    inputs = [getattr(file, "path", file) for file in files]
    output = writable(arguments.output, *inputs, suffixes=NETCDF)
    with progress.shown("aggregate"):
        dataset = analysis.aggregate(files, windows, width, count, times or (), arguments.cores)
    write_dataset(output, dataset)
    return DONE


def _refuse_together(arguments: Namespace) -> None:
    """Raise RequestError unless either files or a study are given."""
    if arguments.study is not None and arguments.files:
        raise RequestError(f"--study {arguments.study}: must not be given with files ({arguments.files[0]})")
    if arguments.study is None and not arguments.files:
        raise RequestError("FILE.h5: missing; give trajectory files, or a study with --study")
    if arguments.study is None and arguments.config:
        raise RequestError("--config: must not be given without --study")
