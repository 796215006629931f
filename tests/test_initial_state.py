"""The initial state: the same for a seed, distributed as the scene says, sound; overlaps against
all pairs of disks.
"""

import hashlib
import math
from itertools import combinations
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from brownpipe.analysis.runs import reported
from brownpipe.engines.exact.simulation import simulate
from brownpipe.engines.start import initial_state
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.start.insertion import COMPARED, ROWS, STUCK, TRIES, insert_disks, push_apart
from brownpipe.engines.start.placement import (
    ALL_FAIL,
    ANSWERS_PER_TRY,
    SOME_FAIL,
    TRIES_PER_SWEEP,
    crowding,
    placement_caution,
    tries_to_place,
)
from brownpipe.errors import PlacementError, RequestError
from brownpipe.scene import parse_scene
from brownpipe.scene.overlaps import overlaps
from scenes import (
    CHANNEL_X,
    CHANNEL_Y,
    PERIODIC,
    WALLS,
    box,
    mixture,
    note_scene,
    scene_of_state,
    species,
)

VELOCITY_17 = [-0.042623150097255494, 2.3328060725321036]
POSITION_17 = [-2.5213268957650588, 0.5819693892044553]


# -- what a seed gives -----------------------------------------------------------------------------


def test_a_seed_gives_the_state_of_the_note_and_always_the_same():
    """Seeds name states, in files and papers: a guard against a new stream by accident."""
    state = draw_state(note_scene(1.0), 17)
    again = draw_state(note_scene(7.0, sample_interval=0.1), 17)
    assert state.velocity[0].tolist() == VELOCITY_17 and state.position[1].tolist() == POSITION_17
    assert all(np.array_equal(a, b) for a, b in zip(state, again, strict=True))
    assert state.position[0].tolist() == [0.0, 0.0]
    assert (
        state.radius.tolist() == [0.3] + [0.1] * 149 and state.mass.tolist() == [1.0] + [0.4] * 149
    )
    for other in (
        draw_state(note_scene(1.0), 18),
        draw_state(note_scene(1.0, particles=100), 17),
    ):  # streams of their own
        assert not np.isin(other.velocity, state.velocity).any()


def test_explicit_disks_are_taken_as_they_are():
    state = draw_state(note_scene(1.0), 5)
    again = draw_state(scene_of_state(box(6, 6, WALLS), state, 1.0), 99)
    assert all(np.array_equal(a, b) for a, b in zip(state, again, strict=True))
    none = type(state)(*(values[:0] for values in state))
    assert draw_state(scene_of_state(box(6, 6, WALLS), none, 1.0), 0).position.shape == (0, 2)


# -- velocities ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("velocities", "deviations"),
    [({"standard_deviation": 2.0}, (2.0, 2.0)), ({"temperature": 1.6}, (np.sqrt(1.6), 2.0))],
)
def test_velocities_are_normal(velocities, deviations):
    """Kolmogorov-Smirnov over 600 states: tracer (1,200 components) and bath; false alarm 1e-6
    each.
    """
    scene = mixture(
        box(6, 6, WALLS), [(30, 0.1, 0.4)], 1.0, {"radius": 0.3, "mass": 1.0}, velocities
    )
    velocity = np.array([draw_state(scene, seed).velocity for seed in range(600)])
    for part, deviation in ((velocity[:, 0], deviations[0]), (velocity[:, 1:], deviations[1])):
        assert stats.kstest(part.ravel(), "norm", args=(0, deviation)).pvalue > 1e-6
    # components, disks and seeds are independent: the means of products are within 5 standard
    # errors of 0
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
    state = draw_state(
        mixture(box(6, 6, PERIODIC), [(30, 0.1, 1.0), (20, 0.2, 7.0)], 1.0, velocities=velocities),
        1,
    )
    momenta = state.mass[:, None] * np.abs(state.velocity)
    assert np.abs(state.mass @ state.velocity).max() < 1e-15 * np.sum(momenta)


@pytest.mark.slow
@pytest.mark.parametrize(("tracer", "runs"), [("pinned", 400), ("free", 1500)])
def test_zero_momentum_at_t_zero_after_equilibration(tracer, runs):
    """Taken out before a pinned equilibration it would come back; taken out twice, it would cool
    the tracer by 7 %.
    """
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
    assert np.abs(np.einsum("i,rix->rx", scene.mass, velocity)).max() < 1e-13
    if tracer == "pinned":
        drawn = np.array([draw_state(scene, seed).velocity[0] for seed in range(runs)])
        check_pinned(velocity[:, 0], drawn, scene.mass)
        return
    square = np.sum(
        velocity[:, 0] ** 2, axis=1
    )  # exponentially distributed: its deviation is its mean
    expected = 2 * 1.6 * (1 - 1 / scene.mass.sum())
    assert abs(square.mean() - expected) < 4.5 * expected / math.sqrt(runs)  # false alarm 7e-6


def check_pinned(velocity, drawn, mass):
    """The tracer's velocity (R, 2) at t = 0 is 1 - m/M of what was drawn, less the bath's momentum
    over M, a noise. False alarm: 7e-6 each for the factor and for the variance of this noise, kT (M
    - m)/M^2."""
    kt, whole = 1.6, mass.sum()
    noise = velocity - (1 - mass[0] / whole) * drawn
    variance, number = kt * (whole - mass[0]) / whole**2, drawn.size
    error_of_factor = math.sqrt(variance / (kt / mass[0]) / number)
    assert abs(np.sum(noise * drawn) / np.sum(drawn**2)) < 4.5 * error_of_factor
    assert error_of_factor < 0.073 / 7  # taken out twice, the factor is smaller by 0.073
    assert abs(np.mean(noise**2) / variance - 1) < 4.5 * math.sqrt(2 / number)


# -- places ----------------------------------------------------------------------------------------

TRACER = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}


def dense(where, kinds, placement, **more):
    mapping = {"box": where, "disks": {"species": species(*kinds), "placement": placement} | more}
    return parse_scene(
        mapping | {"velocities": {"temperature": 1.0}, "duration": 1.0}, "dense.yaml"
    )


def assert_sound(scene, state):
    """Inside the walls, in a periodic box inside it, and no two overlap, checked by other means
    than placement's.
    """
    low, high = np.array((scene.box.x, scene.box.y)).T
    margin = scene.box.margins(state.radius[:, None] * (1 - 1e-14))
    assert (low + margin <= state.position).all() and (state.position <= high - margin).all()
    assert overlaps(state.position, state.radius, scene.box.periodic_sides) is None


RANDOM = {
    "note": note_scene(1.0),
    "far": mixture(box(6, 3, WALLS, (100.0, -50.0)), [(50, 0.1, 1)], 1.0),
    "periodic": mixture(box(3, 2, PERIODIC), [(60, 0.12, 1)], 1.0),
    "narrowest": mixture(box(1, 1, PERIODIC), [(2, 0.25, 1)], 1.0),
    "channel": mixture(box(3, 2, CHANNEL_X), [(60, 0.12, 1)], 1.0),
    "single file": mixture(box(1.9, 30, CHANNEL_Y), [(17, 0.5, 1)], 1.0),
    "channel big": mixture(box(6, 6, CHANNEL_Y), [(3, 0.9, 1), (150, 0.08, 1)], 1.0),
    "mixture": mixture(box(4, 3, PERIODIC), [(10, 0.3, 1), (30, 0.1, 1), (200, 0.02, 1)], 1.0),
    "big last": mixture(box(6, 6, WALLS), [(40, 0.05, 1), (2, 0.5, 1)], 1.0),
    "big": mixture(box(6, 6, PERIODIC), [(3, 0.9, 1), (150, 0.08, 1)], 1.0),
    "big after small": mixture(box(6, 6, WALLS), [(1400, 0.05, 1), (1, 1.0, 1), (1, 0.9, 1)], 1.0),
    "tight": mixture(box(2.0000001, 2.0000001, WALLS), [(1, 1.0, 1), (9, 0.03, 1)], 1.0),
}


@pytest.mark.parametrize("name", RANDOM)
def test_random_places_are_sound(name):
    assert crowding(RANDOM[name]) < SOME_FAIL
    for seed in range(10 if name == "big after small" else 40):
        assert_sound(RANDOM[name], draw_state(RANDOM[name], seed))


@pytest.mark.parametrize("boundary", [WALLS, PERIODIC, CHANNEL_X, CHANNEL_Y])
def test_a_disk_is_uniform_over_where_it_can_be(boundary):
    """Kolmogorov-Smirnov per coordinate over 3,000 states; false alarm 1e-6 each."""
    scene = mixture(box(2, 3, boundary, (0.5, 1.0)), [(2, 0.3, 1)], 1.0)
    places = np.array([draw_state(scene, seed).position for seed in range(3000)])
    for axis, (low, high) in enumerate((scene.box.x, scene.box.y)):
        margin = 0.0 if scene.box.periodic_axes[axis] else 0.3
        law = stats.uniform(low + margin, high - low - 2 * margin)
        assert stats.kstest(places[:, 0, axis], law.cdf).pvalue > 1e-6
    if boundary == PERIODIC:
        # the second one sees the first as uniform over what is left: a ring of the torus
        size = np.array((2.0, 3.0))
        separation = places[:, 1] - places[:, 0]
        separation -= size * np.round(separation / size)
        distance = np.hypot(separation[:, 0], separation[:, 1])
        near = distance[distance < 1.0]
        assert stats.kstest(near, lambda r: (r**2 - 0.36) / (1 - 0.36)).pvalue > 1e-6
        expected = 3000 * np.pi * (1 - 0.36) / (6 - np.pi * 0.36)
        assert abs(len(near) - expected) < 5 * np.sqrt(expected)


TWO_SIZES = [(80, 0.12, 1.0), (80, 0.08, 1.0)]
# Of disks on a lattice: the box, species of (number, radius, mass), and further keys of the disks
LATTICES = {
    "phi = 0.85": (
        box(30, 15 * np.sqrt(3), PERIODIC),
        [(900, 0.5 * np.sqrt(0.85 / 0.9069), 1.0)],
        {},
    ),
    "walls, tracer": (box(4, 4, WALLS), TWO_SIZES, {"tracer": TRACER}),
    "channel, tracer": (
        box(4, 4, CHANNEL_X),
        TWO_SIZES,
        {"tracer": TRACER | {"position": [1.9, -1.5]}},
    ),
    "periodic, tracer": (
        box(4, 4, PERIODIC),
        TWO_SIZES,
        {"tracer": TRACER | {"position": [1.9, -2]}},
    ),
}
for boundary in (WALLS, PERIODIC, CHANNEL_X, CHANNEL_Y):
    small_box = box(3, 2.5, boundary, (10.0, 0.0))
    for number, radius in [(1, 0.5), (2, 0.4), (7, 0.3), (100, 0.14), (1000, 0.043)]:
        LATTICES[f"{number} of {radius}, {boundary}"] = (small_box, [(number, radius, 1.0)], {})


@pytest.mark.parametrize("name", LATTICES)
def test_lattices_are_sound(name):
    where, kinds, more = LATTICES[name]
    scene = dense(where, kinds, "lattice", **more)
    state = draw_state(scene, 1)
    assert_sound(scene, state)
    assert not more or state.position[0].tolist() == more["tracer"]["position"]
    assert scene.particles < 5 or not np.array_equal(draw_state(scene, 2).position, state.position)


def test_no_disks_have_no_momentum_after_equilibration():
    mapping = {
        "box": {"x": [0, 20], "y": [0, 3], "boundary": "periodic"},
        "disks": {"species": species((0, 0.5, 1))},
        "velocities": {"temperature": 1.0},
        "equilibrate": {"time": 1.0, "tracer": "free"},
        "duration": 1.0,
    }
    ensemble = simulate(parse_scene(mapping, "empty.yaml"), [0, 1])
    assert not reported(ensemble, "failed").any()


@pytest.mark.parametrize(
    ("number", "radius", "placement", "message"),
    [
        (150, 0.13, "random", r"only \d+ of 200 disks found a place .*\(packing fraction 0\.885\)"),
        (
            150,
            0.13,
            "auto",
            r"seed 0: disks: 200 disks still overlap .*\(packing fraction 0\.885\)",
        ),
        (110, 0.15, "lattice", r"160 places for disks of radius 0\.15"),
    ],
)
def test_what_cannot_be_placed_ends_with_a_message(number, radius, placement, message):
    """Random insertion jams near phi = 0.547; in bounded time."""
    scene = dense(box(3, 3, PERIODIC), [(number, radius, 1), (50, 0.001, 1)], placement)
    assert placement == "lattice" or crowding(scene) > ALL_FAIL  # for the large ones
    with pytest.raises(RequestError, match=message):  # no run of it could be made
        simulate(scene, [0])


@pytest.mark.parametrize("placement", ["auto", "random"])
@pytest.mark.parametrize(("sides", "fits"), [((1.0, 1.0), False), ((1.0, 0.75**0.5), True)])
def test_only_a_placement_that_can_succeed_is_advised(sides, fits, placement):
    """Rows of a lattice are a factor of sqrt(3)/2 nearer to each other than the sites in a row: a
    square has no 144 places at a packing fraction of 0.86, a box of 12 rows of 12 has them.
    """
    number, phi = 144, 0.86
    unit = math.sqrt(number * math.pi * 0.25 / phi / (sides[0] * sides[1]))
    where = box(sides[0] * unit, sides[1] * unit, PERIODIC)
    scene = dense(where, [(number, 0.5, 1)], placement)
    with pytest.raises(PlacementError) as refusal:
        draw_state(scene, 3)
    _, _, advice = str(refusal.value).partition("; ")
    lattice = ", or `placement: lattice`" if fits else ""
    assert advice == f"must be fewer or smaller disks{lattice}"
    if fits:
        assert_sound(scene, draw_state(dense(where, [(number, 0.5, 1)], "lattice"), 3))
    if placement == "random":
        assert placement_caution(scene).endswith(advice)


# side of the box, (number, radius, mass) of each species, and a tracer: packing fractions of 0.65
# to 0.75
GROWN = {
    "tracer": (box(20.1, 20.1, PERIODIC), [(1300, 0.25, 1)], {"radius": 1.0, "mass": 20.0}),
    "tracer held, walls": (
        box(20.1, 20.1, WALLS),
        [(1300, 0.25, 1)],
        {"radius": 1.0, "mass": 20.0, "position": [1, 2]},
    ),
    "equal": (box(22.9, 22.9, PERIODIC), [(500, 0.5, 1)], None),
    "binary": (box(15.7, 15.7, PERIODIC, (-5.0, 3.0)), [(80, 0.5, 1), (80, 0.7, 1)], None),
    "one to ten": (box(10, 10, WALLS), [(12, 1.0, 1), (950, 0.1, 1)], None),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", GROWN)
def test_mixtures_too_dense_for_insertion_grow(name):
    where, kinds, tracer = GROWN[name]
    scene = dense(where, kinds, "auto", **({"tracer": tracer} if tracer else {}))
    assert 0.6 < scene.packing_fraction < 0.76
    states = [draw_state(scene, seed) for seed in (0, 1)]
    for state in states:
        assert_sound(scene, state)
    assert np.array_equal(draw_state(scene, 0).position, states[0].position)
    assert not np.array_equal(states[0].position[1:], states[1].position[1:])
    if tracer and "position" in tracer:
        assert states[0].position[0].tolist() == tracer["position"]


@pytest.mark.slow
def test_where_some_runs_find_no_place_these_grow():
    """Of equal disks at a packing fraction of 0.52 in a small box, 6 % get stuck."""
    scenes = [dense(box(10, 10, PERIODIC), [(66, 0.5, 1)], how) for how in ("auto", "random")]
    stuck = 0
    for seed in range(50):
        state = draw_state(scenes[0], seed)
        assert_sound(scenes[0], state)
        try:
            assert np.array_equal(state.position, draw_state(scenes[1], seed).position)
        except PlacementError:
            stuck += 1
    assert 0 < stuck < 10


class Watched:
    """`insert_disks`, with what it returned and was given last, and the progress of all
    insertions.
    """

    def __init__(self):
        self.insertions = {}  # progress of each

    def __call__(self, places, numbers, progress):
        self.outcome = insert_disks(places, numbers, progress)
        self.places = places
        self.progress = self.insertions[id(progress)] = progress
        return self.outcome


@pytest.mark.parametrize(("number", "phi"), [(40, 0.56), (120, 0.55), (250, 0.565)])
@pytest.mark.parametrize("boundary", [WALLS, PERIODIC, CHANNEL_X])
def test_a_disk_without_room_is_not_tried_a_million_times(number, phi, boundary, monkeypatch):
    """Of a million tries that fail few are compared with other disks; where no room is left, none
    is made.
    """
    monkeypatch.setattr(initial_state, "insert_disks", watched := Watched())
    side = (number * math.pi / 4 / phi) ** 0.5
    side += {PERIODIC: 0.0, WALLS: 0.34}.get(str(boundary), 0.17)  # one or two walls an axis
    scene = dense(box(side, side, boundary), [(number, 0.5, 1)], "random")
    stuck = 0
    for seed in range(6):
        try:
            draw_state(scene, seed)
        except PlacementError:
            stuck += 1
            assert watched.outcome == STUCK and watched.progress[ROWS] > TRIES
            assert watched.progress[COMPARED] < TRIES / 10
    assert stuck


@pytest.mark.parametrize("boundary", [WALLS, PERIODIC, CHANNEL_X, CHANNEL_Y])
def test_closed_fields_of_the_raster_have_no_room(boundary, monkeypatch):
    """Random points of closed fields against all disks; equal disks, and a mixture, got stuck."""
    monkeypatch.setattr(initial_state, "insert_disks", watched := Watched())
    stream = np.random.default_rng(5)
    for kinds, side in (([(60, 0.5, 1)], 9.0), ([(8, 1.0, 1), (220, 0.2, 1)], 8.2)):
        with pytest.raises(PlacementError):
            draw_state(scene := dense(box(side, side, boundary), kinds, "random"), 3)
        p = watched.places
        i = watched.progress[0]
        columns, rows = p.is_open.shape
        closed = np.argwhere(~p.is_open)
        assert len(closed) > 0.9 * p.is_open.size
        share = (closed + stream.random(closed.shape)) / (columns, rows)
        margin = scene.box.margins(p.radius[i])
        centre = margin + share * (p.size - 2 * margin)
        apart = scene.box.nearest_image(centre[:, None] - p.position[:i])
        gap = np.hypot(*np.moveaxis(apart, -1, 0)) - p.radius[i] - p.radius[:i]
        assert (gap.min(axis=1) < 0).all()


@pytest.mark.parametrize("drawn", range(6))
@pytest.mark.parametrize("skipped", [4, 8, 252, 4 * 10**6])
def test_skipped_random_numbers_are_those_that_would_have_been_drawn(drawn, skipped):
    streams = [np.random.Generator(np.random.Philox(11)) for _ in range(2)]
    for stream in streams:
        stream.random(drawn)
    streams[0].random(skipped)
    initial_state._skip(streams[1], skipped)
    assert streams[0].random(9).tolist() == streams[1].random(9).tolist()


# where insertion fails and disks grow: the beginning of the sha256 of all positions
STATES_AFTER_FAILURE = {50: "732868fcab76a04e", 110: "b48427089fa4b300", 260: "7b76cd3c012f1751"}


@pytest.mark.parametrize("number", STATES_AFTER_FAILURE)
def test_states_that_grow_after_insertion_failed_are_those_of_a_million_tries(number):
    """As made by a million tries, one by one. Seeds name states, in files and papers."""
    side = (number * math.pi / 4 / 0.56) ** 0.5
    positions = draw_state(dense(box(side, side, PERIODIC), [(number, 0.5, 1)], "auto"), 2).position
    assert hashlib.sha256(positions.tobytes()).hexdigest()[:16] == STATES_AFTER_FAILURE[number]


@pytest.mark.parametrize("phi", [0.1, 0.4, 0.53, 0.555, 0.65, 0.75])
def test_tries_to_place_disks_are_near_those_forecast(phi, monkeypatch):
    monkeypatch.setattr(initial_state, "insert_disks", watched := Watched())
    monkeypatch.setattr(initial_state, "push_apart", sweeps := Mock(wraps=push_apart))
    side = (1000 * math.pi / 4 / phi) ** 0.5
    draw_state(scene := dense(box(side, side, PERIODIC), [(1000, 0.5, 1)], "auto"), 0)
    compared = sum(progress[COMPARED] for progress in watched.insertions.values())
    tries = sum(progress[ROWS] for progress in watched.insertions.values())
    found = compared + (tries - compared) / ANSWERS_PER_TRY
    found += 1000 * TRIES_PER_SWEEP * sweeps.call_count
    assert 0.5 < found / tries_to_place(scene) < 2


@pytest.mark.slow
def test_grown_disks_reach_the_pressure_of_the_fluid():
    """At 0.65, after equilibration: Z by the virial beside that of a lattice start; both forget
    where they began.
    """
    pressure = []
    for how in ("auto", "lattice"):
        mapping = dense(box(15.54, 15.54, PERIODIC), [(200, 0.5, 1)], how).replace(
            duration=20.0, equilibrate={"time": 20.0}
        )
        found = simulate(mapping, range(16), {"none"}).observables["virial"]
        pressure.append((found.mean(), found.std(ddof=1) / 4))
    (grown, error), (lattice, other) = pressure
    assert abs(grown - lattice) < 4 * np.hypot(error, other)


# -- overlaps --------------------------------------------------------------------------------------


@pytest.mark.slow
@given(
    st.lists(
        st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(1e-3, 0.24)), min_size=1, max_size=12
    ),
    st.booleans(),
)
@settings(max_examples=300, deadline=None)
def test_finds_an_overlap_where_all_pairs_do(disks, periodic):
    position = np.array([disk[:2] for disk in disks]).reshape(-1, 2)
    radius = np.array([disk[2] for disk in disks])

    def gap(a, b):
        apart = position[a] - position[b]
        if periodic:
            apart -= np.rint(apart)
        return np.hypot(*apart) - radius[a] - radius[b]

    gaps = {pair: gap(*pair) for pair in combinations(range(len(disks)), 2)}
    found = overlaps(position, radius, ((0, 1), (0, 1)) if periodic else (None, None))
    if found is None:
        assert all(value > -1e-12 for value in gaps.values())
    else:
        pair = (found.first, found.second)
        assert found.gap < 0
        assert found.gap == pytest.approx(gaps[pair], abs=1e-12)
        depths = {(a, b): -gap / (radius[a] + radius[b]) for (a, b), gap in gaps.items()}
        assert found.depth == pytest.approx(max(depths.values()), abs=1e-9)
        deep = sum(depth > 1e-9 for depth in depths.values())
        not_separate = sum(depth > -1e-9 for depth in depths.values())
        assert deep <= found.number <= not_separate
