"""Where disks begin: inside, without overlap, uniform over the places there are; a lattice for the dense."""

import numpy as np
import pytest
from scipy import stats

from brownpipe.engines.initial_state import draw
from brownpipe.engines.placement import place
from brownpipe.engines.units import common_radius
from brownpipe.errors import RequestError
from brownpipe.scene import packing, parse_scene
from test_exact import P, W, box, make, note_scene, species


def on_lattice(where, kinds, **more):
    mapping = {"box": where, "disks": {"species": species(*kinds), "placement": "lattice"} | more}
    return parse_scene(mapping | {"velocities": {"temperature": 1.0}, "duration": 1.0}, "dense.yaml")


def assert_sound(scene, state):
    """Inside the walls, in a periodic box inside it, and no two overlap, checked by other means than placement's."""
    low, high = np.array((scene.box.x, scene.box.y)).T
    margin = 0.0 if scene.box.periodic else state.radius[:, None] * (1 - 1e-14)
    assert (state.position >= low + margin).all()
    assert (state.position <= high - margin).all()
    sides = (scene.box.x, scene.box.y) if scene.box.periodic else None
    assert packing.overlap(state.position, state.radius, sides) is None


RANDOM = {
    "note": note_scene(1.0),
    "far": make(box(6, 3, W, (100.0, -50.0)), [(50, 0.1, 1)], 1.0),
    "periodic": make(box(3, 2, P), [(60, 0.12, 1)], 1.0),
    "narrowest": make(box(1, 1, P), [(2, 0.25, 1)], 1.0),
    "mixture": make(box(4, 3, P), [(10, 0.3, 1), (30, 0.1, 1), (200, 0.02, 1)], 1.0),
    "big last": make(box(6, 6, W), [(40, 0.05, 1), (2, 0.5, 1)], 1.0),
    "big": make(box(6, 6, P), [(3, 0.9, 1), (150, 0.08, 1)], 1.0),
    "tight": make(box(2.0000001, 2.0000001, W), [(1, 1.0, 1)], 1.0),
}


@pytest.mark.parametrize("name", RANDOM)
def test_random_places_are_sound(name):
    for seed in range(40):
        assert_sound(RANDOM[name], draw(RANDOM[name], seed))


def test_larger_disks_find_their_places_first():
    """Listed last, a large disk found none among 1,400 small ones; equal ones keep the order of the scene."""
    late = make(box(6, 6, W), [(1400, 0.05, 1), (1, 1.0, 1), (1, 0.9, 1)], 1.0)
    assert_sound(late, draw(late, 0))
    early = make(box(6, 6, W), [(1, 1.0, 1), (1, 0.9, 1), (1400, 0.05, 1)], 1.0)
    assert np.array_equal(draw(early, 0).position[[*range(2, 1402), 0, 1]], draw(late, 0).position)


@pytest.mark.parametrize("boundary", [W, P])
def test_a_disk_is_uniform_over_where_it_can_be(boundary):
    """Kolmogorov-Smirnov per coordinate over 3,000 states; false alarm 1e-6 each."""
    scene = make(box(2, 3, boundary, (0.5, 1.0)), [(2, 0.3, 1)], 1.0)
    places = np.array([draw(scene, seed).position for seed in range(3000)])
    margin = 0.0 if boundary == P else 0.3
    for axis, (low, high) in enumerate((scene.box.x, scene.box.y)):
        law = stats.uniform(low + margin, high - low - 2 * margin)
        assert stats.kstest(places[:, 0, axis], law.cdf).pvalue > 1e-6
    if boundary == P:  # the second one sees the first as uniform over what is left: a ring of the torus
        size = np.array((2.0, 3.0))
        apart = places[:, 1] - places[:, 0]
        distance = np.hypot(*(apart - size * np.round(apart / size)).T)
        near = distance[distance < 1.0]
        assert stats.kstest(near, lambda r: (r**2 - 0.36) / (1 - 0.36)).pvalue > 1e-6
        expected = 3000 * np.pi * (1 - 0.36) / (6 - np.pi * 0.36)
        assert abs(len(near) - expected) < 5 * np.sqrt(expected)


def test_what_cannot_be_placed_ends_with_a_message():
    """Random insertion jams near phi = 0.547; in bounded time."""
    scene = make(box(3, 3, P), [(150, 0.13, 1)], 1.0)
    with pytest.raises(RequestError, match=r"only \d+ of 150 disks found a place .*\(packing fraction 0\.885\)"):
        draw(scene, 0)


@pytest.mark.parametrize("boundary", [W, P])
@pytest.mark.parametrize(("n", "radius"), [(1, 0.5), (2, 0.4), (7, 0.3), (100, 0.125), (1000, 0.043)])
def test_lattices_are_sound(boundary, n, radius):
    scene = on_lattice(box(3, 2.5, boundary, (10.0, 0.0)), [(n, radius, 1.0)])
    assert_sound(scene, draw(scene, 1))


def test_a_lattice_reaches_phi_0_85():
    scene = on_lattice(box(30, 15 * np.sqrt(3), P), [(900, 0.5 * np.sqrt(0.85 / 0.9069), 1.0)])
    assert scene.packing_fraction == pytest.approx(0.85, abs=1e-4)
    assert_sound(scene, draw(scene, 1))


def test_a_lattice_with_a_tracer_and_a_mixture():
    tracer = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}
    for boundary in (W, P):
        scene = on_lattice(box(4, 4, boundary), [(80, 0.12, 1.0), (80, 0.08, 1.0)], tracer=tracer)
        state = draw(scene, 1)
        assert state.position[0].tolist() == [0.0, 0.0]
        assert_sound(scene, state)


def test_species_share_a_lattice_at_random():
    scene = on_lattice(box(4, 4, P), [(60, 0.12, 1.0), (60, 0.08, 1.0)])
    one, two = draw(scene, 1), draw(scene, 2)
    assert not np.array_equal(one.position, two.position)
    sites = {tuple(np.round(x, 9)) for state in (one, two) for x in state.position.tolist()}
    assert len(sites) <= 150  # of one lattice of few more than 120 sites


def test_a_lattice_that_does_not_fit_is_refused():
    scene = on_lattice(box(3, 3, P), [(110, 0.15, 1.0)])
    with pytest.raises(RequestError, match=r"110 places for disks of radius 0\.15"):
        draw(scene, 0)


def test_common_radius():
    """The largest, leaving out at most sqrt(N) that are more than half as large again as the largest that stays."""
    assert common_radius(np.array([0.3] + [0.1] * 149)) == 0.1
    assert common_radius(np.array([0.14] + [0.1] * 149)) == 0.14
    assert common_radius(np.array([0.3] * 50 + [0.1] * 100)) == 0.3
    assert common_radius(np.array([2.0, 0.3, 0.3] + [0.1] * 100)) == 0.1
    assert common_radius(np.array([2.0])) == 2.0


def test_place_is_what_draw_uses():
    scene = note_scene(1.0)
    numbers = np.random.Generator(np.random.Philox(np.random.SeedSequence(2020, spawn_key=(150, 4))))
    numbers.standard_normal((150, 2))
    assert np.array_equal(place(scene, numbers), draw(scene, 4).position)
