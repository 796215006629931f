"""The replay of one run as a web page: every collision, and straight flight between them, at any
speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of
collisions determine every position at every time. The page gets these numbers, and `replay.js`
computes the positions.
"""

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.movie import legend_entries, shades_of
from brownpipe.figures.origin import movie_record
from brownpipe.report.page import filled
from brownpipe.storage.trajectories import Trajectories, chosen_seed, runs_record
from brownpipe.text import counted

MOST_COLLISIONS = 5000  # of a replay: some 350 kB
RECORD = "all,events"  # what `--record` must be given


def replay_page(
    trajectories: Trajectories, path: str, seed: int | None = None
) -> tuple[bytes, str]:
    """Return a web page with the replay of a run, and in words how many of its collisions it has.

    It ends where MOST_COLLISIONS are reached. `path` is the file of the trajectories, for messages;
    the run is that of `seed`, by default of the smallest. The same run gives the same bytes.

    Raises RequestError for a file without this run, its tracks or its collisions.
    """
    scene, seed = trajectories.scene, _seed_of(trajectories, path, seed)
    track, events = trajectories.ensemble.whole[seed], trajectories.ensemble.events[seed]
    shades, end, extent = shades_of(scene), scene.duration, counted(len(events.time), "collision")
    if len(events.time) > MOST_COLLISIONS:
        end = float(events.time[MOST_COLLISIONS])
        extent = f"the first {MOST_COLLISIONS:,} of {extent}, until t = {end:.3g}"
    page = filled(
        "replay.html",
        title=f"{scene.name}, N = {scene.particles}, seed {seed}",
        extent=extent,
        legend=legend_entries(scene, shades),
        record=movie_record(trajectories, RECORD, seed),
        data={
            "box": scene.box.model_dump(),
            "end": end,
            "radius": scene.radius.tolist(),
            "mass": scene.mass.tolist(),
            "shade": shades.tolist(),
            "position": track.position[0].tolist(),
            "velocity": track.velocity[0].tolist(),
            "collisions": {
                name: values[:MOST_COLLISIONS].tolist() for name, values in events._asdict().items()
            },
        },
    )
    return page, extent


def _seed_of(trajectories: Trajectories, path: str, seed: int | None) -> int:
    """Return the seed of the run to replay. Raises RequestError as `replay_page` does."""
    scene, _, ensemble = trajectories[:3]
    ended = len(ensemble.seeds) > len(ensemble.stopped)
    if (
        scene.particles
        and ended
        and not (ensemble.whole and ensemble.whole.keys() == ensemble.events.keys())
    ):
        trajectories.engine.refuse_unfit(scene, RECORD.split(","))
        command = runs_record(
            trajectories, [int(ensemble.seeds[0]) if seed is None else seed], RECORD
        )["command"]
        raise RequestError(f"{path}: holds no collisions of all disks; record them: {command}")
    seed = chosen_seed(trajectories, path, seed, ensemble.whole)
    track, events = ensemble.whole[seed], ensemble.events[seed]
    if not all(
        np.isfinite(values).all()
        for values in (track.position, track.velocity, events.time, events.impulse)
    ):
        raise RequestError(
            f"{path}: seed {seed}: its run failed: positions or velocities are not numbers"
        )
    return seed
