"""`brownpipe movie`: one whole run as a picture, an animation, or a video."""

import contextlib
import io
import itertools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from brownpipe.errors import FigureError
from brownpipe.figures.snapshot import COLOURS, scenery_of, snapshot, whole_run
from brownpipe.figures.style import drawing

KINDS = (".gif", ".mp4", ".png")
DOTS = 100  # per inch, of an animation


def movie(trajectories, path, kind, seed=None, frames=None, fps=25.0):
    """The bytes of a picture (`.png`), an animation (`.gif`) or a video (`.mp4`) of one whole run.

    `path` is the file that the trajectories came from. The picture shows the run at its end. An animation shows
    `frames` of its samples, evenly spread and the last among them (default: all), `fps` of them a second (a GIF counts
    in hundredths of a second). The same run gives the same bytes, except for a video, which ffmpeg makes.
    Raises FigureError for a file without this run, for another kind, or for a video if there is no ffmpeg.
    """
    if kind not in KINDS:
        raise FigureError(f"movie: the output must end in {', '.join(KINDS[:-1])} or {KINDS[-1]}, not {kind!r}")
    run = whole_run(trajectories, path, seed)
    if kind == ".png":
        return snapshot(run)
    with drawing():
        return (_gif if kind == ".gif" else _video)(_frames(run, samples_shown(len(run.times), frames)), fps)


def samples_shown(samples, frames=None):
    """The indices of the samples that an animation shows."""
    return np.unique(np.linspace(samples - 1, 0, frames or samples).round().astype(int))


def _frames(run, shown):
    """One picture after the other, (height, width, 3) bytes each. What stands still is drawn once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, moving, show = scenery_of(run)
    figure.set_dpi(DOTS)
    canvas = FigureCanvasAgg(figure)
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for k in shown:
        canvas.restore_region(background)
        show(k)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.array(canvas.buffer_rgba())[..., :3]


def _gif(frames, fps):
    """The bytes of an animation that repeats for ever."""
    from PIL import Image

    palette, buffer = _palette(), io.BytesIO()
    pictures = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    pause = 10 * max(2, round(100 / fps))  # [ms]; viewers slow down what is faster
    next(pictures).save(buffer, "GIF", save_all=True, append_images=pictures, duration=pause, loop=0)
    return buffer.getvalue()


def _palette():
    """The colours of the pictures and, for smooth rims, what lies between any two of them."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    colours = np.array([to_rgb(colour) for colour in COLOURS])
    pairs = np.array(list(itertools.combinations(colours, 2)))
    between = [(1 - x) * pairs[:, 0] + x * pairs[:, 1] for x in (0.25, 0.5, 0.75)]
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.concatenate([colours, *between])).round().astype(np.uint8).tobytes())
    return palette


def _video(frames, fps):
    """The bytes of an MP4 (H.264), made by ffmpeg from raw frames."""
    if shutil.which("ffmpeg") is None:
        raise FigureError("movie: a .mp4 needs ffmpeg, which is not installed; choose a .gif, or install it")
    first = next(frames)
    size = f"{first.shape[1]}x{first.shape[0]}"
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-video_size", size, "-framerate", f"{fps:g}", "-i", "-"]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "movie.mp4"  # an MP4 cannot be made in a pipe: its index comes last and stands first
        made = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target)]
        started = subprocess.Popen(["ffmpeg", "-loglevel", "error", *raw, *made], stdin=subprocess.PIPE)
        with contextlib.suppress(BrokenPipeError), started as ffmpeg:  # it may have ended; what it says is below
            for frame in itertools.chain([first], frames):
                ffmpeg.stdin.write(frame.tobytes())
        if started.returncode or not target.exists():
            raise OSError(f"movie: ffmpeg failed with exit status {started.returncode}")
        return target.read_bytes()
