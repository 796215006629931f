"""The replay of one run as a web page: every collision, and straight flight between them, at any speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of collisions determine every
position at every time. The page gets these numbers, and `replay.js` computes the positions.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.movie import legend_entries, shades_of
from brownpipe.figures.origin import Record
from brownpipe.report.page import filled
from brownpipe.storage.trajectories import chosen_seed, runs_record

if TYPE_CHECKING:
    from brownpipe.engines.ensemble import Events
    from brownpipe.observables.observable import Track
    from brownpipe.scene import Scene
    from brownpipe.storage.trajectories import Trajectories

MOST_COLLISIONS = 5000  # of a replay: some 350 kB
RECORD = "all,events"  # what `--record` must be given
ELONGATION = 6.0  # longer side of the picture over the shorter one at most; of longer boxes a part is shown


class Replay(NamedTuple):
    """A run, and how much of it is replayed."""

    scene: "Scene"
    seed: int
    track: "Track"  # its tracks of all disks, of which the page has the state at t = 0
    events: "Events"  # its collisions, of which the page has the first ones
    shown: int  # number of these
    end: float  # time up to which they are all there [time]


def replay_of(trajectories: "Trajectories", path: str, seed: int | None = None) -> Replay:
    """Return the replay of a run up to the time until which it has at most MOST_COLLISIONS.

    `path` is the file of the trajectories, for messages; the run is that of `seed`, by default of the smallest.

    Raises RequestError for a file without this run, its tracks or its collisions.
    """
    scene, _, ensemble = trajectories[:3]
    ended = len(ensemble.seeds) > len(ensemble.stopped)
    if scene.particles and ended and not (ensemble.whole and ensemble.whole.keys() == ensemble.events.keys()):
        trajectories.engine.refuse_unfit(scene, RECORD.split(","))
        command = runs_record(trajectories, [int(ensemble.seeds[0]) if seed is None else seed], RECORD)["command"]
        raise RequestError(f"{path}: holds no collisions of all disks; record them: {command}")
    seed = chosen_seed(trajectories, path, seed, ensemble.whole)
    track, events = ensemble.whole[seed], ensemble.events[seed]
    if not all(np.isfinite(values).all() for values in (track.position, track.velocity, events.time, events.impulse)):
        raise RequestError(f"{path}: seed {seed}: its run failed: positions or velocities are not numbers")
    shown = min(len(events.time), MOST_COLLISIONS)
    end = float(events.time[shown]) if shown < len(events.time) else scene.duration
    return Replay(scene, seed, track, events, shown, end)


def replay_page(replay: Replay, record: Record) -> bytes:
    """Return a web page with the replay of a run and what it was made from. The same run gives the same bytes."""
    scene, _, track, events, shown, end = replay
    shades = shades_of(scene)
    pair = np.stack([events.a, events.b], axis=1)  # a disk and its partner, or a wall: -1 left, -2 right, ...
    return filled(
        "replay.html",
        title=f"{scene.name}, N = {scene.particles}, seed {replay.seed}",
        note=_note(replay),
        legend=legend_entries(scene, shades),
        record=record,
        data={
            "box": [*scene.box.origin, scene.box.width, scene.box.height],
            "periodic": scene.box.periodic,
            "elongation": ELONGATION,
            "end": end,
            "radius": scene.radius.tolist(),
            "mass": scene.mass.tolist(),
            "shade": shades.tolist(),
            "position": track.position[0].ravel().tolist(),
            "velocity": track.velocity[0].ravel().tolist(),
            "time": events.time[:shown].tolist(),
            "pair": pair[:shown].ravel().tolist(),
            "impulse": events.impulse[:shown].ravel().tolist(),  # given to the first of the pair
        },
    )


def _note(replay: Replay) -> str:
    """Return what the replay is, and whether it ends before the run."""
    scene = replay.scene
    what = "Disks move straight from one collision to the next, so this is the run itself at any speed."
    sides = (scene.box.width, scene.box.height)
    if max(sides) > ELONGATION * min(sides):
        what += f" The picture follows the tracer along the box of {sides[0]:g} x {sides[1]:g}."
    if replay.shown < len(replay.events.time):
        what += f" The replay has the first {replay.shown:,} of {len(replay.events.time):,} collisions"
        what += f" and ends at {replay.end:.3g}; the run ends at {scene.duration:g}."
    return f"{what} All numbers are in the scene's reduced units."
