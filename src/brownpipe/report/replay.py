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

# Collisions in a replay: some 350 kB
MOST_COLLISIONS = 5000
# What `--record` must be given
RECORD = "all,events"


def replay_page(
    trajectories: Trajectories, path: str, seed: int | None = None
) -> tuple[bytes, str]:
    """Return a web page with the replay of a run, and in words how many of its collisions it has.

    It ends where MOST_COLLISIONS are reached. `path` is the file of the trajectories, for messages;
    the run is that of `seed`, by default of the smallest. The same run gives the same bytes.

    Raises RequestError for a file without this run, its tracks or its collisions.
    """
    scene = trajectories.scene
    seed = _seed_of(trajectories, path, seed)
    events = trajectories.ensemble.events[seed]
    title = f"{scene.title}, seed {seed}"
    shades = shades_of(scene)
    end = scene.duration
    extent = counted(len(events.time), "collision")
    if len(events.time) > MOST_COLLISIONS:
        end = float(events.time[MOST_COLLISIONS])
        extent = f"the first {MOST_COLLISIONS:,} of {extent}, until t = {end:.3g}"
    motion = _motion(trajectories, seed, shades)
    page = filled(
        "replay.html",
        title=title,
        extent=extent,
        legend=legend_entries(scene, shades),
        record=movie_record(trajectories, RECORD, seed),
        data=motion | {"end": end},
    )
    return page, extent


def _motion(trajectories: Trajectories, seed: int, shades: np.ndarray) -> dict[str, object]:
    """Return the numbers from which `replay.js` computes all positions: the box, the disks with
    their `shades` (N,), their state at t = 0, and the first MOST_COLLISIONS collisions.
    """
    scene = trajectories.scene
    track = trajectories.ensemble.whole[seed]
    events = trajectories.ensemble.events[seed]
    of_disks = {
        "radius": scene.radius,
        "mass": scene.mass,
        "shade": shades,
        "position": track.position[0],
        "velocity": track.known_velocity[0],
    }
    collisions = {
        name: values[:MOST_COLLISIONS].tolist() for name, values in events._asdict().items()
    }
    numbers = {name: values.tolist() for name, values in of_disks.items()}
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
