"""The replay of a run: flown from its data it is the run, in Python and as a browser draws it;
controls; refusals.
"""

import html
import json
import re

import numpy as np
import pytest

import brownpipe as bp
import browser
from brownpipe.cli import main
from brownpipe.engines import Engine, engine_of_request
from brownpipe.errors import DONE, WRONG_REQUEST, RequestError
from brownpipe.figures.origin import read_record
from brownpipe.report import replay
from brownpipe.scene import parse_scene
from brownpipe.storage.configurations import read_scene
from brownpipe.storage.trajectories import Trajectories, to_tree, write_trajectories
from ensembles import make_scene
from scenes import CHANNEL_X, CHANNEL_Y

NOTE = "config/scenes/harrison2020.yaml"
EXACT = Engine("exact")
SEED = 5
SMALL = {"name": "small", "count": "rest", "radius": 0.1, "mass": 0.4}
BIG = {"name": "big", "count": 4, "radius": 0.25, "mass": 0.7}
UNEQUAL = {"tracer": {"radius": 0.3, "mass": 1.0}, "species": [SMALL, BIG]}
LISTED = [
    {"position": [-1.0, 0.5], "velocity": [3.0, 0.5], "radius": 0.5, "mass": 100.0},
    {"position": [1.0, 0.8], "velocity": [0.0, 0.0], "radius": 0.25, "mass": 1.0},
]


def listed(disks, boundary):
    """A scene of disks at given places, in a box of which neither side is the other."""
    box = {"x": [-2.0, 2.0], "y": [-1.0, 2.0], "boundary": boundary}
    mapping = {"box": box, "duration": 4.0, "sample_interval": 0.1, "disks": disks}
    return parse_scene(mapping, "listed.yaml")


def long_box():
    """A scene of a fast disk among two others in a long box."""
    fast = LISTED[0] | {"velocity": [12.0, 0.5]}
    far = LISTED[1] | {"position": [49.0, 0.0]}
    box = {"x": [-50.0, 50.0], "y": [-1.0, 2.0], "boundary": "reflecting"}
    disks = [fast, LISTED[1], far]
    mapping = {"box": box, "duration": 4.0, "sample_interval": 0.5, "disks": disks}
    return parse_scene(mapping, "long_box.yaml")


def unequal(boundary):
    """A scene of unequal disks in a box with periodic sides."""
    return make_scene("unequal", 40, boundary=boundary, disks=UNEQUAL, duration=3.0)


def equilibrated():
    """A scene in which the disks have moved before t = 0."""
    return make_scene("later", 40, equilibrate={"time": 0.3, "tracer": "pinned"})


SCENES = {
    "walls": lambda: make_scene("walls", 40),
    "periodic": lambda: unequal("periodic"),
    "channel along x": lambda: unequal(CHANNEL_X),
    "channel along y": lambda: unequal(CHANNEL_Y),
    "equilibrated": equilibrated,
    "listed": lambda: listed(LISTED, "reflecting"),
    "long box": long_box,
    "one disk across the edges": lambda: listed(LISTED[:1], "periodic"),
    "one disk along a channel": lambda: listed(LISTED[:1], CHANNEL_X),
}
WITH_BROWSER = pytest.mark.skipif(browser.CHROMIUM is None, reason="chromium is not installed")


def run_of(scene):
    """Trajectories of one run with all disks and collisions."""
    ensemble = EXACT.simulate(scene, [SEED], frozenset({"all", "events"}))
    return Trajectories(scene, EXACT, ensemble)


@pytest.fixture(scope="module")
def runs():
    return {name: run_of(scene()) for name, scene in SCENES.items()}


def section_of(run):
    """The section of a page that replays a run."""
    return re.search("<section.*</section>", page_of(run), re.DOTALL)[0]


def page_of(run):
    return replay.replay_page(run, "runs.h5")[0].decode()


def data_of(page):
    """The data of a page's first replay."""
    (text,) = re.findall(
        r'<script type="application/json" class="brownpipe-replay-data">(.*?)</script>', page
    )
    return json.loads(text)


def replayed_positions(data, times):
    """Positions (T, N, 2) inside the box at each of the times, all disks moved from one collision
    to the next.
    """
    mass = np.array(data["mass"])
    position = np.array(data["position"])
    velocity = np.array(data["velocity"])
    columns = [data["collisions"][name] for name in ("time", "a", "b", "impulse")]
    collisions = list(zip(*columns, strict=True))
    now = 0.0
    done = 0
    frames = []
    for time in times:
        while done < len(collisions) and collisions[done][0] <= time:
            collision_time, a, b, impulse = collisions[done]
            position = position + velocity * (collision_time - now)
            now = collision_time
            velocity[a] += np.array(impulse) / mass[a]
            if b >= 0:
                velocity[b] -= np.array(impulse) / mass[b]
            done += 1
        frames.append(position + velocity * (time - now))
    positions = np.array(frames)
    low, high = np.array([data["box"]["x"], data["box"]["y"]]).T
    inside = np.mod(positions - low, high - low) + low
    return np.where(data["box"]["periodic"], inside, positions)


def farthest(scene, positions, recorded):
    """Largest distance of positions (T, N, 2) from the recorded ones, across periodic sides if
    that is shorter.
    """
    gap = scene.box.nearest_image(positions - recorded)
    return np.hypot(gap[..., 0], gap[..., 1]).max()


@pytest.mark.parametrize("name", SCENES)
def test_flown_positions_are_those_of_the_run(name, runs):
    scene = runs[name].scene
    ensemble = runs[name].ensemble
    assert len(ensemble.events[SEED].time) > 5 or scene.particles == 1
    data = data_of(section_of(runs[name]))
    positions = replayed_positions(data, ensemble.times)
    error = farthest(scene, positions, ensemble.whole[SEED].position)
    assert error <= 1e-9 * scene.radius.min()


def test_a_replay_with_too_many_collisions_ends_earlier_and_says_so(runs, monkeypatch):
    scene = runs["walls"].scene
    ensemble = runs["walls"].ensemble
    events = ensemble.events[SEED]
    monkeypatch.setattr(replay, "MOST_COLLISIONS", 20)
    page = section_of(runs["walls"])
    data = data_of(page)
    end = events.time[20]
    assert len(data["collisions"]["time"]) == 20
    assert data["end"] == end < scene.duration
    assert f"(the first 20 of {len(events.time)} collisions, until t = {end:.3g})" in page
    in_replay = ensemble.times <= end
    positions = replayed_positions(data, ensemble.times[in_replay])
    error = farthest(scene, positions, ensemble.whole[SEED].position[in_replay])
    assert error <= 1e-9 * scene.radius.min()


def test_a_page_of_the_note_is_small_and_says_what_it_was_made_from(tmp_path, monkeypatch, capsys):
    run = run_of(read_scene(NOTE))
    write_trajectories(tmp_path / "run.h5", run.scene, run.engine, run.ensemble)
    monkeypatch.chdir(tmp_path)
    assert main(["movie", "run.h5", "--output", "run.html"]) == DONE
    page = (tmp_path / "run.html").read_bytes()
    assert len(page) < 100_000
    count = len(data_of(page.decode())["collisions"]["time"])
    assert count > 500
    line = rf"run.html: {count} collisions, \d+ kB\n"
    assert re.fullmatch(line, capsys.readouterr().out)
    record = read_record("run.html")
    assert record["movie"]["seed"] == SEED
    command = record["made_from"][0]["command"]
    assert command.endswith(f"--seeds {SEED} --engine exact --record all,events")
    assert main(["inspect", "run.html"]) == DONE
    assert command in capsys.readouterr().out
    assert main(["movie", "run.h5", "--output", "again.html"]) == DONE
    assert (tmp_path / "again.html").read_bytes() == page


def test_a_notebook_shows_the_page_in_a_frame(runs):
    tree = to_tree(runs["walls"])
    shown = bp.replay(tree, seed=SEED)
    assert data_of(shown.contents.decode()) == data_of(page_of(runs["walls"]))
    (source,) = re.findall('<iframe srcdoc="([^"]*)"', shown._repr_html_())
    assert html.unescape(source) == shown.contents.decode()
    with pytest.raises(RequestError, match="runs: holds no run of seed 6; must be of 5"):
        bp.replay(tree, seed=6)
    with pytest.raises(RequestError, match="seed: must be a valid integer, not True"):
        bp.replay(tree, seed=True)


def test_refusals(tmp_path, capsys, runs):
    run = runs["walls"]
    for name, ensemble in (
        ("whole", run.ensemble._replace(events={})),
        ("events", run.ensemble._replace(whole={})),
        ("both", run.ensemble),
    ):
        write_trajectories(tmp_path / f"{name}.h5", run.scene, run.engine, ensemble)
    command = f"brownpipe simulate walls.yaml --particles 40 --seeds {SEED} --engine exact"
    unrecorded = f"holds no collisions of all disks; record them: {command} --record all,events"
    for arguments, message in (
        ("whole.h5", unrecorded),
        ("events.h5", unrecorded),
        ("both.h5 --seed 6", "holds no run of seed 6"),
        ("both.h5 --frames 3", "--frames, --fps: must not be given for a page"),
        ("both.h5 --fps 3", "--frames, --fps: must not be given for a page"),
    ):
        name, *options = arguments.split()
        output = str(tmp_path / "run.html")
        assert main(["movie", str(tmp_path / name), "--output", output, *options]) == WRONG_REQUEST
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert not (tmp_path / "run.html").exists()


def test_runs_that_cannot_be_replayed(runs):
    by_steps = runs["walls"]._replace(engine=engine_of_request("timestep", {"time_step": 0.001}))
    without_events = by_steps.ensemble._replace(events={})
    with pytest.raises(RequestError, match="events"):
        replay.replay_page(by_steps._replace(ensemble=without_events), "runs.h5")
    ensemble = runs["walls"].ensemble
    events = ensemble.events[SEED]
    without_numbers = events._replace(impulse=np.nan * events.impulse)
    failed = ensemble._replace(events={SEED: without_numbers})
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
    with_walls = section_of(runs["walls"])
    without_walls = section_of(runs["periodic"])
    path.write_text(f"{head}{with_walls}<div style='height: 1000px'></div>{without_walls}")
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


# faces of the disks of radius 0.1, of larger ones, and of the tracer
LIGHT = [0xDA, 0xDA, 0xDA, 255]
DARK = [0xA9, 0xA9, 0xA9, 255]
FACE_OF_TRACER = [0xB5, 0xDA, 0xF0]


@WITH_BROWSER
@pytest.mark.slow
@pytest.mark.parametrize("name", ["walls", "periodic", "channel along x", "channel along y"])
def test_the_browser_draws_the_run(name, chromium, tmp_path, runs):
    scene = runs[name].scene
    ensemble = runs[name].ensemble
    path = tmp_path / "run.html"
    path.write_text(page_of(runs[name]))
    chromium.show(path)
    section = "document.querySelector('.brownpipe-replay')"
    faces = [LIGHT if radius == 0.1 else DARK for radius in scene.radius[1:]]
    for k in (0, len(ensemble.times) // 2, -1):
        time = float(ensemble.times[k])
        recorded = ensemble.whole[SEED].position[k]
        positions = np.array(chromium.value(f"{section}.brownpipe.at({time})"))
        assert farthest(scene, positions, recorded) < 1e-9 * scene.radius.min()
        chromium.value(f"{section}.brownpipe.go({time})")
        colours = chromium.value(f"({COLOURS})(0, {recorded[1:].tolist()})")
        crossed = sum(colour != face for colour, face in zip(colours, faces, strict=True))
        assert crossed <= 2, "the path of the tracer may cross the centres of so many other disks"
        x, y = recorded[0] + (0.0, 0.6 * scene.radius[0])
        y_inside = y if y < 3 else y - 6
        (colour,) = chromium.value(f"({COLOURS})(0, [[{x}, {y_inside}]])")
        assert colour[:3] in (FACE_OF_TRACER, [0x00, 0x72, 0xB2])
    assert chromium.console == []


@WITH_BROWSER
def test_a_disk_that_reaches_over_an_edge_is_drawn_at_the_opposite_one_too(chromium, page, runs):
    scene = runs["periodic"].scene
    ensemble = runs["periodic"].ensemble
    position = ensemble.whole[SEED].position
    reaches_over = position[:, 1:, 0] - scene.box.x[0] < 0.3 * scene.radius[1:]
    k, i = np.argwhere(reaches_over)[0] + (0, 1)
    chromium.show(page)
    section = "document.querySelectorAll('.brownpipe-replay')[1]"
    chromium.value(f"{section}.brownpipe.go({ensemble.times[k]})")
    x, y = position[k, i] + (scene.box.width - 0.6 * scene.radius[i], 0.0)
    (colour,) = chromium.value(f"({COLOURS})(1, [[{x}, {y}]])")
    assert colour == (LIGHT if scene.radius[i] == 0.1 else DARK)


@WITH_BROWSER
@pytest.mark.parametrize("name", ["channel along x", "channel along y"])
def test_disks_reach_over_periodic_sides_of_a_channel_but_not_over_its_walls(
    name, chromium, tmp_path, runs
):
    """Walls are solid lines, periodic sides dashed ones."""
    scene = runs[name].scene
    position = runs[name].ensemble.whole[SEED].position
    along = 0 if scene.box.periodic_x else 1
    reaches_over = position[:, 1:, along] + 3 < 0.3 * scene.radius[1:]
    k, i = np.argwhere(reaches_over)[0] + (0, 1)
    path = tmp_path / "channel.html"
    path.write_text(page_of(runs[name]))
    chromium.show(path)
    section = "document.querySelector('.brownpipe-replay')"
    chromium.value(f"{section}.brownpipe.go({runs[name].ensemble.times[k]})")
    place = position[k, i].copy()
    place[along] += 6 - 0.6 * scene.radius[i]
    (colour,) = chromium.value(f"({COLOURS})(0, {[place.tolist()]})")
    assert colour == (LIGHT if scene.radius[i] == 0.1 else DARK)
    points = np.linspace(-2.99, 2.99, 200)
    for axis in (0, 1):
        for side in (-3.0, 3.0):
            line = np.insert(points[:, None], axis, side, axis=1)
            colours = chromium.value(f"({COLOURS})(0, {line.tolist()})")
            is_solid = all(colour == colours[0] for colour in colours)
            assert is_solid == (axis != along)
    assert chromium.console == []


@WITH_BROWSER
def test_the_picture_follows_the_tracer_along_a_long_box(chromium, tmp_path, runs):
    path = tmp_path / "long_box.html"
    ensemble = runs["long box"].ensemble
    path.write_text(page_of(runs["long box"]))
    chromium.show(path)
    canvas = "document.querySelector('canvas').getBoundingClientRect()"
    assert chromium.value(f"{canvas}.width / {canvas}.height") == pytest.approx(6, rel=0.1)
    in_view = []
    for k in (0, -1):
        time = ensemble.times[k]
        position = ensemble.whole[SEED].position[k]
        chromium.value(f"document.querySelector('.brownpipe-replay').brownpipe.go({time})")
        off_centre = position + np.array([0.0, 0.15])
        colours = chromium.value(f"({COLOURS})(0, {off_centre.tolist()})")
        in_view.append([colour[3] > 0 for colour in colours])
        x, y = position[0] + np.array([0.0, 0.35])
        (colour,) = chromium.value(f"({COLOURS})(0, [[{x}, {y}]])")
        assert colour[:3] == FACE_OF_TRACER
    assert in_view == [[True, True, False], [True, False, True]]


@WITH_BROWSER
def test_numbers_beside_the_picture_are_those_of_the_run(chromium, page, runs):
    scene = runs["walls"].scene
    ensemble = runs["walls"].ensemble
    chromium.show(page)
    section = "document.querySelectorAll('.brownpipe-replay')[0]"
    chromium.value(f"{section}.brownpipe.go({ensemble.times[10]})")
    cells = f"[...{section}.querySelectorAll('td')]"
    texts = chromium.value(f"{cells}.map((td) => td.textContent)")
    track = ensemble.whole[SEED]
    events = ensemble.events[SEED]
    energy = 0.5 * scene.mass * np.sum(track.velocity[10] ** 2, axis=1)
    until = events.time <= ensemble.times[10]
    square = np.sum((track.position[10, 0] - track.position[0, 0]) ** 2)
    hits = np.count_nonzero(until & ((events.a == 0) | (events.b == 0)))
    assert texts[:3] == ["0.500 of 1.000", str(until.sum()), str(hits)]
    expected = [energy.sum(), energy[0], energy[1:].sum(), square]
    np.testing.assert_allclose([float(text) for text in texts[3:]], expected, rtol=1e-3)


@WITH_BROWSER
@pytest.mark.slow
def test_keys_move_the_replay(chromium, page):
    chromium.show(page)
    sliders = "[...document.querySelectorAll('.brownpipe-replay-time')]"
    times = f"{sliders}.map((input) => Number(input.value))"
    buttons = "[...document.querySelectorAll('.brownpipe-replay-play')]"
    labels = f"{buttons}.map((button) => button.textContent)"
    focused = "document.activeElement.className + document.activeElement.matches(':focus-visible')"
    # reduced motion
    assert chromium.value(times) == [0, 0]
    assert chromium.value(labels) == ["Play", "Play"]
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
    assert chromium.value(focused) == "brownpipe-replay-restarttrue"
    assert chromium.value(times) == [0, 0]
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
    time = f"{first}.querySelector('.brownpipe-replay-time').value"
    chromium.until(f"{label} === 'Pause' && {time} > 1")
    second_button = "document.querySelectorAll('.brownpipe-replay-play')[1]"
    assert chromium.value(f"{second_button}.textContent") == "Play"
    chromium.value(f"{first}.brownpipe.go(0.9999)")
    chromium.until(f"{label} === 'Play'")
    assert chromium.value(time) == "1000"
    assert chromium.console == []


@WITH_BROWSER
@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_the_window_in_its_colours(width, dark, chromium, page):
    chromium.show(page, width, dark=dark)
    assert chromium.value("document.documentElement.scrollWidth") <= width
    canvases = "[...document.querySelectorAll('canvas')]"
    edges = f"{canvases}.map((canvas) => canvas.getBoundingClientRect())"
    is_in_view = "(r) => r.width >= 200 && r.left >= 0 && r.right <= innerWidth"
    assert chromium.value(f"{edges}.every({is_in_view})")
    (ground,) = chromium.value(f"({COLOURS})(0, [[-2.95, -2.95]])")
    assert ground == ([0x1D, 0x21, 0x26, 255] if dark else [255] * 4)
    assert chromium.console == []
