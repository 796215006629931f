"""Given disks that overlap, since their coordinates were rounded, are pushed apart."""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe.engines.start import initial_state
from brownpipe.engines.start.initial_state import draw_state, separated, separation_in_words
from brownpipe.errors import RequestError
from brownpipe.scene import parse_scene
from brownpipe.scene.configuration import Configuration
from brownpipe.scene.overlaps import overlaps
from scenes import CHANNEL_Y, PERIODIC, WALLS

SIDE = 40.0


def dense(boundary):
    """1,000 disks of two radii at a packing fraction of 0.7, as the program places them."""
    mapping = {
        "box": {"x": [3.0, 3.0 + SIDE], "y": [-SIDE, 0.0], "boundary": boundary},
        "disks": {
            "tracer": {"radius": 0.9, "mass": 3.0},
            "species": [
                {"name": "small", "count": 600, "radius": 0.525, "mass": 1.0},
                {"name": "large", "count": 399, "radius": 0.67, "mass": 2.0},
            ],
        },
        "velocities": {"temperature": 1.0},
        "duration": 0.1,
    }
    scene = parse_scene(mapping, "dense.yaml")
    assert 0.65 < scene.packing_fraction < 0.72
    return mapping, scene, draw_state(scene, 0).position


def of_given(mapping, scene, position, **keys):
    """The scene of these disks at given positions."""
    given = Configuration(position, None, scene.radius, scene.mass)
    disks = {"configuration": given, "tracer": {"mass": 3.0}, **keys}
    return parse_scene(mapping | {"disks": disks}, "given.yaml")


@pytest.mark.parametrize("boundary", [PERIODIC, WALLS, CHANNEL_Y])
@pytest.mark.parametrize("decimals", [5, 3, 2])
def test_rounded_coordinates_are_separated(boundary, decimals):
    mapping, scene, position = dense(boundary)
    rounded = position.round(decimals)
    allowed = 10.0**-decimals
    given = of_given(mapping, scene, rounded, push_apart=allowed)
    separation = separated(given)
    assert overlaps(separation.position, given.radius, given.box.periodic_sides) is None
    step = given.box.nearest_image(separation.position - rounded)
    assert np.abs(step).max() < 20 * allowed  # a dense row hands a push on
    assert np.hypot(*step.T).max() == pytest.approx(separation.farthest, rel=1e-6, abs=1e-12)
    for seed in (0, 1):
        assert np.array_equal(draw_state(given, seed).position, separation.position)


def test_disks_that_do_not_overlap_stay_where_they_are():
    mapping, scene, position = dense("periodic")
    given = of_given(mapping, scene, position, push_apart=1e-3)
    assert np.array_equal(separated(given).position, position)
    assert separation_in_words(given) is None


def test_the_refusal_counts_the_pairs_and_names_the_key():
    mapping, scene, position = dense("periodic")
    with pytest.raises(RequestError) as refused:
        of_given(mapping, scene, position.round(2))
    message = str(refused.value)
    assert " pairs overlap, these two most; push_apart: " in message
    needed = float(message.partition("push_apart: ")[2].split()[0])
    assert separated(of_given(mapping, scene, position.round(2), push_apart=needed)).moved > 0


def test_a_line_says_how_many_and_how_far():
    mapping, scene, position = dense("periodic")
    given = of_given(mapping, scene, position.round(2), push_apart=0.02)
    with pytest.warns(UserWarning, match=r"given: \d+ pairs overlapped, by 0\.0\d+ contact dist"):
        runs = bp.simulate(given, 2)
    assert float(runs.worst_overlap.max()) < 1e-9


def without_room():
    """A row of disks that fills the box, and one more."""
    x = np.linspace(0.5, 9.5, 11)
    position = np.stack([x, np.full(11, 0.5)], axis=1)
    given = Configuration(position, None, np.full(11, 0.5), np.ones(11))
    return parse_scene(
        {
            "box": {"x": [0.0, 10.0], "y": [0.0, 1.0]},
            "disks": {"configuration": given, "push_apart": 0.2},
            "velocities": {"temperature": 0.0},
            "duration": 1.0,
        },
        "row.yaml",
    )


@pytest.mark.parametrize(("pushes", "sweeps"), [(initial_state.MOST_PUSHES, 5000), (100, 10)])
def test_disks_without_room_are_refused_after_bounded_work(pushes, sweeps, monkeypatch):
    monkeypatch.setattr(initial_state, "MOST_PUSHES", pushes)
    separated.cache_clear()
    problem = f"11 disks still overlap after they were pushed apart {sweeps} times"
    with pytest.raises(RequestError, match=problem):
        draw_state(without_room(), 0)


@pytest.mark.parametrize(("position", "radius"), [
    (np.zeros((30_000, 2)), 0.1),  # they were not written
    (np.random.default_rng(1).uniform(-20, 20, (30_000, 2)), 9.0),  # radii in another unit
])  # fmt: skip
@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_crowded_disks_are_refused_before_their_pairs_are_listed(position, radius, boundary):
    """30,000 disks have up to 450 million pairs."""
    number = len(position)
    given = Configuration(position, None, np.full(number, radius), np.ones(number))
    with pytest.raises(RequestError, match=r"disks: disk \d+ at .* has \d+ disks closer than its"):
        bp.Scene(
            box={"x": [-30.0, 30.0], "y": [-30.0, 30.0], "boundary": boundary},
            disks={"configuration": given, "push_apart": 1.0},
            velocities={"temperature": 1.0},
            duration=1.0,
        )


def test_two_disks_in_a_wide_box_are_separated():
    """A cell for each disk in 1e5 x 1e5 would take 75 GB."""
    given = Configuration(np.array([[1.0, 1.0], [1.9, 1.0]]), None, np.full(2, 0.5), np.ones(2))
    scene = bp.Scene(
        box={"x": [0.0, 1e5], "y": [0.0, 1e5]},
        disks={"configuration": given, "push_apart": 0.2},
        velocities={"temperature": 1.0},
        duration=1.0,
    )
    assert separated(scene).position[:, 0] == pytest.approx([0.95, 1.95])
