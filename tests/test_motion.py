"""How disks move at first: what is known of their velocities at t = 0 before any run.

Tolerances are in standard errors: 4.5 is a false alarm in 1 of 150,000 comparisons.
"""

import numpy as np
import pytest

import brownpipe as bp
from brownpipe.engines.start.initial_state import draw_state, draw_tracer, noise_stream
from brownpipe.scene import motion
from ensembles import make_scene
from scenes import CHANNEL_X, CHANNEL_Y

SIGMAS = 4.5


@pytest.mark.parametrize("velocities", [
    {"standard_deviation": 2.0},
    {"temperature": 1.6},
    {"standard_deviation": 2.0, "zero_momentum": True},
    {"temperature": 1.6, "zero_momentum": True},
])  # fmt: skip
def test_the_square_speed_of_the_tracer_is_that_of_drawn_states(velocities):
    scene = make_scene(particles=4, velocities=velocities)
    v2 = np.array([np.square(draw_state(scene, seed).velocity[0]).sum() for seed in range(1500)])
    error = v2.std() / np.sqrt(v2.size)
    assert abs(v2.mean() - motion.mean_square_speed_of_tracer(scene)) < SIGMAS * error


def test_the_square_speed_of_a_hot_tracer_that_cools_is_not_known():
    free = make_scene(equilibrate={"time": 1.0, "tracer": "free"})
    pinned = make_scene(equilibrate={"time": 1.0, "tracer": "pinned"})
    assert np.isnan(motion.mean_square_speed_of_tracer(free))
    assert motion.mean_square_speed_of_tracer(pinned) == 8.0


HEAVY_BATH = [
    {"name": "heavy", "count": 2, "radius": 0.5, "mass": 4.0},
    {"name": "light", "count": 3, "radius": 0.4, "mass": 0.5},
]
MANY_LIGHT = [
    {"name": "light", "count": 6, "radius": 0.3, "mass": 0.5},
    {"name": "heavy", "count": 1, "radius": 0.6, "mass": 6.0},
]
THREE_KINDS = [
    {"name": "heavy", "count": 1, "radius": 0.5, "mass": 3.0},
    {"name": "middle", "count": 2, "radius": 0.4, "mass": 1.0},
    {"name": "light", "count": 4, "radius": 0.3, "mass": 0.2},
]
SCENES = [
    ("periodic", 2.0, HEAVY_BATH),
    ("periodic", 0.7, MANY_LIGHT),
    ("reflecting", 1.5, THREE_KINDS),
    (CHANNEL_X, 2.0, HEAVY_BATH),
    (CHANNEL_Y, 0.7, MANY_LIGHT),
]


def around_a_pinned_tracer(boundary, mass, bath):
    return bp.Scene(
        box={"x": (0, 4), "y": (0, 4), "boundary": boundary},
        disks={"tracer": {"radius": 0.5, "mass": mass}, "species": bath},
        velocities={"standard_deviation": 1.0, "zero_momentum": True},
        equilibrate={"time": 12.0, "tracer": "pinned"},
        duration=1e-6,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("boundary", "mass", "bath"), SCENES)
def test_around_a_pinned_tracer_the_bath_shares_its_energy_before_its_momentum_is_subtracted(
    boundary, mass, bath
):
    """Without that the value would be 9 to 19 standard errors away."""
    scene = around_a_pinned_tracer(boundary, mass, bath)
    runs = bp.simulate(scene, 5000, record="none", quiet=True)
    v2 = runs.initial_square_speed.values
    error = v2.std() / np.sqrt(v2.size)
    assert abs(v2.mean() - motion.mean_square_speed_of_tracer(scene)) < SIGMAS * error


@pytest.mark.parametrize(("boundary", "mass", "bath"), SCENES)
def test_a_tracer_drawn_alone_has_the_same_square_speed(boundary, mass, bath):
    scene = around_a_pinned_tracer(boundary, mass, bath)
    drawn = [draw_tracer(scene, seed, noise_stream(scene, seed))[1] for seed in range(3000)]
    v2 = np.square(drawn).sum(axis=1)
    error = v2.std() / np.sqrt(v2.size)
    assert abs(v2.mean() - motion.mean_square_speed_of_tracer(scene)) < SIGMAS * error


def test_the_motion_of_very_many_very_heavy_disks_overflows_nothing():
    scene = make_scene(
        disks={
            "tracer": {"radius": 0.3, "mass": 1e300},
            "species": [
                {"name": "heavy", "count": 40, "radius": 0.01, "mass": 1.7e308},
                {"name": "light", "count": 40, "radius": 0.01, "mass": 1e200},
            ],
        },
        particles=81,
        velocities={"standard_deviation": 2.0, "zero_momentum": True},
        equilibrate={"time": 1.0, "tracer": "pinned"},
    )
    expected = 2 * 4.0 * (1 + 0.5 / 40)  # two components; <P^2> of the bath is 40 m^2 s^2 / 2
    assert motion.mean_square_speed_of_tracer(scene) == pytest.approx(expected, rel=1e-7)
    assert not motion.mean_square_velocity_of_centre(scene).any()


def channel(boundary, **velocities):
    """A tracer and six disks in a channel."""
    return make_scene(
        box={"x": [-3.0, 3.0], "y": [-2.0, 2.0], "boundary": boundary},
        particles=7,
        velocities={"temperature": 1.6} | velocities,
    )


@pytest.mark.parametrize(("boundary", "along"), [(CHANNEL_X, 0), (CHANNEL_Y, 1)])
def test_in_a_channel_the_momentum_along_it_is_zero_and_no_other(boundary, along):
    scene = channel(boundary)
    assert scene.velocities.zero_momentum
    assert motion.moving_disks(scene) == 6.5
    momentum = scene.mass @ draw_state(scene, 3).velocity
    assert abs(momentum[along]) < 1e-14
    assert abs(momentum[1 - along]) > 1e-3
    free = channel(boundary, zero_momentum=False)
    assert motion.moving_disks(free) == 7


@pytest.mark.parametrize("zero_momentum", [True, False])
@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_the_centre_of_mass_in_a_channel_moves_as_that_of_drawn_states(boundary, zero_momentum):
    scene = channel(boundary, zero_momentum=zero_momentum)
    share = scene.mass / scene.mass.sum()
    drawn = np.array([share @ draw_state(scene, seed).velocity for seed in range(2000)])
    error = (drawn**2).std(axis=0) / np.sqrt(len(drawn))
    expected = motion.mean_square_velocity_of_centre(scene)
    assert (np.abs((drawn**2).mean(axis=0) - expected) <= SIGMAS * error + 1e-15).all()
