"""The replay of one run as a web page: every collision, and straight flight between them, at any speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of collisions determine every
position at every time. The page gets these numbers, and `replay.js` computes the positions.
"""

from typing import TYPE_CHECKING

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.movie import legend_entries, shades_of
from brownpipe.figures.origin import movie_record
from brownpipe.report.page import filled
from brownpipe.storage.trajectories import chosen_seed, runs_record
from brownpipe.text import counted

if TYPE_CHECKING:
    from brownpipe.storage.trajectories import Trajectories

MOST_COLLISIONS = 5000  # of a replay: some 350 kB
RECORD = "all,events"  # what `--record` must be given
ELONGATION = 6.0  # longer side of the picture over the shorter one at most; of longer boxes a part is shown


def replay_page(trajectories: "Trajectories", path: str, seed: int | None = None) -> tuple[bytes, str]:
    """Return a web page with the replay of a run, and in words how many of its collisions it has.

    It ends where MOST_COLLISIONS are reached. `path` is the file of the trajectories, for messages; the run is that of
    `seed`, by default of the smallest. The same run gives the same bytes.

    Raises RequestError for a file without this run, its tracks or its collisions.
    """
    scene, seed = trajectories.scene, _seed_of(trajectories, path, seed)
    track, events = trajectories.ensemble.whole[seed], trajectories.ensemble.events[seed]
    count, end, extent = len(events.time), scene.duration, counted(len(events.time), "collision")
    if count > MOST_COLLISIONS:
        count, end = MOST_COLLISIONS, float(events.time[MOST_COLLISIONS])
        extent = f"the first {count:,} of {extent}, until t = {end:.3g}"
    shades = shades_of(scene)
    pair = np.stack([events.a, events.b], axis=1)  # a disk and its partner, or a wall: -1 left, -2 right, ...
    page = filled(
        "replay.html",
        title=f"{scene.name}, N = {scene.particles}, seed {seed}",
        extent=extent,
        legend=legend_entries(scene, shades),
        record=movie_record(trajectories, RECORD, seed),
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
            "time": events.time[:count].tolist(),
            "pair": pair[:count].ravel().tolist(),
            "impulse": events.impulse[:count].ravel().tolist(),  # given to the first of the pair
        },
    )
    return page, extent


def _seed_of(trajectories: "Trajectories", path: str, seed: int | None) -> int:
    """Return the seed of the run to replay. Raises RequestError as `replay_page` does."""
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
    return seed
