"""`brownpipe movie`: one run as a picture, an animation or a video."""

import json
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from brownpipe.errors import DONE
from brownpipe.verbs.output import number, show, suffix, writable
from brownpipe.verbs.values import frames, integer, positive

EXAMPLE = "seed17.h5 --output seed17.gif"


def add_arguments(add: Callable) -> None:
    """Add the arguments of the verb; `add` is `add_argument` of its parser."""
    add("file", metavar="FILE.h5", help="trajectory file with whole runs (simulate --record all)")
    add("--seed", type=integer, metavar="SEED", help="the run to show (default: the first in the file)")
    add("--output", metavar="FILE", help="*.gif, *.mp4 or *.png (default: name of the file, .gif)")
    add("--frames", type=frames, metavar="COUNT", help="samples to show (default: all)")
    add("--fps", type=positive, default=25.0, help="frames a second (default: 25)")


def movie(arguments: Namespace) -> int:
    """Show one whole run of a trajectory file: a picture, an animation (GIF), or a video (MP4, by ffmpeg).

    The file must have been recorded with `--record all`. The picture shows the end of the run.
    """
    from brownpipe import progress
    from brownpipe.figures.movie import SUFFIXES, samples_shown
    from brownpipe.figures.movie import movie as moving
    from brownpipe.figures.origin import movie_record, stamped
    from brownpipe.formatting import in_bytes
    from brownpipe.storage import read_trajectories, write_file

    output = writable(arguments.output or f"{Path(arguments.file).stem}.gif", arguments.file, kinds=SUFFIXES)
    trajectories, kind = read_trajectories(arguments.file), suffix(output)
    with progress.shown("movie"):
        record = movie_record(trajectories, arguments.file, arguments.seed, arguments.frames, arguments.fps)
        options = (arguments.seed, arguments.frames, arguments.fps, json.dumps(record))
        contents = stamped(moving(trajectories, arguments.file, kind, *options), f"movie{kind}", record)
    write_file(output, contents)
    count = len(samples_shown(len(trajectories.ensemble.times), arguments.frames)) if kind != ".png" else 1
    show(f"{output}: {number(count, 'frame')}, {in_bytes(len(contents))}")
    return DONE
