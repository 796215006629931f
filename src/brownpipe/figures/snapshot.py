"""A picture of one whole run: every disk to scale, the followed one in colour with the path it has left behind it."""

from typing import NamedTuple

import numpy as np

from brownpipe.errors import FigureError
from brownpipe.figures.style import DATA, INK, drawing, image_bytes
from brownpipe.scene.seeds import seed_text

LONGEST, SHORTEST = 5.6, 3.6  # of the panel: the longer side of the box, the least width [inch]
SIDE, BELOW, ABOVE, LINE = 0.18, 0.4, 0.46, 0.19  # margins, and a line of the key [inch]
FACES = np.array(["#B5DAF0", "#DADADA", "#A9A9A9", "#F1E2B8", "#8FB8A8"])  # of disk 0 and of the others, by kind
RIM = "#858585"
COLOURS = ("#FFFFFF", INK, DATA, RIM, *FACES)


class Run(NamedTuple):
    """One whole run as a picture needs it."""

    scene: object  # brownpipe.scene.Scene
    seed: int
    times: np.ndarray  # (T,)
    position: np.ndarray  # (T, N, 2) inside the box
    image: np.ndarray | None  # (T, 2) periodic images that disk 0 has crossed


class Scenery(NamedTuple):
    """A figure with a function that shows it at a sample, `show(k)`, and the artists that this changes."""

    figure: object
    moving: tuple
    show: object


def whole_run(trajectories, path, seed=None):
    """The whole run of a seed, or the first that there is, of the trajectories in the file at `path`.

    Raises FigureError if the file holds no whole runs, none of this seed, or no disks.
    """
    whole = trajectories.ensemble.whole
    if not whole:
        raise FigureError(f"{path}: holds no whole runs; make it again: brownpipe simulate SCENE --record all")
    if seed is not None and seed not in whole:
        raise FigureError(f"{path}: seed {seed} is not in it; its whole runs have the seeds {seed_text(sorted(whole))}")
    if not trajectories.scene.particles:
        raise FigureError(f"{path}: its scene has no disks to show")
    seed = min(whole) if seed is None else seed
    track = whole[seed]
    image = None if track.image is None else track.image[:, 0]
    return Run(trajectories.scene, seed, trajectories.ensemble.times, track.position, image)


def snapshot(run):
    """The bytes of a PNG that shows a run at its last sample. The same run gives the same bytes."""
    with drawing():
        scenery = scenery_of(run)
        scenery.show(len(run.times) - 1)
        return image_bytes(scenery.figure, "png")


def scenery_of(run):
    """The box, the disks and the path, ready to be shown at any sample; to be used while `style.drawing` holds."""
    kinds = _kinds(run.scene)
    axes = _stage(run.scene, f"{run.scene.name}, N = {run.scene.particles}, seed {run.seed}", kinds)
    disks = _disks(axes)
    (path,) = axes.plot([], [], color=DATA, linewidth=1.2)
    (here,) = axes.plot([], [], "o", color=DATA, markersize=3.5)
    axes.plot(*run.position[0, 0], "o", color=DATA, markersize=3.5, markerfacecolor="white", zorder=3)
    clock = axes.set_title("", loc="right", fontweight="normal", fontsize=10)
    track, ends = _path(run)

    def show(k):
        centres, which = _with_images(run.scene, run.position[k])
        disks.set_offsets(centres)
        disks.set_widths(2 * run.scene.radius[which])
        disks.set_heights(2 * run.scene.radius[which])
        disks.set_facecolors(FACES[kinds[which]])
        disks.set_edgecolors(np.where(which == 0, DATA, RIM))
        path.set_data(*track[: ends[k]].T)
        here.set_data(*run.position[k, :1].T)
        clock.set_text(_time_text(run.times, k))

    return Scenery(axes.figure, (disks, path, here, clock), show)


# --- what stands still


def _kinds(scene):
    """(N,) the shade of each disk: 0 is disk 0, then one for each radius and mass in order of their first disk."""
    alike = np.stack([scene.radius, scene.mass])[:, 1:]
    _, first, kind = np.unique(alike, axis=1, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.append(0, 1 + rank[kind.ravel()] % (len(FACES) - 1))


def _stage(scene, title, kinds):
    """The axes of the empty box, its sides solid where there are walls and dashed where it repeats itself."""
    from matplotlib.figure import Figure

    scale = LONGEST / max(scene.box.width, scene.box.height)
    width, height, words = scene.box.width * scale, scene.box.height * scale, _words(scene, kinds)
    size = np.array([max(width, SHORTEST) + 2 * SIDE, height + BELOW + ABOVE + LINE * len(words)])
    size = np.ceil(50 * size) / 50  # an even number of pixels at 100 to the inch, as videos want
    figure = Figure(size)
    axes = figure.add_axes((0.5 - width / size[0] / 2, BELOW / size[1], width / size[0], height / size[1]))
    axes.set(xlim=scene.box.x, ylim=scene.box.y, xticks=[], yticks=[])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(visible=True, color=INK, linewidth=1.2 if scene.box.periodic else 2.5)
        spine.set_linestyle((0, (4, 3)) if scene.box.periodic else "-")
    figure.text(SIDE / size[0], 1 - 0.12 / size[1], title, fontsize=11, fontweight="bold", va="top")
    _key(figure, words, SIDE / size[0], 1 - (0.12 + 0.2) / size[1])
    _scale(axes, scene.box, height)
    return axes


def _words(scene, kinds):
    """What each shade stands for: (shade, text)."""
    words = []
    for kind in np.unique(kinds):
        mine = kinds == kind
        radius, mass = (_range(values[mine]) for values in (scene.radius, scene.mass))
        name = "followed, with its path" if kind == 0 else f"{np.count_nonzero(mine):,} others"
        words.append((kind, f"{name}: radius {radius}, mass {mass}"))
    return words


def _range(values):
    low, high = values.min(), values.max()
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"


def _key(figure, words, x, y):
    from matplotlib.lines import Line2D

    rims = [DATA if kind == 0 else RIM for kind, _ in words]
    marks = [
        Line2D([], [], linestyle="", marker="o", markersize=8, markerfacecolor=FACES[kind], markeredgecolor=rim)
        for (kind, _), rim in zip(words, rims, strict=True)
    ]
    texts = [text for _, text in words]
    figure.legend(marks, texts, loc="upper left", bbox_to_anchor=(x, y), borderpad=0, borderaxespad=0, handlelength=1)


def _scale(axes, box, height):
    """A bar below the box, of a round length; `height` is that of the panel [inch]."""
    most = box.width / 4
    length = 10.0 ** np.floor(np.log10(most))
    length *= max(step for step in (1, 2, 5) if step * length <= most)
    at = {"transform": axes.get_xaxis_transform(), "clip_on": False}
    axes.plot([box.x[0], box.x[0] + length], [-0.2 / height] * 2, color=INK, linewidth=3, solid_capstyle="butt", **at)
    sides = "periodic" if box.periodic else "hard walls"
    text = f"  {length:g} (reduced units); {sides}"
    axes.text(box.x[0] + length, -0.2 / height, text, va="center_baseline", fontsize=8.8, **at)


# --- what moves


def _disks(axes):
    """Circles in units of the box."""
    from matplotlib.collections import EllipseCollection

    disks = EllipseCollection([], [], 0, units="xy", offset_transform=axes.transData, linewidths=0.5)
    return axes.add_collection(disks)


def _with_images(scene, position):
    """Centres (M, 2) and indices (M,) of all disks, and of the images that reach into a periodic box; disk 0 last."""
    which, box = np.arange(scene.particles)[::-1], scene.box
    centres = position[which]
    if not box.periodic:
        return centres, which
    for axis, (low, high) in enumerate((box.x, box.y)):
        step = np.eye(2)[axis] * (high - low)
        over = centres[:, axis] > high - scene.radius[which]
        under = centres[:, axis] < low + scene.radius[which]
        centres = np.concatenate([centres[over] - step, centres[under] + step, centres])
        which = np.concatenate([which[over], which[under], which])
    order = np.argsort(which == 0, kind="stable")
    return centres[order], which[order]


def _path(run):
    """The path of disk 0 as points (P, 2), and how many of them (T,) there are up to each sample.

    Where it leaves a periodic box, the path goes on beyond the edge and, after a gap, comes in at the other one.
    """
    track, ends = run.position[:, 0], np.arange(1, len(run.times) + 1)
    if run.image is None:
        return track, ends
    crossed = np.flatnonzero(np.diff(run.image, axis=0).any(axis=1))
    shift = np.diff(run.image, axis=0)[crossed] * (run.scene.box.width, run.scene.box.height)
    between = np.stack([track[crossed + 1] + shift, np.full_like(shift, np.nan), track[crossed] - shift], axis=1)
    points = np.insert(track, np.repeat(crossed + 1, 3), between.reshape(-1, 2), axis=0)
    return points, ends + 3 * np.searchsorted(crossed, np.arange(len(run.times)))


def _time_text(times, k):
    """The time of sample k, with as many decimals as the step to its nearest neighbour has, to one per cent."""
    step = np.abs(np.delete(times, k) - times[k]).min(initial=max(times[-1], 1e-9))
    decimals = next((d for d in range(9) if abs(round(step, d) - step) < 0.01 * step), 9)
    return f"$t$ = {times[k]:.{decimals}f}"
