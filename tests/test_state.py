"""The initial state: the same for the same scene and seed, and distributed as the scene says."""

import math

import numpy as np
import pytest
from scipy import stats

from brownpipe.engines.exact.simulation import simulate
from brownpipe.engines.initial_state import draw
from brownpipe.scene import packing, parse_scene
from test_exact import P, W, box, explicit, make, note_scene

VELOCITY_17 = [-0.042623150097255494, 2.3328060725321036]
POSITION_17 = [-2.5213268957650588, 0.5819693892044553]


def test_the_same_seed_gives_the_same_state():
    scene = note_scene(1.0)
    one, two = draw(scene, 17), draw(scene, 17)
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert not np.array_equal(one.position, draw(scene, 18).position)
    assert not np.array_equal(one.velocity, draw(scene, 18).velocity)


def test_a_state_does_not_depend_on_what_is_done_with_it():
    a, b = draw(note_scene(1.0), 3), draw(note_scene(7.0, sample_interval=0.1), 3)
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_particle_counts_have_streams_of_their_own():
    few, many = draw(note_scene(1.0, particles=100), 3), draw(note_scene(1.0), 3)
    assert not np.isin(few.velocity, many.velocity).any()


def test_the_published_numbers_do_not_change():
    """A guard against a new stream by accident: seeds name states, in files and papers."""
    state = draw(note_scene(1.0), 17)
    assert state.velocity[0].tolist() == VELOCITY_17
    assert state.position[1].tolist() == POSITION_17


def test_the_notes_initial_condition():
    state = draw(note_scene(1.0), 0)
    assert state.position.shape == state.velocity.shape == (150, 2)
    assert state.position[0].tolist() == [0.0, 0.0]
    assert state.radius.tolist() == [0.3] + [0.1] * 149
    assert state.mass.tolist() == [1.0] + [0.4] * 149
    assert np.abs(state.position[1:]).max() <= 2.9
    assert packing.overlap(state.position, state.radius) is None


def test_explicit_disks_are_taken_as_they_are():
    scene = note_scene(1.0)
    state = draw(scene, 5)
    again = draw(explicit(box(6, 6, W), state, 1.0), 99)
    assert all(np.array_equal(a, b) for a, b in zip(state, again, strict=True))
    assert draw(explicit(box(6, 6, W), state._replace(**{k: getattr(state, k)[:0] for k in state._fields}), 1.0), 0)[
        0
    ].shape == (0, 2)


@pytest.mark.parametrize(
    ("velocities", "deviations"),
    [({"standard_deviation": 2.0}, (2.0, 2.0)), ({"temperature": 1.6}, (np.sqrt(1.6), 2.0))],
)
def test_velocities_are_normal(velocities, deviations):
    """Kolmogorov-Smirnov over 600 states: tracer (1,200 components) and bath; false alarm 1e-6 each."""
    scene = make(box(6, 6, W), [(30, 0.1, 0.4)], 1.0, {"radius": 0.3, "mass": 1.0}, velocities)
    velocity = np.array([draw(scene, seed).velocity for seed in range(600)])
    for part, deviation in ((velocity[:, 0], deviations[0]), (velocity[:, 1:], deviations[1])):
        assert stats.kstest(part.ravel(), "norm", args=(0, deviation)).pvalue > 1e-6
    # components, disks and seeds are independent: the means of products are within 5 standard errors of 0
    for one, two in (
        (velocity[..., 0], velocity[..., 1]),
        (velocity[:, 1], velocity[:, 2]),
        (velocity[1:], velocity[:-1]),
    ):
        products = (one * two).ravel()
        assert abs(products.mean()) < 5 * products.std() / np.sqrt(products.size)


def test_zero_momentum():
    """To round-off of the sum of abs(m v)."""
    velocities = {"temperature": 1.0, "zero_momentum": True}
    state = draw(make(box(6, 6, P), [(30, 0.1, 1.0), (20, 0.2, 7.0)], 1.0, velocities=velocities), 1)
    assert np.abs(state.mass @ state.velocity).max() < 1e-15 * np.sum(state.mass[:, None] * np.abs(state.velocity))


def test_nothing_to_draw():
    state = draw(make(box(6, 6, W), [(0, 0.1, 1.0)], 1.0), 1)
    assert state.position.shape == state.velocity.shape == (0, 2)


@pytest.mark.slow
@pytest.mark.parametrize(("tracer", "runs"), [("pinned", 400), ("free", 1500)])
def test_zero_momentum_at_t_zero_after_equilibration(tracer, runs):
    """Taken out before a pinned equilibration it would come back; taken out twice, it would cool the tracer by 7 %."""
    disks = {
        "tracer": {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]},
        "species": [{"name": "bath", "count": 29, "radius": 0.1, "mass": 0.4}],
    }
    mapping = {
        "box": {"x": [-3.0, 3.0], "y": [-3.0, 3.0], "boundary": "periodic"},
        "disks": disks,
        "velocities": {"temperature": 1.6, "zero_momentum": True},
        "duration": 0.01,
        "equilibrate": {"time": 2.0, "tracer": tracer},
    }
    scene = parse_scene(mapping, "scene.yaml")
    whole = simulate(scene, range(runs), {"all"}).whole.values()
    velocity = np.array([run.velocity[0] for run in whole])
    momentum = np.einsum("i,rix->rx", scene.mass, velocity)
    assert np.abs(momentum).max() < 1e-13
    if tracer == "pinned":
        drawn = np.array([draw(scene, seed).velocity[0] for seed in range(runs)])
        check_pinned(velocity[:, 0], drawn, scene.mass)
        return
    square = np.sum(velocity[:, 0] ** 2, axis=1)  # exponentially distributed: its deviation is its mean
    expected = 2 * 1.6 * (1 - 1 / scene.mass.sum())
    assert abs(square.mean() - expected) < 4.5 * expected / math.sqrt(runs)  # false alarm 7e-6


def check_pinned(velocity, drawn, mass):
    """The tracer's velocity (R, 2) at t = 0 is 1 - m/M of what was drawn, less the bath's momentum over M, a noise.

    False alarm: 7e-6 each for the factor and for the variance of this noise, kT (M - m)/M^2.
    """
    kt, whole = 1.6, mass.sum()
    noise = velocity - (1 - mass[0] / whole) * drawn
    variance, number = kt * (whole - mass[0]) / whole**2, drawn.size
    error_of_factor = math.sqrt(variance / (kt / mass[0]) / number)
    assert abs(np.sum(noise * drawn) / np.sum(drawn**2)) < 4.5 * error_of_factor
    assert error_of_factor < 0.073 / 7  # taken out twice, the factor is smaller by 0.073
    assert abs(np.mean(noise**2) / variance - 1) < 4.5 * math.sqrt(2 / number)
