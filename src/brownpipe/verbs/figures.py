"""`brownpipe figures`: from a dataset to figures, tables and the summary."""

from argparse import Namespace
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from brownpipe.errors import DONE, RequestError
from brownpipe.figures.catalogue import FIGURES
from brownpipe.verbs.output import PAGE, folder, refuse_unwritable, say, writable
from brownpipe.verbs.values import integer

if TYPE_CHECKING:
    from brownpipe.figures.origin import Record
    from brownpipe.figures.replay import Fragment

EXAMPLE = "small.nc --output figures"


def add_arguments(add: Callable) -> None:
    add("dataset", metavar="DATASET.nc", help="dataset of `brownpipe aggregate`")
    add("--output", required=True, metavar="FOLDER", help="folder for the figures, tables and the summary")
    add("--page", metavar="FILE.html", help="also write a page with all results, in one file")
    add("--replay", metavar="RUN.h5", help="one run (simulate --record all,events), replayed in this page")
    names = f"some of {', '.join(FIGURES)} (default: all)"
    add("--figures", nargs="+", choices=FIGURES, metavar="NAME", help=names)
    count = "show the runs with this many disks (default: 150 or, if there are none, the most)"
    add("--particles", type=integer, metavar="N", help=count)
    cores = "draw so many figures at the same time (default: 1); the files are the same"
    add("--cores", type=partial(integer, least=1), metavar="N", default=1, help=cores)


def figures(arguments: Namespace) -> int:
    """Draw the figures of a dataset, each with a table of its numbers, and write the summary.

    provenance.json in the folder says what they were made from, and so do the pictures in their metadata. `SHA256SUMS`,
    written last, has the checksums of all files and of the dataset: `sha256sum --check SHA256SUMS`.
    """
    from brownpipe.parallel import limit_threads

    limit_threads(arguments.cores)
    from brownpipe import progress
    from brownpipe.figures.cases import of_file
    from brownpipe.report.products import read, write
    from brownpipe.storage.checksums import write_checksums
    from brownpipe.tradeoff import is_tradeoff

    output = folder(arguments.output)
    dataset, record = read(arguments.dataset, arguments.figures, arguments.particles)
    refuse_unwritable(output, arguments.figures or FIGURES)
    page = arguments.page and writable(arguments.page, arguments.dataset, suffixes=PAGE)
    if arguments.replay and not page:
        raise RequestError("--replay: is shown in a page; must be given together with --page")
    if arguments.replay and is_tradeoff(dataset):
        raise RequestError(f"--replay: {arguments.dataset} is a trade-off, whose page replays no run")
    replay = _replay(arguments.replay, record) if arguments.replay else None
    with progress.shown("figures"), of_file(arguments.dataset):
        files = write(dataset, output, record, page=page, replay=replay, cores=arguments.cores)
    write_checksums(output, [*files, arguments.dataset])
    return DONE


def _replay(path: str, record: "Record") -> "Fragment | None":
    """Return the replay of the first run in a file, for the page with this record.

    If it cannot be replayed, or the dataset of the page does not have its scene, say so and return None.
    """
    from brownpipe.figures.replay import replay_fragment
    from brownpipe.storage import read_trajectories

    try:
        trajectories = read_trajectories(path)
        digests = {runs["scene_digest"] for runs in record["dataset"].get("made_from", [])}
        if trajectories.scene.digest not in digests:
            raise RequestError(f"{path}: its scene is none of those in the dataset")
        return replay_fragment(trajectories, path)
    except RequestError as error:
        say(f"the page has no replay: {error}", DONE)
        return None
