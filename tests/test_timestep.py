"""The time-stepping engine against a plain twin to the bit, against the exact engine as dt -> 0,
and conservation.
"""

import json
import math
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

import naive
from brownpipe.engines.collisions import exchange, shares
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.exact.simulation import equilibrate, prepare_equilibration
from brownpipe.engines.recording import Conservation, report_in_scene_units
from brownpipe.engines.start.initial_state import draw_state
from brownpipe.engines.timestep import COLLISIONS, Settings, largest_step
from brownpipe.engines.timestep import simulation as timestep
from brownpipe.errors import RequestError
from brownpipe.scene import parse_scene
from brownpipe.tradeoff.compare import departure_time
from scenes import CHANNEL_X, CHANNEL_Y, PERIODIC, WALLS, in_plain_python

EPSILON = np.finfo(float).eps


def mixture_in_box(boundary, side, kinds, duration, tracer=None, **more):
    """A scene of species from (count, radius, mass) each, in a box, perhaps a square, around the
    origin.
    """
    x, y = (np.broadcast_to(side, 2) / 2).tolist()
    rows = []
    for j, (count, radius, mass) in enumerate(kinds):
        rows.append({"name": f"s{j}", "count": count, "radius": radius, "mass": mass})
    disks = {"species": rows, "placement": more.pop("placement", "random")}
    if tracer is not None:
        disks["tracer"] = tracer
    mapping = {
        "box": {"x": [-x, x], "y": [-y, y], "boundary": boundary},
        "disks": disks,
        "duration": duration,
        "velocities": {"standard_deviation": 1.0},
    }
    return parse_scene(mapping | more, "made.yaml")


def listed_disks(boundary, side, disks, duration, **more):
    """A scene of disks from (position, velocity, radius, mass) each."""
    keys = ("position", "velocity", "radius", "mass")
    rows = [dict(zip(keys, disk, strict=True)) for disk in disks]
    edges = [-side / 2, side / 2]
    mapping = {
        "box": {"x": edges, "y": edges, "boundary": boundary},
        "disks": rows,
        "duration": duration,
    }
    return parse_scene(mapping | more, "explicit.yaml")


TRACER = {"radius": 0.5, "mass": 3.0, "position": [0.0, 0.0]}
SCENES = {
    "walls": mixture_in_box(WALLS, 2.0, [(12, 0.125, 1)], 4.0),
    "mixture": mixture_in_box(WALLS, 2.0, [(8, 0.1, 1), (8, 0.14, 0.25)], 4.0),
    "big": mixture_in_box(WALLS, 4.0, [(40, 0.1, 0.5)], 4.0, TRACER),
    "alone": mixture_in_box(WALLS, 2.0, [(1, 0.25, 1)], 40.0),
    "periodic": mixture_in_box(PERIODIC, 2.0, [(12, 0.125, 1)], 1.0),
    "periodic mixture": mixture_in_box(PERIODIC, 2.0, [(8, 0.1, 1), (8, 0.14, 0.25)], 1.0),
    "periodic big": mixture_in_box(
        PERIODIC, 2.0, [(16, 0.1, 0.5), (1, 0.5, 3.0)], 1.0
    ),  # last: the tracer is another one
    "two cells a side": mixture_in_box(PERIODIC, 1.0, [(4, 0.17, 1)], 2.0),
    "channel": mixture_in_box(CHANNEL_X, 2.0, [(12, 0.125, 1)], 1.0),
    "channel mixture": mixture_in_box(CHANNEL_Y, 2.0, [(8, 0.1, 1), (8, 0.14, 0.25)], 1.0),
    "channel big": mixture_in_box(CHANNEL_Y, 2.0, [(16, 0.1, 0.5), (1, 0.5, 3.0)], 1.0),
    "channel of two cells": mixture_in_box(CHANNEL_X, 1.0, [(4, 0.17, 1)], 2.0),
}
DT = 2.0**-7
REPORTED = ("pair_collisions", "tracer_collisions", "wall_collisions", "virial", "wall_impulse")


# -- step by step ----------------------------------------------------------------------------------


class Meeting(NamedTuple):
    """Disk k as seen from disk i."""

    place: tuple
    velocity: tuple
    collides: bool
    since: float  # how long ago they met


class Twin:
    """The algorithm as it reads, all pairs with all images."""

    def __init__(self, state, box, dt, collisions):
        self.x, self.v, self.radius, self.mass = (column.copy() for column in state)
        self.dt = dt
        self.late = collisions == "late"
        self.size = np.array((box.width, box.height))
        self.low = np.array((box.x[0], box.y[0]))
        self.periodic = np.array([naive.is_periodic(box, axis) for axis in "xy"])
        tiles = np.array([*product((-1, 0, 1), repeat=2)])
        self.images = tiles[(tiles[:, ~self.periodic] == 0).all(axis=1)]
        self.course = np.zeros(len(self.x))  # when each disk last collided
        self.reported = np.zeros(5)

    def meeting(self, i, k, image, now):
        """Whether and when disk i and an image of disk k met."""
        rx, ry = self.x[k] + image * self.size - self.x[i]
        ux, uy = self.v[k] - self.v[i]
        sigma = self.radius[i] + self.radius[k]
        approach = rx * ux + ry * uy
        overlapping = rx * rx + ry * ry < sigma * sigma
        if self.late:
            return Meeting((rx, ry), (ux, uy), overlapping and approach < 0, 0.0)
        speed2 = ux * ux + uy * uy
        cross = rx * uy - ry * ux
        root = speed2 * (sigma * sigma) - cross * cross
        free = now - max(self.course[i], self.course[k])
        since = -1.0
        if root > 0:
            root = math.sqrt(root)
            gap = sigma * sigma - (rx * rx + ry * ry)
            since = (approach + root) / speed2 if approach > 0 else gap / (root - approach)
        met = 0 <= since <= free
        if not met:
            since = free
            bx = rx - ux * free
            by = ry - uy * free
            met = bx * bx + by * by < sigma * sigma and bx * ux + by * uy < 0
        collides = met and (since <= 2 * self.dt or overlapping)
        return Meeting((rx, ry), (ux, uy), collides, since)

    def near_pairs(self):
        """Pairs and images that may have met: such a pair overlaps, or met within two steps and has
        not gone further since.
        """
        first, second = np.triu_indices(len(self.x), 1)
        separation = (self.x[second] - self.x[first])[:, None] + self.images * self.size
        distance = np.linalg.norm(separation, axis=-1)
        path = 5 * self.dt * np.linalg.norm(self.v, axis=1).max()
        furthest = self.radius[first] + self.radius[second] + path
        for pair, image in np.argwhere(distance < furthest[:, None]):
            yield first[pair], second[pair], tuple(self.images[image])

    def collide(self, i, k, image, now):
        """Let two disks collide where they met, if they did."""
        (rx, ry), (ux, uy), collides, since = self.meeting(i, k, np.array(image), now)
        if not collides:
            return
        r = rx - ux * since, ry - uy * since
        f = np.array(exchange(*r, ux, uy))
        whole_i, part_i, whole_k, part_k, _ = shares(self.mass[i], self.mass[k])
        after_i = self.v[i] + whole_i * f + part_i * f
        after_k = self.v[k] - whole_k * f - part_k * f
        virial = self.mass[i] * (self.v[i] - after_i) @ r
        self.reported += 1, i == 0, 0, virial, 0
        for disk, velocity in ((i, after_i), (k, after_k)):
            self.x[disk] += (velocity - self.v[disk]) * since
            self.v[disk] = velocity
        self.course[[i, k]] = now - since

    def bounce(self, i, axis, now):
        """Let a disk that reaches beyond a wall bounce, as often as it hit both."""
        left = self.low[axis] - (self.x[i, axis] - self.radius[i])
        right = self.x[i, axis] + self.radius[i] - (self.low + self.size)[axis]
        beyond = left if self.v[i, axis] < 0 else right
        speed = abs(self.v[i, axis])
        if not (speed > 0 and beyond > 0):
            return
        hits = 1
        if not self.late:
            gap = self.size[axis] - 2 * self.radius[i]
            inward = -np.sign(self.v[i, axis])
            hits = int(beyond / gap) + 1
            rest = beyond - (hits - 1) * gap
            into_box = rest if hits % 2 else gap - rest
            self.x[i, axis] = self.x[i, axis] + inward * beyond + inward * into_box
            self.course[i] = max(self.course[i], now - rest / speed)
        self.v[i, axis] *= (-1) ** hits
        self.reported += 0, 0, hits, 0, 2 * self.mass[i] * speed * hits

    def step(self, now):
        """Advance by a step, to the time now."""
        self.x += self.v * self.dt
        boxes_away = np.floor((self.x - self.low) / self.size)
        self.x -= np.where(self.periodic, boxes_away * self.size, 0.0)
        met = []
        for i, k, image in self.near_pairs():
            meeting = self.meeting(i, k, np.array(image), now)
            if meeting.collides or self.late:
                met.append((-meeting.since, i, k, image))
        for _, i, k, image in sorted(met):
            self.collide(i, k, image, now)
        for i, axis in np.ndindex(self.x.shape):
            if not self.periodic[axis]:
                self.bounce(i, axis, now)


def twin(state, box, dt, steps, collisions):
    """Positions and velocities after some steps of the plain twin, and what is REPORTED."""
    plain = Twin(state, box, dt, collisions)
    for step in range(steps):
        plain.step((step + 1) * dt)
    return plain.x, plain.v, plain.reported


@pytest.mark.parametrize("collisions", ["at_contact", pytest.param("late", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", SCENES)
def test_every_step_is_that_of_the_plain_twin(name, collisions):
    """Between walls to the last bit; in periodic boxes positions are rounded elsewhere, so to 1e-9
    in a short time.
    """
    scene = SCENES[name]
    run = timestep.simulate(scene, [5], {"all"}, time_step=DT, collisions=collisions)
    steps = round(scene.duration / DT)
    x, v, reported = twin(draw_state(scene, 5), scene.box, DT, steps, collisions)
    track = run.whole[5]
    found = run.observables
    totals = [found.get(name, [0])[0] for name in REPORTED]
    assert totals == pytest.approx(reported, rel=1e-9)
    assert reported[0] + reported[2] > 10
    assert not found["failed"][0]
    if scene.box.has_images:
        apart = scene.box.nearest_image(track.position[-1] - x)
        assert np.abs(apart).max() < 1e-9
        assert np.abs(track.velocity[-1] - v).max() < 1e-9
    else:
        assert np.array_equal(track.position[-1], x)
        assert np.array_equal(track.velocity[-1], v)


@pytest.mark.parametrize("collisions", COLLISIONS)
@pytest.mark.parametrize("name", ["mixture", "big"])
def test_how_neighbours_are_found_changes_no_bit(name, collisions):
    """Long and short lists, lists that are renewed at every step, and lists that have too little
    room at first.
    """
    scene = SCENES[name]
    engine = timestep.prepare_scene(scene, Settings(DT, collisions))
    wide = np.ones(4)
    runs = []
    for skin in (engine.workspace.skin, 0.0, 0.3, 10.0):
        w = engine.workspace._replace(skin=skin)
        if skin == 10.0:
            few = [column[:4] if j < 2 else wide.copy() for j, column in enumerate(w.within)]
            w = w._replace(within=type(w.within)(*few))
        state = draw_state(scene, 2)
        other_lists = engine._replace(workspace=w)
        runs.append(timestep.run_steps(other_lists, state, scene.times, {"all"}))
    usual = dict(runs[0].observables)
    usual_residual = usual.pop("momentum_residual")
    for run in runs[1:]:
        assert np.array_equal(run.whole.position, runs[0].whole.position)
        observables = dict(run.observables)
        # Only the impulses given to the walls are added up in another order.
        assert abs(observables.pop("momentum_residual") - usual_residual) < 1e-15
        assert observables == usual


@pytest.mark.parametrize(
    "scene", [SCENES["mixture"], mixture_in_box(PERIODIC, 2.0, [(20, 0.1, 0.5), (1, 0.5, 3)], 1.0)]
)
def test_no_step_depends_on_samples_batch_or_record(scene):  # the engine has the big one first
    sampled = json.loads(scene.text) | {"sample_interval": scene.duration / 37}
    more = parse_scene(sampled, "made.yaml")
    alone = timestep.simulate(scene, [3], {"all"}, time_step=0.0071)
    batch = timestep.simulate(more, [1, 3, 2], {"tracer"}, time_step=0.0071)
    assert np.array_equal(batch.tracer.position[-1, 1], alone.whole[3].position[-1, 0])
    for name, values in alone.observables.items():
        assert values[0] == batch.observables[name][1]


def test_a_sample_is_a_free_flight_after_the_step_before():
    mover = ((0.0, 0.0), (1.0, -0.5), 0.25, 1.0)
    scene = listed_disks(PERIODIC, 4.0, [mover], 3.0, sample_interval=0.37)
    run = timestep.simulate(scene, [0], time_step=0.1)
    unwrapped = run.tracer.position[:, 0] + 4.0 * run.tracer.image[:, 0]
    free_flight = scene.times[:, None] * (1.0, -0.5)
    assert np.abs(unwrapped - free_flight).max() < 1e-14
    assert run.times[-1] == 3.0
    assert np.all(np.abs(run.tracer.position) <= 2.0)
    frame = timestep.prepare_scene(scene, Settings(0.1)).frame
    recorder = timestep.new_recorder(scene, frame, 0.1, np.arange(31) * 0.1, ())
    assert recorder.step.tolist() == [*range(31)]


# -- as dt -> 0 ------------------------------------------------------------------------------------


LONE_PAIR = [((-1.0, 0.1), (1.0, 0.05), 0.3, 1.0), ((0.2, 0.3), (-0.5, 0.0), 0.2, 0.4)]


def test_a_lone_pair_collides_at_contact_whatever_the_step():
    """To round-off of the steps: 1e5 additions of 1e-16 at most."""
    scene = listed_disks(WALLS, 8.0, LONE_PAIR, 2.0)
    there = exact.simulate(scene, [0], {"all"}).whole[0].position[-1]
    for dt in (1e-2, 0.7e-3, 2e-5):
        run = timestep.simulate(scene, [0], {"all"}, time_step=dt)
        assert run.observables["pair_collisions"][0] == 1
        assert np.abs(run.whole[0].position[-1] - there).max() < 1e-11


def test_a_disk_meets_walls_in_time_whatever_the_step():
    mover = ((0.1, -0.3), (1.7, 0.9), 0.25, 1.0)
    scene = listed_disks(WALLS, 2.0, [mover], 20.0, sample_interval=0.1)
    there = exact.simulate(scene, [0], {"all"})
    expected = there.whole[0].position
    for dt in (1e-2, 1e-3, 1e-4):
        run = timestep.simulate(scene, [0], {"all"}, time_step=dt)
        bounces = run.observables["wall_collisions"][0]
        assert abs(bounces - there.observables["wall_collisions"][0]) <= 1
        # a sample may lie before a bounce
        inside = np.abs(expected).max(axis=(1, 2)) < 0.75 - 1.7 * dt
        assert np.abs(run.whole[0].position - expected)[inside].max() < 1e-10
        assert np.count_nonzero(inside) > 150


@pytest.mark.parametrize(
    ("radius", "speed", "dt"), [(0.45, 1, 0.3), (0.45, 1, 0.15), (0.49, 0.3, 0.1), (0.3, 1, 0.05)]
)
def test_a_disk_in_a_narrow_gap_meets_both_walls_in_a_step(radius, speed, dt):
    mover = ((0.01, 0.0), (0.3 * speed, speed), radius, 1.0)
    scene = listed_disks(WALLS, 1.0, [mover], 10.0, sample_interval=0.5)
    expected = exact.simulate(scene, [0], {"all"}).observables
    run = timestep.simulate(scene, [0], {"all"}, time_step=dt)
    seen = run.observables
    assert abs(seen["wall_collisions"][0] - expected["wall_collisions"][0]) <= 1
    assert not seen["failed"][0]
    # a sample may lie before a bounce
    assert np.abs(run.whole[0].position).max() < 0.5 - radius + speed * dt
    assert seen["wall_impulse"][0] == pytest.approx(expected["wall_impulse"][0], rel=0.05)


def test_a_disk_with_hardly_any_room_stays():
    mover = ((0.0, 0.0), (0.0, 0.1), 0.5, 1.0)
    scene = listed_disks(WALLS, 1.0 + 1e-9, [mover], 1.0, sample_interval=0.1)
    run = timestep.simulate(scene, [0], {"all"}, time_step=0.01)
    assert not run.observables["failed"][0]
    assert np.abs(run.whole[0].position).max() < 2e-3


def test_a_dense_fluid_loses_no_collisions_in_a_step_of_a_fiftieth():
    """phi = 0.72, steps of a fiftieth of the largest: pairs that third disks push together meet,
    too; 3 % at most.
    """
    scene = mixture_in_box(
        PERIODIC, 10.0, [(92, 0.5, 1.0)], 1.0, placement="lattice", equilibrate=1.0
    )
    expected = exact.simulate(scene, range(10)).observables["pair_collisions"]
    dt = largest_step(scene) / 50
    found = timestep.simulate(scene, range(10), time_step=dt).observables["pair_collisions"]
    assert abs(found.sum() / expected.sum() - 1) < 0.03


def test_a_late_collision_is_late_by_up_to_a_step_so_the_error_is_of_first_order():
    """One oblique collision of unequal disks: log error against log dt, slope 1 within 4 of its
    standard errors.

    The delay is uniform in [0, dt], so the errors scatter about the line; false alarm 1 in 16,000.
    """
    scene = listed_disks(WALLS, 8.0, LONE_PAIR, 2.0)
    there = exact.simulate(scene, [0], {"all"}).whole[0].position[-1]
    logarithms = np.random.default_rng(7).uniform(np.log(1e-5), np.log(1e-2), 100)
    steps = np.exp(logarithms)
    error = []
    for dt in steps:
        run = timestep.simulate(scene, [0], {"all"}, time_step=float(dt), collisions="late")
        assert run.observables["pair_collisions"][0] == 1
        error.append(np.abs(run.whole[0].position[-1] - there).max())
    assert np.all(np.array(error) < 6 * steps)
    (slope, _), covariance = np.polyfit(np.log(steps), np.log(error), 1, cov=True)
    standard_error = covariance[0, 0] ** 0.5
    assert standard_error < 0.1
    assert abs(slope - 1) < 4 * standard_error


def test_a_wall_met_late_is_met_by_up_to_a_step_later_and_never_passed():
    mover = ((0.1, -0.3), (1.7, 0.9), 0.25, 1.0)
    scene = listed_disks(WALLS, 2.0, [mover], 20.0, sample_interval=0.1)
    there = exact.simulate(scene, [0], {"all"})
    for dt in (1e-2, 1e-3, 1e-4):
        run = timestep.simulate(scene, [0], {"all"}, time_step=dt, collisions="late")
        position = run.whole[0].position
        bounces = run.observables["wall_collisions"][0]
        assert abs(bounces - there.observables["wall_collisions"][0]) <= 1
        distance = np.abs(position - there.whole[0].position).max()
        assert 0 < distance < 2 * bounces * 1.7 * dt
        assert np.abs(position).max() < 0.75 + 1.7 * dt


def test_a_short_encounter_is_missed_and_counted_where_collisions_are_late():
    """A chord of length 2 sqrt(sigma^2 - h^2) is crossed in 0.028; a step of 0.1 that straddles it
    sees nothing.
    """
    late = {"collisions": "late"}
    sigma = 1.0
    height = np.sqrt(1 - 0.014**2)
    assert np.hypot(-1.05, height) > sigma
    still = ((0.0, 0.0), (0.0, 0.0), 0.5, 1.0)
    grazing = ((-1.05, height), (1.0, 0.0), 0.5, 1.0)
    scene = listed_disks(WALLS, 8.0, [grazing, still], 2.0)
    coarse = timestep.simulate(scene, [0], time_step=0.1, **late).observables
    assert (coarse["pair_collisions"][0], coarse["missed_collisions"][0]) == (0, 1)
    fine = timestep.simulate(scene, [0], time_step=0.005, **late).observables
    assert (fine["pair_collisions"][0], fine["missed_collisions"][0]) == (1, 0)
    passing = ((-1.05, 1.0001), (1.0, 0.0), 0.5, 1.0)
    past = listed_disks(WALLS, 8.0, [passing, still], 2.0)
    coarse = timestep.simulate(past, [0], time_step=0.1, **late).observables
    assert coarse["missed_collisions"][0] == 0
    expected = exact.simulate(scene, [0], {"all"}).whole[0].position[-1]
    at_contact = timestep.simulate(scene, [0], {"all"}, time_step=0.1)
    assert at_contact.observables["pair_collisions"][0] == 1
    assert "missed_collisions" not in at_contact.observables
    assert np.abs(at_contact.whole[0].position[-1] - expected).max() < 1e-12
    assert timestep.simulate(past, [0], time_step=0.1).observables["pair_collisions"][0] == 0


def test_late_collisions_are_fewer_by_an_amount_that_vanishes_with_the_step():
    """A crowded box, the same 40 states: significantly fewer with a long step, with a short one
    within 4 errors.

    At contact the long step loses less than half as many: 2.8(7) % instead of 12.1(8) %.
    """
    scene = mixture_in_box(
        PERIODIC, 10.0, [(70, 0.5, 1.0)], 1.0, placement="lattice", equilibrate=1.0
    )
    seeds = np.arange(40)
    expected = exact.simulate(scene, seeds).observables["pair_collisions"]
    bias = []
    error = []
    for dt, collisions in ((3e-2, "late"), (1e-3, "late"), (3e-2, "at_contact")):
        run = timestep.simulate(scene, seeds, time_step=dt, collisions=collisions)
        less = run.observables["pair_collisions"] - expected
        bias.append(less.mean())
        error.append(less.std(ddof=1) / np.sqrt(len(seeds)))
    late, late_short, at_contact = bias
    assert late < -5 * error[0]
    assert abs(late_short) < 4 * error[1]
    assert abs(late_short) < 0.25 * abs(late)
    assert abs(at_contact) < abs(late) / 2


@pytest.mark.slow
def test_the_course_is_the_exact_one_until_errors_have_grown():
    """Departure comes the later the shorter the step, and later with collisions at contact than
    with late ones.
    """
    tracer = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}
    scene = mixture_in_box(
        WALLS,
        6.0,
        [(99, 0.1, 0.4)],
        1.0,
        tracer,
        sample_interval=0.01,
        velocities={"standard_deviation": 2.0},
    )
    seeds = range(30)
    there = exact.simulate(scene, seeds).tracer.position

    def departs(dt, collisions):
        batch = seeds if dt > 1e-5 else range(3)
        run = timestep.simulate(scene, batch, time_step=dt, collisions=collisions)
        reference = there[:, : len(run.seeds)]
        departed = departure_time(scene.times, run.tracer.position, reference, 1e-3 * 0.3)
        return np.mean(np.minimum(departed, 2.0))

    assert departs(1e-2, "late") < departs(1e-4, "late") < departs(2e-6, "late")
    assert departs(1e-2, "late") < departs(1e-2, "at_contact") < departs(1e-3, "at_contact")


# -- what is conserved -----------------------------------------------------------------------------


@pytest.mark.parametrize("collisions", COLLISIONS)
@pytest.mark.parametrize("name", SCENES)
def test_energy_and_momentum_are_conserved_to_round_off(name, collisions):
    """The sum of as many roundings as there are collisions, each of one unit of round-off of the
    whole at most.
    """
    scene = SCENES[name]
    found = timestep.simulate(scene, range(5), time_step=DT, collisions=collisions).observables
    events = found["pair_collisions"] + found["wall_collisions"] + 10
    assert np.all(np.abs(found["energy_drift"]) < EPSILON * events)
    assert np.all(found["momentum_residual"] < EPSILON * events)
    assert not found["failed"].any()
    assert np.all(found["worst_overlap"] < 1.0)
    expected = exact.simulate(scene, range(5)).observables["kinetic_energy"]
    assert np.allclose(found["kinetic_energy"], expected)


def test_what_is_no_number_or_not_conserved_has_failed():
    scene = SCENES["walls"]
    engine = timestep.prepare_scene(scene, Settings(DT))
    state = draw_state(scene, 0)
    state.velocity[3] = np.nan
    times = np.array([0.1])
    assert timestep.run_steps(engine, state, times).observables["failed"]
    sound = timestep.run_steps(engine, draw_state(scene, 0), times)
    assert not sound.observables["failed"]
    for drift, finite in (
        (2e-9, True),
        (-2e-9, True),
        (np.nan, True),
        (0.0, False),
        (-5e-10, True),
    ):
        conserved = Conservation(1.0, drift, 0.0, 1.0, finite)
        found = report_in_scene_units(
            engine.scene, engine.frame, conserved, [0, 0, 0], np.zeros(5), 0.0, True
        )
        assert found["failed"] == (drift != -5e-10)


# -- the same everywhere ---------------------------------------------------------------------------


@pytest.mark.parametrize("tracer", ["pinned", "free"])
def test_runs_begin_where_the_exact_engine_begins(tracer):
    where = {"radius": 0.3, "mass": 2.0, "position": [0.1, 0.2]}
    equilibration = {"time": 0.5, "tracer": tracer}
    scene = mixture_in_box(PERIODIC, 3.0, [(30, 0.1, 1.0)], 0.5, where, equilibrate=equilibration)
    expected = exact.simulate(scene, [4], {"all"}).whole[4]
    track = timestep.simulate(scene, [4], {"all"}, time_step=DT).whole[4]
    assert np.array_equal(track.position[0], expected.position[0])
    assert np.array_equal(track.velocity[0], expected.velocity[0])
    equilibrated = equilibrate(prepare_equilibration(scene), draw_state(scene, 4))
    assert np.array_equal(expected.position[0], equilibrated.position)


def few():
    """Short runs of scenes of every kind, collisions at contact and late."""
    names = ("walls", "mixture", "periodic big", "two cells a side")
    runs = []
    for name, collisions in product(names, COLLISIONS):
        settings = {"time_step": 2**-5, "collisions": collisions}
        runs.append(timestep.simulate(SCENES[name], [3], {"all"}, **settings))
    return runs


@pytest.mark.slow
def test_the_compiler_changes_no_bit():
    others = in_plain_python("few", "test_timestep")
    for run, other in zip(few(), others, strict=True):
        assert run.observables["pair_collisions"][0] > 2
        for column, expected in zip(run.whole[3], other.whole[3], strict=True):
            assert column is None or np.array_equal(column, expected)
        assert run.observables == other.observables


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time_step", "more", "message"),
    [
        (0.5, {}, r"time_step: must be at most 0\.07\d+, .* found 0.5"),
        (1e-12, {}, "time_step: must be at least 4e-10, for"),
        (np.nan, {}, "time_step: must be at most"),
        (
            1e-3,
            {"record": {"events"}},
            "--record events: the timestep engine knows no instants of collisions",
        ),
    ],
)
def test_bad_settings_are_refused_in_one_line(time_step, more, message):
    scene = mixture_in_box(WALLS, 2.0, [(12, 0.1, 1)], 4.0)
    with pytest.raises(RequestError, match=message) as refused:
        timestep.simulate(scene, [0], time_step=time_step, **more)
    assert "\n" not in str(refused.value)
    of_smallest_disks = 0.1 / math.sqrt(2 * 46 / 41)
    assert largest_step(SCENES["big"]) == pytest.approx(of_smallest_disks)


# -- departure -------------------------------------------------------------------------------------


def test_departure_is_the_first_sample_beyond_the_bound():
    times = np.linspace(0, 1, 11)
    reference = np.zeros((11, 4, 2))
    position = reference.copy()
    position[:, 1, 0] = times**2  # beyond 0.3 from 0.6 on
    position[:, 2, 1] = 10.0 * (times > 0.25)
    position[5:, 3, 0] = np.nan
    assert departure_time(times, position, reference, 0.3).tolist() == [
        np.inf,
        0.6000000000000001,
        times[3],
        0.5,
    ]
