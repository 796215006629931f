"""Pictures and animations of a whole run: what is in them, the same bytes each time, refusals by name."""

import io

import numpy as np
import pytest
from PIL import Image, ImageSequence

from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Track
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.figures import movie
from brownpipe.storage.trajectories import write_trajectories
from brownpipe.text import in_bytes
from ensembles import make_runs, make_scene

SEEDS = (3, 8)


def whole(scene, seed):
    """A whole run that is no physics: every disk on a straight line, across the edges of the box again and again."""
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


@pytest.fixture(scope="module")
def frames(path):
    """The frames of an animation with its defaults, one a sample, from red, green and blue."""
    with Image.open(io.BytesIO(made(path, ".gif"))) as animation:
        assert (animation.n_frames, animation.info["duration"]) == (21, 40)
        assert all(side % 2 == 0 for side in animation.size), "or H.264 refuses to make a video of it"
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(animation)]


@pytest.mark.slow
def test_same_bytes_for_the_same_run(path):
    for kind, few in ((".png", ()), (".gif", ("--frames", "3"))):
        assert made(path, kind, *few) == made(path, kind, *few, "--seed", "3") != made(path, kind, *few, "--seed", "8")


@pytest.mark.slow
def test_animation_has_the_frames_asked_for_and_it_says_so(path, capsys):
    contents = made(path, ".gif", "--frames", "5", "--fps", "10")
    assert capsys.readouterr().out == f"{path.with_suffix('.gif')}: 5 frames, {in_bytes(len(contents))}\n"
    with Image.open(io.BytesIO(contents)) as animation:
        assert (animation.n_frames, animation.info["duration"], animation.info["loop"]) == (5, 100, 0)


@pytest.mark.parametrize("fps", ["0.0015", "50.0001"])
def test_rate_that_a_gif_cannot_have_is_refused_before_anything_is_drawn(path, tmp_path, capsys, monkeypatch, fps):
    monkeypatch.setattr("brownpipe.figures.movie._gif", None)
    assert main(["movie", str(path), "--output", str(tmp_path / "a.gif"), "--fps", fps]) == WRONG_REQUEST
    assert capsys.readouterr().err.startswith("brownpipe: --fps: must be from 0.00153 to 50 frames a second")
    assert not (tmp_path / "a.gif").exists()


def test_last_frame_is_the_picture_in_the_colours_of_the_animation(path, frames):
    with Image.open(io.BytesIO(made(path, ".png"))) as picture:
        small = np.asarray(picture.convert("RGB").resize(frames[-1].shape[1::-1], Image.Resampling.BOX))
    apart = abs(small - frames[-1].astype(int))
    assert apart.mean() < 4  # edges differ by the resolution; most pixels are white, which the GIF has as 254


def test_refusals(path, tmp_path, capsys):
    write_trajectories(tmp_path / "tracer.h5", make_scene(), Engine("exact"), make_runs(make_scene(), [1]).ensemble)
    asked = {
        "holds no whole runs; brownpipe simulate SCENE --record all makes some": [tmp_path / "tracer.h5"],
        "holds no run of seed 17; must be of 3,8": [path, "--seed", "17"],
        "the output must end in .gif, .png or .html, not '.avi'": [path, "--output", tmp_path / "run.avi"],
        "is an input": [path, "--output", path],
    }
    for message, arguments in asked.items():
        assert main(["movie", *map(str, arguments)]) == WRONG_REQUEST
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


def test_images_of_disks_that_reach_over_an_edge():
    scene = make_scene(particles=2, boundary="periodic")
    centres, which = movie.with_images(scene, np.array([[-2.9, 2.8], [0.0, -2.95]]))
    found = sorted((int(k), *map(float, centre.round(9))) for k, centre in zip(which, centres, strict=True))
    assert found == [*((0, x, y) for x in (-2.9, 3.1) for y in (-3.2, 2.8)), (1, 0.0, -2.95), (1, 0.0, 3.05)]
    assert list(which) == sorted(which, reverse=True)  # the disk that is followed lies on top
    assert len(movie.with_images(make_scene(particles=2), np.array([[-2.7, 2.7], [0.0, -2.9]]))[1]) == 2


def test_path_has_a_gap_where_it_goes_on_at_the_other_edge():
    """The pieces, each a straight line, make up the way of free flight but for the steps across an edge."""
    scene = make_scene("walk", 12, boundary="periodic")
    track = whole(scene, 3)
    points, ends = movie.path_of(track)
    for k in range(len(scene.times)):
        np.testing.assert_array_equal(points[ends[k] - 1], track.position[k, 0])
    steps = np.hypot(*np.diff(points, axis=0).T)
    gaps, crossings = np.isnan(steps).sum() / 2, np.diff(track.image[:, 0], axis=0).any(axis=1).sum()
    assert gaps == crossings > 1
    speed = 5 * np.hypot(*track.velocity[0, 0])
    assert np.nansum(steps) == pytest.approx(speed * (1 - 0.05 * crossings))
