"""The replay of a run: flown from its data it is the run, in Python and as a browser draws it;
controls; refusals.
"""

import json
import re

import numpy as np
import pytest

import browser
from brownpipe.cli import main
from brownpipe.engines import Engine, engine_of_request
from brownpipe.errors import DONE, WRONG_REQUEST, RequestError
from brownpipe.figures.origin import read_record
from brownpipe.report import replay
from brownpipe.scene import parse_scene, read_scene
from brownpipe.storage.trajectories import Trajectories, write_trajectories
from ensembles import make_scene

NOTE = "config/scenes/harrison2020.yaml"
EXACT, SEED = Engine("exact"), 5
SPECIES = [{"name": "small", "count": "rest", "radius": 0.1, "mass": 0.4}]
SPECIES += [{"name": "big", "count": 4, "radius": 0.25, "mass": 0.7}]
UNEQUAL = {"tracer": {"radius": 0.3, "mass": 1.0}, "species": SPECIES}
LISTED = [
    {"position": [-1.0, 0.5], "velocity": [3.0, 0.5], "radius": 0.5, "mass": 100.0},
    {"position": [1.0, 0.8], "velocity": [0.0, 0.0], "radius": 0.25, "mass": 1.0},
]


def listed(disks, boundary):
    """A scene of disks at given places, in a box of which neither side is the other."""
    box = {"x": [-2.0, 2.0], "y": [-1.0, 2.0], "boundary": boundary}
    return parse_scene(
        {"box": box, "duration": 4.0, "sample_interval": 0.1, "disks": disks}, "listed.yaml"
    )


CHANNEL = {
    "box": {"x": [-50.0, 50.0], "y": [-1.0, 2.0], "boundary": "reflecting"},
    "duration": 4.0,
    "sample_interval": 0.5,
    "disks": [
        LISTED[0] | {"velocity": [12.0, 0.5]},
        LISTED[1],
        LISTED[1] | {"position": [49.0, 0.0]},
    ],
}
SCENES = {
    "walls": lambda: make_scene("walls", 40),
    "periodic": lambda: make_scene(
        "periodic", 40, boundary="periodic", disks=UNEQUAL, duration=3.0
    ),
    "equilibrated": lambda: make_scene("later", 40, equilibrate={"time": 0.3, "tracer": "pinned"}),
    "listed": lambda: listed(LISTED, "reflecting"),
    "channel": lambda: parse_scene(CHANNEL, "channel.yaml"),
    "one disk across the edges": lambda: listed(LISTED[:1], "periodic"),
}
WITH_BROWSER = pytest.mark.skipif(browser.CHROMIUM is None, reason="chromium is not installed")


def run_of(scene):
    """Trajectories of one run with all disks and collisions."""
    return Trajectories(scene, EXACT, EXACT.simulate(scene, [SEED], frozenset({"all", "events"})))


@pytest.fixture(scope="module")
def runs():
    return {name: run_of(scene()) for name, scene in SCENES.items()}


def section_of(run):
    """The part of a page that replays a run."""
    return re.search("<section.*</section>", page_of(run), re.DOTALL)[0]


def page_of(run):
    return replay.replay_page(run, "runs.h5")[0].decode()


def data_of(page):
    """The data of a page's first replay."""
    (text,) = re.findall(
        r'<script type="application/json" class="brownpipe-replay-data">(.*?)</script>', page
    )
    return json.loads(text)


def flown(data, times):
    """Positions (T, N, 2) inside the box at each of the times, all disks moved from one collision
    to the next.
    """
    mass = np.array(data["mass"])
    position, velocity = np.array(data["position"]), np.array(data["velocity"])
    collisions = [
        *zip(*(data["collisions"][name] for name in ("time", "a", "b", "impulse")), strict=True)
    ]
    now, done, frames = 0.0, 0, []
    for time in times:
        while done < len(collisions) and collisions[done][0] <= time:
            then, a, b, impulse = collisions[done]
            position, now = position + velocity * (then - now), then
            velocity[a] += np.array(impulse) / mass[a]
            if b >= 0:
                velocity[b] -= np.array(impulse) / mass[b]
            done += 1
        frames.append(position + velocity * (time - now))
    low, high = np.array([data["box"]["x"], data["box"]["y"]]).T
    is_periodic = data["box"]["boundary"] == "periodic"
    return np.mod(np.array(frames) - low, high - low) + low if is_periodic else np.array(frames)


def farthest(scene, positions, recorded):
    """Largest distance of positions (T, N, 2) from the recorded ones, across the edges if that is
    shorter.
    """
    gap, edges = positions - recorded, np.array([scene.box.width, scene.box.height])
    gap -= edges * np.round(gap / edges) if scene.box.periodic else 0.0
    return np.hypot(gap[..., 0], gap[..., 1]).max()


@pytest.mark.parametrize("name", SCENES)
def test_flown_positions_are_those_of_the_run(name, runs):
    scene, ensemble = runs[name].scene, runs[name].ensemble
    assert len(ensemble.events[SEED].time) > 5 or scene.particles == 1
    data = data_of(section_of(runs[name]))
    error = (
        farthest(scene, flown(data, ensemble.times), ensemble.whole[SEED].position)
        / scene.radius.min()
    )
    assert error <= 1e-9


def test_a_replay_with_too_many_collisions_ends_earlier_and_says_so(runs, monkeypatch):
    scene, ensemble = runs["walls"].scene, runs["walls"].ensemble
    events = ensemble.events[SEED]
    monkeypatch.setattr(replay, "MOST_COLLISIONS", 20)
    page = section_of(runs["walls"])
    data, shown = data_of(page), ensemble.times <= events.time[20]
    assert len(data["collisions"]["time"]) == 20 and data["end"] == events.time[20] < scene.duration
    assert f"(the first 20 of {len(events.time)} collisions, until t = {data['end']:.3g})" in page
    error = farthest(
        scene, flown(data, ensemble.times[shown]), ensemble.whole[SEED].position[shown]
    )
    assert error <= 1e-9 * scene.radius.min()


def test_a_page_of_the_note_is_small_and_says_what_it_was_made_from(tmp_path, monkeypatch, capsys):
    write_trajectories(tmp_path / "run.h5", *run_of(read_scene(NOTE))[:3])
    monkeypatch.chdir(tmp_path)
    assert main(["movie", "run.h5", "--output", "run.html"]) == DONE
    page = (tmp_path / "run.html").read_bytes()
    assert len(page) < 100_000
    count = len(data_of(page.decode())["collisions"]["time"])
    assert count > 500 and re.fullmatch(
        rf"run.html: {count} collisions, \d+ kB\n", capsys.readouterr().out
    )
    record = read_record("run.html")
    assert record["movie"]["seed"] == SEED
    assert record["made_from"][0]["command"].endswith(
        f"--seeds {SEED} --engine exact --record all,events"
    )
    assert main(["inspect", "run.html"]) == DONE
    assert record["made_from"][0]["command"] in capsys.readouterr().out
    assert main(["movie", "run.h5", "--output", "again.html"]) == DONE
    assert (tmp_path / "again.html").read_bytes() == page


def test_refusals(tmp_path, capsys, runs):
    again = (
        f"record them: brownpipe simulate walls.yaml --particles 40 --seeds {SEED} --engine exact"
    )
    scene, engine, ensemble = runs["walls"][:3]
    files = {
        "whole": ensemble._replace(events={}),
        "events": ensemble._replace(whole={}),
        "both": ensemble,
    }
    for name, kept in files.items():
        write_trajectories(tmp_path / f"{name}.h5", scene, engine, kept)
    asked = {
        ("whole.h5",): f"holds no collisions of all disks; {again} --record all,events",
        ("events.h5",): f"holds no collisions of all disks; {again} --record all,events",
        ("both.h5", "--seed", "6"): "holds no run of seed 6",
        ("both.h5", "--frames", "3"): "--frames, --fps: must not be given for a page",
        ("both.h5", "--fps", "3"): "--frames, --fps: must not be given for a page",
    }
    for (name, *options), message in asked.items():
        output = str(tmp_path / "run.html")
        assert main(["movie", str(tmp_path / name), "--output", output, *options]) == WRONG_REQUEST
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    assert not (tmp_path / "run.html").exists()


def test_runs_that_cannot_be_replayed(runs):
    by_steps = runs["walls"]._replace(engine=engine_of_request("timestep", {"time_step": 0.001}))
    without = by_steps._replace(ensemble=by_steps.ensemble._replace(events={}))
    with pytest.raises(RequestError, match="events"):
        replay.replay_page(without, "runs.h5")
    ensemble = runs["walls"].ensemble
    events = ensemble.events[SEED]
    failed = ensemble._replace(events={SEED: events._replace(impulse=np.nan * events.impulse)})
    with pytest.raises(RequestError, match=f"seed {SEED}: .* are not numbers"):
        replay.replay_page(runs["walls"]._replace(ensemble=failed), "runs.h5")


# --- in a browser


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    opened = browser.Browser(tmp_path_factory.mktemp("chromium"))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def page(tmp_path_factory, runs):
    """A page with two replays: with walls, and in a periodic box."""
    path = tmp_path_factory.mktemp("page") / "two.html"
    head = (
        '<!DOCTYPE html><meta charset="utf-8"><meta name="viewport" '
        'content="width=device-width"><title>two</title>'
    )
    walls, periodic = (section_of(runs[name]) for name in ("walls", "periodic"))
    path.write_text(f"{head}{walls}<div style='height: 1000px'></div>{periodic}")
    return path


COLOURS = """(place, points) => {
  const section = document.querySelectorAll(".brownpipe-replay")[place];
  const canvas = section.querySelector("canvas");
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const pen = copy.getContext("2d", {willReadFrequently: true});
  pen.drawImage(canvas, 0, 0);
  return points.map(([x, y]) => {
    const [column, row] = section.brownpipe.pixel(x, y).map(Math.floor);
    return [...pen.getImageData(column, row, 1, 1).data];
  });
}"""


@WITH_BROWSER
@pytest.mark.slow
@pytest.mark.parametrize("name", ["walls", "periodic"])
def test_the_browser_draws_the_run(name, chromium, page, runs):
    scene, ensemble = runs[name].scene, runs[name].ensemble
    chromium.show(page)
    place = ["walls", "periodic"].index(name)
    section = f"document.querySelectorAll('.brownpipe-replay')[{place}]"
    faces = [[0xDA] * 3 if radius == 0.1 else [0xA9] * 3 for radius in scene.radius[1:]]
    for k in (0, len(ensemble.times) // 2, -1):
        time, recorded = float(ensemble.times[k]), ensemble.whole[SEED].position[k]
        positions = np.array(chromium.value(f"{section}.brownpipe.at({time})"))
        assert farthest(scene, positions, recorded) < 1e-9 * scene.radius.min()
        chromium.value(f"{section}.brownpipe.go({time})")
        seen = chromium.value(f"({COLOURS})({place}, {recorded[1:].tolist()})")
        different = [
            i
            for i, (colour, face) in enumerate(zip(seen, faces, strict=True))
            if colour != [*face, 255]
        ]
        assert len(different) <= 2, (
            "the path of the tracer may cross the centres of so many other disks"
        )
        x, y = recorded[0] + (0.0, 0.6 * scene.radius[0])
        (tracer,) = chromium.value(f"({COLOURS})({place}, [[{x}, {y if y < 3 else y - 6}]])")
        assert tracer[:3] in ([0xB5, 0xDA, 0xF0], [0x00, 0x72, 0xB2])
    assert chromium.console == []


@WITH_BROWSER
def test_a_disk_that_reaches_over_an_edge_is_drawn_at_the_opposite_one_too(chromium, page, runs):
    scene, ensemble = runs["periodic"].scene, runs["periodic"].ensemble
    over = ensemble.whole[SEED].position[..., 0] - scene.box.x[0] < 0.3 * scene.radius
    k, i = next((k, i) for k, i in np.argwhere(over).tolist() if i > 0)
    x, y = ensemble.whole[SEED].position[k, i]
    chromium.show(page)
    chromium.value(
        f"document.querySelectorAll('.brownpipe-replay')[1].brownpipe.go({ensemble.times[k]})"
    )
    (colour,) = chromium.value(
        f"({COLOURS})(1, [[{x + scene.box.width - 0.6 * scene.radius[i]}, {y}]])"
    )
    assert colour == [*([0xDA] * 3 if scene.radius[i] == 0.1 else [0xA9] * 3), 255]


@WITH_BROWSER
def test_the_picture_follows_the_tracer_along_a_channel(chromium, tmp_path, runs):
    path, ensemble = tmp_path / "channel.html", runs["channel"].ensemble
    path.write_text(page_of(runs["channel"]))
    chromium.show(path)
    canvas = "document.querySelector('canvas').getBoundingClientRect()"
    assert chromium.value(f"{canvas}.width / {canvas}.height") == pytest.approx(6, rel=0.1)
    in_view = []
    for k in (0, -1):
        time, position = (values[k] for values in (ensemble.times, ensemble.whole[SEED].position))
        chromium.value(f"document.querySelector('.brownpipe-replay').brownpipe.go({time})")
        seen = chromium.value(f"({COLOURS})(0, {(position + np.array([0.0, 0.15])).tolist()})")
        in_view.append([colour[3] > 0 for colour in seen])
        (beside,) = chromium.value(
            f"({COLOURS})(0, {[(position[0] + np.array([0.0, 0.35])).tolist()]})"
        )
        assert beside[:3] == [0xB5, 0xDA, 0xF0], "the tracer's face"
    assert in_view == [[True, True, False], [True, False, True]]


@WITH_BROWSER
def test_numbers_beside_the_picture_are_those_of_the_run(chromium, page, runs):
    scene, ensemble = runs["walls"].scene, runs["walls"].ensemble
    chromium.show(page)
    shown = (
        "[...document.querySelectorAll('.brownpipe-replay')[0].querySelectorAll('td')].map((td) "
        "=> td.textContent)"
    )
    chromium.value(
        f"document.querySelector('.brownpipe-replay').brownpipe.go({ensemble.times[10]})"
    )
    track, events = ensemble.whole[SEED], ensemble.events[SEED]
    energy = 0.5 * scene.mass * np.sum(track.velocity[10] ** 2, axis=1)
    until = events.time <= ensemble.times[10]
    square = np.sum((track.position[10, 0] - track.position[0, 0]) ** 2)
    hits = np.count_nonzero(until & ((events.a == 0) | (events.b == 0)))
    time, collisions, *numbers = chromium.value(shown)
    assert (time, collisions, numbers[0]) == ("0.500 of 1.000", str(until.sum()), str(hits))
    expected = [energy.sum(), energy[0], energy[1:].sum(), square]
    np.testing.assert_allclose([float(text) for text in numbers[1:]], expected, rtol=1e-3)


@WITH_BROWSER
@pytest.mark.slow
def test_keys_move_the_replay(chromium, page):
    chromium.show(page)
    times = (
        "[...document.querySelectorAll('.brownpipe-replay-time')].map((input) => "
        "Number(input.value))"
    )
    labels = (
        "[...document.querySelectorAll('.brownpipe-replay-play')].map((button) => "
        "button.textContent)"
    )
    focused = "document.activeElement.className + document.activeElement.matches(':focus-visible')"
    assert (chromium.value(times), chromium.value(labels)) == (
        [0, 0],
        ["Play", "Play"],
    )  # reduced motion
    chromium.press("Tab")
    assert chromium.value(focused) == "brownpipe-replay-boxtrue"
    for key, value in (("ArrowRight", 5), ("End", 1000), ("ArrowLeft", 995), ("Home", 0)):
        chromium.press(key)
        assert chromium.value(times) == [value, 0]
    for word in ("Pause", "Play"):
        chromium.press(" ")
        assert chromium.value(labels) == [word, "Play"]
    chromium.press("Tab")
    for key, word in (("Enter", "Pause"), (" ", "Play")):
        assert chromium.value(focused) == "brownpipe-replay-playtrue"
        chromium.press(key)
        assert chromium.value(labels) == [word, "Play"]
    chromium.value("document.querySelector('.brownpipe-replay').brownpipe.go(0.5)")
    chromium.press("Tab")
    chromium.press(" ")
    assert chromium.value(focused) == "brownpipe-replay-restarttrue" and chromium.value(times) == [
        0,
        0,
    ]
    assert chromium.value(labels) == ["Play", "Play"]
    rate = "document.querySelector('.brownpipe-replay-rate').textContent"
    assert chromium.value(rate) == "0.033 time units per second"
    chromium.press("Tab")
    chromium.press("ArrowRight")
    assert chromium.value(rate) == "0.067 time units per second"
    chromium.press("Tab")
    chromium.press("End")
    assert chromium.value(times) == [1000, 0]
    assert chromium.console == []


@WITH_BROWSER
@pytest.mark.slow
def test_it_plays_when_it_comes_into_view_and_stops_at_the_end(chromium, page):
    chromium.show(page, still=False)
    first = "document.querySelector('.brownpipe-replay')"
    label = f"{first}.querySelector('.brownpipe-replay-play').textContent"
    chromium.until(
        f"{label} === 'Pause' && {first}.querySelector('.brownpipe-replay-time').value > 1"
    )
    assert (
        chromium.value("document.querySelectorAll('.brownpipe-replay-play')[1].textContent")
        == "Play"
    )
    chromium.value(f"{first}.brownpipe.go(0.9999)")
    chromium.until(f"{label} === 'Play'")
    assert chromium.value(f"{first}.querySelector('.brownpipe-replay-time').value") == "1000"
    assert chromium.console == []


@WITH_BROWSER
@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_the_window_in_its_colours(width, dark, chromium, page):
    chromium.show(page, width, dark=dark)
    assert chromium.value("document.documentElement.scrollWidth") <= width
    wide = (
        "[...document.querySelectorAll('canvas')].map((canvas) => canvas.getBoundingClientRect())"
    )
    assert chromium.value(
        f"{wide}.every((r) => r.width >= 200 && r.left >= 0 && r.right <= innerWidth)"
    )
    (ground,) = chromium.value(f"({COLOURS})(0, [[-2.95, -2.95]])")
    assert ground == ([0x1D, 0x21, 0x26, 255] if dark else [255] * 4)
    assert chromium.console == []
