"""One whole run in pictures, for `brownpipe movie`: every disk to scale, the tracer in colour with
its path so far.

A picture shows the end of the run; an animation its samples.
"""

import io
import json
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from PIL import Image

from brownpipe.errors import RequestError
from brownpipe.figures.origin import Record, metadata
from brownpipe.figures.style import DATA, INK, drawing, image_bytes
from brownpipe.observables.trajectory import Track
from brownpipe.progress import tracked
from brownpipe.scene import Scene
from brownpipe.scene.species import species_table
from brownpipe.storage.trajectories import Trajectories
from brownpipe.text import counted

SUFFIXES = (".gif", ".png")
DOTS = 100  # per inch, of an animation
# Frames a second: a pause is two bytes [0.01 s], and viewers slow down shorter ones
GIF_RATES = (100 / 65535, 50.0)
LONGER_SIDE = 5.6  # of the box [inch]
LEAST_WIDTH = 3.6  # of the panel [inch]
BESIDE = 0.36  # margin of the panel to both sides [inch]
ABOVE = 0.9  # margin of the panel above and below, without the legend [inch]
LINE = 0.19  # height of a line of the legend [inch]
# Colours of disk 0 and of the others, by species
FACES = np.array(["#B5DAF0", "#DADADA", "#A9A9A9", "#F1E2B8", "#8FB8A8"])
RIM = "#858585"  # edge of the other disks


def scenery_of(scene: Scene, seed: int, track: Track) -> tuple[Figure, Callable[[int], None]]:
    """Return the figure of a run with box, disks and path, and the function that sets them to
    sample k.

    The function is to be called within the context `style.drawing`, as this one.
    """
    shades = shades_of(scene)
    figure, axes = _box(scene, f"{scene.title}, seed {seed}", shades)
    disks = EllipseCollection(
        [], [], 0, units="xy", offset_transform=axes.transData, linewidths=0.5
    )
    axes.add_collection(disks)
    (path,) = axes.plot([], [], color=DATA, linewidth=1.2)
    (centre,) = axes.plot([], [], "o", color=DATA, markersize=3.5)
    start = track.position[0, 0]
    axes.plot(*start, "o", color=DATA, markersize=3.5, markerfacecolor="white", zorder=3)
    time = axes.set_title("", loc="right", fontweight="normal", fontsize=10)
    points, ends = path_of(track)

    def show(k: int) -> None:
        centres, indices = with_images(scene, track.position[k])
        diameters = 2 * scene.radius[indices]
        disks.set_offsets(centres)
        disks.set_widths(diameters)
        disks.set_heights(diameters)
        disks.set_facecolor(FACES[shades[indices]])
        disks.set_edgecolor(np.where(indices == 0, DATA, RIM).tolist())
        path.set_data(*points[: ends[k]].T)
        centre.set_data(*track.position[k, :1].T)
        time.set_text(f"$t$ = {scene.times[k]:#.4g}")

    show(len(scene.times) - 1)
    figure.draw_without_rendering()  # computes the layout, which all frames share
    figure.set_layout_engine(None)
    return figure, show


# --- the background


def shades_of(scene: Scene) -> np.ndarray:
    """Index (N,) of each disk's colour in FACES: 0 for disk 0, then one per species, in their
    order.
    """
    _, rank = np.unique(species_table(scene).species_index[1:], return_inverse=True)
    return np.append(0, 1 + rank % (len(FACES) - 1))


def _box(scene: Scene, title: str, shades: np.ndarray) -> tuple[Figure, Axes]:
    """The figure and the axes of the empty box, with solid sides for hard walls and dashed
    periodic ones.
    """
    sides = np.array([scene.box.width, scene.box.height])
    width, height = LONGER_SIDE * sides / sides.max()
    entries = legend_entries(scene, shades)
    size = np.array([max(width, LEAST_WIDTH) + BESIDE, height + ABOVE + LINE * len(entries)])
    even_size = np.ceil(50 * size) / 50  # an even number of pixels, as videos need
    figure = Figure(even_size, layout="constrained")
    axes = figure.add_subplot(
        aspect="equal", xlim=scene.box.x, ylim=scene.box.y, xticks=[], yticks=[]
    )
    for side, spine in axes.spines.items():
        is_periodic = scene.box.periodic_x if side in ("left", "right") else scene.box.periodic_y
        spine.set(visible=True, color=INK, linewidth=1.2 if is_periodic else 2.5)
        spine.set_linestyle((0, (4, 3)) if is_periodic else "-")
    _draw_legend(figure, entries, title)
    sides_in_words = f"{scene.box.width:g} x {scene.box.height:g} (reduced units)"
    axes.set_xlabel(f"{sides_in_words}, {scene.box.sides_in_words}", loc="left", fontsize=8.8)
    return figure, axes


def _draw_legend(figure: Figure, entries: Sequence[tuple[int, str]], title: str) -> None:
    """Put the title and a disk in the colours of each entry above the box."""
    mark = partial(Line2D, [], [], linestyle="", marker="o", markersize=8)
    marks = []
    for shade, text in entries:
        edge = RIM if shade else DATA
        marks.append(mark(mfc=FACES[shade], mec=edge, label=text))
    figure.legend(
        handles=marks,
        title=title,
        title_fontproperties=FontProperties(size=11, weight="bold"),
        loc="outside upper left",
        handlelength=1,
        borderpad=0,
        borderaxespad=0.9,
        alignment="left",
    )


def legend_entries(scene: Scene, shades: np.ndarray) -> list[tuple[int, str]]:
    """Shade and text of each entry of the legend."""
    entries = []
    for shade in np.unique(shades):
        members = shades == shade
        radius = _range(scene.radius[members])
        mass = _range(scene.mass[members])
        name = counted(int(members.sum()), "other disk") if shade else "tracer and its path"
        entries.append((shade, f"{name}: radius {radius}, mass {mass}"))
    return entries


def _range(values: np.ndarray) -> str:
    low, high = values.min(), values.max()
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"


# --- disks and path


def with_images(scene: Scene, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres (M, 2) and indices (M,) of all disks and of the images that reach into the box over
    periodic sides; disk 0 is last.
    """
    box = scene.box
    columns = (-1, 0, 1) if box.periodic_x else (0,)
    rows = (-1, 0, 1) if box.periodic_y else (0,)
    tiles = np.array([*product(columns, rows)])
    indices = np.repeat(np.arange(scene.particles)[::-1], len(tiles))
    images = np.tile(tiles, (scene.particles, 1))
    centres = position[indices] + images * box.size
    middle = np.array(box.origin) + box.size / 2
    reach = box.size / 2 + scene.radius[indices, None]
    reaches_in = (np.abs(centres - middle) < reach).all(axis=1)
    is_disk = ~images.any(axis=1)
    seen = reaches_in | is_disk
    return centres[seen], indices[seen]


def path_of(track: Track) -> tuple[np.ndarray, np.ndarray]:
    """The path of disk 0 as points (P, 2), and the number of points up to each sample (T,).

    It has a gap, a point of NaN, where the disk leaves a periodic box and enters at the opposite
    edge.
    """
    points = track.position[:, 0]
    ends = np.arange(1, len(points) + 1)
    if track.image is None:
        return points, ends
    crossings = np.flatnonzero(np.diff(track.image[:, 0], axis=0).any(axis=1))
    gaps_before = np.searchsorted(crossings, ends - 1)
    return np.insert(points, crossings + 1, np.nan, axis=0), ends + gaps_before


# --- pictures, animations


def movie(
    trajectories: Trajectories,
    seed: int,
    suffix: str,
    record: Record,
    frames: int | None = None,
    fps: float = 25.0,
) -> bytes:
    """Return the bytes of a picture (`.png`) or an animation (`.gif`) of one whole run.

    A picture shows the run at its end. An animation shows `frames` of its samples (default: all),
    equally spaced and ending with the last, at `fps` per second; a GIF rounds the time per frame to
    hundredths of a second. `record` goes into the metadata. The same run gives the same bytes.
    Raise RequestError for a rate that a GIF cannot have.
    """
    if suffix == ".gif" and not GIF_RATES[0] <= fps <= GIF_RATES[1]:
        low, high = GIF_RATES
        raise RequestError(
            f"--fps: must be from {low:.3g} to {high:g} frames a second for a .gif, not {fps:.10g}"
        )
    scene = trajectories.scene
    with drawing():
        figure, show = scenery_of(scene, seed, trajectories.ensemble.whole[seed])
        if suffix == ".png":
            return image_bytes(figure, "png", metadata(record))
        shown = samples_shown(len(scene.times), frames)
        return _gif(figure, show, shown, fps, json.dumps(record))


def samples_shown(samples: int, frames: int | None = None) -> np.ndarray:
    """Return the indices of those of `samples` samples that an animation of `frames` frames
    shows.
    """
    return np.unique(np.linspace(samples - 1, 0, frames or samples).round().astype(int))


def _gif(
    figure: Figure, show: Callable[[int], None], shown: np.ndarray, fps: float, comment: str
) -> bytes:
    """Return the bytes of an animation that repeats forever, in the colours of its last picture."""
    figure.set_dpi(DOTS)
    canvas = FigureCanvasAgg(figure)

    def picture(k: int) -> Image.Image:
        show(k)
        canvas.draw()
        return Image.fromarray(np.array(canvas.buffer_rgba())[..., :3])

    colours = picture(shown[-1]).quantize(method=Image.Quantize.FASTOCTREE)
    pictures = (
        picture(k).quantize(palette=colours, dither=Image.Dither.NONE)
        for k in tracked(shown, "frames")
    )
    options = {"duration": 10 * round(100 / fps), "loop": 0, "comment": comment}
    buffer = io.BytesIO()
    next(pictures).save(buffer, "GIF", save_all=True, append_images=pictures, **options)
    return buffer.getvalue()
