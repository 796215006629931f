"""`brownpipe aggregate`: from trajectory files to one dataset."""

from argparse import Namespace
from collections.abc import Callable
from functools import partial

from brownpipe.errors import DONE, RequestError
from brownpipe.verbs.output import NETCDF, writable
from brownpipe.verbs.values import integer, key_value, positive, window

EXAMPLE = "results/runs/dilute/N200/exact-*/*.h5 --output dilute.nc"


def add_arguments(add: Callable) -> None:
    add("files", nargs="*", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc", help="dataset to write (netCDF4)")
    add("--study", metavar="STUDY", help="study file (YAML): analyse its files, and refuse any that holds other runs")
    replaced = "with --study: other values of its keys, as for `snakemake --config`"
    add("--config", nargs="+", type=key_value, default=[], metavar="KEY=VALUE", help=replaced)
    add("--list-runs", metavar="FILE", help="with --study: also write the folders and seeds of its runs")
    add("--plan", metavar="PLAN.yaml", help="with --study: the file that says how many runs its tolerance needs")
    windows = "where lines are fitted to the MSD (default: the last 90 %% and the last half of the shortest run)"
    add("--fit-windows", nargs="+", type=window, metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=positive, metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", nargs="+", type=positive, metavar="T", help=times)
    count = "of the displacement distribution, with --ring-width"
    add("--rings", type=partial(integer, least=1, most=100_000), metavar="COUNT", help=count)


def aggregate(arguments: Namespace) -> int:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their errors over runs.

    With `--study` instead of files, those in `results` of this folder are analysed as the study says. A file that holds
    other seeds, another scene or engine, or other records than the study asks for is refused by name.
    """
    from brownpipe import analysis, progress
    from brownpipe.storage import write_dataset, write_file

    _refuse_together(arguments)
    files, windows = arguments.files, arguments.fit_windows
    width, count, times = arguments.ring_width, arguments.rings, arguments.displacement_times
    if arguments.study is not None:
        from brownpipe.study import read_study
        from brownpipe.study.run_count import settled
        from brownpipe.study.run_sets import files_of, listed_runs

        study = settled(read_study(arguments.study, dict(arguments.config)), arguments.plan)
        files, windows, times = files_of(study), windows or study.fit_windows, times or study.displacement_times
        if study.rings and not (width or count):
            width, count = study.rings.dr, study.rings.count
    inputs = [getattr(file, "path", file) for file in files]
    output = writable(arguments.output, *inputs, suffixes=NETCDF)
    with progress.shown("aggregate"):
        dataset = analysis.aggregate(files, windows, width, count, times or ())
    write_dataset(output, dataset)
    if arguments.study is not None and arguments.list_runs is not None:
        write_file(arguments.list_runs, "\n".join([*listed_runs(study), ""]).encode())
    return DONE


def _refuse_together(arguments: Namespace) -> None:
    """Raise RequestError unless either files or a study are given."""
    if arguments.study is not None and arguments.files:
        raise RequestError(f"--study {arguments.study}: must not be given with files ({arguments.files[0]})")
    if arguments.study is None and not arguments.files:
        raise RequestError("FILE.h5: missing; give trajectory files, or a study with --study")
    if arguments.study is None and arguments.config:
        raise RequestError("--config: must not be given without --study")
