"""The replay of one run as a web page: every collision, and straight flight between them, at any speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of collisions determine every
position at every time. The page gets these numbers, and `replay.js` computes the positions.
"""

import base64
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.movie import legend_entries, shades_of
from brownpipe.figures.origin import Record
from brownpipe.report.page import filled
from brownpipe.storage.trajectories import chosen_seed, runs_record

if TYPE_CHECKING:
    from brownpipe.scene import Scene
    from brownpipe.storage.trajectories import Trajectories

MOST_BYTES = 150_000  # of the collisions of a replay: 200 kB as base64
MOST_DISKS = 1000
RECORD = "all,events"  # what `--record` must be given
ELONGATION = 6.0  # longer side of the picture over the shorter one at most; of longer boxes a part is shown


class Replay(NamedTuple):
    """A run: the state of its N disks at t = 0, and its first E collisions."""

    scene: "Scene"
    seed: int
    end: float  # time up to which the collisions are there [time]
    collisions: int  # of the whole run
    position: np.ndarray  # (N, 2) [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    time: np.ndarray  # (E,) [time]
    pair: np.ndarray  # (E, 2) int16: a disk and its partner, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2) given to the first disk [mass length/time]


def replay_of(trajectories: "Trajectories", path: str, seed: int | None = None) -> Replay:
    """Return the replay of a run up to the time until which its collisions fit into MOST_BYTES, of 28 bytes each.

    `path` is the file of the trajectories, for messages; the run is that of `seed`, by default of the smallest.

    Raises RequestError for a file without this run, its tracks or its collisions, and for more than MOST_DISKS disks.
    """
    scene, _, ensemble = trajectories[:3]
    first = int(ensemble.seeds[0]) if seed is None else seed
    ended = len(ensemble.seeds) > len(ensemble.stopped)
    if scene.particles and ended and not (ensemble.whole and ensemble.whole.keys() == ensemble.events.keys()):
        trajectories.engine.refuse_unfit(scene, RECORD.split(","))
        command = runs_record(trajectories, [first], RECORD)["command"]
        raise RequestError(f"{path}: holds no collisions of all disks; record them: {command}")
    seed = chosen_seed(trajectories, path, seed, trajectories.ensemble.whole)
    if scene.particles > MOST_DISKS:
        raise RequestError(f"{path}: a replay must have at most {MOST_DISKS:,} disks, not {scene.particles:,}")
    track, events = ensemble.whole[seed], ensemble.events[seed]
    numbers = (track.position, track.velocity, events.time, events.impulse)
    if not all(np.isfinite(values).all() for values in numbers):
        raise RequestError(f"{path}: seed {seed}: its run failed: positions or velocities are not numbers")
    shown = min(len(events.time), MOST_BYTES // 28)
    end = float(events.time[shown]) if shown < len(events.time) else scene.duration
    pair = np.stack([events.a, events.b], axis=1)[:shown].astype(np.int16)
    logged = (events.time[:shown], pair, events.impulse[:shown])
    return Replay(scene, seed, end, len(events.time), track.position[0], track.velocity[0], *logged)


def is_whole(replay: Replay) -> bool:
    """Whether a replay has all collisions of the run."""
    return len(replay.time) == replay.collisions


def replay_page(replay: Replay, record: Record) -> bytes:
    """Return a web page with the replay of a run and what it was made from. The same run gives the same bytes."""
    scene = replay.scene
    shades = shades_of(scene)
    return filled(
        Path(__file__).with_suffix(".html"),
        title=f"{scene.name}, N = {scene.particles}, seed {replay.seed}",
        note=_note(replay),
        legend=legend_entries(scene, shades),
        record=record,
        data={
            "box": [*scene.box.origin, scene.box.width, scene.box.height],
            "periodic": scene.box.periodic,
            "elongation": ELONGATION,
            "end": replay.end,
            "radius": scene.radius.tolist(),
            "mass": scene.mass.tolist(),
            "shade": shades.tolist(),
            **{name: _base64(getattr(replay, name)) for name in ("position", "velocity", "time", "pair", "impulse")},
        },
    )


def _note(replay: Replay) -> str:
    """Return what the replay is, and whether it ends before the run."""
    scene = replay.scene
    what = "Disks move straight from one collision to the next, so this is the run itself at any speed."
    sides = (scene.box.width, scene.box.height)
    if max(sides) > ELONGATION * min(sides):
        what += f" The picture follows the tracer along the box of {sides[0]:g} x {sides[1]:g}."
    if not is_whole(replay):
        what += f" The replay has the first {len(replay.time):,} of {replay.collisions:,} collisions"
        what += f" and ends at {replay.end:.3g}; the run ends at {scene.duration:g}."
    return f"{what} All numbers are in the scene's reduced units."


def _base64(values: np.ndarray) -> str:
    """Return numbers as base64 of their little-endian bytes."""
    return base64.b64encode(values.astype(values.dtype.newbyteorder("<")).tobytes()).decode()
