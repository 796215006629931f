"""The verbs of results: from trajectory files to a dataset, figures and a trade-off."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe import analysis, needs, progress
from brownpipe import tradeoff as comparison
from brownpipe.analysis.dataset import refuse_windows
from brownpipe.errors import RequestError, RunError
from brownpipe.scene.reading import AtLeastOne, Positive, choice_of
from brownpipe.storage.datasets import read_dataset, write_dataset
from brownpipe.storage.files import seal_of, write_file
from brownpipe.storage.store import StoredFile
from brownpipe.study import Study, read_study
from brownpipe.study.plan import with_planned_seeds
from brownpipe.study.run_sets import digests, files_of, listed_runs
from brownpipe.study.study import Window
from brownpipe.text import counted, from_ascii, shell_path
from brownpipe.verbs import AddOption, Verb
from brownpipe.verbs.options import add_config, add_particles, several, typed
from brownpipe.verbs.output import FILES, NETCDF, PAGE, suffix, writable
from brownpipe.verbs.screen import show

if TYPE_CHECKING:
    from xarray import Dataset

    from brownpipe.figures.origin import Record


def _aggregate_options(add: AddOption) -> None:
    add("files", nargs="*", metavar="FILE.h5", help="trajectory files of one study, in any order")
    add("--output", required=True, metavar="DATASET.nc", help="dataset to write (netCDF4)")
    instead = (
        "study file (YAML), in place of FILE.h5 and the options below: analyse its runs as it says"
    )
    add("--study", metavar="STUDY", help=instead)
    _add_runs_of_study(add)
    windows = "where lines are fitted to the MSD (default: two that begin when motion is diffusive)"
    add("--fit-windows", type=several(typed(Window, "T0:T1")), metavar="T0:T1", help=windows)
    width = "of the displacement distribution, with --rings (default: from the data)"
    add("--ring-width", type=typed(Positive), metavar="DR", help=width)
    times = "of the displacement distribution (default: the end of each run)"
    add("--displacement-times", type=several(typed(Positive)), metavar="T", help=times)
    count = "of the displacement distribution, with --ring-width"
    add("--rings", type=typed(AtLeastOne), metavar="COUNT", help=count)


def aggregate_runs(arguments: Namespace) -> None:
    """Analyse trajectory files: one dataset of displacements, fits and distributions, with their
    errors over runs.

    With `--study` instead of files, those in `results` of this folder are analysed as the study
    says. A file that holds other seeds, another scene or engine, or other records than the study
    asks for is refused by name.

    example: brownpipe aggregate results/runs/dilute/N200/exact-*/*.h5 --output dilute.nc
    """
    _refuse_together(arguments)
    study = None if arguments.study is None else _study(arguments, "aggregate")
    if study is None:
        files = arguments.files
        inputs = arguments.files
    else:
        files = files_of(study)
        inputs = [str(file.path) for file in files]
    output = writable(arguments.output, *inputs, suffixes=NETCDF)
    with progress.shown("aggregate"):
        if study is None:
            dataset = analysis.aggregate(
                files,
                windows=arguments.fit_windows,
                dr=arguments.ring_width,
                rings=arguments.rings,
                displacement_times=arguments.displacement_times or (),
            )
        else:
            dataset = _aggregate_study(study, files)
    _write(output, dataset, study, arguments)
    runs = counted(int(dataset.runs.sum()), "run")
    show(f"{output}: {counted(len(inputs), 'file')}, {runs}")


def _aggregate_study(study: Study, files: Sequence[StoredFile]) -> "Dataset":
    """Return the dataset of a study with its windows, rings, times and varied keys."""
    return analysis.aggregate(
        files,
        windows=study.asked_windows,
        dr=study.rings.dr if study.rings else None,
        rings=study.rings.count if study.rings else None,
        displacement_times=study.displacement_times,
        vary=[*study.vary],
        vary_together=study.vary_together,
    )


def _refuse_together(arguments: Namespace) -> None:
    """Raise RequestError unless either files and options, or a study are given."""
    refused = ["config", "list_runs", "plan"]
    where = "without"
    if arguments.study:
        refused = ["files", "fit_windows", "displacement_times", "ring_width", "rings"]
        where = "with"
    for name in refused:
        if getattr(arguments, name):
            raise RequestError(f"{name}: must not be given {where} --study")
    if not arguments.study and not arguments.files:
        raise RequestError("FILE.h5: missing; give trajectory files, or a study with --study")


def _figures_options(add: AddOption) -> None:
    add(
        "dataset",
        metavar="DATASET.nc",
        help="dataset of `brownpipe aggregate` or `brownpipe tradeoff`",
    )
    add(
        "--output",
        required=True,
        metavar="FOLDER",
        help="folder for the figures, tables and the summary",
    )
    add("--page", metavar="FILE.html", help="also write a page with all results, in one file")
    names = f"names joined by commas, some of {', '.join(needs.FIGURES)} (default: all)"
    add(
        "--figures",
        type=several(typed(choice_of(needs.FIGURES))),
        metavar="NAMES",
        help=names,
    )
    add_particles(add, "show the runs with this many disks (default: the most)")
    add(
        "--panel",
        type=several(str),
        metavar="NAMES",
        help="draw what differs in these labels in panels of its own",
    )
    above = "of the study, above the answer and the page"
    add("--title", type=from_ascii, metavar="TEXT", help=above)
    about = "what the study is about, at the top of the page"
    add("--note", type=from_ascii, metavar="TEXT", help=about)
    add(
        "--planned",
        metavar="SHA256",
        help="refuse a dataset that was not made from the study in its present state",
    )
    cores = "draw so many figures at the same time (default: 1); the files are the same"
    add("--cores", type=typed(AtLeastOne), metavar="N", default=1, help=cores)


def draw_figures(arguments: Namespace) -> None:
    """Draw the figures of a dataset, each with a table of its numbers, and write the summary.

    provenance.json in the folder says what they were made from, and so do the pictures in their
    metadata. Those of an earlier drawing are removed. Files that brownpipe did not make are neither
    replaced nor removed.

    example: brownpipe figures small.nc --output figures
    """
    from brownpipe.figures.origin import record_of
    from brownpipe.report.products import write  # takes 0.5 s

    output = arguments.output
    folder = Path(output)
    if not folder.is_dir() and (folder.exists() or suffix(output) in FILES):
        raise RequestError(f"{output}: the output must be a folder, not a file")
    dataset = read_dataset(arguments.dataset)
    if arguments.planned not in (None, dataset.attrs.get("planned")):
        raise RequestError(
            f"{arguments.dataset}: is not of this study as it is; delete it and run the study again"
        )
    if arguments.planned is not None and not dataset.runs.any():
        raise RunError(
            f"{arguments.dataset}: all runs failed, and there is nothing to draw; "
            f"brownpipe inspect {shell_path(arguments.dataset)} says why"
        )
    page = arguments.page and writable(arguments.page, arguments.dataset, suffixes=PAGE)
    with progress.shown("figures"):
        record = record_of(dataset, seal_of(arguments.dataset), _options_given(arguments))
        written = write(dataset, output, record, page=page, cores=arguments.cores)
    line = f"{output}: {counted(len(written), 'file')}"
    if page:
        line += f", all on one page: {page}"
    show(line)


def _options_given(arguments: Namespace) -> "Record":
    """Return the options that say what is drawn, as far as they are given."""
    options: Record = {}
    if arguments.figures is not None:
        options["figures"] = arguments.figures
    if arguments.particles is not None:
        options["particles"] = arguments.particles
    if arguments.panel is not None:
        options["panel"] = arguments.panel
    if arguments.title is not None:
        options["title"] = arguments.title
    if arguments.note is not None:
        options["note"] = arguments.note
    return options


def _tradeoff_options(add: AddOption) -> None:
    add("study", metavar="STUDY", help="study file (YAML)")
    _add_runs_of_study(add)
    add(
        "--output",
        metavar="DATASET.nc",
        help="dataset to write (default: results/STUDY/tradeoff/STUDY.nc)",
    )
    fitted = "where the line for D is fitted (default: from a tenth of each run to its end)"
    add("--fit-window", type=typed(Window, "T0:T1"), metavar="T0:T1", help=fitted)


def measure_tradeoff(arguments: Namespace) -> None:
    """Measure the cost-accuracy trade-off: bias and CPU time of every engine of a study, relative
    to its exact runs.

    Compares the trajectory files of the study, and runs each engine for some seconds to measure its
    cost. A file that holds other runs than the study asks for is refused by name.
    `brownpipe figures` draws the figures and tables of the dataset.

    example: brownpipe tradeoff config/tradeoff.yaml
    """
    study = _study(arguments, "tradeoff")
    study.refuse_tradeoff()
    windows = [arguments.fit_window] if arguments.fit_window else []
    refuse_windows(windows, [case.times for case in study.cases])
    expected = files_of(study)
    inputs = [str(file.path) for file in expected]
    missing = [path for path in inputs if not Path(path).exists()]
    if missing:
        first = f"brownpipe run {shell_path(arguments.study)} ({missing[0]} is missing)"
        raise RequestError(f"{arguments.study}: has no results yet; run it first: {first}")
    default = f"results/{study.name}/tradeoff/{study.name}.nc"
    output = writable(arguments.output or default, arguments.study, *inputs, suffixes=NETCDF)
    with progress.shown("tradeoff"):
        dataset = comparison.measure(expected, dict(study.instead_of), arguments.fit_window)
    _write(output, dataset, study, arguments)
    show(f"{output}: figures and tables by brownpipe figures {shell_path(output)} --output FOLDER")


def _add_runs_of_study(add: AddOption) -> None:
    """Add the options of a verb that makes a dataset of the runs of a study, besides the study
    itself.
    """
    add_config(add)
    plan = (
        "the file that says how many runs the tolerance of the study needs; nothing for a study "
        "with seeds"
    )
    add("--plan", nargs="?", metavar="PLAN.yaml", help=plan)
    add("--planned", metavar="SHA256", help="of all that the dataset is made from; stored in it")
    add(
        "--list-runs",
        metavar="FILE",
        help="also write the folders and seeds of the runs of the study",
    )


def _study(arguments: Namespace, step: str) -> Study:
    """Return the study, with its number of runs. Raises RequestError if it is not the one that
    --planned says.
    """
    study = with_planned_seeds(read_study(arguments.study, dict(arguments.config)), arguments.plan)
    if arguments.planned not in (None, digests(study)[step]):
        raise RequestError(f"{arguments.study}: has changed since it was planned; run it again")
    return study


def _write(output: str, dataset: "Dataset", study: Study | None, arguments: Namespace) -> None:
    """Write a dataset and, if that is asked for, the list of the runs of its study."""
    if arguments.planned:
        dataset = dataset.assign_attrs(planned=arguments.planned)
    write_dataset(output, dataset)
    if study is not None and arguments.list_runs is not None:
        write_file(arguments.list_runs, "\n".join([*listed_runs(study), ""]).encode())


AGGREGATE = Verb("aggregate", aggregate_runs, _aggregate_options)
FIGURES = Verb("figures", draw_figures, _figures_options)
TRADEOFF = Verb("tradeoff", measure_tradeoff, _tradeoff_options)
