"""`brownpipe movie`: one run as a picture, an animation, a video or a page that replays it."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from brownpipe.errors import RequestError
from brownpipe.formatting import counted, in_bytes
from brownpipe.verbs.output import PAGE, show, suffix, writable
from brownpipe.verbs.values import add_seed, typed

if TYPE_CHECKING:
    from brownpipe.storage.trajectories import Trajectories

EXAMPLE = "seed17.h5 --output seed17.gif"
FPS = 25.0  # frames a second


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import AtLeastOne, Positive

    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    add_seed(add, "the run to show (default: the first in the file)")
    add("--output", metavar="FILE", help="*.gif, *.mp4, *.png or *.html (default: FILE.gif, in this folder)")
    add("--frames", type=typed(AtLeastOne), metavar="COUNT", help="samples to show (default: all)")
    add("--fps", type=typed(Positive), help="frames a second (default: 25); of a .gif at most 50, in steps of 0.01 s")


def movie(arguments: Namespace) -> None:
    """Show one whole run of a trajectory file: a picture, an animation (GIF), a video (MP4, by ffmpeg), or a web page.

    The file must have been recorded with `--record all`, for a page with `--record all,events`. The picture shows the
    end of the run. The page (HTML) replays the run from collision to collision, and needs no other file.
    """
    from brownpipe.figures.movie import SUFFIXES
    from brownpipe.storage.files import write_file
    from brownpipe.storage.trajectories import read_trajectories

    output = arguments.output or f"{Path(arguments.file).stem}.gif"
    output = writable(output, arguments.file, suffixes=(*SUFFIXES, *PAGE))
    made = _page if suffix(output) in PAGE else _frames
    contents, shown = made(read_trajectories(arguments.file), arguments, suffix(output))
    write_file(output, contents)
    show(f"{output}: {shown}, {in_bytes(len(contents))}")


def _frames(trajectories: "Trajectories", arguments: Namespace, kind: str) -> tuple[bytes, str]:
    """Return a picture, animation or video, and what it shows."""
    from brownpipe import progress
    from brownpipe.figures.movie import movie, samples_shown, whole_run
    from brownpipe.figures.origin import movie_record

    frames, fps = arguments.frames, arguments.fps or FPS
    with progress.shown("movie"):
        run = whole_run(trajectories, arguments.file, arguments.seed)
        record = movie_record(trajectories, "all", run.seed, frames=frames, fps=fps)
        contents = movie(run, kind, record, frames, fps)
    return contents, counted(len(samples_shown(len(run.times), frames)) if kind != ".png" else 1, "frame")


def _page(trajectories: "Trajectories", arguments: Namespace, _: str) -> tuple[bytes, str]:
    """Return the page that replays a run, and what it shows."""
    from brownpipe.figures.origin import movie_record
    from brownpipe.figures.replay import RECORD, is_whole, replay_of, replay_page

    for option in ("frames", "fps"):
        if getattr(arguments, option) is not None:
            raise RequestError(f"--{option}: must not be given for a page, which has every collision instead of frames")
    replay = replay_of(trajectories, arguments.file, arguments.seed)
    contents = replay_page(replay, movie_record(trajectories, RECORD, replay.seed))
    part = "" if is_whole(replay) else f" of {replay.collisions:,}, up to time {replay.end:.3g}"
    return contents, f"{counted(len(replay.time), 'collision')}{part}"
