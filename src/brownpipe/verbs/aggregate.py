"""`brownpipe aggregate`: from trajectory files to one dataset."""

from argparse import Namespace
from collections.abc import Callable

from brownpipe.errors import RequestError
from brownpipe.formatting import counted
from brownpipe.verbs.output import NETCDF, show, writable
from brownpipe.verbs.values import add_runs_of_study, list_runs, several, study_of, typed, window

EXAMPLE = "results/runs/dilute/N200/exact-*/*.h5 --output dilute.nc"


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import AtLeastOne, Positive

    add("files", nargs="*", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc", help="dataset to write (netCDF4)")
    instead = "study file (YAML), in place of FILE.h5 and the options below: analyse its runs as it says"
    add("--study", metavar="STUDY", help=instead)
    add_runs_of_study(add)
    windows = "where lines are fitted to the MSD (default: two that begin when motion is diffusive)"
    add("--fit-windows", type=several(window), metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=typed(Positive), metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", type=several(typed(Positive)), metavar="T", help=times)
    count = "of the displacement distribution, with --ring-width"
    add("--rings", type=typed(AtLeastOne), metavar="COUNT", help=count)


def aggregate(arguments: Namespace) -> None:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their errors over runs.

    With `--study` instead of files, those in `results` of this folder are analysed as the study says. A file that holds
    other seeds, another scene or engine, or other records than the study asks for is refused by name.
    """
    from brownpipe import analysis, progress
    from brownpipe.storage.datasets import write_dataset
    from brownpipe.study.run_sets import files_of

    _refuse_together(arguments)
    files, windows, times = arguments.files, arguments.fit_windows, arguments.displacement_times
    width, count, study = arguments.ring_width, arguments.rings, None
    if arguments.study is not None:
        study = study_of(arguments)
        files, times = files_of(study), study.displacement_times
        windows = study.fit_windows if "fit_windows" in study.model_fields_set else None
        width, count = (study.rings.dr, study.rings.count) if study.rings else (None, None)
    inputs = [getattr(file, "path", file) for file in files]
    output = writable(arguments.output, *inputs, suffixes=NETCDF)
    with progress.shown("aggregate"):
        dataset = analysis.aggregate(files, windows, width, count, times or (), *(study.varied_keys if study else ()))
    write_dataset(output, dataset)
    if study is not None:
        list_runs(study, arguments)
    show(f"{output}: {counted(len(inputs), 'file')}, {counted(int(dataset.runs.sum()), 'run')}")


def _refuse_together(arguments: Namespace) -> None:
    """Raise RequestError unless either files and options, or a study are given."""
    own = ("files", "fit_windows", "displacement_times", "ring_width", "rings")
    of_study = ("config", "list_runs", "plan")
    for name in own if arguments.study else of_study:
        if getattr(arguments, name):
            raise RequestError(f"{name}: must not be given {'with' if arguments.study else 'without'} --study")
    if not arguments.study and not arguments.files:
        raise RequestError("FILE.h5: missing; give trajectory files, or a study with --study")
