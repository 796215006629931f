"""`brownpipe movie`: one run as a picture, an animation, a video or a page that replays it."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE, RequestError
from brownpipe.formatting import counted, in_bytes
from brownpipe.verbs.output import PAGE, show, suffix, writable
from brownpipe.verbs.values import add_seed, typed

EXAMPLE = "seed17.h5 --output seed17.gif"
KINDS = ("gif", "mp4", "png", "html")
FPS = 25.0  # frames a second


def add_arguments(add: Callable) -> None:
    from brownpipe.scene.reading import AtLeastOne, Positive

    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    add_seed(add, "the run to show (default: the first in the file)")
    add("--to", choices=KINDS, metavar="KIND", help="gif, mp4, png or html (default: that of the output, or gif)")
    add("--output", metavar="FILE", help="*.gif, *.mp4, *.png or *.html (default: name of the file, in this folder)")
    add("--frames", type=typed(AtLeastOne), metavar="COUNT", help="samples to show (default: all)")
    add("--fps", type=typed(Positive), help="frames a second (default: 25); of a .gif at most 50, in steps of 0.01 s")


def movie(arguments: Namespace) -> int:
    """Show one whole run of a trajectory file: a picture, an animation (GIF), a video (MP4, by ffmpeg), or a web page.

    The file must have been recorded with `--record all`, for a page with `--record all,events`. The picture shows the
    end of the run. The page (HTML) replays the run from collision to collision, and needs no other file.
    """
    from brownpipe import progress
    from brownpipe.figures.movie import SUFFIXES, samples_shown
    from brownpipe.figures.movie import movie as moving
    from brownpipe.figures.origin import movie_record
    from brownpipe.figures.snapshot import whole_run
    from brownpipe.storage.files import write_file
    from brownpipe.storage.trajectories import read_trajectories

    suffixes = (*SUFFIXES, *PAGE) if arguments.to is None else (f".{arguments.to}",)
    name = f"{Path(arguments.file).stem}.{arguments.to or 'gif'}"
    output = writable(arguments.output or name, arguments.file, suffixes=suffixes)
    kind = suffix(output)
    if kind in PAGE:
        return _replay(arguments, output)
    trajectories, frames, fps = read_trajectories(arguments.file), arguments.frames, arguments.fps or FPS
    with progress.shown("movie"):
        run = whole_run(trajectories, arguments.file, arguments.seed)
        record = movie_record(trajectories, "all", run.seed, frames=frames, fps=fps)
        contents = moving(run, kind, record, frames, fps)
    write_file(output, contents)
    count = len(samples_shown(len(run.times), frames)) if kind != ".png" else 1
    show(f"{output}: {counted(count, 'frame')}, {in_bytes(len(contents))}")
    return DONE


def _replay(arguments: Namespace, output: str) -> int:
    """Write the page that replays a run."""
    from brownpipe.figures.origin import movie_record
    from brownpipe.figures.replay import RECORD, is_whole, replay_of, replay_page
    from brownpipe.storage.files import write_file
    from brownpipe.storage.trajectories import read_trajectories

    for option in ("frames", "fps"):
        if getattr(arguments, option) is not None:
            raise RequestError(f"--{option}: must not be given for a page, which has every collision instead of frames")
    trajectories = read_trajectories(arguments.file)
    replay = replay_of(trajectories, arguments.file, arguments.seed)
    contents = replay_page(replay, movie_record(trajectories, RECORD, replay.seed))
    write_file(output, contents)
    shown = counted(len(replay.time), "collision")
    part = "" if is_whole(replay) else f" of {replay.collisions:,}, up to time {replay.end:.3g}"
    show(f"{output}: {shown}{part}, {in_bytes(len(contents))}")
    return DONE
