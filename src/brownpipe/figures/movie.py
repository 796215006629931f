"""`brownpipe movie`: one whole run as a picture, an animation or a video."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from brownpipe.errors import FigureError, RequestError
from brownpipe.figures.origin import Record, metadata
from brownpipe.figures.snapshot import COLOURS, WholeRun, scenery_of, snapshot, whole_run
from brownpipe.figures.style import drawing
from brownpipe.stages import remark, tracked

if TYPE_CHECKING:
    from PIL.Image import Image

    from brownpipe.storage import Trajectories

SUFFIXES = (".gif", ".mp4", ".png")
DOTS = 100  # per inch, of an animation
PAUSES = (2, 65535)  # of a frame of a GIF [0.01 s], two bytes: viewers slow down shorter ones


def movie(
    trajectories: Trajectories,
    path: str,
    suffix: str,
    seed: int | None = None,
    frames: int | None = None,
    fps: float = 25.0,
    record: Record | None = None,
) -> bytes:
    """Return the bytes of a picture (`.png`), an animation (`.gif`) or else a video (`.mp4`) of one whole run.

    `path` is the file of the trajectories, for messages. A picture shows the run at its end. An animation shows
    `frames` of its samples (default: all), equally spaced and ending with the last, at `fps` per second. A GIF
    rounds the time per frame to hundredths of a second; a remark says which rate that gives. `record` goes into the
    metadata. The same run gives the same bytes, except for a video, which ffmpeg encodes.

    Raise RequestError for a file without this run, and for a rate that a GIF cannot have; for a video, FigureError if
    ffmpeg is not installed and OSError if it fails.
    """
    pause = _pause(fps) if suffix == ".gif" else 0
    run = whole_run(trajectories, path, seed)
    if suffix == ".png":
        return snapshot(run, metadata(record or {}))
    comment = json.dumps(record)
    with drawing():
        pictures = _frames(run, samples_shown(len(run.times), frames))
        return _gif(pictures, pause, comment) if suffix == ".gif" else _video(pictures, fps, comment)


def samples_shown(samples: int, frames: int | None = None) -> np.ndarray:
    """Return the indices of the samples that an animation shows, of so many samples."""
    return np.unique(np.linspace(samples - 1, 0, frames or samples).round().astype(int))


def _frames(run: WholeRun, shown: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the pictures, (height, width, 3) uint8. The background is drawn once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, moving, show = scenery_of(run)
    figure.set_dpi(DOTS)
    canvas = FigureCanvasAgg(figure)
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for k in tracked(shown, "frames"):
        canvas.restore_region(background)
        show(k)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]


def _pause(fps: float) -> int:
    """Return for how long a GIF shows each frame [0.01 s]; remark on a rate that differs from `fps`."""
    least, most = PAUSES
    if not 100 / most <= fps <= 100 / least:
        allowed = f"from {100 / most:.3g} to {100 / least:g} frames a second for a .gif"
        raise RequestError(f"--fps: must be {allowed}, not {fps:.10g}; a .mp4 can have any rate")
    pause = round(100 / fps)
    if f"{100 / pause:.3g}" != f"{fps:.3g}":
        rate = f"{100 / pause:.3g} frames a second instead of {fps:g}"
        remark(f"--fps: {rate}, because a .gif shows each frame for a whole number of hundredths of a second")
    return pause


def _gif(frames: Iterator[np.ndarray], pause: int, comment: str) -> bytes:
    """The bytes of an animation that repeats forever and shows each frame for a time `pause` [0.01 s]."""
    from PIL import Image

    palette = _palette()
    buffer = io.BytesIO()
    pictures = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    how = {"duration": 10 * pause, "loop": 0, "comment": comment}
    next(pictures).save(buffer, "GIF", save_all=True, append_images=pictures, **how)
    return buffer.getvalue()


def _palette() -> Image:
    """An image with the colours of the pictures as its palette and, for smooth edges, mixtures of any two of them."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    colours = np.array([to_rgb(colour) for colour in COLOURS])
    pairs = np.array(list(itertools.combinations(colours, 2)))
    mixtures = [(1 - x) * pairs[:, 0] + x * pairs[:, 1] for x in (0.25, 0.5, 0.75)]
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.concatenate([colours, *mixtures])).round().astype(np.uint8).tobytes())
    return palette


def _video(frames: Iterator[np.ndarray], fps: float, comment: str) -> bytes:
    """The bytes of an MP4 (H.264), encoded by ffmpeg from raw frames."""
    if shutil.which("ffmpeg") is None:
        raise FigureError("movie: a .mp4 needs ffmpeg, which is not installed; choose a .gif, or install it")
    first = next(frames)
    size = f"{first.shape[1]}x{first.shape[0]}"
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-video_size", size, "-framerate", f"{fps:g}", "-i", "-"]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "movie.mp4"  # not a pipe: ffmpeg writes the index at the start, once it has all frames
        encoded = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        encoded += ["-metadata", f"comment={comment}", str(target)]
        started = subprocess.Popen(["ffmpeg", "-loglevel", "error", *raw, *encoded], stdin=subprocess.PIPE)
        with contextlib.suppress(BrokenPipeError), started as ffmpeg:  # if it ended early, its exit status says so
            for frame in itertools.chain([first], frames):
                ffmpeg.stdin.write(frame.tobytes())
        if started.returncode or not target.exists():
            raise OSError(f"movie: ffmpeg failed with exit status {started.returncode}")
        return target.read_bytes()
