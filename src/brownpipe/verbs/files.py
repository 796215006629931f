"""The verbs of one file: what it contains, whether it is intact, a movie of a run, a run for other
programs.
"""

from argparse import Namespace
from pathlib import Path

from brownpipe import inspection, progress
from brownpipe.errors import DONE, FAILED, RequestError, StorageError
from brownpipe.inspection import reproduction
from brownpipe.inspection.reports import PRODUCTS, failed_runs
from brownpipe.scene.reading import AtLeastOne, Count, Positive
from brownpipe.storage.datasets import read_contents
from brownpipe.storage.export import FORMATS, export_runs
from brownpipe.storage.files import UNSEALED, has_lost_its_seal, write_file
from brownpipe.storage.trajectories import Trajectories, chosen_seed, read_trajectories
from brownpipe.study.verification import verify_results
from brownpipe.text import counted, in_bytes
from brownpipe.verbs import AddOption, Verb
from brownpipe.verbs.options import add_seed, refuse_together, typed
from brownpipe.verbs.output import PAGE, absent, suffix, writable
from brownpipe.verbs.screen import say, show

FPS = 25.0  # frames a second


def _inspect_options(add: AddOption) -> None:
    add("file", metavar="FILE", help="trajectory file, dataset, figure, table, page or movie")
    add_seed(add, "all about this run of a trajectory file")
    again = (
        "make the runs of a trajectory file again, or with --seed one of them, and compare every "
        "bit"
    )
    add("--reproduce", action="store_true", help=again)
    add(
        "--scene",
        action="store_true",
        help="print the scene of a trajectory file, as a scene file (YAML)",
    )
    allowed = "of a dataset, say only which runs failed; exit status 1 if they are more than N"
    add("--allow-failed", type=typed(Count), metavar="N", help=allowed)
    add(
        "--variables",
        action="store_true",
        help="list the variables of a dataset with dimensions, units and meaning",
    )


def inspect_file(arguments: Namespace) -> int:
    """Describe the contents of a trajectory file or dataset, and say whether it is intact.

    Of a figure, table, summary, page or movie it says what they were made from. `--reproduce` takes
    scene, engine, seeds and all settings from a trajectory file, makes its runs again, and ends
    with exit status 1 if a bit differs. `--allow-failed N` names the failed runs of a dataset and
    ends with exit status 1 if they are more than N. A study ends with this step.

    example: brownpipe inspect seed17.h5 --seed 17
    """
    refuse_together(
        arguments,
        "scene",
        "variables",
        "reproduce",
        "allow_failed",
        "seed",
        but=["reproduce", "seed"],
    )
    if arguments.allow_failed is not None:
        return _failed(arguments.file, arguments.allow_failed)
    if arguments.reproduce:
        return _reproduce(arguments)
    if arguments.scene:
        lines = inspection.scene_text(arguments.file).splitlines()
    elif arguments.variables:
        lines = inspection.table_of_variables(arguments.file).split("\n")
    elif arguments.seed is None and Path(arguments.file).suffix.lower() in PRODUCTS:
        lines = inspection.describe_product(arguments.file)
    else:
        lines = inspection.file_report(arguments.file, arguments.seed).split("\n")
    show(*lines)
    return DONE


def _failed(path: str, allowed: int) -> int:
    """Say which runs of a dataset failed, if any."""
    failed, runs, cases = failed_runs(path)
    if not failed:
        return DONE
    status = FAILED if failed > allowed else DONE
    limit = (
        f"allow_failed: {allowed} accepts no more"
        if status
        else f"accepted by allow_failed: {allowed}"
    )
    which = f"{failed:,} of {runs:,} runs failed and are in no average, {limit}"
    return say(f"{path}: {which}: {cases}", status)


def _reproduce(arguments: Namespace) -> int:
    """Make runs of a trajectory file again and print whether they are the same."""
    original = reproduction.read_original(arguments.file, arguments.seed)
    show(*reproduction.announcement(original), flush=True)
    with progress.shown("inspect"):
        differences = reproduction.differing_variables(original)
    show(*reproduction.comparison_in_words(original, differences).split("\n"))
    return FAILED if differences else DONE


def _verify_options(add: AddOption) -> None:
    what = "folder with the results of a study, or single trajectory files and datasets"
    add("paths", nargs="+", metavar="RESULTS", help=what)


def _harm(path: str) -> str:
    """Return what has happened to a file that is not intact, and the cure."""
    if has_lost_its_seal(path):
        return UNSEALED.format(verb="simulate")
    return "is damaged; delete it and run the study again"


def verify_files(arguments: Namespace) -> int:
    """Read every trajectory file, dataset and figure of a study and verify its checksum.

    Names every file that is damaged, and runs and figures that are missing; then the exit status is
    1. To make damaged files again, delete them and run the study. Nothing is written.

    example: brownpipe verify results/small
    """
    statuses: set[int] = {DONE}
    with progress.shown("verify"):
        for path in arguments.paths:
            try:
                if Path(path).is_dir():
                    intact, damaged, missing = verify_results(path)
                    wrong = [f"{file}: {_harm(file)}" for file in damaged]
                    wrong += [f"{file}: is missing; run the study again" for file in missing]
                    intact_files = f"{len(intact)} intact"
                    wrong_files = f"{len(damaged)} damaged, {len(missing)} missing"
                    show(*wrong, f"{path}: {intact_files}, {wrong_files}")
                    statuses.add(FAILED if damaged or missing else DONE)
                else:
                    read_contents(path)
                    show(f"{path}: intact")
            except StorageError as error:
                statuses.add(say(str(error), error.exit_status))
    return FAILED if FAILED in statuses else max(statuses)


def _movie_options(add: AddOption) -> None:
    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    add_seed(add, "the run to show (default: the first in the file)")
    add(
        "--output",
        metavar="FILE",
        help="*.gif, *.png or *.html (default: FILE.gif, in this folder)",
    )
    add("--frames", type=typed(AtLeastOne), metavar="COUNT", help="samples to show (default: all)")
    add(
        "--fps",
        type=typed(Positive),
        help="frames a second (default: 25); of a .gif at most 50, in steps of 0.01 s",
    )


def make_movie(arguments: Namespace) -> None:
    """Show one whole run of a trajectory file: a picture, an animation (GIF), or a web page.

    The file must have been recorded with `--record all`, for a page with `--record all,events`. The
    picture shows the end of the run. The page (HTML) replays the run from collision to collision,
    and needs no other file.

    example: brownpipe movie seed17.h5 --output seed17.gif
    """
    from brownpipe.figures.movie import SUFFIXES

    output = arguments.output or absent(f"{Path(arguments.file).stem}.gif")
    output = writable(output, arguments.file, suffixes=(*SUFFIXES, *PAGE))
    trajectories = read_trajectories(arguments.file)
    kind = suffix(output)
    if kind in PAGE:
        contents, summary = _page(trajectories, arguments)
    else:
        contents, summary = _frames(trajectories, arguments, kind)
    write_file(output, contents)
    show(f"{output}: {summary}, {in_bytes(len(contents))}")


def _frames(trajectories: Trajectories, arguments: Namespace, kind: str) -> tuple[bytes, str]:
    """Return a picture or animation, and what it shows."""
    from brownpipe.figures.movie import movie, samples_shown
    from brownpipe.figures.origin import movie_record

    frames = arguments.frames
    fps = arguments.fps or FPS
    whole = trajectories.ensemble.whole
    with progress.shown("movie"):
        seed = chosen_seed(trajectories, arguments.file, arguments.seed, whole)
        record = movie_record(trajectories, "all", seed, frames=frames, fps=fps)
        contents = movie(trajectories, seed, kind, record, frames, fps)
    if kind == ".png":
        return contents, counted(1, "frame")
    samples = samples_shown(len(trajectories.scene.times), frames)
    return contents, counted(len(samples), "frame")


def _page(trajectories: Trajectories, arguments: Namespace) -> tuple[bytes, str]:
    """Return the page that replays a run, and what it shows."""
    from brownpipe.report.replay import replay_page

    if arguments.frames or arguments.fps:
        raise RequestError(
            "--frames, --fps: must not be given for a page, which has every collision instead of "
            "frames"
        )
    return replay_page(trajectories, arguments.file, arguments.seed)


SCENE = "scene"  # in place of a format


def _export_options(add: AddOption) -> None:
    add(
        "file",
        metavar="FILE.h5",
        help="trajectory file with whole runs (simulate --record all); for csv, any",
    )
    add(
        "--to",
        required=True,
        choices=(*FORMATS, SCENE),
        metavar="FORMAT",
        help="gsd, xyz (extended XYZ), csv, or scene: the scene file of the runs",
    )
    add_seed(add, "the run to export (default: the first in the file; csv: all)")
    add(
        "--output",
        metavar="FILE",
        help="*.gsd, *.xyz, *.csv, or *.yaml of a scene (default: name of the file, in this "
        "folder)",
    )


def export_run(arguments: Namespace) -> None:
    """Export a run to GSD (HOOMD-blue, freud, MDAnalysis, OVITO), extended XYZ (ASE, OVITO, VMD) or
    a table (CSV).

    The file must have been recorded with `--record all`. Without whole runs, CSV has the tracers of
    all runs. GSD has single precision and the centre of the box at the origin, and needs the
    package gsd; XYZ and CSV have every digit. Unwrapped positions in a box
    with periodic sides are position + image * (width, height). A file that is there is not
    replaced.

    `--to scene` writes the scene of any runs, to be read again; disks that were in a file are
    written into NAME_disks.csv beside it.

    example: brownpipe export seed17.h5 --to gsd
    """
    kind = ".yaml" if arguments.to == SCENE else f".{arguments.to}"
    output = arguments.output or f"{Path(arguments.file).stem}{kind}"
    output = writable(output, arguments.file, suffixes=(kind,))
    absent(output, "choose another name for the output, or delete it")
    if arguments.to == SCENE:
        read_trajectories(arguments.file).scene.save(output)
        show(f"{output}: a scene, {in_bytes(Path(output).stat().st_size)}")
        return
    tracks, remarks = export_runs(
        read_trajectories(arguments.file), arguments.file, output, arguments.to, arguments.seed
    )
    for remark in remarks:
        say(f"{output}: {remark}", DONE)
    size = Path(output).stat().st_size
    show(f"{output}: {counted(len(tracks), 'run')}, {in_bytes(size)}")


INSPECT = Verb("inspect", inspect_file, _inspect_options)
VERIFY = Verb("verify", verify_files, _verify_options)
MOVIE = Verb("movie", make_movie, _movie_options)
EXPORT = Verb("export", export_run, _export_options)
