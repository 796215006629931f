"""The replay of one run as part of a web page: every collision, and straight flight between them, at any speed.

Disks move straight from one collision to the next, so that the state at t = 0 and the log of collisions determine every
position at every time. The page gets these numbers, and `replay.js` computes the positions as `flown` does here.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from brownpipe.errors import RequestError
from brownpipe.figures.origin import in_script
from brownpipe.figures.snapshot import legend_entries, shades_of
from brownpipe.quoting import printable
from brownpipe.storage import runs_record
from brownpipe.storage.trajectories import refuse_stopped, whole_seed

if TYPE_CHECKING:
    from brownpipe.scene import Scene
    from brownpipe.storage import Trajectories

MOST_BYTES = 150_000  # of the numbers of a replay: 200 kB as base64
MOST_DISKS = 1000
WORST = 1e-3  # departure from the recorded samples beyond which a replay is refused [smallest radius]
RECORD = "all,events"  # what `--record` must be given
ELONGATION = 6.0  # longer side of the picture over the shorter one at most; of longer boxes a part is shown


class Flight(NamedTuple):
    """The state of N disks at t = 0 and the first E collisions of a run."""

    position: np.ndarray  # (N, 2) [length]
    velocity: np.ndarray  # (N, 2) [length/time]
    time: np.ndarray  # (E,) [time]
    pair: np.ndarray  # (E, 2) int16: a disk and its partner, or a wall: -1 left, -2 right, -3 bottom, -4 top
    impulse: np.ndarray  # (E, 2) given to the first disk [mass length/time]


class Replay(NamedTuple):
    """What a page needs to replay one run."""

    scene: Scene
    seed: int
    flight: Flight
    end: float  # time up to which the collisions are there [time]
    collisions: int  # of the whole run
    departure: float  # largest distance of a flown disk from its recorded samples [smallest radius]


def replay_page(replay: Replay) -> bytes:
    """Return a web page with the replay of a run, which needs no other file. The same run gives the same bytes."""
    title = html.escape(f"{replay.scene.name}, N = {replay.scene.particles}, seed {replay.seed}")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }}
body {{ max-width: 60rem; margin: 0 auto; padding: 1rem; }}
@media (prefers-color-scheme: dark) {{ body {{ background: #141414; color: #e4e6e8; }} }}
h1 {{ font-size: 1.3rem; line-height: 1.25; margin: 0 0 .5rem; }}
</style>
</head>
<body>
<main>
<h1>{title.replace(" = ", "&nbsp;=&nbsp;").replace("seed ", "seed&nbsp;")}</h1>
{_section(replay)}</main>
</body>
</html>
""".encode()


# --- the numbers


def replay_of(trajectories: Trajectories, path: str, seed: int | None = None) -> Replay:
    """Return the replay of a run up to the time until which its collisions fit into MOST_BYTES.

    `path` is the file of the trajectories, for messages; the run is that of `seed`, by default of the smallest.

    Raises RequestError for a file without this run, its tracks or its collisions, for more than MOST_DISKS disks, and
    for collisions that do not lead to the recorded positions.
    """
    seed = replayed_seed(trajectories, path, seed)
    scene, ensemble = trajectories.scene, trajectories.ensemble
    track, events = ensemble.whole[seed], ensemble.events[seed]
    numbers = (track.position, track.velocity, events.time, events.impulse)
    if track.velocity is None or not all(np.isfinite(values).all() for values in numbers):
        raise RequestError(f"{path}: seed {seed}: its run failed: positions or velocities are not numbers")
    flight = _first(track.position[0], track.velocity[0], events)
    shown = len(flight.time)
    end = float(events.time[shown]) if shown < len(events.time) else scene.duration
    departure = _departure(scene, flight, ensemble.times[ensemble.times <= end], track.position)
    if not departure <= WORST:
        raise RequestError(f"{path}: seed {seed}: its collisions do not lead to its recorded positions")
    return Replay(scene, seed, flight, end, len(events.time), departure)


def replayed_seed(trajectories: Trajectories, path: str, seed: int | None = None) -> int:
    """Return the seed of the run to replay; arguments and errors as of `replay_of`."""
    ensemble, scene = trajectories.ensemble, trajectories.scene
    if scene.particles == 0:
        raise RequestError(f"{path}: has no disks to replay")
    refuse_stopped(trajectories, path, int(ensemble.seeds[0]) if seed is None else seed)
    if not (ensemble.whole and ensemble.whole.keys() == ensemble.events.keys()):
        trajectories.engine.refuse_unfit(scene, RECORD.split(","))
        runs = [int(ensemble.seeds[0]) if seed is None else seed]
        command = runs_record(trajectories.outline, runs, RECORD)["command"]
        raise RequestError(f"{path}: holds no collisions of all disks; record them: {command}")
    seed = whole_seed(trajectories, path, seed)
    if scene.particles > MOST_DISKS:
        raise RequestError(f"{path}: a replay must have at most {MOST_DISKS:,} disks, not {scene.particles:,}")
    return seed


def _first(position: np.ndarray, velocity: np.ndarray, events: Any) -> Flight:
    """Return the flight of as many of the first collisions as fit into MOST_BYTES, of 28 bytes each."""
    fit = (MOST_BYTES - position.nbytes - velocity.nbytes) // 28
    pair = np.stack([events.a, events.b], axis=1)[:fit].astype(np.int16)
    return Flight(position, velocity, events.time[:fit], pair, events.impulse[:fit])


def flown(flight: Flight, mass: np.ndarray, times: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the unwrapped positions (N, 2) float64 of disks of masses (N,) at each of the ascending times (T,)."""
    position, velocity = flight.position.copy(), flight.velocity.copy()
    since, done = np.zeros(len(position)), 0
    for time in times:
        while done < len(flight.time) and flight.time[done] <= time:
            now = flight.time[done]
            for disk, impulse in zip(
                flight.pair[done].tolist(), (flight.impulse[done], -flight.impulse[done]), strict=True
            ):
                if disk >= 0:
                    position[disk] += velocity[disk] * (now - since[disk])
                    velocity[disk] += impulse / mass[disk]
                    since[disk] = now
            done += 1
        yield position + velocity * (time - since)[:, None]


def _departure(scene: Scene, flight: Flight, times: np.ndarray, recorded: np.ndarray) -> float:
    """Return the largest distance of a flown disk from its recorded positions (T, N, 2) [smallest radius], or NaN."""
    edges, worst = np.array([scene.box.width, scene.box.height]), np.float64(0.0)
    for position, expected in zip(flown(flight, scene.mass, times), recorded, strict=False):
        gap = position - expected
        if scene.box.periodic:
            gap -= edges * np.round(gap / edges)
        worst = np.maximum(worst, np.hypot(*gap.T).max())
    return float(worst / scene.radius.min())


# --- the page


def _section(replay: Replay) -> str:
    """Return the HTML section: style, canvas, controls, numbers and curves, the data, and the script that moves it."""
    style, script = (Path(__file__).with_suffix(suffix).read_text(encoding="utf-8") for suffix in (".css", ".js"))
    data = json.dumps(_data(replay), sort_keys=True, allow_nan=False)
    name = html.escape(printable(f"Replay of {replay.scene.name}, N = {replay.scene.particles}, seed {replay.seed}"))
    mean = "; dashed: mean of the other disks" if replay.scene.particles > 1 else ""
    legend = "".join(
        f'<li><span class="brownpipe-replay-face" data-shade="{shade}"></span>{html.escape(text)}</li>\n'
        for shade, text in legend_entries(replay.scene, shades_of(replay.scene))
    )
    return f"""<section class="brownpipe-replay" aria-label="{name}">
<style>
{style}</style>
<p class="brownpipe-replay-note">{html.escape(_says(replay))}</p>
<noscript><p>The replay needs JavaScript, which is switched off.</p></noscript>
<div class="brownpipe-replay-panes">
<div class="brownpipe-replay-stage">
<canvas class="brownpipe-replay-box" role="img" tabindex="0" aria-label="{name}"></canvas>
<div class="brownpipe-replay-controls">
<button type="button" class="brownpipe-replay-play">Play</button>
<button type="button" class="brownpipe-replay-restart">Restart</button>
<label>Speed <input type="range" class="brownpipe-replay-speed" min="-6" max="4" step="1" value="0"></label>
<output class="brownpipe-replay-rate"></output>
<label class="brownpipe-replay-long">Time
<input type="range" class="brownpipe-replay-time" min="0" max="1000" step="1" value="0"></label>
</div>
<ul class="brownpipe-replay-legend">
{legend}<li><span class="brownpipe-replay-face" data-shade="flash"></span>disks that have just collided</li>
</ul>
<p class="brownpipe-replay-note">Keys: space plays and pauses; arrows, Home and End move in time.</p>
</div>
<div class="brownpipe-replay-numbers">
<table>
<tr><th scope="row">Time</th><td data-number="time"></td></tr>
<tr><th scope="row">Collisions</th><td data-number="collisions"></td></tr>
<tr><th scope="row" class="brownpipe-replay-part">of the tracer</th><td data-number="hits"></td></tr>
<tr><th scope="row">Kinetic energy</th><td data-number="energy"></td></tr>
<tr><th scope="row" class="brownpipe-replay-part">of the tracer</th><td data-number="tracer"></td></tr>
<tr><th scope="row" class="brownpipe-replay-part">of the bath</th><td data-number="bath"></td></tr>
<tr><th scope="row">Square displacement</th><td data-number="square"></td></tr>
</table>
<p>Square displacement of the tracer</p>
<canvas class="brownpipe-replay-curve" data-curve="square" role="img" aria-label="its curve over time"></canvas>
<p>Kinetic energy of the tracer{mean}</p>
<canvas class="brownpipe-replay-curve" data-curve="energy" role="img" aria-label="its curve over time"></canvas>
</div>
</div>
<script type="application/json" class="brownpipe-replay-data">{in_script(data)}</script>
<script>
{script}</script>
</section>
"""


def _says(replay: Replay) -> str:
    """Return what the replay is, how exact it is, and whether it ends before the run."""
    bound = 10.0 ** np.ceil(np.log10(max(replay.departure, 1e-15)))
    exact = f"positions differ from the recorded ones by less than {bound:.0e} of the smallest radius"
    what = f"Disks move straight from one collision to the next, so this is the run itself at any speed: {exact}."
    box = replay.scene.box
    if _is_longer_than_shown(replay.scene):
        what += f" The picture follows the tracer along the box of {box.width:g} x {box.height:g}."
    if is_whole(replay):
        return f"{what} All numbers are in the scene's reduced units."
    count = f"{len(replay.flight.time):,} of {replay.collisions:,} collisions"
    part = f"The replay has the first {count} and ends at {replay.end:.3g}; the run ends at {replay.scene.duration:g}."
    return f"{what} {part} All numbers are in the scene's reduced units."


def _is_longer_than_shown(scene: Scene) -> bool:
    """Whether a box is too long for all of it to be shown."""
    sides = (scene.box.width, scene.box.height)
    return max(sides) > ELONGATION * min(sides)


def is_whole(replay: Replay) -> bool:
    """Whether a replay has all collisions of the run."""
    return len(replay.flight.time) == replay.collisions


def _data(replay: Replay) -> dict[str, Any]:
    """Return the data of the page: numbers of the box and of the species, arrays as base64 of little-endian numbers."""
    scene, flight = replay.scene, replay.flight
    box, shades, first = scene.box, shades_of(scene).tolist(), 0
    species = []
    for members in scene.listed or scene.species:
        count = getattr(members, "count", 1)
        for part in (min(1, count), count - 1) if first == 0 else (count,):  # disk 0 has a shade of its own
            if part > 0:
                species.append([part, members.radius, members.mass, shades[first]])
            first += part
    return {
        "box": [*box.origin, box.width, box.height],
        "periodic": box.periodic,
        "elongation": ELONGATION,
        "species": species,
        "end": replay.end,
        **{name: _base64(values) for name, values in flight._asdict().items()},
    }


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.astype(values.dtype.newbyteorder("<")).tobytes()).decode()
