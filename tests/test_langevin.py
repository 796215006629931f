"""The tracer alone, in friction and noise: against the exact solutions of its equation, and where
it is refused.
"""

import math

import numpy as np
import pytest
from scipy.special import exprel, hyp1f1

import brownpipe as bp
from brownpipe import theory
from brownpipe.engines import friction
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.langevin import RATE_COLLISIONS, Settings, caution, refuse_unfit
from brownpipe.engines.langevin import simulation as langevin
from brownpipe.engines.langevin.simulation import step_weights
from brownpipe.engines.start.initial_state import draw_state, draw_tracer, noise_stream
from brownpipe.errors import RequestError
from brownpipe.scene import parse_scene

RUNS = 4000
FAR = 3.3  # standard errors: 0.1 % false alarms of one comparison
ALONE = {"standard_deviation": 2.0, "zero_momentum": False}  # no velocity is drawn but the tracer's


def langevin_msd(t, friction_rate, initial_square_speed, equilibrium_square_speed):
    """Return the MSD [length^2] of the Langevin equation, G. E. Uhlenbeck & L. S. Ornstein, Phys.
    Rev. 36, 823 (1930).

    In the plane; square speeds count both components. `friction_rate` is gamma [1/time], 0 allowed,
    and `equilibrium_square_speed` 2 kT/m. With e = exp(-gamma t): (v0^2 - v_eq^2) ((1 - e)/gamma)^2
    + (2 v_eq^2/gamma) (t - (1 - e)/gamma); v0^2 t^2 at first, slope 2 v_eq^2/gamma = 4 kT/(m gamma)
    in the end.
    """
    t = np.asarray(t, float)
    x = friction_rate * t
    # without cancellation
    first_integral = exprel(-x)  # (1 - e)/x
    second_integral = hyp1f1(1, 3, -x) / 2  # (x - 1 + e)/x^2
    excess = initial_square_speed - equilibrium_square_speed
    of_start = excess * first_integral**2
    of_noise = 2.0 * equilibrium_square_speed * second_integral
    return np.square(t) * (of_start + of_noise)


def scene_of(
    name="some", boundary="reflecting", width=6.0, particles=150, species=None, tracer=None, **more
):
    """The note's scene, with what a test changes."""
    side = [-width / 2, width / 2]
    tracer_of_note = {"radius": 0.3, "mass": 1.0, "position": [0.0, 0.0]}
    bath_of_note = {"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}
    mapping = {
        "box": {"x": side, "y": side, "boundary": boundary},
        "particles": particles,
        "disks": {
            "tracer": tracer_of_note | (tracer or {}),
            "species": species or [bath_of_note],
        },
        "velocities": {"standard_deviation": 2.0},
        "duration": 1.0,
        "sample_interval": 0.01,
    }
    mapping = {key: value for key, value in (mapping | more).items() if value is not None}
    return parse_scene(mapping, f"{name}.yaml")


def unwrapped(scene, ensemble):
    """(T, S, 2) displacements from the start."""
    box = scene.box
    position = ensemble.tracer.position
    if ensemble.tracer.image is not None:
        position = position + ensemble.tracer.image * (box.width, box.height)
    return position - position[0]


def mean_and_error(values):
    """Mean over runs, the last axis, and its standard error."""
    deviation = values.std(axis=-1, ddof=1)
    return values.mean(axis=-1), deviation / math.sqrt(values.shape[-1])


# -- the equation ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_msd_of_the_tracer(boundary):
    """Short, middle and long times at once: gamma t from 0.07 to 29. Six numbers, 0.6 % false
    alarms.
    """
    scene = scene_of(
        boundary=boundary, width=60.0, particles=15_000, duration=4.0, velocities=ALONE
    )
    gamma = friction.friction_rate(scene, "enskog")
    assert 7.0 < gamma < 8.0
    found = langevin.simulate(scene, range(RUNS))
    r2 = np.square(unwrapped(scene, found)).sum(axis=-1)
    mean, error = mean_and_error(r2)
    expected = langevin_msd(found.times, gamma, 2 * 4.0, 2 * 1.6)
    for t in (0.01, 0.03, 0.1, 0.3, 1.0, 4.0):
        k = round(t / 0.01)
        assert abs(mean[k] - expected[k]) < FAR * error[k]


def one_step(dt, gamma, square_speed):
    """The step as a matrix that acts on (x, v), and the covariance of what the noise adds."""
    decay, spread, middle, loose = step_weights(dt, gamma, square_speed)
    matrix = np.array([[1.0, middle * (1 + decay)], [0.0, decay]])
    noise_on = np.array([[middle * spread, loose], [spread, 0.0]])
    return matrix, noise_on @ noise_on.T


@pytest.mark.parametrize("x", [0.0, 1e-9, 1e-4, 0.03, 0.0999, 0.1, 0.3, 2.0, 30.0, 800.0])
def test_a_step_has_the_moments_of_the_langevin_equation(x):
    """To 1e-12, for gamma dt = x: those of a start at rest and those that a first velocity adds."""
    gamma = 3.0
    square_speed = 1.6
    matrix, covariance = one_step(x / gamma, gamma, square_speed)
    msd = langevin_msd(x / gamma, gamma, 0.0, 2 * square_speed) / 2
    decay = math.exp(-x)
    of_place_and_velocity = square_speed / gamma * (1 - decay) ** 2
    of_velocity = -square_speed * math.expm1(-2 * x)
    expected = [[msd, of_place_and_velocity], [0, of_velocity]]
    assert np.allclose(np.triu(covariance), expected, rtol=1e-12, atol=1e-22)
    path = -math.expm1(-x) / gamma
    assert np.allclose(matrix, [[1.0, path], [0.0, decay]], rtol=1e-14, atol=0)


def free_path(gamma, square_speed, times, start, seed=1):
    """Position and velocity (runs, T, 2, 2) of free paths from `start` (runs, 2, 2)."""
    weights = step_weights(np.diff(times), gamma, square_speed)
    rng = np.random.default_rng(seed)
    paths = np.empty((len(start), len(times), 2, 2))
    paths[:, 0] = start
    for path in paths:
        langevin.follow(path, rng.standard_normal((len(times) - 1, 2, 2)), weights)
    return paths


# -- walls -----------------------------------------------------------------------------------------


def dense():
    """A tracer whose path forgets its direction within 0.01, in a box where it can go 2.7 each
    way.
    """
    bath = [{"name": "bath", "count": "rest", "radius": 0.05, "mass": 0.4}]
    return scene_of(
        particles=2000, species=bath, duration=2000.0, sample_interval=20.0, velocities=ALONE
    )


@pytest.mark.slow
def test_between_walls_it_diffuses_as_in_the_reflecting_square():
    """The whole curve, to 2 a^2/3; what flight at first leaves out is 1/(gamma t) < 1e-3. Six
    times, 0.6 %.
    """
    scene = dense()
    gamma = friction.friction_rate(scene, "enskog")
    found = langevin.simulate(scene, range(RUNS))
    r2 = np.square(unwrapped(scene, found)).sum(axis=-1)
    mean, error = mean_and_error(r2)
    expected = theory.reflecting_square_msd(found.times, 1.6 / gamma, 2.7)
    assert gamma * found.times[1] > 1e3
    assert 0.1 < expected[1] / expected[-1] < 0.2
    plateau = 2 * 2.7**2 / 3
    assert abs(expected[-1] / plateau - 1) < 1e-6
    some = [1, 3, 5, 10, 20, 100]
    assert np.all(np.abs(mean - expected)[some] < FAR * error[some])
    assert np.abs(found.tracer.position).max() <= 2.7


def reflected_by_small_steps(start, gamma, square_speed, duration, width, steps=4000):
    """The obvious twin: Euler's step, and whoever is beyond a wall is put back with the velocity
    turned.
    """
    rng = np.random.default_rng(3)
    dt = duration / steps
    kick = math.sqrt(2 * gamma * square_speed * dt)
    x, v = (column.copy() for column in start)
    for _ in range(steps):
        v += -gamma * v * dt + kick * rng.standard_normal(x.shape)
        x += v * dt
        beyond = (x < 0) | (x > width)
        mirrored = np.where(x < 0, -x, 2 * width - x)
        x = np.where(beyond, mirrored, x)
        v = np.where(beyond, -v, v)
    return x, v


@pytest.mark.slow
def test_mirrored_paths_are_reflected_paths():
    """Where the wall matters most: one bounce or two in the time of friction. Euler's error is
    below 0.1 %; 1 %.
    """
    scene = scene_of()
    gamma = 1.0
    square_speed = 4.0
    duration = 2.0
    width = 5.4
    start = np.zeros((RUNS, 2, 2))
    start[:, 0] = 1.5
    start[:, 1] = (4.0, -3.0)
    paths = free_path(gamma, square_speed, np.array([0.0, duration]), start)
    tracks = [langevin.folded(scene, path)[0] for path in paths]
    x = np.array([track.position[-1, 0] for track in tracks])
    v = np.array([track.velocity[-1, 0] for track in tracks])
    assert np.abs(x).max() <= 2.7
    assert np.mean(np.abs(paths[:, -1, 0]) > 2.7) > 0.3
    shifted = start[:, 0] + 2.7, start[:, 1]
    x_twin, v_twin = reflected_by_small_steps(shifted, gamma, square_speed, duration, width)
    x_twin = x_twin - 2.7
    for moment, moment_of_twin in (
        (x, x_twin),
        (v, v_twin),
        (x * v, x_twin * v_twin),
        (x**2, x_twin**2),
        (v**2, v_twin**2),
    ):
        mean, error = mean_and_error(moment.T)
        expected, error_of_twin = mean_and_error(moment_of_twin.T)
        assert np.all(np.abs(mean - expected) < FAR * np.hypot(error, error_of_twin))


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_a_path_is_folded_into_the_box(boundary):
    """Wrapped and counted, or mirrored: a triangle wave of the free path, and the velocity turns
    with its slope.
    """
    path = 20.0 * np.random.default_rng(4).standard_normal((1000, 2, 2))
    path[0, 0] = (-2.0, 2.5)
    track, _ = langevin.folded(scene_of(boundary=boundary), path)
    position, velocity = track.position[:, 0], track.velocity[:, 0]
    free, free_velocity = path[:, 0], path[:, 1]
    if boundary == "periodic":
        assert np.all(np.abs(position) <= 3.0)
        assert track.image[0].tolist() == [[0, 0]]
        unfolded = position + 6.0 * track.image[:, 0]
        np.testing.assert_allclose(unfolded, free, rtol=0, atol=1e-12)
        assert np.array_equal(velocity, free_velocity)
    else:
        phase = (free + 2.7) % 10.8
        wave = 2.7 - np.abs(phase - 5.4)
        np.testing.assert_allclose(position, wave, rtol=0, atol=1e-12)
        slope = np.where(phase < 5.4, 1, -1)
        assert np.array_equal(velocity, slope * free_velocity)


def test_a_tracer_with_hardly_any_room_stays_in_it():
    """As wide as the box, to more than round-off: without a gap the scene is refused."""
    gap = 1e-9
    scene = scene_of(width=1.0 + gap, particles=2, tracer={"radius": 0.5}, species=[
        {"name": "bath", "count": "rest", "radius": 0.01, "mass": 0.4}
    ])  # fmt: skip
    position = langevin.simulate(scene, [1], friction="boltzmann").tracer.position
    assert np.abs(position).max() <= 0.51 * gap


# -- the run ---------------------------------------------------------------------------------------


def test_bits_do_not_depend_on_the_batch():
    scene = scene_of(tracer={"position": None})
    whole = langevin.simulate(scene, range(20))
    part = langevin.simulate(scene, [7, 3])
    selected = whole.tracer.position[:, [7, 3]]
    assert selected.tobytes() == part.tracer.position.tobytes()
    assert part.seeds.tolist() == [7, 3]
    assert part.tracer.position.shape == (101, 2, 2)
    assert part.observables["failed"].tolist() == [0, 0]
    assert langevin.simulate(scene, [3], frozenset({"none"})).tracer is None


@pytest.mark.parametrize(
    "velocities",
    [
        {"standard_deviation": 2.0},
        {"temperature": 1.6},
        {"temperature": 1.6, "zero_momentum": True},
    ],
)
def test_it_begins_with_the_velocity_of_the_exact_engine(velocities):
    scene = scene_of(velocities=velocities)
    for seed in range(5):
        position, velocity = draw_tracer(scene, seed, noise_stream(scene, seed))
        state = draw_state(scene, seed)
        assert velocity.tobytes() == state.velocity[0].tobytes()
        assert np.array_equal(position, state.position[0])
        assert np.array_equal(draw_tracer(scene.replace(equilibrate=1.0), seed, None)[1], velocity)
        one, other = velocity / noise_stream(scene, seed).standard_normal(2)
        assert one != pytest.approx(other)  # other random numbers than those of the noise


@pytest.mark.slow
def test_without_a_place_it_begins_anywhere_it_can_be():
    """Mean and variance of 8,000 uniform coordinates in [-2.7, 2.7]: 0.2 % false alarms."""
    found = langevin.simulate(scene_of(tracer={"position": None}), range(RUNS)).tracer.position[0]
    assert 2.69 < np.abs(found).max() <= 2.7
    square = np.square(found).ravel()
    product = found[:, 0] * found[:, 1]
    for values, expected in ((found.ravel(), 0.0), (square, 2.7**2 / 3), (product, 0.0)):
        mean, error = mean_and_error(values)
        assert abs(mean - expected) < FAR * error


@pytest.mark.slow
@pytest.mark.parametrize(("tracer", "square_speed"), [("free", 1.6), ("pinned", 4.0)])
def test_a_tracer_that_is_free_while_the_scene_equilibrates_cools(tracer, square_speed):
    """<r^2> = <v0^2> t^2 to 1 % in the first 0.001 of a run: 0.1 % false alarms each."""
    equilibration = {"time": 3.0, "tracer": tracer}
    scene = scene_of(equilibrate=equilibration, duration=0.001, sample_interval=0.001)
    runs = langevin.simulate(scene, range(RUNS))
    velocity = unwrapped(scene, runs)[-1] / 0.001
    mean, error = mean_and_error(np.square(velocity).sum(axis=-1))
    tolerance = 0.01 + FAR * error / mean
    assert abs(mean / (2 * square_speed) - 1) < tolerance


def test_a_cold_bath_does_nothing():
    scene = scene_of(velocities={"temperature": 0.0})
    for which in ("enskog", "boltzmann", "measured"):
        assert np.all(langevin.simulate(scene, [0], friction=which).tracer.position == 0.0)


# -- friction --------------------------------------------------------------------------------------


def test_friction_of_the_note():
    """By hand: n = 149/36, sigma = 0.4, mu = 0.4/1.4, kT = 0.4 x 2^2; the tracer covers a part of
    the box, too.
    """
    covered = (149 * 0.1**2 + 0.3**2) * math.pi / 36
    surface = math.pi / 4 * (149 * 0.2 + 0.6) / 36
    per_surface = 9 / 8 * (0.6 * 0.2 / 0.8)
    chi = 1 / (1 - covered) + per_surface * surface / (1 - covered) ** 2
    root = math.sqrt(2 * math.pi * 0.4 / 1.4 * 1.6)
    thin = 2 * 149 / 36 * 0.4 * root
    assert friction.friction_rate(scene_of(), "boltzmann") == pytest.approx(thin, rel=1e-14)
    assert friction.friction_rate(scene_of(), "enskog") == pytest.approx(chi * thin, rel=1e-14)
    thermal = scene_of(velocities={"temperature": 1.6})
    assert friction.friction_rate(thermal, "boltzmann") == pytest.approx(thin)


@pytest.mark.slow
def test_a_bath_without_other_momentum_recoils():
    """With half of the mass in the tracer of a thin gas D is a quarter of kT/(m gamma), as measured
    by exact runs.
    """
    bath = {"name": "bath", "count": 30, "radius": 0.3, "mass": 1.0}
    scene = bp.Scene(
        box={"x": [0, 30], "y": [0, 30], "boundary": "periodic"},
        disks={"tracer": {"radius": 1.0, "mass": 30.0}, "species": [bath]},
        velocities={"temperature": 1.0, "zero_momentum": True},
        equilibrate={"time": 200.0, "tracer": "free"},
        duration=1500.0,
        sample_interval=10.0,
    )
    runs = bp.simulate(
        scene, 100, observables=["square_displacement"], average="origins", quiet=True
    )
    found = bp.analyse(runs, fit_windows=[(300, 700)], quiet=True).squeeze()
    free = 1.0 / (30.0 * friction.friction_rate(scene, "enskog"))
    assert found.enskog_diffusion == pytest.approx(free / 4, rel=1e-12)
    error = found.diffusion_coefficient_standard_error
    assert error < 0.15 * free / 4
    assert abs(found.diffusion_coefficient - free / 4) < 4 * error
    long = scene.replace(duration=1e5, sample_interval=1e4)
    runs = langevin.simulate(long, range(RUNS), {"tracer", "velocity"})
    r2 = np.square(unwrapped(scene, runs)[-1]).sum(axis=-1)
    mean, error = mean_and_error(r2)
    assert abs(mean - free * 1e5) < FAR * error, "the tracer alone: 4 D t"
    square_speed = np.square(runs.tracer.velocity).sum(axis=-1).mean(axis=0)
    mean, error = mean_and_error(square_speed)
    assert abs(mean - 1 / 30) < FAR * error, "half of 2 kT/m"


def test_a_tagged_disk_has_the_friction_of_one_fluid():
    """Equal radii: Luding's contact value at the packing fraction of all disks, whether or not one
    has a name.
    """
    bath = [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 1.0}]
    scene = scene_of(species=bath, tracer={"radius": 0.1, "mass": 4.0}, particles=400)
    chi = theory.contact_value(400 * math.pi * 0.1**2 / 36)
    assert friction.partners_of(scene).contact_value == pytest.approx([chi], rel=1e-14)
    zeta = theory.enskog_friction(399 / 36, 0.2, chi, 0.8, 4.0)
    assert friction.friction_rate(scene, "enskog") == pytest.approx(zeta / 4.0, rel=1e-14)
    often = 1.5 * friction.partners_of(scene).rate.sum()
    measured = friction.friction_rate(scene, "measured", often)
    assert measured == pytest.approx(1.5 * zeta / 4.0, rel=1e-14)


def test_a_bath_of_several_species_has_the_mean_energy_of_its_disks():
    light = {"name": "s100", "count": 100, "radius": 0.05, "mass": 0.2}
    heavy = {"name": "s20", "count": 20, "radius": 0.05, "mass": 0.4}
    hot = friction.bath_of(scene_of(species=[light, heavy], particles=121))
    mean_mass = (100 * 0.2 + 20 * 0.4) / 120
    assert hot.temperature == pytest.approx(4 * mean_mass, rel=1e-14)


@pytest.mark.slow
def test_measured_friction_is_that_of_theory_in_a_thin_bath():
    """4,000 collisions are 1.6 % if they come at random; walls take 0.7 % of the room, chi is
    1.001. 0.1 %.
    """
    scene = scene_of(width=60.0, particles=100)
    measured, expected = (langevin.rate_of(scene, which) for which in ("measured", "enskog"))
    assert measured == langevin.rate_of(scene.replace(duration=5.0), "measured")
    tolerance = 0.007 + FAR / math.sqrt(RATE_COLLISIONS)
    assert abs(measured / expected - 1) < tolerance


@pytest.mark.slow
def test_the_measured_collision_rate_is_the_mean_over_runs_drawn_at_its_temperature(monkeypatch):
    """In a periodic box, where two degrees of freedom are missing: without that 22 % too high."""
    monkeypatch.setattr(langevin, "RATE_RUNS", 400)
    scene = scene_of(
        width=4.0, boundary="periodic", particles=3, velocities={"temperature": 1.0}, duration=100.0
    )
    counts = exact.simulate(scene, range(400), {"none"}).observables["tracer_collisions"]
    mean, error = mean_and_error(counts / scene.duration)
    assert abs(langevin._collision_rate(scene) - mean) < FAR * error < 0.08 * mean


@pytest.mark.slow
def test_the_note_by_langevin_and_by_collisions():
    """With the measured friction the first steps agree, MSD(0.1) to 1 % (9,600 runs each: 0.0496(5)
    and 0.0501(5)).

    Later the bath gives momentum back, which has no place in the Langevin equation: MSD(1) is
    0.917(9) by collisions and 0.816(8) so, 0.848(9) with Enskog's friction. Bounds: these
    differences and 0.1 % false alarms.
    """
    scene = scene_of()
    by_friction = langevin.simulate(scene, range(RUNS), friction="measured")
    by_collisions = exact.simulate(scene, range(2400))
    for k, least, most in ((10, 0.0, 0.02), (100, 0.05, 0.17)):
        squares = np.square(unwrapped(scene, by_friction)[k]).sum(axis=-1)
        approximate, approximate_error = mean_and_error(squares)
        squares = np.square(unwrapped(scene, by_collisions)[k]).sum(axis=-1)
        exactly, exact_error = mean_and_error(squares)
        slack = FAR * math.hypot(approximate_error, exact_error)
        missing = exactly - approximate
        assert least * exactly - slack < missing < most * exactly + slack


# -- units ---


def in_units(length=0, time=0, mass=0, **more):
    """The note's scene in units smaller by these powers of two."""
    tracer = {"position": [0.0, 0.0], "radius": 0.3, "mass": 1.0}
    bath = {"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}
    for species in (tracer, bath):
        species["radius"] = math.ldexp(species["radius"], length)
        species["mass"] = math.ldexp(species["mass"], mass)
    deviation = math.ldexp(2.0, length - time)
    sampling = {
        "duration": math.ldexp(1.0, time),
        "sample_interval": math.ldexp(0.125, time),
    }
    return scene_of(
        width=math.ldexp(6.0, length),
        tracer=tracer,
        species=[bath],
        velocities={"standard_deviation": deviation},
        **sampling,
        **more,
    )


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
@pytest.mark.parametrize("length", [-400, 0, 400])
@pytest.mark.parametrize("time", [-400, 0, 400])
@pytest.mark.parametrize("mass", [-900, 0, 900])
def test_units_are_powers_of_two_or_refused(boundary, length, time, mass):
    """The path to the square root of odd powers, 4 units of round-off; kT and kT/m must be numbers
    with all digits.
    """
    scene = in_units(length, time, mass, boundary=boundary)
    usual = in_units(boundary=boundary)
    if abs(2 * (length - time) + mass) > 1018 or abs(2 * (length - time)) > 1018:
        with pytest.raises(RequestError, match="needs kT and kT/m from"):
            langevin.simulate(scene, [1, 2])
        return
    found = langevin.simulate(scene, [1, 2])
    plain = langevin.simulate(usual, [1, 2])
    moved = np.ldexp(unwrapped(scene, found), -length)
    expected = unwrapped(usual, plain)
    np.testing.assert_allclose(moved, expected, rtol=0, atol=4e-15 * 6)
    assert found.observables["failed"].tolist() == [0, 0]
    gamma = np.ldexp(found.observables["friction_rate"], time)
    np.testing.assert_allclose(gamma, plain.observables["friction_rate"], rtol=4e-16 * 4)


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_a_path_too_long_to_be_known_fails(boundary):
    """Periodic images, or reflections, beyond 2^30: sqrt(2 D t) of duration 1e18 is 5e8 boxes, of
    1e22 it is 5e10.
    """
    for duration, failed in ((1e14, [0, 0]), (1e22, [1, 1])):
        scene = scene_of(boundary=boundary, duration=duration, sample_interval=duration)
        found = langevin.simulate(scene, [1, 2])
        assert found.observables["failed"].tolist() == failed
        assert np.all(np.abs(found.tracer.position) <= 3.0)
    path = np.zeros((2, 2, 2))
    for value in (math.nan, math.inf, -math.inf):
        path[1, 0, 0] = value
        assert not langevin.folded(scene, path)[1]
    path[1, 0, 0] = 5.0
    assert langevin.folded(scene, path)[1]


def test_steps_of_any_length_diffuse():
    """Position adds 2 kT/(m gamma) t, whatever gamma t: to 1e-12, where the start no longer
    counts.
    """
    for x in (1e20, 1e154, 1e160, 1e300):
        middle, loose = step_weights(x, 1.0, 1.0)[2:]
        assert loose / math.sqrt(2 * x) == pytest.approx(1.0, abs=1e-12)
        assert middle == pytest.approx(1.0, abs=1e-12)
    spread = step_weights(1e-200, 1e-100, 1e-250)[1]
    assert spread == pytest.approx(math.sqrt(2) * 1e-275, rel=1e-12)


# -- where it is refused ---------------------------------------------------------------------------


LIGHT = {"tracer": {"mass": 0.7}}
NO_TRACER = {"disks": {"species": [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}]}}
CROWD = {"particles": 900, "width": 6.0, "disks": {
    "tracer": {"radius": 0.3, "mass": 10.0},
    "species": [{"name": "bath", "count": "rest", "radius": 0.1, "mass": 0.4}],
    "placement": "lattice",
}}  # fmt: skip


DISK = {"position": [0.0, 0.0], "velocity": [0.0, 0.0], "radius": 0.1, "mass": 1.0}
LISTED = {"particles": 1, "disks": [DISK], "velocities": None}


@pytest.mark.parametrize(
    ("changes", "record", "message"),
    [
        (
            LIGHT,
            "tracer",
            "some, N = 150: --engine langevin is for a heavy tracer: the disk that is followed "
            "has 1.75",
        ),
        (
            NO_TRACER,
            "tracer",
            "followed has 1 times the mass of the heaviest of the others; must be at least 2",
        ),
        (
            CROWD,
            "tracer",
            "has no contact value for --friction enskog: the packing fraction is 0.79",
        ),
        (LISTED, "tracer", "some, N = 1: --engine langevin needs disks whose velocities are drawn"),
        ({"particles": 1}, "tracer", "needs a bath, and there is a single disk"),
        (
            {"velocities": {"standard_deviation": 1e300}},
            "tracer",
            "needs kT and kT/m from 2.23e-308 to 1.8e308",
        ),
        ({}, "all", "the langevin engine has no bath; must be tracer or none"),
        ({}, "events", "the langevin engine has no bath; must be tracer or none"),
    ],
)
def test_where_friction_and_noise_are_no_bath(changes, record, message):
    with pytest.raises(RequestError) as refusal:
        langevin.simulate(scene_of(**changes), [0], frozenset({record}))
    assert message in str(refusal.value)
    if changes is CROWD:  # a dense bath is measured or nothing
        refuse_unfit(scene_of(**CROWD), Settings("measured"), frozenset())


@pytest.mark.parametrize(("mass", "said"), [(1.0, True), (3.9, True), (4.0, False)])
def test_a_tracer_that_is_not_very_heavy(mass, said):
    light = {"name": "light", "count": 9, "radius": 0.1, "mass": 0.1}
    heavy = {"name": "heavy", "count": 9, "radius": 0.1, "mass": 0.4}
    scene = scene_of(tracer={"mass": mass}, species=[light, heavy], particles=19)
    assert (caution(scene) is not None) == said
