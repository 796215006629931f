"""Where disks begin: inside, without overlap, uniform over the places there are; a lattice for the dense."""

import numpy as np
import pytest
from scipy import stats

from brownpipe.engines.exact.simulation import simulate
from brownpipe.engines.initial_state import draw, place
from brownpipe.engines.units import common_radius
from brownpipe.errors import PlacementError, RequestError
from brownpipe.scene import packing, parse_scene
from test_exact import P, W, box, make, note_scene, species


def dense(where, kinds, placement, **more):
    mapping = {"box": where, "disks": {"species": species(*kinds), "placement": placement} | more}
    return parse_scene(mapping | {"velocities": {"temperature": 1.0}, "duration": 1.0}, "dense.yaml")


def on_lattice(where, kinds, **more):
    return dense(where, kinds, "lattice", **more)


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
    scene = dense(box(3, 3, P), [(150, 0.13, 1)], "random")
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


GROWN = {  # side of the box, (number, radius, mass) of each species, and a tracer: packing fractions of 0.65 to 0.75
    "tracer": (box(20.1, 20.1, P), [(1300, 0.25, 1)], {"radius": 1.0, "mass": 20.0}),
    "tracer held, walls": (box(20.1, 20.1, W), [(1300, 0.25, 1)], {"radius": 1.0, "mass": 20.0, "position": [1, 2]}),
    "equal": (box(22.9, 22.9, P), [(500, 0.5, 1)], None),
    "binary": (box(15.7, 15.7, P, (-5.0, 3.0)), [(80, 0.5, 1), (80, 0.7, 1)], None),
    "one to ten": (box(10, 10, W), [(12, 1.0, 1), (950, 0.1, 1)], None),
}


@pytest.mark.parametrize("name", GROWN)
def test_mixtures_too_dense_for_insertion_grow(name):
    where, kinds, tracer = GROWN[name]
    scene = dense(where, kinds, "auto", **({"tracer": tracer} if tracer else {}))
    assert 0.6 < scene.packing_fraction < 0.76
    states = [draw(scene, seed) for seed in (0, 1)]
    for state in states:
        assert_sound(scene, state)
    assert np.array_equal(draw(scene, 0).position, states[0].position)
    assert not np.array_equal(states[0].position[1:], states[1].position[1:])
    if tracer and "position" in tracer:
        assert states[0].position[0].tolist() == tracer["position"]


def test_growth_changes_no_place_that_insertion_finds():
    kinds = [(60, 0.12, 1)]
    assert np.array_equal(*(draw(dense(box(3, 2, P), kinds, how), 7).position for how in ("auto", "random")))


def test_where_some_runs_find_no_place_these_grow():
    """Of equal disks at a packing fraction of 0.52 in a small box, 6 % get stuck."""
    scenes = [dense(box(10, 10, P), [(66, 0.5, 1)], how) for how in ("auto", "random")]
    stuck = 0
    for seed in range(100):
        state = draw(scenes[0], seed)
        assert_sound(scenes[0], state)
        try:
            assert np.array_equal(state.position, draw(scenes[1], seed).position)
        except PlacementError:
            stuck += 1
    assert 0 < stuck < 20


def test_what_is_jammed_cannot_grow():
    with pytest.raises(RequestError, match=r"^disks: 150 disks still overlap .*\(packing fraction 0\.885\)"):
        draw(dense(box(3, 3, P), [(150, 0.13, 1)], "auto"), 0)


def test_grown_disks_reach_the_pressure_of_the_fluid():
    """At 0.65, after equilibration: Z by the virial beside that of a lattice start; both forget where they began."""
    pressure = []
    for how in ("auto", "lattice"):
        mapping = dense(box(15.54, 15.54, P), [(200, 0.5, 1)], how).replace(duration=20.0, equilibrate={"time": 20.0})
        found = simulate(mapping, range(16), {"none"}).observables["virial"]
        pressure.append((found.mean(), found.std(ddof=1) / 4))
    (grown, error), (lattice, other) = pressure
    assert abs(grown - lattice) < 4 * np.hypot(error, other)
