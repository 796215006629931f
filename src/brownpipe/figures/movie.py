"""`brownpipe movie`: one whole run as a picture, an animation or a video."""

import io
import itertools
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from subprocess import CalledProcessError

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from brownpipe.errors import FigureError, RequestError
from brownpipe.figures.origin import Record, metadata
from brownpipe.figures.snapshot import COLOURS, WholeRun, scenery_of
from brownpipe.figures.style import drawing, image_bytes
from brownpipe.stages import tracked

SUFFIXES = (".gif", ".mp4", ".png")
DOTS = 100  # per inch, of an animation
GIF_RATES = (100 / 65535, 50.0)  # frames a second: a pause is two bytes [0.01 s], and viewers slow down shorter ones


def movie(run: WholeRun, suffix: str, record: Record, frames: int | None = None, fps: float = 25.0) -> bytes:
    """Return the bytes of a picture (`.png`), an animation (`.gif`) or else a video (`.mp4`) of one whole run.

    A picture shows the run at its end. An animation shows
    `frames` of its samples (default: all), equally spaced and ending with the last, at `fps` per second; a GIF
    rounds the time per frame to hundredths of a second. `record` goes into the metadata. The same run gives the same
    bytes, except for a video, which ffmpeg encodes.

    Raise RequestError for a rate that a GIF cannot have; for a video, FigureError if
    ffmpeg is not installed and OSError if it fails.
    """
    if suffix == ".gif" and not GIF_RATES[0] <= fps <= GIF_RATES[1]:
        allowed = f"from {GIF_RATES[0]:.3g} to {GIF_RATES[1]:g} frames a second for a .gif"
        raise RequestError(f"--fps: must be {allowed}, not {fps:.10g}; a .mp4 can have any rate")
    with drawing():
        figure, show = scenery_of(run)
        if suffix == ".png":
            show(len(run.times) - 1)
            return image_bytes(figure, "png", metadata(record))
        shown = samples_shown(len(run.times), frames)
        return (_gif if suffix == ".gif" else _video)(figure, show, shown, fps, json.dumps(record))


def samples_shown(samples: int, frames: int | None = None) -> np.ndarray:
    """Return the indices of the samples that an animation shows, of so many samples."""
    return np.unique(np.linspace(samples - 1, 0, frames or samples).round().astype(int))


def _gif(figure: Figure, show: Callable[[int], None], shown: np.ndarray, fps: float, comment: str) -> bytes:
    """Return the bytes of an animation that repeats forever."""
    figure.set_dpi(DOTS)
    canvas, palette, buffer = FigureCanvasAgg(figure), _palette(), io.BytesIO()

    def picture(k: int) -> Image.Image:
        show(k)
        canvas.draw()
        frame = Image.fromarray(np.array(canvas.buffer_rgba())[..., :3])
        return frame.quantize(palette=palette, dither=Image.Dither.NONE)

    pictures = map(picture, tracked(shown, "frames"))
    how = {"duration": 10 * round(100 / fps), "loop": 0, "comment": comment}
    next(pictures).save(buffer, "GIF", save_all=True, append_images=pictures, **how)
    return buffer.getvalue()


def _palette() -> Image.Image:
    """An image with the colours of the pictures as its palette and, for smooth edges, mixtures of any two of them."""
    colours = np.array([to_rgb(colour) for colour in COLOURS])
    pairs = np.array(list(itertools.combinations(colours, 2)))
    mixtures = [(1 - x) * pairs[:, 0] + x * pairs[:, 1] for x in (0.25, 0.5, 0.75)]
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.concatenate([colours, *mixtures])).round().astype(np.uint8).tobytes())
    return palette


def _video(figure: Figure, show: Callable[[int], None], shown: np.ndarray, fps: float, comment: str) -> bytes:
    """Return the bytes of an MP4 (H.264), encoded by ffmpeg."""
    if not FFMpegWriter.isAvailable():
        raise FigureError("movie: a .mp4 needs ffmpeg, which is not installed; choose a .gif, or install it")
    encoded = ["-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    writer = FFMpegWriter(fps, "libx264", metadata={"comment": comment}, extra_args=encoded)  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "movie.mp4"  # not a pipe: ffmpeg writes the index at the start, once it has all frames
        try:
            with writer.saving(figure, target, DOTS):
                for k in tracked(shown, "frames"):
                    show(k)
                    writer.grab_frame()
        except CalledProcessError as error:
            raise OSError(f"movie: ffmpeg failed with exit status {error.returncode}") from error
        return target.read_bytes()
