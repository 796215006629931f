"""Where hard-disk programs break: contact, corners, grazing, close packing, extreme masses, speeds,
times and places.

Each with the exact answer, or with the refusal that names what is wrong.
"""

import math
import signal
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from brownpipe.engines.exact import run as exact_run
from brownpipe.engines.exact.layout import begin_run
from brownpipe.engines.exact.run import prepare_scene
from brownpipe.engines.exact.simulation import simulate
from brownpipe.engines.exact.workspace import CROSSINGS, NEAREST, NOW
from brownpipe.engines.start.initial_state import draw_state, remove_total_momentum
from brownpipe.engines.timestep import largest_step
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.engines.units import State, motion_of
from brownpipe.errors import RequestError
from brownpipe.scene.overlaps import overlaps
from brownpipe.scene.scene import LARGEST_MASS_RATIO, SMALLEST_RADIUS
from scenes import PERIODIC, SMALL_SCENES, WALLS, box, crystal, mixture, note_scene, scene_of_state

BOTH = pytest.mark.parametrize("boundary", [WALLS, PERIODIC])


def state_of(disks, radius=0.125, mass=1.0):
    """A state from (x, y, vx, vy) of every disk; radius and mass common or one each."""
    rows = np.array(disks, dtype=float).reshape(-1, 4)
    radii = np.broadcast_to(radius, len(rows)).copy()
    masses = np.broadcast_to(mass, len(rows)).copy()
    return State(rows[:, :2], rows[:, 2:], radii, masses)


def outcome(where, state, duration, **more):
    """Final positions and velocities, events and observables of a run that must not fail."""
    scene = scene_of_state(where, state, duration, **more)
    run = simulate(scene, [0], {"all", "events"})
    seen = {key: column[0] for key, column in run.observables.items()}
    assert not seen["failed"]
    assert abs(seen["energy_drift"]) <= 1e-14
    assert seen["momentum_residual"] <= 1e-14
    whole = run.whole[0]
    return whole.position[-1], whole.velocity[-1], run.events[0], seen


# -- contact ---------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize(
    ("u", "v", "collisions", "after"),
    [(-1, 0, 1, ([-1, 0], [0, 0])), (1, 0, 0, ([0, 0], [1, 0])), (0, 1, 0, ([0, 0], [0, 1]))],
    ids=["pressing", "leaving", "sliding"],
)
def test_exact_contact_at_the_start(boundary, u, v, collisions, after):
    disks = state_of([(-0.125, 0, 0, 0), (0.125, 0, u, v)])
    _, velocity, events, seen = outcome(box(6, 6, boundary), disks, 1.0)
    assert velocity.tolist() == [list(each) for each in after]
    assert seen["pair_collisions"] == collisions
    assert events.time.tolist() == [0.0] * collisions


@pytest.mark.parametrize(("u", "bounces"), [(-1.0, 1), (1.0, 0), (0.0, 0)])
def test_exact_contact_with_a_wall_at_the_start(u, bounces):
    disks = state_of([(-3 + 0.125, 0, u, 0.5)])
    position, velocity, events, seen = outcome(box(6, 6, WALLS), disks, 1.0)
    assert velocity.tolist() == [[abs(u), 0.5]]
    assert position.tolist() == [[-3 + 0.125 + abs(u), 0.5]]
    assert seen["wall_collisions"] == bounces
    assert events.time.tolist() == [0.0] * bounces


def test_behind_contact_with_a_wall_by_round_off():
    """A big disk, and between it and its contact with the wall behind it a cell's edge: that is not
    the wall ahead.
    """
    small = [(2.45 + 0.3 * (i % 5), 0.3 + 0.45 * (i // 5), 0, 0) for i in range(40)]

    def disks(edge, turn):
        large = (edge * (1 - 3e-13), 2, 1, 0)
        radius = np.array([edge * (1 + 5e-13)] + [0.135] * 40)
        state = state_of([large, *small], radius)
        position = (state.position - 2) * turn
        return state._replace(position=position, velocity=state.velocity * turn)

    def columns(edge):
        scene = scene_of_state(box(4, 4, WALLS), disks(edge, 1), 1.0)
        return prepare_scene(scene, np.zeros(0)).workspace.grid.columns

    found = []
    for n in range(5, 16):
        edge = 4 / n * round(n / 4)
        if edge < 1.15 and columns(edge) == n:
            found.append(edge)
    assert found
    for edge, turn in product(found, (1, -1)):
        position, _, _, seen = outcome(box(4, 4, WALLS), disks(edge, turn), 0.01)
        assert seen["wall_collisions"] == seen["pair_collisions"] == 0
        np.testing.assert_allclose(position[0], [(edge - 1.99) * turn, 0.0], rtol=0, atol=1e-12)


@BOTH
def test_a_cradle_in_contact(boundary):
    """Equal masses in a line: the last one leaves with all the speed, whatever the order of
    collisions at t = 0.
    """
    line = [(0.25 * i, 0, float(i == 0), 0) for i in range(6)]
    end = [[0.25 * i, 0] for i in range(5)] + [[0.25 * 5 + 0.5, 0]]
    for order in (1, -1):
        disks = state_of(line[::order])
        position, velocity, events, _ = outcome(box(6, 6, boundary), disks, 0.5)
        assert velocity[::order].tolist() == [[0, 0]] * 5 + [[1, 0]]
        assert position[::order].tolist() == end
        assert events.time.tolist() == [0.0] * 5


def test_a_cradle_of_unequal_masses_in_contact_conserves_and_separates():
    line = [(0.25 * i, 0, float(i == 0), 0) for i in range(4)]
    disks = state_of(line, mass=np.array([1.0, 4.0, 2.0, 3.0]))
    _, velocity, _, _ = outcome(box(6, 6, WALLS), disks, 0.5)
    vx = velocity[:, 0]
    assert (np.diff(vx) >= -1e-15).all()  # each at least as fast as the one behind it
    assert disks.mass @ vx == pytest.approx(1.0, rel=1e-14)
    assert disks.mass @ vx**2 == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("gap", [1e-6, 1e-10, 1e-14])
def test_small_gaps(gap):
    """Collision after gap/speed, to the round-off of the positions, and the speed handed on from
    disk to disk.
    """
    line = [(0.25 * (1 + gap) * i, 0, float(i == 0), 0) for i in range(6)]
    _, velocity, events, _ = outcome(box(6, 6, WALLS), state_of(line), 0.5)
    first = []
    for i in range(1, 6):
        has_part = (events.a == i) | (events.b == i)
        first.append(events.time[has_part][0])
    expected = 0.25 * gap * np.arange(1, 6)
    np.testing.assert_allclose(first, expected, rtol=0, atol=2e-15)
    np.testing.assert_allclose(velocity, [[0, 0]] * 5 + [[1, 0]], rtol=0, atol=1e-15)


@BOTH
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, 2.9])
def test_grazing(boundary, angle):
    """Impact parameter sigma (1 - 1e-12): f = v cos, with cos^2 = 2e-12; with 1 + 1e-12 they pass
    each other.
    """
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-math.sin(angle), math.cos(angle)])
    for side, collisions in ((-1e-12, 1), (1e-12, 0)):
        start = -0.8 * along + 0.25 * (1 + side) * across
        disks = state_of([(0, 0, 0, 0), (*start, *along)])
        _, velocity, events, seen = outcome(box(6, 6, boundary), disks, 1.6)
        assert seen["pair_collisions"] == collisions
        if collisions:
            # the impact parameter is known to 1e-16 of 0.25, so cos^2 to some 1e-15 of 2e-12
            assert np.hypot(*velocity[0]) == pytest.approx(math.sqrt(2e-12), rel=2e-3)
            assert events.time[0] == pytest.approx(0.8, abs=1e-6)


# -- at the same time ------------------------------------------------------------------------------


@pytest.mark.parametrize("corner", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_into_a_corner(corner):
    """Both walls at once, exactly: back the way it came."""
    corner = np.array(corner)
    mover = state_of([(0.5, 0.5, *corner)])
    disks = mover._replace(position=np.array([0.5 * corner]))
    position, velocity, events, _ = outcome(box(4, 4, WALLS), disks, 3.0)
    assert velocity.tolist() == [(-corner).tolist()]
    end = corner * (0.5 + 2 * 1.375 - 3.0)
    assert position.tolist() == [end.tolist()]
    assert events.time.tolist() == [1.375, 1.375]


@BOTH
def test_many_pairs_at_the_same_time(boundary):
    """400 head-on collisions at t = 1/4 exactly; a bucket of the queue holds 15."""
    disks = []
    for x, y in product(range(20), range(20)):
        disks.append((x - 0.25, 0.5 * y, 0.5, 0))
        disks.append((x + 0.25, 0.5 * y, -0.5, 0))
    start = state_of(disks)
    where = box(20.5, 10.5, boundary, (9.5, 4.75))
    position, velocity, events, _ = outcome(where, start, 0.5)
    assert np.array_equal(velocity, -start.velocity)
    assert np.array_equal(position, start.position)
    assert events.time.tolist() == [0.25] * 400


def test_a_row_of_disks_reaches_the_wall_at_the_same_time():
    disks = state_of([(0.5, 0.25 * (i + 0.5), 1.0, 0.0) for i in range(400)])
    position, velocity, events, _ = outcome(box(4, 100, WALLS, (2.0, 50.0)), disks, 5.0)
    assert set(velocity[:, 0]) == {-1.0}
    assert set(position[:, 0]) == {4 - 0.125 - (5 - 3.375)}
    assert events.time.tolist() == [3.375] * 400


@BOTH
@pytest.mark.parametrize("n", [3, 4, 6])
def test_disks_that_meet_in_one_point(boundary, n):
    """Their outcome is not unique: conserved they must be, and apart in the end."""
    angles = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    disks = state_of(np.hstack([ring, -ring]))
    position, velocity, _, seen = outcome(box(6, 6, boundary), disks, 1.5)
    assert seen["pair_collisions"] >= n / 2
    assert (np.sum(position * velocity, axis=1) > 0).all()
    assert overlaps(position, disks.radius) is None
    assert np.abs(velocity.sum(axis=0)).max() < 1e-14


# -- close packing ---------------------------------------------------------------------------------


def neighbours(scene):
    """The pairs of a scene's disks that are nearer than 1.3 diameters."""
    position = draw_state(scene, 0).position
    size = np.array((scene.box.width, scene.box.height))
    apart = position[:, None] - position
    if not scene.box.has_walls:
        apart -= size * np.round(apart / size)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    a, b = np.nonzero(np.triu(distance < 1.3, 1))
    return set(zip(a.tolist(), b.tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("gap", [1e-2, 1e-6, 1e-10, 1e-14])
def test_a_packing_keeps_its_neighbours(gap):
    """400,000 collisions in which nobody collides with anyone but its six neighbours at the start.

    One collision lost lets two disks change places, and all later ones are wrong. Disks never move
    by more than about a gap, of which the coordinates (up to 12) resolve 1e-15. Contacts in always
    the same three directions round always the same way: up to a tenth of a unit of round-off of a
    pair's energy a collision, 2e-13 in all.
    """
    scene = crystal(12, gap, gap * 2700)
    result = simulate(scene, [0], {"tracer", "events"})
    events = result.events[0]
    around = neighbours(scene)
    assert len(around) == 3 * 144
    assert len(events.time) > 400_000
    partners = np.sort(np.stack([events.a, events.b], axis=1), axis=1)
    pairs = np.unique(partners, axis=0)
    assert set(map(tuple, pairs.tolist())) == around
    assert result.observables["failed"][0] == 0
    assert result.observables["worst_overlap"][0] <= 1e-12
    assert abs(result.observables["energy_drift"][0]) <= 2e-13


def row(number, side=1.0, moving=1, direction=(1.0, 0.0), mass=None):
    """Disks in a row that fill a side of the box, of which the first ones move."""
    radius = side / number / 2
    along = radius + 2 * radius * np.arange(number) - side / 2
    velocity = np.zeros((number, 2))
    velocity[:moving] = direction
    mass = np.ones(number) if mass is None else mass
    position = np.stack([along, np.zeros(number)], axis=1)
    return State(position, velocity, np.full(number, radius), mass)


def upright(state):
    return state._replace(position=state.position[:, ::-1], velocity=state.velocity[:, ::-1])


def block(columns):
    """Two rows of disks, one upon the other, that fill a box of width 1."""
    below = row(columns, moving=columns, direction=(0.3, -0.8))
    lift = np.array([0.0, below.radius[0]])
    low = below._replace(position=below.position - lift)
    high = below._replace(position=below.position + lift, velocity=-0.7 * below.velocity)
    return State(*(np.concatenate(pair) for pair in zip(low, high, strict=True)))


def crowded_row():
    """A row from wall to wall, and 60 disks that are free above it."""
    first = row(11)
    flights = [(0.015 * k - 0.45, 1.0, math.cos(k), math.sin(k)) for k in range(60)]
    free = state_of(flights, 0.005)
    return State(*(np.concatenate(pair) for pair in zip(first, free, strict=True)))


def struck_in_slit():
    """A disk that touches both walls and moves along them, struck on its shoulder by a small
    one.
    """
    return state_of([(0.25, 0, 0, 0.7), (0.2, 0.5, 0, -1)], [0.15, 0.05])


UNLIKE = np.random.default_rng(5).uniform(0.1, 8.0, 14)
JAMMED = {
    "crystal": crystal(6, 0.0, 1.0),
    "row": scene_of_state(box(1, 1, WALLS), row(8), 1.0),
    "row, oblique": scene_of_state(box(1, 1, WALLS), row(13, direction=(1.0, 0.01)), 1.0),
    "column": scene_of_state(box(1, 1, WALLS), upright(row(12)), 1.0),
    "all move": scene_of_state(box(2, 1, WALLS), row(27, 2.0, 27), 1.0),
    "unlike masses": scene_of_state(box(1, 2, WALLS), row(14, mass=UNLIKE), 1.0),
    "ring": scene_of_state(box(3, 3, PERIODIC), row(17, 3.0, 5), 1.0),
    "block": scene_of_state(box(1, 2 / 6, WALLS), block(6), 1.0),
    "slit": scene_of_state(box(0.3, 4, WALLS, (0.25, 0)), struck_in_slit(), 1.0),
    "free disks beside": scene_of_state(box(1, 3, WALLS), crowded_row(), 1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("record", [set(), {"events"}], ids=str)
@pytest.mark.parametrize("name", JAMMED)
def test_disks_that_touch_all_round_end_with_an_error(name, record):
    """At time 0 for ever, or by the last bits of their gaps for days: then an alarm ends the
    process.
    """
    signal.alarm(60)
    stopped = simulate(JAMMED[name], [7], record).stopped
    signal.alarm(0)
    assert stopped.keys() == {7}
    assert "no progress at t = " in stopped[7]


@pytest.mark.slow
@pytest.mark.parametrize("gap", [1e-12, 1e-13])
def test_narrow_gaps_are_no_standstill(gap):
    """Some 4,000,000 collisions, which are examined twice: of 100 disks all round, and of two
    beside each other in a box of their width.
    """
    shots = crystal(10, gap, gap * 40_000)
    left, right = (-0.5 - gap / 3, 0, 1.1, 0), (0.5 + gap / 3, 0, -0.3, 0)
    pair = state_of([left, right], 0.5)
    beside = scene_of_state(box(2 + 2 * gap, 4, WALLS), pair, gap * 4_000_000)
    for scene in (shots, beside):
        seen = simulate(scene, [0]).observables
        assert not seen["failed"][0]
        assert seen["pair_collisions"][0] + seen["wall_collisions"][0] > 3_000_000


# -- masses, speeds, times -------------------------------------------------------------------------


def scaled(scene, seed, length=0, time=0, mass=0):
    """The scene from the state of a seed, in units smaller by these powers of two; box centred at
    0.
    """
    state = draw_state(scene, seed)
    position = np.ldexp(state.position, length)
    velocity = np.ldexp(state.velocity, length - time)
    radius = np.ldexp(state.radius, length)
    state = State(position, velocity, radius, np.ldexp(state.mass, mass))
    width = math.ldexp(scene.box.width, length)
    height = math.ldexp(scene.box.height, length)
    where = box(width, height, scene.box.boundary)
    return scene_of_state(where, state, math.ldexp(scene.duration, time))


ENDS = (-440, 0, 440)  # 1e-132 to 1e132
UNITS = [(0, 0, 996), (0, 0, -996)]  # masses of 1e300, and of 1e-300
UNITS += [
    (0, 565, 0),
    (0, -531, 0),
    (0, -498, 0),
    (0, 498, 0),
]  # speeds of 1e-170 and 1e160, durations of 1e-150
UNITS += [(300, 100, -200), (-300, -100, 200)]


@pytest.mark.parametrize(
    ("name", "units"),
    [*product(["periodic"], product(ENDS, ENDS, (-900, 0, 900))), *product(SMALL_SCENES, UNITS)],
    ids=str,
)
def test_units_of_both_engines(name, units):
    """Trajectories and observables to the bit; NaN, or next to 0, where there is no such number."""
    length, time, mass = units
    plain = scaled(SMALL_SCENES[name], 3)
    other = scaled(SMALL_SCENES[name], 3, *units)
    step = largest_step(plain) / 64
    square_speed = 2 * (length - time)
    powers = {
        "kinetic_energy": mass + square_speed,
        "virial": mass + 2 * length - time,
        "initial_square_speed": square_speed,
        "wall_impulse": mass + length - time,
    }
    for engine, short, long in (
        (simulate, {}, {}),
        (timestep.simulate, {"time_step": step}, {"time_step": math.ldexp(step, time)}),
    ):
        runs = engine(plain, [0], {"all"}, **short)
        runs_in_units = engine(other, [0], {"all"}, **long)
        track = runs.whole[0]
        track_in_units = runs_in_units.whole[0]
        assert np.array_equal(np.ldexp(track.position, length), track_in_units.position)
        assert np.array_equal(np.ldexp(track.velocity, length - time), track_in_units.velocity)
        for name, values in runs.observables.items():
            power = powers.get(name, 0)
            value = float(values[0])
            value_in_units = float(runs_in_units.observables[name][0])
            if value == 0 or -1021 <= math.frexp(value)[1] + power <= 1024:
                assert value_in_units == math.ldexp(value, power), name
            else:
                assert math.isnan(value_in_units) or abs(value_in_units) < 1e-307, name


@pytest.mark.parametrize(
    "factors", [(3e-121, 7e-33, 0.3e111), (0.7e99, 1.1e-40, 3e-290), (1e-90, 1e-60, 1e200)], ids=str
)
def test_units_that_are_no_powers_of_two(factors):
    """A run of so few collisions that round-off of the start, 1e-15 of the box, grows by less than
    1e4.
    """
    length, time, mass = factors
    scene = scaled(SMALL_SCENES["periodic"], 3).replace(duration=1.0, sample_interval=1.0)
    state = draw_state(scene, 0)
    position = state.position * length
    velocity = state.velocity * (length / time)
    moved = State(position, velocity, state.radius * length, state.mass * mass)
    sides = [side * length for side in (scene.box.width, scene.box.height)]
    other = scene_of_state(box(*sides, PERIODIC), moved, time)
    step = largest_step(scene) / 64
    for engine, short, long in (
        (simulate, {}, {}),
        (timestep.simulate, {"time_step": step}, {"time_step": step * time}),
    ):
        run = engine(scene, [0], {"all"}, **short)
        run_in_units = engine(other, [0], {"all"}, **long)
        collisions = run.observables["pair_collisions"]
        assert collisions == run_in_units.observables["pair_collisions"] > 0
        expected = run.whole[0].position
        found = run_in_units.whole[0].position / length
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
        assert not run_in_units.observables["failed"][0]


def test_a_disk_that_is_nowhere_fails_the_run_and_so_do_lost_energy_lost_momentum_and_an_overlap():
    """By 1e-8, ten times what is allowed, and each alone: momentum is lost where a velocity is
    reversed.
    """
    scene = SMALL_SCENES["crowded"]
    prepared = prepare_scene(scene, scene.times)
    w = prepared.workspace
    first = motion_of(draw_state(scene, 3), prepared.frame)
    first[:, 2:] -= first[:, 2:].mean(axis=0)
    disks = w.disk.reshape(len(first), -1)
    slower = first[:, :4].copy()
    slower[:, 2:] *= 1 - 1e-8
    harms = []
    for index in range(4):
        for value in (math.nan, math.inf, -math.inf):
            harms.append((w.disk, index, value))
    harms.append((disks, np.s_[:, :4], slower))
    harms.append((w.disk, 2, -first[0, 2]))
    harms.append((w.tally, NEAREST, -2e-8))
    # Too long a time for an int32 to count images, by the shorter side, of a disk that has all the
    # energy.
    speed = math.sqrt(np.sum(first[:, 2:] ** 2))
    too_long = 2**31 * 1.45 / prepared.frame.length / speed
    harms.append((w.tally, NOW, too_long))
    for array, where, value in harms:
        begin_run(w, first)
        w.count[CROSSINGS] = 2**31
        for failed in (False, True):
            assert exact_run.report_of(prepared, w, first, finite=True)["failed"] == failed
            array[where] = value


def test_a_duration_that_the_clock_cannot_count_is_refused():
    disks = state_of([(0, 0, 1, 0)])
    with pytest.raises(RequestError, match=r"explicit: duration: must be at most .* not 1e\+200"):
        simulate(scene_of_state(box(6, 6, WALLS), disks, 1e200), [0])


@pytest.mark.parametrize("size", [1e-139, 1.0, 1e139])
@pytest.mark.parametrize("duration", [1e-280, 1.0, 1e300])
def test_disks_at_rest_in_any_units(size, duration):
    disks = state_of([(0, 0, 0, 0), (0.5 * size, 0, 0, 0)], 0.125 * size)
    where = box(size * 2, size * 2, PERIODIC)
    position, velocity, _, _ = outcome(where, disks, duration)
    assert np.array_equal(position, disks.position)
    assert not velocity.any()


@pytest.mark.parametrize("speed", [1e-200, 1e200])
def test_a_unit_of_time_that_is_no_number_is_refused(speed):
    size = 1e130 if speed < 1 else 1e-130
    disks = state_of([(0, 0, speed, 0)], size / 8)
    scene = scene_of_state(box(size, size, WALLS), disks, 1.0)
    message = r"explicit: velocities: the rms speed 1e.200 must be from .* other units"
    with pytest.raises(RequestError, match=message):
        simulate(scene, [0])


def test_no_momentum_of_the_heaviest_masses():
    """Their sum is infinite, their mean velocity is not."""
    velocity = np.random.default_rng(1).standard_normal((2000, 2))
    unit = remove_total_momentum(velocity, np.full(2000, 1.0))
    heavy = remove_total_momentum(velocity, np.full(2000, 2.0**1020))
    assert np.array_equal(unit, heavy)


@BOTH
def test_the_largest_mass_ratio(boundary):
    """Some 1e4 collisions with a disk of 1e200 times the mass, which they do not move: from 1/eps^2
    on, a change of its velocity is below the last bit. A time step leaves overlaps, but the same
    balance of energy and momentum.

    At equal temperature: a disk so heavy that moved would squeeze a light one against a wall in
    1e100 collisions.
    """
    kinds = [(9, 0.1, 1.0), (1, 0.1, LARGEST_MASS_RATIO)]
    scene = mixture(box(2, 2, boundary), kinds, 500.0, velocities={"temperature": 1.0})
    for run in (
        simulate(scene, [1], {"all"}),
        timestep.simulate(scene, [1], {"all"}, time_step=0.01),
    ):
        seen = {key: column[0] for key, column in run.observables.items()}
        assert not seen["failed"]
        assert seen["pair_collisions"] > 200
        assert abs(seen["energy_drift"]) <= 1e-9
        assert seen["momentum_residual"] <= 1e-9
        assert np.isfinite(run.whole[1].velocity).all()


@pytest.mark.parametrize("place", [1e-3, 3.0])
def test_the_smallest_radius(place):
    """An impact at 0.6 of the contact distance leaves the struck disk 0.8 of the speed, to a unit
    of round-off of the largest coordinate in radii. Such a run may fail its check of overlaps,
    which is stricter.
    """
    radius = 6.0 * (1 + 1e-9) * SMALLEST_RADIUS
    for angle in np.random.default_rng(1).uniform(0, 2 * math.pi, 40):
        along = np.array([math.cos(angle), math.sin(angle)])
        across = np.array([-math.sin(angle), math.cos(angle)])
        start = np.array((place - 1e-6, -place + 1e-6)) * 0.99
        other = start + radius * (1.2 * across - 10 * along)
        disks = state_of([(*start, 0, 0), (*other, *along)], radius)
        scene = scene_of_state(box(6, 6, WALLS), disks, 40 * radius)
        run = simulate(scene, [0], {"all"})
        assert run.observables["pair_collisions"][0] == 1
        speed = np.hypot(*run.whole[0].velocity[-1, 0])
        assert abs(speed - 0.8) <= np.finfo(float).eps * 3.0 / radius


def test_a_duration_of_1e_150():
    scene = note_scene(1.0).replace(duration=1e-150, sample_interval=1e-150)
    run = simulate(scene, [1], {"all"})
    track = run.whole[1]
    start, end = track.position
    moved = end - start  # below the round-off of all coordinates but the tracer's, which are 0
    assert np.array_equal(moved[0], track.velocity[0, 0] * 1e-150)
    assert not moved[1:].any()
    assert run.observables["pair_collisions"][0] == run.observables["wall_collisions"][0] == 0
    assert run.times.tolist() == [0.0, 1e-150]


@pytest.mark.parametrize("digits", [0, 1, 2, 3, 4, 5, pytest.param(6, marks=pytest.mark.slow)])
def test_pi_collisions(digits):
    """A wall, a light disk and a heavy one of 100^digits times its mass: the digits of pi, up to
    3,141,592.
    """
    masses = np.array([1.0, 100.0**digits])
    disks = state_of([(2, 0, 0, 0), (4, 0, -1, 0)], 0.5, masses)
    where = {"x": [0.0, 40.0], "y": [-20.0, 20.0], "boundary": WALLS}
    run = simulate(scene_of_state(where, disks, 30.0), [0], frozenset())
    seen = {key: column[0] for key, column in run.observables.items()}
    collisions = seen["pair_collisions"] + seen["wall_collisions"]
    assert collisions == math.floor(math.pi * 10**digits)
    # a tenth of a unit of round-off, always the same way, in 3e6 collisions
    assert abs(seen["energy_drift"]) <= 5e-11
    assert not seen["failed"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kinds", "bound"),
    [
        pytest.param([(10, 0.1, 1.0)], 1e-12, id="equal"),
        pytest.param([(5, 0.1, 1.0), (5, 0.1, 7.3)], 1e-12, id="7.3"),
        pytest.param([(9, 0.1, 1.0), (1, 0.1, 1e12)], 1e-9, id="1e12"),
    ],
)
@BOTH
def test_energy_over_a_million_events(boundary, kinds, bound):
    """At random, 1e6 errors of a unit of round-off of 2/10 of the energy add up to 5e-14. A bias of
    0.1 units would give 5e-12, and did: see `collisions.shares`.
    """
    scene = mixture(box(2, 2, boundary), kinds, 10.0, velocities={"temperature": 1.0})
    few = simulate(scene, [1], frozenset()).observables
    events = few["pair_collisions"][0] + few["wall_collisions"][0]
    million = 1e7 / events
    longer = scene.replace(duration=million, sample_interval=million)
    seen = simulate(longer, [1], frozenset()).observables
    assert 0.5e6 < seen["pair_collisions"][0] + seen["wall_collisions"][0] < 2e6
    assert abs(seen["energy_drift"][0]) <= bound
    assert seen["worst_overlap"][0] <= 1e-12
    assert seen["momentum_residual"][0] <= 1e-12


# -- long times, far places ------------------------------------------------------------------------


def reflected(x, v, t, half):
    """Where a point is that bounces between -half and half, exactly."""
    period = 4 * half
    path = (Fraction(x) + Fraction(v) * Fraction(t) + half) % period
    folded = path if path <= 2 * half else period - path
    return float(folded) - float(half)


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "speed", "bound"), [(1e6, 1.0, 1e-7), (1e9, 1 / 64, 1e-5)])
def test_a_lone_disk_for_a_long_time(duration, speed, bound):
    """Up to 5e6 bounces, each off by some 1e-13 at random and 1e-15 in the mean."""
    vx, vy = 0.9 * speed, 0.7 * speed
    disk = state_of([(0.1, -0.2, vx, vy)], 0.25)
    run = simulate(scene_of_state(box(6, 6, WALLS), disk, duration), [0], {"tracer"})
    end = run.tracer.position[-1, 0]
    half = Fraction(11, 4)
    assert end[0] == pytest.approx(reflected(0.1, vx, duration, half), abs=bound)
    assert end[1] == pytest.approx(reflected(-0.2, vy, duration, half), abs=bound)
    assert not run.observables["failed"][0]


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "speed"), [(1e6, 1.0), (1e9, 1 / 64)])
def test_a_lone_disk_in_a_periodic_box_for_a_long_time(duration, speed):
    """Unwrapped it moves straight; the error is that of times within blocks, 1e-16 of the way at
    the most.
    """
    vx, vy = 0.9 * speed, -0.7 * speed
    disk = state_of([(0.1, -0.2, vx, vy)], 0.25)
    scene = scene_of_state(box(6, 6, PERIODIC), disk, duration)
    track = simulate(scene, [0], {"tracer"}).tracer
    for axis, (x, v) in enumerate([(0.1, vx), (-0.2, vy)]):
        position = float(track.position[-1, 0, axis])
        image = int(track.image[-1, 0, axis])
        way = Fraction(position) + 6 * image - Fraction(x)
        assert abs(float(way - Fraction(v) * Fraction(duration))) <= 1e-7
        assert -3 <= position <= 3


@BOTH
def test_a_box_a_million_away_loses_no_digit(boundary):
    """The same events to the bit; only the positions that are handed back are rounded to their
    1e-10.
    """
    where = box(4, 4, boundary)
    state = draw_state(mixture(where, [(20, 0.14, 1), (20, 0.1, 0.3)], 1.0), 1)
    rounded = np.round(state.position * 2**30) / 2**30  # so that the shift is exact
    state = state._replace(position=rounded)
    near = simulate(scene_of_state(where, state, 1.0), [0], {"all", "events"})
    shift = np.array([2.0**20, -(2.0**20)])
    shifted = state._replace(position=state.position + shift)
    where = box(4, 4, boundary, tuple(shift.tolist()))
    far = simulate(scene_of_state(where, shifted, 1.0), [0], {"all", "events"})
    assert len(near.events[0].time) > 50
    for column, expected in zip(far.events[0], near.events[0], strict=True):
        assert np.array_equal(column, expected)
    distance = far.whole[0].position - shift - near.whole[0].position
    assert np.abs(distance).max() <= 1.2e-10  # half an ulp of 2^20
    assert np.array_equal(near.whole[0].velocity, far.whole[0].velocity)


# -- how many, how large ---------------------------------------------------------------------------


@BOTH
def test_no_disk_at_all(boundary):
    scene = mixture(box(2, 2, boundary), [(0, 0.1, 1.0)], 1.0)
    run = simulate(scene, [0, 1], {"tracer", "all", "events"})
    assert run.tracer is None
    assert run.times.tolist() == [0.0, 1.0]
    for column in run.observables.values():
        assert column.tolist() == [0, 0]
