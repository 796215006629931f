"""The exact path of a disk passes through all samples of it, and starts and ends with the run."""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe.errors import RequestError
from brownpipe.storage.configurations import read_scene
from ensembles import make_scene
from scenes import CHANNEL_X, CHANNEL_Y

NOTE = "config/scenes/harrison2020.yaml"
SMALL = {"name": "small", "count": "rest", "radius": 0.1, "mass": 0.4}
BIG = {"name": "big", "count": 4, "radius": 0.25, "mass": 0.7}
MIXTURE = {"tracer": {"radius": 0.3, "mass": 1.0}, "species": [SMALL, BIG]}
ALONE = [{"position": [-1.0, 0.5], "velocity": [3.0, 0.5], "radius": 0.5, "mass": 2.0}]
SCENES = {
    "walls": lambda: make_scene("walls", 40, disks=MIXTURE, duration=4.0),
    "periodic": lambda: make_scene("periodic", 40, boundary="periodic", disks=MIXTURE),
    "channel_x": lambda: make_scene("channel_x", 40, boundary=CHANNEL_X, disks=MIXTURE),
    "channel_y": lambda: make_scene("channel_y", 40, boundary=CHANNEL_Y, disks=MIXTURE),
    "later": lambda: make_scene("later", 40, equilibrate={"time": 0.3, "tracer": "pinned"}),
}
# of positions of some units of length, after some hundred collisions: round-off is 1e-15 of these
ROUND_OFF = 1e-12


def runs_of(scene, record):
    return bp.simulate(scene, seeds=[7, 3], record=record, quiet=True)


def positions_at(path, times):
    """Positions (T, 2) on a path at some times."""
    columns = [np.interp(times, path.time, column) for column in path.position.values.T]
    return np.stack(columns, axis=1)


def test_the_tracer_of_the_note_passes_through_its_samples():
    runs = runs_of(read_scene(NOTE), "velocity,events")
    for seed in (3, 7):
        path = bp.path(runs, seed=seed)
        recorded = runs.sel(seed=seed)
        positions = positions_at(path, runs.time)
        assert np.abs(positions - recorded.unwrapped).max() < ROUND_OFF
        assert path.time[0] == 0.0
        assert path.time[-1] == runs.time[-1]
        assert np.abs(path.velocity[-1] - recorded.velocity.isel(time=-1)).max() < ROUND_OFF
        events = recorded.events.to_dataset()
        of_tracer = (events.a == 0) | (events.b == 0)
        assert path.sizes["event"] == of_tracer.sum() + 2 > 3
        assert path.attrs == {"scene": "harrison2020", "seed": seed, "disk": 0}


@pytest.mark.parametrize("name", SCENES)
def test_every_disk_passes_through_its_samples(name):
    runs = runs_of(SCENES[name](), "all,events")
    recorded = runs.disks.sel(seed=7)
    for disk in recorded.disk.values:
        path = bp.path(runs, 7, disk)
        positions = positions_at(path, runs.time)
        assert np.abs(positions - recorded.unwrapped.sel(disk=disk)).max() < ROUND_OFF
        last_velocity = recorded.velocity.sel(disk=disk).isel(time=-1)
        assert np.abs(path.velocity[-1] - last_velocity).max() < ROUND_OFF


def test_speeds_change_at_collisions_with_disks_alone():
    """A wall turns the velocity of a disk, and keeps its speed."""
    runs = runs_of(make_scene(disks=ALONE, particles=1, duration=4.0), "velocity,events")
    path = bp.path(runs)
    assert path.sizes["event"] > 2
    assert np.allclose((path.velocity**2).sum("component"), 9.25, rtol=1e-14, atol=0)


def test_a_disk_without_collisions_moves_straight():
    scene = make_scene(disks=ALONE, particles=1, boundary="periodic", duration=4.0)
    path = bp.path(bp.simulate(scene, record="velocity,events", quiet=True))
    assert path.time.values.tolist() == [0.0, 4.0]
    assert path.position.values.tolist() == [[-1.0, 0.5], [11.0, 2.5]]
    assert path.velocity.values.tolist() == [[3.0, 0.5], [3.0, 0.5]]


def test_the_smallest_seed_is_the_default_and_selections_have_paths(tmp_path):
    runs = runs_of(make_scene(), "velocity,events")
    path = bp.path(runs)
    assert path.attrs["seed"] == 3
    assert bp.path(runs.sel(seed=[7])).identical(bp.path(runs, seed=7))
    bp.save(runs, tmp_path / "runs.h5")
    assert bp.path(bp.open(tmp_path / "runs.h5")).identical(path)


WITHOUT_COLLISIONS = (
    "runs: hold no collisions; record them: brownpipe.simulate(..., record='velocity,events')"
)
WITHOUT_VELOCITY = (
    "runs: hold no velocity of disk {} at t = 0; record it: brownpipe.simulate(..., record='{}')"
)


@pytest.mark.parametrize(
    ("record", "arguments", "message"),
    [
        ("velocity", {}, WITHOUT_COLLISIONS),
        ("events", {}, WITHOUT_VELOCITY.format(0, "velocity,events")),
        ("velocity,events", {"disk": 4}, WITHOUT_VELOCITY.format(4, "all,events")),
        ("all,events", {"seed": 4}, "seed: must be of 3,7, not 4"),
        ("all,events", {"disk": 20}, "disk: must be from 0 to 19, not 20"),
        ("all,events", {"disk": -1}, "disk: must be from 0 to 19, not -1"),
        ("all,events", {"disk": True}, "disk: must be a valid integer, not True"),
        ("all,events", {"seed": True}, "seed: must be a valid integer, not True"),
    ],
)
def test_refusals(record, arguments, message):
    runs = runs_of(make_scene(), record)
    with pytest.raises(RequestError) as refusal:
        bp.path(runs, **arguments)
    assert str(refusal.value) == message


def test_engines_without_collisions_have_no_paths():
    scene = make_scene()
    runs = bp.simulate(scene, engine="timestep", time_step=0.001, record="velocity", quiet=True)
    with pytest.raises(RequestError, match="the timestep engine knows no instants of collisions"):
        bp.path(runs)
    with pytest.raises(RequestError, match="runs: must be what simulate or open returns"):
        bp.path(scene)
