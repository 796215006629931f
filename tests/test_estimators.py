"""Estimators of velocities, pairs, thermodynamics and the control variate: from arrays measured in
runs to results.
"""

import numpy as np
import pytest

from brownpipe import analysis, observables, theory
from brownpipe.analysis import (
    components,
    displacement,
    distribution,
    estimator,
    pairs,
    thermodynamics,
    velocity,
)
from brownpipe.analysis.resampling import Estimate
from brownpipe.engines import Engine
from brownpipe.engines.ensemble import Ensemble
from brownpipe.engines.exact import simulation as exact
from brownpipe.engines.langevin import simulation as langevin
from brownpipe.observables.trajectory import Track
from brownpipe.scene import parse_scene
from brownpipe.storage.trajectories import write_trajectories
from ensembles import make_scene
from scenes import CHANNEL_X, CHANNEL_Y
from validation.transport import fluid

SIGMAS = 4.5
EVERYTHING = tuple(observables.OBSERVABLES)
CHANNELS = [pytest.param(CHANNEL_X, id="channel-x"), pytest.param(CHANNEL_Y, id="channel-y")]


def gas(boundary="periodic", number=16, side=8.0, tracer=None, **more):
    """Equal disks of radius 0.5 and mass 1 in equilibrium at kT = 1."""
    gas_species = {"name": "gas", "count": number, "radius": 0.5, "mass": 1.0}
    disks = {"species": [gas_species]}
    if tracer:
        disks["tracer"] = tracer
    mapping = {
        "box": {"x": [0.0, side], "y": [0.0, side], "boundary": boundary},
        "disks": disks,
        "velocities": {"temperature": 1.0, "zero_momentum": boundary != "reflecting"},
        "duration": 2.0,
        "sample_interval": 0.1,
        "equilibrate": {"time": 1.0, "tracer": "free"},
    }
    name = boundary if isinstance(boundary, str) else "channel"
    return parse_scene(mapping | more, f"{name}.yaml")


def case_of(scene):
    windows = ((0.0, 1.0),)
    edges = np.arange(4.0)
    return estimator.Case(scene, Engine("exact"), scene.times, windows=windows, edges=edges)


def block(seeds, tracer, seen):
    """Runs with the arrays `seen`."""
    return Ensemble(seeds, np.zeros(0), tracer, seen, {}, {}, {}, {})


def averages_of(case, seen, *estimators):
    """What the arrays `seen`, (n, ...) each, add up to."""
    runs = len(next(iter(seen.values())))
    averages = estimator.Averages()
    for seeds in np.split(np.arange(runs), range(1024, runs, 1024)):
        batch = block(seeds, None, {name: array[seeds] for name, array in seen.items()})
        averages.add(seeds, estimator.collect_columns(estimators, case, batch))
    return averages


def values_of(case, seen, *estimators):
    """The variables that estimators make of the arrays `seen`."""
    return estimator.collect_results(estimators, case, averages_of(case, seen, *estimators))


# --- real runs


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Equal disks in a periodic box, and a heavy one among them between walls: 30 runs each."""
    folder = tmp_path_factory.mktemp("gas")
    for scene in (gas(), gas("reflecting", tracer={"radius": 1.0, "mass": 3.0})):
        names = [
            name for name in EVERYTHING if observables.OBSERVABLES[name].why_unfit(scene) is None
        ]
        ensemble = exact.simulate(scene, np.arange(30), frozenset({"tracer"}), observables=names)
        write_trajectories(folder / f"{scene.name}.h5", scene, Engine("exact"), ensemble)
    return analysis.aggregate(sorted(folder.iterdir()), windows=((0.5, 2.0),))


@pytest.mark.slow
def test_every_variable_is_there(dataset):
    """And says its unit. A run that could not go on, a drift, 200 runs, channels and large fluids
    have variables of their own.
    """
    others = ("stopped", "drift_diffusion", "non_gaussian_parameter_controlled", "vacf_tail")
    others += (*(components.VARIABLES.keys() - {"component_msd"}),)
    expected = {name for name in analysis.dataset.ALL_VARIABLES if not name.startswith(others)}
    assert {*dataset.data_vars} == expected
    for variable in dataset.data_vars.values():
        assert {"units", "long_name"} <= set(variable.attrs)
    assert all("long_name" in dataset[name].attrs for name in dataset.coords)
    assert dataset.species.values.tolist() == ["gas", "tracer"]
    for name in (
        "bath_velocity_autocorrelation",
        "wall_pressure",
        "wall_compressibility",
        "contact_density",
    ):
        assert np.isnan(dataset[name].sel(scene="periodic")).all()
        assert np.isfinite(dataset[name].sel(scene="reflecting", particles=17)).any()


def test_gas_is_as_theory_has_it(dataset):
    """Virial, rate and contact values are views of one number, which Luding's form has within 1 %
    for 16 disks.
    """
    periodic = dataset.sel(scene="periodic", particles=16).squeeze()
    chi = (periodic.enskog_compressibility - 1) / (2 * periodic.packing_fraction)
    expectations = {
        "compressibility": periodic.enskog_compressibility,
        "compressibility_rate": periodic.enskog_compressibility,
        "kinetic_temperature": 1.0,
    }
    for name, expected in expectations.items():
        standard_error = periodic[f"{name}_standard_error"]
        assert abs(periodic[name] - expected) < SIGMAS * standard_error + 0.02
    by_rate = periodic.contact_value_rate.sel(species_pair="gas:gas")
    by_pairs = periodic.contact_value.sel(species_pair="gas:gas")
    assert abs(by_rate - chi) < 0.1
    assert float(by_pairs - by_rate) == pytest.approx(0, abs=0.15)


def test_densities_and_energies(dataset):
    for name, along, width in (
        ("velocity_density", "velocity_bin", 0.1),
        ("speed_density", "speed_bin", 0.1),
    ):
        sums = (dataset[name].sum(along, min_count=1) * width).values
        assert sums[np.isfinite(sums)] == pytest.approx(np.ones(3))
    periodic = dataset.sel(scene="periodic", particles=16).squeeze()
    energy = periodic.species_energy.sel(species="gas")
    assert np.ptp(energy.values) < 1e-12  # conserved: one species has it all
    at_start = periodic.velocity_autocorrelation[0]
    assert abs(at_start - 2 * 15 / 16) < SIGMAS * 2 / np.sqrt(30)


# --- velocities


def langevin_runs(times, gamma, start, runs, seed):
    """Position and velocity (T, n, 2) of free Langevin particles with kT/m = 1; `start` is the
    variance of v(0).
    """
    rng = np.random.default_rng(seed)
    position, velocity = np.zeros((2, len(times), runs, 2))
    velocity[0] = np.sqrt(start) * rng.standard_normal((runs, 2))
    weights = langevin.step_weights(np.diff(times), gamma, 1.0)
    for k, (decay, spread, middle, loose) in enumerate(weights):
        kick, jitter = rng.standard_normal((2, runs, 2))
        velocity[k + 1] = decay * velocity[k] + spread * kick
        drift = middle * (velocity[k] + velocity[k + 1])
        position[k + 1] = position[k] + drift + loose * jitter
    return position, velocity


def observed(position, velocity):
    """The arrays that runs with these tracks yield."""

    def over_components(products):
        return products.sum(axis=-1).T

    return {
        "square_displacement": over_components(position**2),
        "displacement_velocity": over_components(position * velocity),
        "velocity_autocorrelation": over_components(velocity * velocity[0]),
        "velocity_displacement": over_components(position * velocity[0]),
    }


@pytest.mark.parametrize("start", [1.0, 4.0])
def test_routes_to_d_have_no_error_of_the_sample_interval(start):
    """10,240 Ornstein-Uhlenbeck velocities sampled once a relaxation time: D(t) is exact, by both
    routes.

    They agree in equilibrium (start = 1), by time reversal, and differ where the runs begin hot.
    With such samples the trapezoid is off by (h/2) coth(h/2) = 8 %, and the central difference by
    more.
    """
    scene = gas(duration=4.0, sample_interval=1.0)
    t = scene.times
    seen = observed(*langevin_runs(t, 1.0, start, 10_240, 11))
    found = values_of(case_of(scene), seen, displacement.ESTIMATOR, velocity.ESTIMATOR)
    growing = (start - 1) * np.exp(-t) * (1 - np.exp(-t)) + 1 - np.exp(-t)  # d<r^2>/dt / 4
    integral = start * (1 - np.exp(-t))
    running, running_error = found["diffusion_running"], found["diffusion_running_standard_error"]
    green_kubo, green_kubo_error = found["green_kubo"], found["green_kubo_standard_error"]
    later = slice(1, None)  # at t = 0 all runs have 0
    assert (np.abs(running - growing) <= SIGMAS * running_error)[later].all()
    assert (np.abs(green_kubo - integral) <= SIGMAS * green_kubo_error)[later].all()
    differ = np.abs(running - green_kubo) > SIGMAS * np.hypot(running_error, green_kubo_error)
    assert differ[later].all() if start > 1 else not differ[later].any()
    c = seen["velocity_autocorrelation"].mean(axis=0)
    trapezoid = (c[0] + c[1]) / 4
    assert trapezoid - integral[1] > SIGMAS * green_kubo_error[1]
    r2 = seen["square_displacement"].mean(axis=0)
    quotient = (r2[2] - r2[0]) / 8
    assert abs(quotient - growing[1]) > SIGMAS * running_error[1]


def test_non_gaussian_parameter_and_its_control_variate():
    """Exponential r^2, as of normal displacements: jackknife error; in free flight the control
    variate takes it all.
    """
    scene = gas()
    n = 400
    case = case_of(scene)._replace(rings=(np.arange(4.0),))
    late = scene.times > 1.0
    v2, r2 = np.random.default_rng(4).exponential(2.0, (2, n, 1))
    squared = np.where(late, r2, v2 * scene.times**2)
    seen = {"square_displacement": squared, "quartic_displacement": squared**2}
    values = values_of(case, seen, displacement.ESTIMATOR, distribution.ESTIMATOR)
    alpha = values["non_gaussian_parameter"]
    alpha_error = values["non_gaussian_parameter_standard_error"]
    controlled = values["non_gaussian_parameter_controlled"]
    controlled_error = values["non_gaussian_parameter_controlled_standard_error"]
    replicates = np.zeros((n, 2))
    for k in range(n):
        others = np.delete(squared, k, axis=0)[:, [5, -1]]
        replicates[k] = (others**2).mean(axis=0) / (2 * others.mean(axis=0) ** 2) - 1
    # the bias is of order 1/n
    assert alpha[[5, -1]] == pytest.approx(replicates.mean(axis=0), abs=1e-3)
    # some 1/sqrt(n) = 0.05; delta method and jackknife differ by 3 % with r^4 as skewed as it is
    error = np.sqrt((n - 1) * replicates.var(axis=0))
    assert alpha_error[[5, -1]] == pytest.approx(error, rel=0.06)
    assert np.isnan(alpha[0])
    assert np.isnan(controlled[0])
    early = ~late & (scene.times > 0)
    # the replicates are rounded to 2e-4 standard deviations of a run
    assert controlled[early] == pytest.approx(0.0, abs=1e-4)
    assert controlled_error[early] == pytest.approx(0.0, abs=1e-4)
    assert controlled_error[-1] == pytest.approx(error[1], rel=0.1)
    first_199 = {name: array[:199] for name, array in seen.items()}
    few = values_of(case, first_199, displacement.ESTIMATOR, distribution.ESTIMATOR)
    assert not any("controlled" in name for name in few)


def decaying(scene, rate, runs=12):
    """Runs without any scatter whose autocorrelation decays at `rate`."""
    correlation = 2 * np.exp(-rate * scene.times)
    return {"velocity_autocorrelation": np.tile(correlation, (runs, 1))}


def slope_of(scene, seen):
    """The slope at 0, its stated error, and the ends of its interval."""
    values = values_of(case_of(scene), seen, velocity.ESTIMATOR)
    return [
        float(values[f"vacf_initial_slope{part}"])
        for part in ("", "_standard_error", "_low", "_high")
    ]


@pytest.mark.parametrize("misjudged", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("spacing", [0.02, 0.1, 0.2])
def test_the_error_of_the_initial_slope_covers_that_of_the_samples(spacing, misjudged):
    """Without scatter no other error is left; the decay is at Enskog's rate, or that is 30 % off.

    The parabola alone would be off by (gamma h)^2/3, 1.3 % at gamma h = 0.2; here by the cube of
    0.3 of that.
    """
    rate = velocity.enskog_rate(gas()) / misjudged
    scene = gas(duration=40 * spacing / rate, sample_interval=spacing / rate)
    slope, error, low, high = slope_of(scene, decaying(scene, rate))
    round_off = 1e-13 * rate / spacing
    assert abs(slope + 2 * rate) <= error + round_off
    assert low - round_off <= -2 * rate <= high + round_off
    assert abs(slope / (2 * rate) + 1) < 2e-3
    assert error < 0.01 * 2 * rate


def test_initial_slope_of_a_heavy_tracer_is_taken_before_the_bath_has_collisions():
    """A friction that falls by half within a mean free time of the bath, when next to nothing of
    the velocity is lost.

    The error covers that of the samples; from a quarter of the relaxation time the slope would be
    40 % off.
    """
    scene = gas(number=256, side=40.0, tracer={"radius": 2.0, "mass": 1000.0}, duration=20.0)
    rate = velocity.enskog_rate(scene)
    pace = velocity.fastest_rate(scene)
    assert pace == thermodynamics.enskog(scene)["enskog_collision_rate"] > 10 * rate
    # the integral of a friction that falls from rate to rate/2 at the pace of the bath
    lost = rate / 2 * (scene.times + (1 - np.exp(-pace * scene.times)) / pace)
    correlation = np.tile(2 * np.exp(-lost), (12, 1))
    slope, error, _, _ = slope_of(scene, {"velocity_autocorrelation": correlation})
    assert abs(slope + 2 * rate) <= error < 0.1 * rate
    coarse = scene.replace(sample_interval=0.6 / pace)  # later than collisions of the bath
    assert np.isnan(slope_of(coarse, decaying(coarse, rate))).all()


@pytest.mark.parametrize(
    ("lost", "stated"), [(0.19, True), (0.21, False), (0.9, False), (1 - 1e-9, False)]
)
def test_no_initial_slope_where_samples_are_far_apart(lost, stated):
    rate = velocity.enskog_rate(gas())
    interval = -np.log(1 - lost) / rate
    scene = gas(duration=8 * interval, sample_interval=interval)
    assert np.isfinite(slope_of(scene, decaying(scene, rate))).all() == stated


def test_expected_slope_is_enskogs_friction():
    """-(2 mu/m) rate <v^2> with Enskog's rate is -(friction/m) <v^2>."""
    n = 0.25
    case = case_of(gas(tracer={"radius": 1.0, "mass": 3.0}))
    rate = theory.collision_rate(n, 1.5, 1.3, 0.75, 1.0)
    correlation = np.full((12, len(case.times)), 2 / 3)
    found = averages_of(case, {"velocity_autocorrelation": correlation}, velocity.ESTIMATOR)
    assert np.isnan(velocity.expected_slope(case, found))
    both = {
        "tracer_collisions": np.full(12, rate * case.times[-1]),
        "velocity_autocorrelation": correlation,
    }
    found = estimator.Averages().add(np.arange(12), estimator.Columns(both))
    expected = -theory.enskog_friction(n, 1.5, 1.3, 0.75, 1.0) / 3.0 * 2 / 3  # with <v^2> = 2 kT/m
    share = 3 / 19  # of the tracer in the mass of all disks
    at_rest = expected / (1 - share)  # without total momentum
    assert velocity.expected_slope(case, found) == pytest.approx(at_rest)
    by_origins = case._replace(average="origins")
    assert velocity.expected_slope(by_origins, found) == pytest.approx(at_rest)
    pinned = case.scene.replace(equilibrate={"time": 1.0, "tracer": "pinned"})
    assert velocity.expected_slope(case_of(pinned), found) == pytest.approx(at_rest)


NOT_SETTLED = {
    "hot": {"velocities": {"standard_deviation": 1.0}},
    "uniform": {"velocities": {"standard_deviation": 1.0, "distribution": "uniform"}},
    "inserted": {"equilibrate": 0.0},
    "own velocity": {"disks.tracer.velocity": [1.0, 0.0]},
}


@pytest.mark.parametrize("changes", NOT_SETTLED.values(), ids=NOT_SETTLED)
def test_no_expected_slope_where_the_collision_rate_changes_within_the_runs(changes):
    """The mean rate of the runs is not that at t = 0: it is 17(1) % smaller for a tracer of 20
    times the mass and kT of its bath that cools within the runs.
    """
    tracer = {"radius": 1.0, "mass": 3.0, "position": [4.0, 4.0]}
    pinned = {"time": 1.0, "tracer": "pinned"}
    settled = gas(tracer=tracer, equilibrate=pinned)
    assert np.isfinite(velocity.expected_slope(case_of(settled), collided(settled)))
    scene = settled.replace(**changes)
    assert np.isnan(velocity.expected_slope(case_of(scene), collided(scene)))


@pytest.mark.parametrize("boundary", ["reflecting", *CHANNELS])
@pytest.mark.parametrize("tracer", ["pinned", "free"])
def test_no_expected_slope_between_walls(boundary, tracer):
    """They turn the velocity, too, and near them the rate is not that of a start apart from them:
    for a disk of radius 0.3 that begins in the middle of a square of side 3 the mean rate of long
    runs is 9(1) % smaller than that at t = 0.
    """
    disk = {"radius": 1.0, "mass": 3.0, "position": [4.0, 4.0]}
    scene = gas(boundary, tracer=disk, equilibrate={"time": 1.0, "tracer": tracer})
    case = case_of(scene)
    assert np.isnan(velocity.expected_slope(case, collided(scene)))
    by_origins = case._replace(average="origins")
    assert np.isnan(velocity.expected_slope(by_origins, collided(scene)))


def collided(scene):
    """Averages over runs of a scene whose tracer collides 2.5 times in a unit of time."""
    means = {
        "tracer_collisions": np.full(12, 2.5 * scene.duration),
        "velocity_autocorrelation": np.full((12, len(scene.times)), 0.6),
    }
    return estimator.Averages().add(np.arange(12), estimator.Columns(means))


@pytest.mark.slow
@pytest.mark.parametrize("still", [True, False])
def test_expected_slope_is_that_of_the_collisions(still):
    """Four disks: <v.dv> per time, which is -<|dv|^2> per time / 2 where <v^2> does not change.

    The impulses of all collisions have it. Without total momentum <v^2> is 3/4 of 2 kT/m, the slope
    remains.
    """
    velocities = {"temperature": 1.0, "zero_momentum": still}
    n = 1000
    scene = gas(number=4, side=4.0, duration=4.0, sample_interval=2.0, velocities=velocities)
    request = {"observables": ("velocity_autocorrelation",), "average": "disks"}
    ensemble = exact.simulate(scene, range(n), {"events"}, **request)
    squares = np.array([np.sum(ensemble.events[seed].impulse ** 2) for seed in range(n)])
    slope = -squares / (4 * 4.0)
    collisions = ensemble.observables["pair_collisions"] / 2
    correlation = ensemble.observables["velocity_autocorrelation"]
    means = {"tracer_collisions": collisions, "velocity_autocorrelation": correlation}
    found = estimator.Averages().add(np.arange(n), estimator.Columns(means))
    expected = velocity.expected_slope(case_of(scene)._replace(average="disks"), found)
    start = correlation[:, 0]
    # the ratio of slope and expectation, of each run, to first order
    relative = slope / slope.mean() - collisions / collisions.mean() - start / start.mean()
    standard_error = relative.std() / np.sqrt(n)
    assert abs(slope.mean() / expected - 1) < SIGMAS * standard_error < 0.1


def test_initial_slope_of_a_real_gas():
    """256 disks at a packing fraction of 0.14, sampled every 0.1 to 1.25 times: within the errors,
    or not stated.

    The rate of all disks' collisions is known within 0.5 %, a tenth of the error of the slope.
    """
    side = np.sqrt(64 * np.pi / 0.14)
    scene = gas(number=256, side=side, duration=2.5, sample_interval=0.05)
    request = {"observables": ("velocity_autocorrelation",), "average": "disks"}
    seen = exact.simulate(scene, range(120), {"none"}, **request).observables
    correlation = seen["velocity_autocorrelation"]
    share = 255 / 256  # of 2 kT/m in <v^2> without total momentum
    rate = seen["pair_collisions"].mean() / (256 * 2.5)
    exact_slope = -2 * rate * correlation[:, 0].mean() / share
    stated = []
    for each in (2, 5, 10, 25):
        case = case_of(scene)._replace(times=scene.times[::each], average="disks")
        sampled = {"velocity_autocorrelation": correlation[:, ::each]}
        found = averages_of(case, sampled, velocity.ESTIMATOR)
        slope = velocity.initial_slope(case, found)
        stated.append(bool(np.isfinite(slope.mean)))
        if stated[-1]:
            tolerance = SIGMAS * slope.standard_error
            assert abs(slope.mean - exact_slope) < tolerance < 0.9 * abs(exact_slope)
    assert stated == [True, True, False, False]


# --- pairs


def snapshots(scene, held=None, runs=300):
    """Arrays of runs of one sample: every disk a point in its room, the tracer perhaps held at one
    place.
    """
    rng = np.random.default_rng(1)
    counter = observables.OBSERVABLES["pair_distribution"]
    room = np.array([scene.box.accessible(radius)[1] for radius in scene.radius])
    middle = scene.box.origin + scene.box.size / 2
    counted = []
    for _ in range(runs):
        position = middle + (rng.random((scene.particles, 2)) - 0.5) * room
        if held is not None:
            position[0] = held
        counted.append(counter.measure(scene, Track(position[None]), "runs"))
    arrays = {}
    for name in counted[0]:
        arrays[name] = np.array([run[name] for run in counted])
    return arrays


def g_of(scene, seen):
    """g(r) and its standard error (P, R)."""
    values = values_of(case_of(scene), seen, pairs.ESTIMATOR)
    return values["pair_distribution"], values["pair_distribution_standard_error"]


NARROW = {"x": [0.0, 20.0], "y": [0.0, 3.4], "boundary": CHANNEL_X}
HIGH = {"x": [0.0, 3.4], "y": [0.0, 20.0], "boundary": CHANNEL_Y}


@pytest.mark.parametrize("boundary", ["periodic", "reflecting", *CHANNELS, NARROW, HIGH])
def test_points_have_no_structure(boundary):
    """g(r) = 1 in all bins for 300 snapshots of an ideal gas; between walls two sizes have two
    rooms. In a narrow channel the bins go on to 10, three times its height.

    Also relative to two uniform points, since the tracer has spread over its room.
    """
    box = {"box": boundary} if "boundary" in boundary else {}
    scene = gas(boundary, tracer={"radius": 1.5, "mass": 1.0}, **box)
    seen = snapshots(scene)
    end = 5.0 if boundary == "reflecting" else 4.0  # the height less the tracer; half the length
    if box:
        end = 10.0
    assert pairs.bin_edges(scene)[-1] == pytest.approx(end, rel=1e-12)
    assert ("pair_expected" in seen) == (boundary != "periodic")
    expected = 300 * pairs.ideal(scene, pairs.bin_edges(scene))
    for names in (seen, ("pair_counts", "pair_snapshots")):
        g, _ = g_of(scene, {name: seen[name] for name in names})
        off = (g - 1)[1:]
        standard_error = 1.3 / np.sqrt(expected[1:])  # 1.3: pairs share disks
        assert (np.abs(off) < SIGMAS * standard_error + 4 / expected[1:]).all()
        assert np.isnan(g[0]).all()  # one tracer makes no pair


@pytest.fixture(scope="module", params=["reflecting", *CHANNELS])
def off_centre(request):
    """A gas of points around a tracer near a corner, in a channel near a wall: the scene, the place
    of the tracer and the arrays of 1,000 snapshots.
    """
    scene = gas(request.param, number=40, tracer={"radius": 1.5, "mass": 3.0})
    place = (1.6, 1.6) if scene.box.has_images else (1.6, 2.2)
    return scene, place, snapshots(scene, held=place, runs=1000)


@pytest.mark.slow
def test_points_around_a_tracer_off_centre_have_no_structure(off_centre):
    """Relative to a gas around where the tracer is, whose errors say how far from 1; not to two
    uniform points.

    4 standard errors in some 185 bins, in channels 142: 1 % of all seeds would fail. Those with
    next to no pair are left out.
    """
    scene, _, seen = off_centre
    expected = seen["pair_expected"].sum(axis=0)
    enough = expected[1] > 50
    assert enough.sum() > 140
    g, error = g_of(scene, seen)
    around, around_error = g[1, enough], error[1, enough]
    assert (np.abs(around - 1) < 4 * around_error).all()
    poisson = 1 / np.sqrt(expected[1, enough])
    np.testing.assert_allclose(around_error, poisson, rtol=0.2)
    uniform, _ = g_of(scene, {name: seen[name] for name in ("pair_counts", "pair_snapshots")})
    off = (uniform[1, enough] - 1) / around_error
    assert np.sqrt((off**2).mean()) > 1.5  # 1.00(6) for no structure
    assert np.array_equal(uniform[2], g[2])  # the gas among itself


@pytest.mark.slow
def test_contact_value_around_a_tracer_off_centre(off_centre):
    """By either route a gas of points has 1 at contact, too, though walls cut the ring of contact
    around the tracer; in a channel those of one axis.
    """
    scene, place, seen = off_centre
    periodic_x, periodic_y = scene.box.periodic_axes
    channel = periodic_x or periodic_y
    angle = np.linspace(0, 2 * np.pi, 10_001)[1:]
    x, y = place[0] + 2 * np.cos(angle), place[1] + 2 * np.sin(angle)
    inside = np.mean(((x > 0.5) | periodic_x) & ((y > 0.5) | periodic_y))
    room = 7 * 8 if channel else 7 * 7
    density = 2 * np.pi * 2 / room * inside  # of a point's distance, at contact
    flux = 40 * density * np.sqrt(0.8 / (2 * np.pi * 0.75))
    degrees = 81 if channel else 82
    number = flux * scene.times[-1] / theory.mean_root_chi_square(degrees)
    energy = 0.8 * degrees / 2
    counts = {"pair_collisions": number, "tracer_collisions": number, "kinetic_energy": energy}
    seen = seen | {name: np.full(1000, value) for name, value in counts.items()}
    case = case_of(scene)
    found = averages_of(case, seen, pairs.ESTIMATOR)
    values = estimator.collect_results([pairs.ESTIMATOR], case, found)
    error = values["contact_value_standard_error"][1]
    assert error < 0.1
    assert values["contact_value"][1] == pytest.approx(1, abs=4 * error)
    # the ideal gas at contact, from bins: 0.2 % in the corner, 0.75 % in front of one wall
    assert values["contact_value_rate"][1] == pytest.approx(1, abs=0.01 if channel else 0.005)
    around = found.totals["around_lone"] / found.runs
    assert (around * pairs.weights_of(scene)[0])[1].sum() < (0.95 if channel else 0.8)


def bin_averages(g, edges, flat=False):
    """Averages of g(r) over the areas of the rings (strips) between `edges`, by 20 points of
    Gauss-Legendre each.
    """
    node, weight = np.polynomial.legendre.leggauss(20)
    low, high = edges[:-1, None], edges[1:, None]
    r = (low * (1 - node) + high * (1 + node)) / 2
    area = weight * (np.ones_like(r) if flat else r)
    return (area * g(r)).sum(axis=1) / area.sum(axis=1)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("decay", [0.0, 1.0, 6.0])
def test_contact_value_of_the_form_that_is_fitted(decay, flat):
    """A parabola times the decay is recovered to round-off (quadrature: 1e-10), a cubic by the next
    order.
    """
    edges = np.arange(60) * 0.025
    fitted, following = pairs.contact_weights(edges, 1.0, decay, flat)
    assert np.isnan(pairs.contact_weights(edges, 1.49, decay)).all()
    for cubic in (0.0, 7.0):

        def g(r, x=cubic):
            z = r - 1
            parabola = 1.7 - 2 * z + 3 * z**2
            return (parabola + x * z**3) / (1 + decay * z / 16) ** 16

        averages = bin_averages(g, edges, flat)
        to_next_order = (averages * (fitted + following)).sum()
        assert to_next_order == pytest.approx(1.7, rel=1e-9)
        contact = (averages * fitted).sum()
        assert (contact == pytest.approx(1.7, rel=1e-9)) == (cubic == 0)


def test_truncation_widens_error_and_interval():
    """What the next order exceeds its own noise by is added in quadrature."""
    two, error, low, high = (np.full(3, value) for value in (2.0, 0.3, 1.5, 2.6))
    narrow = Estimate(two, error, low, high)
    following = Estimate(np.array([-0.5, 0.2, np.nan]), np.full(3, 0.3), None, None)
    wide = pairs.widened(narrow, following)
    assert wide.mean.tolist() == [2.0, 2.0, 2.0]
    assert wide.standard_error[:2] == pytest.approx([0.5, 0.3])
    truncation = 1.96 * 0.4  # 0.5^2 = 0.3^2 + 0.4^2
    assert wide.low[:2] == pytest.approx([2 - np.hypot(0.5, truncation), 1.5], rel=1e-4)
    assert wide.high[:2] == pytest.approx([2 + np.hypot(0.6, truncation), 2.6], rel=1e-4)
    assert np.isnan(wide.standard_error[2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("phi", "time", "samples"), [(0.14, 100.0, 250), (0.5, 40.0, 125), (0.65, 50.0, 60)]
)
def test_contact_value_of_the_fluid_is_that_of_its_collisions(phi, time, samples):
    """256 disks, 16 runs: within 3 of the stated errors of the exact value, whose own are smaller.

    For each packing fraction a false alarm in 200 (Student's t). Counting pairs takes longer than
    the runs do; the denser the fluid, the slower it changes: twice as many samples there have the
    same errors.
    """
    side = float(np.sqrt(256 * np.pi / 4 / phi))
    equilibrate = {"time": 20.0, "tracer": "free"}
    sampling = {"duration": time, "sample_interval": time / samples}
    scene = gas(number=256, side=side, equilibrate=equilibrate, **sampling)
    scene = scene.replace(**{"disks.placement": "lattice"})
    ensemble = exact.simulate(
        scene, np.arange(16), frozenset({"none"}), observables=("pair_distribution",)
    )
    values = values_of(case_of(scene), ensemble.observables, pairs.ESTIMATOR)
    by_pairs, by_rate = values["contact_value"], values["contact_value_rate"]
    error = np.hypot(
        values["contact_value_standard_error"], values["contact_value_rate_standard_error"]
    )
    assert np.abs(by_pairs - by_rate) < 3 * error
    assert error < 0.02 * by_rate  # of 16 runs it is 0.3 to 1.4 %


def test_contact_values_from_rates_are_enskogs():
    """Of the tracer with the gas, and of the gas among itself, to which all other collisions
    belong.
    """
    scene = gas(tracer={"radius": 1.0, "mass": 3.0})
    of_tracer = theory.collision_rate(16 / 64, 1.5, 1.3, 0.75, 0.8)
    of_gas = 16 / 2 * theory.collision_rate(15 / 64, 1.0, 1.2, 0.5, 0.8)
    time = scene.times[-1] / theory.mean_root_chi_square(32)
    counts = {
        "tracer_collisions": of_tracer * time,
        "pair_collisions": (of_tracer + of_gas) * time,
        "kinetic_energy": 0.8 * 16,
    }
    seen = {name: np.full(12, value) for name, value in counts.items()}
    values = values_of(case_of(scene), seen, pairs.ESTIMATOR)
    assert values["contact_value_rate"][1:] == pytest.approx([1.3, 1.2])


def test_few_pairs_have_an_interval_of_poissons():
    """Beyond contact, the 41st bin, and no shorter one by the bootstrap: 0 pairs are less than 3.84
    (Wilson, 95 %).
    """
    scene = gas()
    counts = np.zeros((12, 1, 160))
    counts[:2, 0, 50] = 1
    seen = {"pair_counts": counts, "pair_snapshots": np.ones(12)}
    values = values_of(case_of(scene), seen, pairs.ESTIMATOR)
    expected = 12 * pairs.ideal(scene, pairs.bin_edges(scene))[0]
    low = values["pair_distribution_low"][0] * expected
    high = values["pair_distribution_high"][0] * expected
    assert high[[40, 159]] == pytest.approx([3.8415] * 2, rel=1e-4)
    assert not high[:40].any()
    reach = 1.95996 * np.sqrt(2 + 1.95996**2 / 4)
    assert low[50] < 2.001 + 1.9207 - reach
    assert high[50] > 1.999 + 1.9207 + reach


# --- thermodynamics


def test_pair_virial_and_wall_pressure_differ_by_the_room_of_the_centres():
    """Z = Z_wall (1 - R/w - R/h), here 7/8; of each run but for the change of sum m r.v, whose mean
    is 0.

    Within 4 standard errors of the mean difference of 60 runs: 1 false alarm in 5,000 (Student's
    t).
    """
    scene = gas("reflecting", number=24, duration=40.0)
    seen = exact.simulate(scene, np.arange(60), frozenset({"none"})).observables
    runs = block(np.arange(60), None, seen)
    means = thermodynamics.thermodynamic_columns(case_of(scene), runs).means
    virial = means["compressibility"]
    difference = virial - 7 / 8 * means["wall_compressibility"]
    error = difference.std(ddof=1) / np.sqrt(60)
    assert abs(difference.mean()) < 4 * error < 0.008 * virial.mean()
    wide = case_of(scene.replace(box={"x": [0, 16], "y": [0, 8]}))
    means = thermodynamics.thermodynamic_columns(wide, runs).means
    pressure = means["wall_pressure"]
    assert pressure == pytest.approx(seen["wall_impulse"] / (2 * (16 + 8) * 40))
    compressibility = pressure * 16 * 8 / seen["kinetic_energy"]
    assert means["wall_compressibility"] == pytest.approx(compressibility)


@pytest.mark.parametrize("boundary", CHANNELS)
def test_virial_across_a_channel_and_wall_pressure_differ_by_the_room_of_the_centres(boundary):
    """Z_y = Z_wall (1 - 2R/h), here 7/8, with the virial of impulses across the channel; Z is the
    mean of that and the one along it, which is larger: by 0.08, 16 standard errors of these runs.

    Within 4 standard errors of the mean difference of 60 runs: 1 false alarm in 5,000 (Student's
    t).
    """
    scene = gas(boundary, number=24, duration=40.0)
    across = 1 if boundary == CHANNEL_X else 0
    ensemble = exact.simulate(scene, np.arange(60), frozenset({"events"}))
    seen = ensemble.observables
    means = thermodynamics.thermodynamic_columns(
        case_of(scene), block(np.arange(60), None, seen)
    ).means
    kt = seen["kinetic_energy"] / (24 - 1 / 2)
    assert means["kinetic_temperature"] == pytest.approx(kt)
    assert means["wall_pressure"] == pytest.approx(seen["wall_impulse"] / (2 * 8 * 40))
    virial = np.zeros((60, 2))
    for seed, events in ensemble.events.items():
        impulse = events.impulse[events.b >= 0]
        size = np.hypot(*impulse.T)[:, None]
        virial[seed] = (impulse**2 / size).sum(axis=0)  # contact distance 1
    z = 1 + virial / (24 * kt * 40)[:, None]
    assert means["compressibility"] == pytest.approx(z.mean(axis=1), rel=1e-12)
    difference = z[:, across] - 7 / 8 * means["wall_compressibility"]
    error = difference.std(ddof=1) / np.sqrt(60)
    assert abs(difference.mean()) < 4 * error < 0.01 * z.mean()
    anisotropy = z[:, 1 - across] - z[:, across]
    assert anisotropy.mean() > 8 * anisotropy.std(ddof=1) / np.sqrt(60)


@pytest.mark.parametrize("boundary", CHANNELS)
def test_density_at_the_walls_of_a_channel_has_their_pressure(boundary):
    """n(0) kT = P, extrapolated from a fifth of a diameter: within 4 of the stated errors of 300
    runs, each 2 %.
    """
    scene = gas(boundary, number=24, duration=10.0)
    request = {"observables": ("density_profile",)}
    seen = exact.simulate(scene, np.arange(300), frozenset({"none"}), **request).observables
    values = values_of(case_of(scene), seen, thermodynamics.ESTIMATOR, pairs.ESTIMATOR)
    density, pressure = values["contact_density"][0], values["wall_pressure"]
    error = np.hypot(
        values["contact_density_standard_error"][0], values["wall_pressure_standard_error"]
    )
    assert abs(density - pressure) < 4 * error < 0.09 * pressure


@pytest.mark.slow
@pytest.mark.parametrize("boundary", CHANNELS)
def test_contact_value_in_a_channel_is_that_of_its_collisions(boundary):
    """24 disks, 60 runs: from pairs and from collisions within 3 of the stated errors, though the
    density is not the same everywhere; a false alarm in 300. The errors are 0.9 and 1.1 %, of twice
    as many samples 0.8 and 0.9 %: disks have half a collision between two of these.
    """
    scene = gas(boundary, number=24, duration=40.0, sample_interval=0.2)
    request = {"observables": ("pair_distribution",)}
    seen = exact.simulate(scene, np.arange(60), frozenset({"none"}), **request).observables
    values = values_of(case_of(scene), seen, pairs.ESTIMATOR)
    by_pairs, by_rate = values["contact_value"], values["contact_value_rate"]
    error = np.hypot(
        values["contact_value_standard_error"], values["contact_value_rate_standard_error"]
    )
    assert np.abs(by_pairs - by_rate) < 3 * error
    assert error < 0.02 * by_rate


@pytest.mark.parametrize("boundary", ["periodic", "reflecting", *CHANNELS])
def test_rate_and_virial_of_four_disks_have_one_contact_value(boundary):
    """The mean speed at a fixed energy is not that of Maxwell and Boltzmann: 4 % more for 6 degrees
    of freedom.

    Within 4 standard errors of the mean difference of 100 runs: 1 false alarm in 8,000.
    """
    scene = gas(boundary, number=4, side=4.0, duration=200.0)
    seen = exact.simulate(scene, np.arange(100), frozenset({"none"})).observables
    runs = block(np.arange(100), None, seen)
    means = thermodynamics.thermodynamic_columns(case_of(scene), runs).means
    virial = means["compressibility"]
    difference = means["compressibility_rate"] - virial
    error = difference.std(ddof=1) / np.sqrt(100)
    assert abs(difference.mean()) < 4 * error < 0.016 * (virial.mean() - 1)


def test_what_is_alike_in_all_runs_has_no_error():
    """No collision in any run, and no disk near a wall: the runs do not tell how far from 0 the
    mean is.
    """
    scene = gas("reflecting", number=2, side=1e4)
    seen = exact.simulate(
        scene, np.arange(12), frozenset({"none"}), observables=("density_profile",)
    ).observables
    found = values_of(case_of(scene), seen, thermodynamics.ESTIMATOR, pairs.ESTIMATOR)
    assert found["compressibility"] == 1.0
    zeros = ("collision_rate", "wall_pressure", "contact_density")
    assert [found[name] for name in zeros] == [0.0, 0.0, 0.0]
    assert found["kinetic_temperature_standard_error"] > 0
    alike = {name: found[name] == 0 for name in ("density_profile", *zeros)}
    alike["compressibility"] = ...
    for name, where in alike.items():
        for suffix in ("standard_error", "low", "high"):
            assert np.isnan(found[f"{name}_{suffix}"][where]).all()


def test_densities_at_the_walls_are_extrapolated_from_a_fifth_of_each_diameter():
    """Of a gas so thin that the form that is fitted is a parabola."""
    scene = gas("reflecting", side=1e4, tracer={"radius": 1.0, "mass": 3.0})
    z = observables.AXES["wall_distance"].coordinates(scene)
    weights = pairs.wall_weights(scene)
    assert np.count_nonzero(weights[0], axis=1).tolist() == [16, 8]
    parabola = 1.7 - 2 * z + 3 * (z**2 + 0.025**2 / 12)  # averages over bins
    assert weights[0] @ parabola == pytest.approx([1.7, 1.7], rel=1e-6)


def test_enskogs_theory_of_a_mixture():
    """A disk collides with all others, not with itself; D = kT/(m gamma), in the frame of the
    centre of mass.
    """
    few = {"name": "few", "count": 2, "radius": 0.1, "mass": 9.0}
    species = gas().as_mapping()["disks"]["species"][0]
    tracer = {"radius": 1.0, "mass": 3.0}
    scene = gas(disks={"tracer": tracer, "species": [few, species]})
    number = np.array([1, 2, 16])
    sizes = 2 * np.array([1.0, 0.1, 0.5])
    mass = [3.0, 9.0, 1.0]
    chi = theory.mixture_contact_values(number / 64, sizes)
    rates, friction = np.zeros((2, 3, 3))
    for a, b in np.ndindex(3, 3):
        density = (number[b] - (a == b)) / 64
        sigma = (sizes[a] + sizes[b]) / 2
        pair = (density, sigma, chi[a, b], theory.reduced_mass(mass[a], mass[b]))
        rates[a, b] = theory.collision_rate(*pair, 1.0)
        friction[a, b] = theory.enskog_friction(*pair, 1.0)
    found = thermodynamics.enskog(scene)
    assert found["enskog_collision_rate"] == pytest.approx(number @ rates.sum(axis=1) / 19)
    assert found["enskog_tracer_collision_rate"] == pytest.approx(rates[0].sum())
    diffusion = (34 / 37) ** 2 / friction[0].sum()
    assert found["enskog_diffusion"] == pytest.approx(diffusion)
    assert found["enskog_contact_value"] == pytest.approx(chi[0, 2])
    assert pytest.approx(chi[0, 2]) != pytest.approx(chi[0, 1])
    assert thermodynamics.enskog(make_scene()) == {}, "it needs a temperature"


def equal_disks(particles=4000, phi=0.3, diameter=0.5, mass=2.0, kt=3.0, **keys):
    """A periodic fluid, sampled up to 40 of the times in which diameter, mass and kT are 1."""
    side = np.sqrt(particles * np.pi * diameter**2 / (4 * phi))
    unit = diameter * np.sqrt(mass / kt)
    disks = {"name": "disk", "count": particles, "radius": diameter / 2, "mass": mass}
    box = {"x": [0.0, side], "y": [0.0, side], "boundary": "periodic"}
    scene = {
        "box": box,
        "disks": {"species": [disks]},
        "velocities": {"temperature": kt},
        "duration": 40 * unit,
        "sample_interval": 0.25 * unit,
    }
    return parse_scene(scene, "fluid.yaml").replace(None, **keys), unit


def tail_of(scene):
    return velocity.tail_of_fluid(estimator.Case(scene, Engine("exact"), scene.times))


def test_the_tail_is_that_of_mode_coupling_theory_in_the_window_of_the_validation():
    """In any units; with zero total momentum it lacks the motion of the centre of mass."""
    for zero_momentum in (True, False):
        scene, unit = equal_disks(**{"velocities.zero_momentum": zero_momentum})
        expected = fluid(0.3)
        t = scene.times / unit
        tail = tail_of(scene)
        inside = (t > 30 / expected.rate) & (t < 0.7 * expected.crossing(4000))
        assert np.array_equal(np.isfinite(tail), inside) and inside.any()
        centre = 1 / 4000 if zero_momentum else 0.0
        correlation = tail[inside] / (2 * 3.0 / 2.0) + centre
        np.testing.assert_allclose(correlation * t[inside], expected.tail, rtol=1e-12)


@pytest.mark.parametrize(
    "keys",
    [
        {"box.boundary": "reflecting"},
        {"box.boundary": {"x": "periodic", "y": "reflecting"}},
        {"duration": 2.0},  # too short
        {"disks.tracer": {"radius": 0.25, "mass": 30.0}},
    ],
)
def test_other_scenes_and_short_runs_have_no_tail(keys):
    scene, _ = equal_disks()
    assert tail_of(scene) is not None
    assert tail_of(scene.replace(None, **keys)) is None
    small, _ = equal_disks(particles=100)  # sound crosses the box before
    assert tail_of(small) is None
