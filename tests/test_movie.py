"""Pictures and animations of a whole run: what is in them, the same bytes each time, refusals by
name.
"""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgba_array
from PIL import Image

from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Track
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.figures import movie, style
from brownpipe.storage.trajectories import write_trajectories
from brownpipe.text import in_bytes
from ensembles import make_runs, make_scene
from scenes import CHANNEL_X, CHANNEL_Y, PERIODIC, WALLS

SEEDS = (3, 8)


def whole(scene, seed):
    """A whole run that is no physics: every disk on a straight line, across the edges of the box
    again and again.
    """
    start, velocity = np.random.default_rng(seed).uniform(-3, 3, (2, scene.particles, 2))
    from_corner = start + scene.times[:, None, None] * 5 * velocity + 3
    image = np.floor_divide(from_corner, 6).astype(np.int32)
    position = from_corner - 6 * image - 3
    return Track(position, np.broadcast_to(velocity, position.shape), image)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    scene = make_scene("walk", 12, boundary="periodic")
    runs = make_runs(scene, SEEDS)
    tracks = {seed: whole(scene, seed) for seed in SEEDS}
    path = tmp_path_factory.mktemp("movie") / "runs.h5"
    write_trajectories(path, scene, Engine("exact"), runs.ensemble._replace(whole=tracks))
    return path


def make_movie(path, kind, *options):
    """The bytes of the file that the verb writes."""
    target = path.with_suffix(kind)
    assert main(["movie", str(path), "--output", str(target), *options]) == DONE
    return target.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "options", "frames"),
    [(".png", (), "1 frame"), (".gif", ("--frames", "5", "--fps", "10"), "5 frames")],
)
def test_same_bytes_for_the_same_run_with_the_frames_asked_for_and_it_says_so(
    path, kind, options, frames, capsys
):
    contents = make_movie(path, kind, *options)
    line = f"{path.with_suffix(kind)}: {frames}, {in_bytes(len(contents))}\n"
    assert capsys.readouterr().out == line
    assert make_movie(path, kind, *options, "--seed", "3") == contents
    assert make_movie(path, kind, *options, "--seed", "8") != contents
    with Image.open(io.BytesIO(contents)) as picture:
        if options:
            assert picture.n_frames == 5
            assert (picture.info["duration"], picture.info["loop"]) == (100, 0)
        else:
            assert getattr(picture, "n_frames", 1) == 1
            assert not {"duration", "loop"} & picture.info.keys()


def test_an_animation_has_a_frame_a_sample_and_the_last_is_the_picture_in_its_colours(path):
    frames = io.BytesIO(make_movie(path, ".gif"))
    large = io.BytesIO(make_movie(path, ".png"))
    with Image.open(frames) as animation, Image.open(large) as picture:
        assert (animation.n_frames, animation.info["duration"]) == (21, 40)
        is_even = [side % 2 == 0 for side in animation.size]
        assert all(is_even), "or H.264 refuses to make a video of it"
        animation.seek(20)
        last_frame = np.asarray(animation.convert("RGB")).astype(int)
        small = np.asarray(picture.convert("RGB").resize(animation.size, Image.Resampling.BOX))
    # edges differ by the resolution; most pixels are white, which the GIF has as 254
    assert abs(small - last_frame).mean() < 4


def test_a_frame_shows_every_disk_to_scale_in_its_colour_and_the_path_so_far():
    light = {"name": "light", "count": 2, "radius": 0.2, "mass": 1.0}
    heavy = {"name": "heavy", "count": 9, "radius": 0.2, "mass": 4.0}
    disks = {"tracer": {"radius": 0.3, "mass": 1.0}, "species": [light, heavy]}
    box = {"x": [-3.0, 3.0], "y": [-1.0, 9.0], "boundary": "periodic"}
    scene = make_scene(box=box, particles=12, disks=disks)
    position = np.random.default_rng(1).uniform([-3.0, -1.0], [3.0, 9.0], (21, 12, 2))
    image = np.zeros(position.shape, np.int32)
    with style.drawing():
        figure, show = movie.scenery_of(scene, 3, Track(position, position, image))
        show(7)
    (axes,) = figure.axes
    assert axes.get_xlim() == (-3, 3)
    assert axes.get_ylim() == (-1, 9)
    assert axes.get_title("right") == "$t$ = 0.3500"

    def assert_equal(drawn, expected):
        np.testing.assert_allclose(drawn, expected, rtol=1e-15)

    centres, shown_disks = movie.with_images(scene, position[7])
    (circles,) = axes.collections
    assert_equal(circles.get_offsets(), centres)
    assert_equal(circles.get_widths(), 2 * scene.radius[shown_disks])
    assert_equal(circles.get_heights(), 2 * scene.radius[shown_disks])
    species_index = np.array([0, 1, 1, *[2] * 9])
    faces = movie.FACES[species_index[shown_disks]]
    assert_equal(circles.get_facecolor(), to_rgba_array(faces))
    path, centre, start = axes.lines
    assert_equal(path.get_xydata(), position[:8, 0])
    assert_equal(centre.get_xydata(), position[7:8, 0])
    assert_equal(start.get_xydata(), position[:1, 0])
    _, *others = [text.get_text() for text in figure.legends[0].get_texts()]
    assert others == [
        "2 other disks: radius 0.2, mass 1",
        "9 other disks: radius 0.2, mass 4",
    ]


def test_refusals(path, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("brownpipe.figures.movie._gif", None)  # nothing is drawn before
    tracer_alone = tmp_path / "tracer.h5"
    ensemble = make_runs(make_scene(), [1]).ensemble
    write_trajectories(tracer_alone, make_scene(), Engine("exact"), ensemble)
    film = f"{path} --output {tmp_path / 'run.avi'}"
    gif = f"{path} --output {tmp_path / 'a.gif'}"
    rates = "--fps: must be from 0.00153 to 50 frames a second for a .gif"
    for arguments, message in (
        (tracer_alone, "holds no whole runs; brownpipe simulate SCENE --record all makes some"),
        (f"{path} --seed 17", "holds no run of seed 17; must be of 3,8"),
        (film, "the output must end in .gif, .png or .html, not '.avi'"),
        (f"{path} --output {path}", "is an input"),
        (f"{gif} --fps 0.0015", f"{rates}, not 0.0015"),
        (f"{gif} --fps 50.0001", f"{rates}, not 50.0001"),
    ):
        assert main(["movie", *str(arguments).split()]) == WRONG_REQUEST
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert [*tmp_path.iterdir()] == [tracer_alone]


def test_images_of_disks_that_reach_over_an_edge():
    scene = make_scene(particles=2, boundary="periodic")
    centres, disks = movie.with_images(scene, np.array([[-2.9, 2.8], [0.0, -2.95]]))
    images_of_disks = []
    for disk, (x, y) in zip(disks, centres.round(9), strict=True):
        images_of_disks.append((int(disk), float(x), float(y)))
    assert sorted(images_of_disks) == [
        (0, -2.9, -3.2),
        (0, -2.9, 2.8),
        (0, 3.1, -3.2),
        (0, 3.1, 2.8),
        (1, 0.0, -2.95),
        (1, 0.0, 3.05),
    ]
    assert list(disks) == sorted(disks, reverse=True)  # the disk that is followed lies on top
    walls = make_scene(particles=2)
    _, disks = movie.with_images(walls, np.array([[-2.7, 2.7], [0.0, -2.9]]))
    assert len(disks) == 2


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_images_in_a_channel_are_those_across_its_periodic_sides(boundary):
    channel = make_scene(particles=2, boundary=boundary)
    at_wall_and_over_side = np.where(channel.box.periodic_axes, 2.95, -2.9)
    centres, disks = movie.with_images(channel, np.array([[0.0, 0.0], at_wall_and_over_side]))
    across = np.where(channel.box.periodic_axes, 6.0, 0.0)
    assert list(disks) == [1, 1, 0]
    np.testing.assert_allclose(np.ptp(centres[:2], axis=0), across)


@pytest.mark.parametrize(
    ("boundary", "solid", "words"),
    [
        (WALLS, {"left", "right", "bottom", "top"}, "hard walls"),
        (PERIODIC, set(), "periodic"),
        (CHANNEL_X, {"bottom", "top"}, "periodic in x, hard walls in y"),
        (CHANNEL_Y, {"left", "right"}, "periodic in y, hard walls in x"),
    ],
)
def test_walls_are_solid_and_periodic_sides_dashed(boundary, solid, words):
    scene = make_scene("walk", 12, boundary=boundary)
    with style.drawing():
        figure, _ = movie.scenery_of(scene, 3, whole(scene, 3))
    (axes,) = figure.axes
    is_solid = {side for side, spine in axes.spines.items() if spine.get_linestyle() == "-"}
    assert is_solid == solid
    assert axes.get_xlabel() == f"6 x 6 (reduced units), {words}"


def test_path_has_a_gap_where_it_goes_on_at_the_other_edge():
    """The pieces, each a straight line, make up the way of free flight but for the steps across an
    edge.
    """
    scene = make_scene("walk", 12, boundary="periodic")
    track = whole(scene, 3)
    points, ends = movie.path_of(track)
    for k in range(len(scene.times)):
        np.testing.assert_array_equal(points[ends[k] - 1], track.position[k, 0])
    steps = np.hypot(*np.diff(points, axis=0).T)
    gaps = np.isnan(steps).sum() / 2
    crossings = np.diff(track.image[:, 0], axis=0).any(axis=1).sum()
    assert crossings > 1
    assert gaps == crossings
    speed = 5 * np.hypot(*track.velocity[0, 0])
    assert np.nansum(steps) == pytest.approx(speed * (1 - 0.05 * crossings))
