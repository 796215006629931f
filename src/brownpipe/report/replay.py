"""The replay of one run, a web page or a part of one: every collision, and straight flight between
them, at any speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of
collisions determine every position at every time. The page gets these numbers, and `replay.js`
computes the positions.
"""

from html import escape
from typing import NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.movie import legend_entries, shades_of, with_images
from brownpipe.figures.origin import movie_record
from brownpipe.report.templates import filled
from brownpipe.scene import Scene
from brownpipe.storage.trajectories import Trajectories, chosen_seed, runs_record
from brownpipe.text import counted

# Collisions in a replay: some 350 kB
MOST_COLLISIONS = 5000
# What `--record` must be given
RECORD = "all,events"
# Longer side of the picture over the shorter one at most, as in `replay.js`
ELONGATION = 6
FRAME_HEIGHT = 860  # of a page in a notebook [pixel]
MARGIN = 0.012  # around the box, for its sides, in longer sides of the picture


class Circle(NamedTuple):
    """A disk, or an image of it across a periodic side, in a picture whose y points down."""

    x: float
    y: float
    radius: float
    shade: int


class Rectangle(NamedTuple):
    """A rectangle in a picture whose y points down."""

    left: float
    top: float
    width: float
    height: float


class Side(NamedTuple):
    """A side of the box from one corner to another, in a picture whose y points down."""

    x: tuple[float, float]
    y: tuple[float, float]
    periodic: bool


class Still(NamedTuple):
    """The picture of a run at t = 0, for print and where scripts do not run."""

    picture: Rectangle  # with a margin
    window: Rectangle  # the part of the box that is shown
    sides: list[Side]
    circles: list[Circle]  # the tracer last, on top


class ReplayPage(NamedTuple):
    """A web page with the replay of a run, which notebooks show by themselves."""

    contents: bytes
    extent: str  # how many of the collisions it has, in words

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own: its scripts know nothing of the notebook."""
        page = escape(self.contents.decode(), quote=True)
        style = f"width: 100%; height: {FRAME_HEIGHT}px; border: 0"
        return f'<iframe srcdoc="{page}" style="{style}" title="{self.extent}"></iframe>'


class Replay(NamedTuple):
    """What `replay_section.html` shows of one run."""

    title: str
    extent: str  # how many of its collisions it has, in words
    legend: list[tuple[int, str]]  # shade and meaning
    data: dict[str, object]  # from which `replay.js` computes all positions
    still: Still


def replay_page(trajectories: Trajectories, path: str, seed: int | None = None) -> ReplayPage:
    """Return a web page with the replay of a run.

    It ends where MOST_COLLISIONS are reached. `path` is the file of the trajectories, for messages;
    the run is that of `seed`, by default of the smallest. The same run gives the same bytes.

    Raises RequestError for a file without this run, its tracks or its collisions.
    """
    seed = _seed_of(trajectories, path, seed)
    replay = replay_of(trajectories, seed)
    page = filled(
        "replay.html",
        replay=replay,
        record=movie_record(trajectories, RECORD, seed),
    )
    return ReplayPage(page, replay.extent)


def replay_of(trajectories: Trajectories, seed: int) -> Replay:
    """Return the replay of the run of a seed, which has its tracks and its collisions."""
    scene = trajectories.scene
    events = trajectories.ensemble.events[seed]
    shades = shades_of(scene)
    end = scene.duration
    extent = counted(len(events.time), "collision")
    if len(events.time) > MOST_COLLISIONS:
        end = float(events.time[MOST_COLLISIONS])
        extent = f"the first {MOST_COLLISIONS:,} of {extent}, until t = {end:.3g}"
    return Replay(
        title=f"{scene.title}, seed {seed}",
        extent=extent,
        legend=legend_entries(scene, shades),
        data=_motion(trajectories, seed, shades) | {"end": end},
        still=still_of(scene, trajectories.ensemble.whole[seed].position[0], shades),
    )


def still_of(scene: Scene, position: np.ndarray, shades: np.ndarray) -> Still:
    """Return the picture of disks at positions (N, 2) with their `shades` (N,): all of the box or,
    of a very long one, the part around the tracer.
    """
    box = scene.box
    longest = ELONGATION * min(box.width, box.height)
    size = np.minimum(box.size, longest)
    low = np.array(box.origin)
    corner = np.clip(position[0] - size / 2, low, low + box.size - size)
    left, bottom = corner.tolist()
    width, height = size.tolist()
    window = Rectangle(left, -bottom - height, width, height)
    margin = MARGIN * max(width, height)
    picture = Rectangle(
        window.left - margin, window.top - margin, width + 2 * margin, height + 2 * margin
    )
    centres, disks = with_images(scene, position)
    circles = [
        Circle(x, -y, scene.radius[disk].item(), shades[disk].item())
        for (x, y), disk in zip(centres.tolist(), disks.tolist(), strict=True)
    ]
    sides = [
        *(Side((x, x), (-box.y[0], -box.y[1]), box.periodic_x) for x in box.x),
        *(Side(box.x, (-y, -y), box.periodic_y) for y in box.y),
    ]
    return Still(picture, window, sides, circles)


def _motion(trajectories: Trajectories, seed: int, shades: np.ndarray) -> dict[str, object]:
    """Return the numbers from which `replay.js` computes all positions: the box, the disks with
    their `shades` (N,), their state at t = 0, and the first MOST_COLLISIONS collisions.
    """
    scene = trajectories.scene
    track = trajectories.ensemble.whole[seed]
    events = trajectories.ensemble.events[seed]
    arrays = {
        "radius": scene.radius,
        "mass": scene.mass,
        "shade": shades,
        "position": track.position[0],
        "velocity": track.known_velocity[0],
    }
    collisions = {
        name: values[:MOST_COLLISIONS].tolist() for name, values in events._asdict().items()
    }
    numbers = {name: values.tolist() for name, values in arrays.items()}
    box = scene.box
    sides = {"x": box.x, "y": box.y, "periodic": box.periodic_axes.tolist()}
    return {"box": sides, "collisions": collisions} | numbers


def _seed_of(trajectories: Trajectories, path: str, seed: int | None) -> int:
    """Return the seed of the run to replay. Raises RequestError as `replay_page` does."""
    scene = trajectories.scene
    ensemble = trajectories.ensemble
    has_runs = len(ensemble.seeds) > len(ensemble.stopped)
    is_recorded = bool(ensemble.whole) and ensemble.whole.keys() == ensemble.events.keys()
    if scene.particles and has_runs and not is_recorded:
        trajectories.engine.refuse_unfit(scene, RECORD.split(","))
        recorded_seed = int(ensemble.seeds[0]) if seed is None else seed
        command = runs_record(trajectories, [recorded_seed], RECORD)["command"]
        raise RequestError(f"{path}: holds no collisions of all disks; record them: {command}")
    seed = chosen_seed(trajectories, path, seed, ensemble.whole)
    track = ensemble.whole[seed]
    events = ensemble.events[seed]
    numbers = (track.position, track.known_velocity, events.time, events.impulse)
    if not all(np.isfinite(values).all() for values in numbers):
        raise RequestError(
            f"{path}: seed {seed}: its run failed: positions or velocities are not numbers"
        )
    return seed
