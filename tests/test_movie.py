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

SEEDS = (3, 8)


def whole(scene, seed):
    """A whole run that is no physics: every disk on a straight line, across the edges of the box
    again and again.
    """
    start, velocity = np.random.default_rng(seed).uniform(-3, 3, (2, scene.particles, 2))
    free = start + scene.times[:, None, None] * 5 * velocity + 3
    image = np.floor_divide(free, 6).astype(np.int32)
    return Track(free - 6 * image - 3, np.broadcast_to(velocity, free.shape), image)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    scene = make_scene("walk", 12, boundary="periodic")
    runs = make_runs(scene, SEEDS)
    tracks = {seed: whole(scene, seed) for seed in SEEDS}
    path = tmp_path_factory.mktemp("movie") / "runs.h5"
    write_trajectories(path, scene, Engine("exact"), runs.ensemble._replace(whole=tracks))
    return path


def made(path, kind, *options):
    """The bytes of the file that the verb writes."""
    target = path.with_suffix(kind)
    assert main(["movie", str(path), "--output", str(target), *options]) == DONE
    return target.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "asked"), [(".png", ()), (".gif", ("--frames", "5", "--fps", "10"))]
)
def test_same_bytes_for_the_same_run_with_the_frames_asked_for_and_it_says_so(
    path, kind, asked, capsys
):
    contents = made(path, kind, *asked)
    frames = "5 frames" if asked else "1 frame"
    assert (
        capsys.readouterr().out
        == f"{path.with_suffix(kind)}: {frames}, {in_bytes(len(contents))}\n"
    )
    assert (
        contents
        == made(path, kind, *asked, "--seed", "3")
        != made(path, kind, *asked, "--seed", "8")
    )
    with Image.open(io.BytesIO(contents)) as picture:
        shown = getattr(picture, "n_frames", 1), *map(picture.info.get, ("duration", "loop"))
    assert shown == ((5, 100, 0) if asked else (1, None, None))


def test_an_animation_has_a_frame_a_sample_and_the_last_is_the_picture_in_its_colours(path):
    with (
        Image.open(io.BytesIO(made(path, ".gif"))) as animation,
        Image.open(io.BytesIO(made(path, ".png"))) as picture,
    ):
        assert (animation.n_frames, animation.info["duration"]) == (21, 40)
        assert all(side % 2 == 0 for side in animation.size), (
            "or H.264 refuses to make a video of it"
        )
        animation.seek(20)
        small = np.asarray(picture.convert("RGB").resize(animation.size, Image.Resampling.BOX))
        apart = abs(small - np.asarray(animation.convert("RGB")).astype(int))
    assert (
        apart.mean() < 4
    )  # edges differ by the resolution; most pixels are white, which the GIF has as 254


def test_a_frame_shows_every_disk_to_scale_in_its_colour_and_the_path_so_far():
    kinds = [
        {"name": f"bath-{n}", "count": n, "radius": 0.2, "mass": mass}
        for n, mass in ((2, 1.0), (9, 4.0))
    ]
    disks = {"tracer": {"radius": 0.3, "mass": 1.0}, "species": kinds}
    scene = make_scene(
        box={"x": [-3.0, 3.0], "y": [-1.0, 9.0], "boundary": "periodic"}, particles=12, disks=disks
    )
    position = np.random.default_rng(1).uniform([-3.0, -1.0], [3.0, 9.0], (21, 12, 2))
    with style.drawing():
        figure, show = movie.scenery_of(
            scene, 3, Track(position, position, np.zeros(position.shape, np.int32))
        )
        show(7)
    (axes,), (centres, which) = figure.axes, movie.with_images(scene, position[7])
    (disks,), (path, centre, start) = axes.collections, axes.lines
    assert (axes.get_xlim(), axes.get_ylim(), axes.get_title("right")) == (
        (-3, 3),
        (-1, 9),
        "$t$ = 0.3500",
    )
    for found, expected in (
        (disks.get_offsets(), centres),
        ([disks.get_widths(), disks.get_heights()], [2 * scene.radius[which]] * 2),
        (disks.get_facecolor(), to_rgba_array(movie.FACES[np.array([0, 1, 1, *[2] * 9])[which]])),
        (path.get_xydata(), position[:8, 0]),
        ([*centre.get_xydata(), *start.get_xydata()], position[[7, 0], 0]),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-15)
    others = [f"{count} other disks: radius 0.2, mass {mass}" for count, mass in ((2, 1), (9, 4))]
    assert [text.get_text() for text in figure.legends[0].get_texts()][1:] == others


def test_refusals(path, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("brownpipe.figures.movie._gif", None)  # nothing is drawn before
    write_trajectories(
        tmp_path / "tracer.h5", make_scene(), Engine("exact"), make_runs(make_scene(), [1]).ensemble
    )
    gif = "--output", tmp_path / "a.gif"
    asked = {
        "holds no whole runs; brownpipe simulate SCENE --record all makes some": [
            tmp_path / "tracer.h5"
        ],
        "holds no run of seed 17; must be of 3,8": [path, "--seed", "17"],
        "the output must end in .gif, .png or .html, not '.avi'": [
            path,
            "--output",
            tmp_path / "run.avi",
        ],
        "is an input": [path, "--output", path],
        "--fps: must be from 0.00153 to 50 frames a second for a .gif, not 0.0015": [
            path,
            *gif,
            "--fps",
            "0.0015",
        ],
        "--fps: must be from 0.00153 to 50 frames a second for a .gif, not 50.0001": [
            path,
            *gif,
            "--fps",
            "50.0001",
        ],
    }
    for message, arguments in asked.items():
        assert main(["movie", *map(str, arguments)]) == WRONG_REQUEST
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    assert [*tmp_path.iterdir()] == [tmp_path / "tracer.h5"]


def test_images_of_disks_that_reach_over_an_edge():
    scene = make_scene(particles=2, boundary="periodic")
    centres, which = movie.with_images(scene, np.array([[-2.9, 2.8], [0.0, -2.95]]))
    found = sorted(
        (int(k), *map(float, centre.round(9))) for k, centre in zip(which, centres, strict=True)
    )
    assert found == [
        *((0, x, y) for x in (-2.9, 3.1) for y in (-3.2, 2.8)),
        (1, 0.0, -2.95),
        (1, 0.0, 3.05),
    ]
    assert list(which) == sorted(which, reverse=True)  # the disk that is followed lies on top
    assert (
        len(movie.with_images(make_scene(particles=2), np.array([[-2.7, 2.7], [0.0, -2.9]]))[1])
        == 2
    )


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
    gaps, crossings = (
        np.isnan(steps).sum() / 2,
        np.diff(track.image[:, 0], axis=0).any(axis=1).sum(),
    )
    assert gaps == crossings > 1
    speed = 5 * np.hypot(*track.velocity[0, 0])
    assert np.nansum(steps) == pytest.approx(speed * (1 - 0.05 * crossings))
