"""Estimators of velocities, pairs, thermodynamics and the control variate: from arrays measured in
runs to results.
"""

import numpy as np
import pytest

from brownpipe import analysis, observables, theory
from brownpipe.analysis import (
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

SIGMAS = 4.5
EVERYTHING = tuple(observables.OBSERVABLES)


def gas(boundary="periodic", number=16, side=8.0, tracer=None, **more):
    """Equal disks of radius 0.5 and mass 1 in equilibrium at kT = 1."""
    disks = {"species": [{"name": "gas", "count": number, "radius": 0.5, "mass": 1.0}]}
    mapping = {
        "box": {"x": [0.0, side], "y": [0.0, side], "boundary": boundary},
        "disks": disks | ({"tracer": tracer} if tracer else {}),
        "velocities": {"temperature": 1.0, "zero_momentum": boundary == "periodic"},
        "duration": 2.0,
        "sample_interval": 0.1,
        "equilibrate": {"time": 1.0, "tracer": "free"},
    }
    return parse_scene(mapping | more, f"{boundary}.yaml")


def case_of(scene):
    return estimator.Case(
        scene, Engine("exact"), scene.times, windows=((0.0, 1.0),), edges=np.arange(4.0)
    )


def block(seeds, tracer, seen):
    """Runs with the arrays `seen`."""
    return Ensemble(seeds, np.zeros(0), tracer, seen, {}, {}, {}, {})


def averages_of(case, seen, *estimators):
    """What the arrays `seen`, (n, ...) each, add up to."""
    n, averages = len(next(iter(seen.values()))), estimator.Averages()
    for seeds in np.split(np.arange(n), range(1024, n, 1024)):
        part = block(seeds, None, {name: array[seeds] for name, array in seen.items()})
        averages.add(seeds, estimator.collect_columns(estimators, case, part))
    return averages


def values_of(case, seen, *estimators):
    """The variables that estimators make of the arrays `seen`."""
    return estimator.collect_results(estimators, case, averages_of(case, seen, *estimators))


# --- real runs


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Equal disks in a periodic box, and a heavy one among them between walls: 30 runs each."""
    folder, scenes = (
        tmp_path_factory.mktemp("gas"),
        (gas(), gas("reflecting", tracer={"radius": 1.0, "mass": 3.0})),
    )
    for scene in scenes:
        names = [
            name for name in EVERYTHING if observables.OBSERVABLES[name].why_unfit(scene) is None
        ]
        ensemble = exact.simulate(scene, np.arange(30), frozenset({"tracer"}), observables=names)
        write_trajectories(folder / f"{scene.name}.h5", scene, Engine("exact"), ensemble)
    return analysis.aggregate(sorted(folder.iterdir()), windows=((0.5, 2.0),))


@pytest.mark.slow
def test_every_variable_is_there(dataset):
    """And says its unit. A run that could not go on, a drift, and 200 runs have variables of their
    own.
    """
    others = ("stopped", "drift_diffusion", "non_gaussian_parameter_controlled")
    assert {*dataset.data_vars} == {
        name for name in analysis.dataset.ALL_VARIABLES if not name.startswith(others)
    }
    assert all({"units", "long_name"} <= set(dataset[name].attrs) for name in dataset.data_vars)
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
    one = dataset.sel(scene="periodic", particles=16).squeeze()
    chi = (one.enskog_compressibility - 1) / (2 * one.packing_fraction)
    pairs = {
        "compressibility": one.enskog_compressibility,
        "compressibility_rate": one.enskog_compressibility,
    }
    pairs |= {"kinetic_temperature": 1.0}
    for name, expected in pairs.items():
        assert abs(one[name] - expected) < SIGMAS * one[f"{name}_standard_error"] + 0.02
    by_rate = one.contact_value_rate.sel(species_pair="gas:gas")
    assert abs(by_rate - chi) < 0.1
    assert float(one.contact_value.sel(species_pair="gas:gas") - by_rate) == pytest.approx(
        0, abs=0.15
    )


def test_densities_and_energies(dataset):
    for name, along, width in (
        ("velocity_density", "velocity_bin", 0.1),
        ("speed_density", "speed_bin", 0.1),
    ):
        sums = (dataset[name].sum(along, min_count=1) * width).values
        assert sums[np.isfinite(sums)] == pytest.approx(np.ones(3))
    energy = dataset.species_energy.sel(scene="periodic", species="gas", particles=16).squeeze()
    assert np.ptp(energy.values) < 1e-12  # conserved: one species has it all
    zero = dataset.velocity_autocorrelation.sel(scene="periodic", particles=16).squeeze()[0]
    assert abs(zero - 2 * 15 / 16) < SIGMAS * 2 / np.sqrt(30)


# --- velocities


def langevin_runs(times, gamma, start, runs, seed):
    """Position and velocity (T, n, 2) of free Langevin particles with kT/m = 1; `start` is the
    variance of v(0).
    """
    rng = np.random.default_rng(seed)
    position, velocity = np.zeros((2, len(times), runs, 2))
    velocity[0] = np.sqrt(start) * rng.standard_normal((runs, 2))
    for k, (decay, spread, middle, loose) in enumerate(
        langevin.step_weights(np.diff(times), gamma, 1.0)
    ):
        noise = rng.standard_normal((2, runs, 2))
        velocity[k + 1] = decay * velocity[k] + spread * noise[0]
        position[k + 1] = position[k] + middle * (velocity[k] + velocity[k + 1]) + loose * noise[1]
    return position, velocity


def observed(position, velocity):
    """The arrays that runs with these tracks yield."""
    return {
        "square_displacement": (position**2).sum(axis=-1).T,
        "displacement_velocity": (position * velocity).sum(axis=-1).T,
        "velocity_autocorrelation": (velocity * velocity[0]).sum(axis=-1).T,
        "velocity_displacement": (position * velocity[0]).sum(axis=-1).T,
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
    t, n = scene.times, 10_240
    seen = observed(*langevin_runs(t, 1.0, start, n, 11))
    found = values_of(case_of(scene), seen, displacement.ESTIMATOR, velocity.ESTIMATOR)
    growing = (start - 1) * np.exp(-t) * (1 - np.exp(-t)) + 1 - np.exp(-t)  # d<r^2>/dt / 4
    integral = start * (1 - np.exp(-t))
    off = {
        "diffusion_running": found["diffusion_running"] - growing,
        "green_kubo": found["green_kubo"] - integral,
    }
    for name, difference in off.items():
        assert (np.abs(difference) <= SIGMAS * found[f"{name}_standard_error"])[
            1:
        ].all()  # at t = 0 all runs have 0
    errors = [found[f"{name}_standard_error"] for name in off]
    apart = (
        np.abs(found["diffusion_running"] - found["green_kubo"])[1:]
        > SIGMAS * np.hypot(*errors)[1:]
    )
    assert apart.all() if start > 1 else not apart.any()
    c, r2 = seen["velocity_autocorrelation"].mean(axis=0), seen["square_displacement"].mean(axis=0)
    trapezoid, quotient = (c[0] + c[1]) / 4, (r2[2] - r2[0]) / 8
    assert trapezoid - integral[1] > SIGMAS * found["green_kubo_standard_error"][1]
    assert abs(quotient - growing[1]) > SIGMAS * found["diffusion_running_standard_error"][1]


def test_non_gaussian_parameter_and_its_control_variate():
    """Exponential r^2, as of normal displacements: jackknife error; in free flight the control
    variate takes it all.
    """
    scene, n = gas(), 400
    case, late = case_of(scene)._replace(rings=(np.arange(4.0),)), scene.times > 1.0
    v2, r2 = np.random.default_rng(4).exponential(2.0, (2, n, 1))
    squared = np.where(late, r2, v2 * scene.times**2)
    seen = {"square_displacement": squared, "quartic_displacement": squared**2}
    values = values_of(case, seen, displacement.ESTIMATOR, distribution.ESTIMATOR)
    found = {
        name.replace("non_gaussian_parameter", "alpha"): value for name, value in values.items()
    }
    without = [np.delete(squared, k, axis=0)[:, [5, -1]] for k in range(n)]
    alpha = np.array([(one**2).mean(axis=0) / (2 * one.mean(axis=0) ** 2) - 1 for one in without])
    assert found["alpha"][[5, -1]] == pytest.approx(
        alpha.mean(axis=0), abs=1e-3
    )  # bias of order 1/n
    # some 1/sqrt(n) = 0.05; delta method and jackknife differ by 3 % with r^4 as skewed as it is
    error = np.sqrt((n - 1) * alpha.var(axis=0))
    assert found["alpha_standard_error"][[5, -1]] == pytest.approx(error, rel=0.06)
    assert np.isnan(found["alpha"][0]) and np.isnan(found["alpha_controlled"][0])
    early = ~late & (
        scene.times > 0
    )  # the replicates are rounded to 2e-4 standard deviations of a run
    assert found["alpha_controlled"][early] == pytest.approx(0.0, abs=1e-4)
    assert found["alpha_controlled_standard_error"][early] == pytest.approx(0.0, abs=1e-4)
    assert found["alpha_controlled_standard_error"][-1] == pytest.approx(error[1], rel=0.1)
    few = values_of(
        case,
        {name: array[:199] for name, array in seen.items()},
        displacement.ESTIMATOR,
        distribution.ESTIMATOR,
    )
    assert not any("controlled" in name for name in few)


def decaying(scene, rate, runs=12):
    """Runs without any scatter whose autocorrelation decays at `rate`."""
    return {"velocity_autocorrelation": np.tile(2 * np.exp(-rate * scene.times), (runs, 1))}


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
    assert abs(slope / (2 * rate) + 1) < 2e-3 and error < 0.01 * 2 * rate


def test_initial_slope_of_a_heavy_tracer_is_taken_before_the_bath_has_collisions():
    """A friction that falls by half within a mean free time of the bath, when next to nothing of
    the velocity is lost.

    The error covers that of the samples; from a quarter of the relaxation time the slope would be
    40 % off.
    """
    scene = gas(number=256, side=40.0, tracer={"radius": 2.0, "mass": 1000.0}, duration=20.0)
    rate, pace = velocity.enskog_rate(scene), velocity.fastest_rate(scene)
    assert pace == thermodynamics.enskog(scene)["enskog_collision_rate"] > 10 * rate
    falling = np.exp(-rate / 2 * (scene.times + (1 - np.exp(-pace * scene.times)) / pace))
    slope, error, _, _ = slope_of(
        scene, {"velocity_autocorrelation": np.tile(2 * falling, (12, 1))}
    )
    assert abs(slope + 2 * rate) <= error < 0.1 * rate
    coarse = scene.replace(
        sample_interval=0.6 / pace
    )  # samples are later than collisions of the bath
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
    case, n = case_of(gas(tracer={"radius": 1.0, "mass": 3.0})), 0.25
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
    assert velocity.expected_slope(case, found) == pytest.approx(expected / (1 - share))
    assert velocity.expected_slope(case._replace(average="origins"), found) == pytest.approx(
        expected / (1 - share)
    )
    walls = case_of(gas("reflecting", tracer={"radius": 1.0, "mass": 3.0}))
    assert np.isnan(velocity.expected_slope(walls, found))  # which turn the velocity, too
    apart = gas("reflecting", tracer={"radius": 1.0, "mass": 3.0, "position": [4.0, 4.0]})
    walls = case_of(apart.replace(equilibrate={"time": 1.0, "tracer": "pinned"}))
    assert velocity.expected_slope(walls, found) == pytest.approx(expected)
    assert np.isnan(velocity.expected_slope(walls._replace(average="origins"), found))


@pytest.mark.slow
@pytest.mark.parametrize("still", [True, False])
def test_expected_slope_is_that_of_the_collisions(still):
    """Four disks: <v.dv> per time, which is -<|dv|^2> per time / 2 where <v^2> does not change.

    The impulses of all collisions have it. Without total momentum <v^2> is 3/4 of 2 kT/m, the slope
    remains.
    """
    velocities = {"temperature": 1.0, "zero_momentum": still}
    scene, n = (
        gas(number=4, side=4.0, duration=4.0, sample_interval=2.0, velocities=velocities),
        1000,
    )
    asked = {"observables": ("velocity_autocorrelation",), "average": "disks"}
    made = exact.simulate(scene, range(n), {"events"}, **asked)
    slope = np.array([-np.sum(made.events[seed].impulse ** 2) / (4 * 4.0) for seed in range(n)])
    correlation = made.observables["velocity_autocorrelation"]
    means = {
        "tracer_collisions": made.observables["pair_collisions"] / 2,
        "velocity_autocorrelation": correlation,
    }
    found = estimator.Averages().add(np.arange(n), estimator.Columns(means))
    expected = velocity.expected_slope(case_of(scene)._replace(average="disks"), found)
    relative = slope / slope.mean() - sum(
        column / column.mean() for column in (means["tracer_collisions"], correlation[:, 0])
    )
    assert (
        abs(slope.mean() / expected - 1) < SIGMAS * relative.std() / np.sqrt(n) < 0.1
    )  # to first order


def test_initial_slope_of_a_real_gas():
    """256 disks at a packing fraction of 0.14, sampled every 0.1 to 1.25 times: within the errors,
    or not stated.

    The rate of all disks' collisions is known within 0.5 %, a tenth of the error of the slope.
    """
    scene = gas(number=256, side=np.sqrt(64 * np.pi / 0.14), duration=2.5, sample_interval=0.05)
    made = exact.simulate(
        scene, range(120), {"none"}, observables=("velocity_autocorrelation",), average="disks"
    )
    seen = made.observables
    share = 255 / 256  # of 2 kT/m in <v^2> without total momentum
    exactly = (
        -2
        * seen["pair_collisions"].mean()
        / (256 * 2.5)
        * seen["velocity_autocorrelation"][:, 0].mean()
        / share
    )
    stated = []
    for each in (2, 5, 10, 25):
        case = case_of(scene)._replace(times=scene.times[::each], average="disks")
        found = averages_of(
            case,
            {"velocity_autocorrelation": seen["velocity_autocorrelation"][:, ::each]},
            velocity.ESTIMATOR,
        )
        slope = velocity.initial_slope(case, found)
        stated.append(bool(np.isfinite(slope.mean)))
        assert not stated[-1] or abs(
            slope.mean - exactly
        ) < SIGMAS * slope.standard_error < 0.9 * abs(exactly)
    assert stated == [True, True, False, False]


# --- pairs


def snapshots(scene, held=None, runs=300):
    """Arrays of runs of one sample: every disk a point in its room, the tracer perhaps held at one
    place.
    """
    rng, ones = np.random.default_rng(1), []
    room = np.array([scene.box.accessible(radius)[1] for radius in scene.radius])
    for _ in range(runs):
        position = 4.0 + (rng.random((scene.particles, 2)) - 0.5) * room
        position[0] = position[0] if held is None else held
        ones.append(
            observables.OBSERVABLES["pair_distribution"].measure(
                scene, Track(position[None]), "runs"
            )
        )
    return {name: np.array([one[name] for one in ones]) for name in ones[0]}


def g_of(scene, seen):
    """g(r) and its standard error (P, R)."""
    values = values_of(case_of(scene), seen, pairs.ESTIMATOR)
    return values["pair_distribution"], values["pair_distribution_standard_error"]


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_points_have_no_structure(boundary):
    """g(r) = 1 in all bins for 300 snapshots of an ideal gas; between walls two sizes have two
    rooms.

    Also relative to two uniform points, since the tracer has spread over its room.
    """
    scene = gas(boundary, tracer={"radius": 1.5, "mass": 1.0})
    seen = snapshots(scene)
    assert ("pair_expected" in seen) == (boundary == "reflecting")
    expected = 300 * pairs.ideal(scene, pairs.bin_edges(scene))
    for names in (seen, ("pair_counts", "pair_snapshots")):
        g, _ = g_of(scene, {name: seen[name] for name in names})
        off = (g - 1)[1:]
        assert (
            np.abs(off) < SIGMAS * 1.3 / np.sqrt(expected[1:]) + 4 / expected[1:]
        ).all()  # 1.3: pairs share disks
        assert np.isnan(g[0]).all()  # one tracer makes no pair


@pytest.fixture(scope="module")
def off_centre():
    """A gas of points around a tracer near a corner: the scene, and the arrays of 1,000
    snapshots.
    """
    scene = gas("reflecting", number=40, tracer={"radius": 1.5, "mass": 3.0})
    return scene, snapshots(scene, held=(1.6, 2.2), runs=1000)


@pytest.mark.slow
def test_points_around_a_tracer_off_centre_have_no_structure(off_centre):
    """Relative to a gas around where the tracer is, whose errors say how far from 1; not to two
    uniform points.

    4 standard errors in some 185 bins: 1 % of all seeds would fail. Those with next to no pair
    are left out.
    """
    scene, seen = off_centre
    expected = seen["pair_expected"].sum(axis=0)
    enough = expected[1] > 50
    assert enough.sum() > 180
    g, error = g_of(scene, seen)
    assert (np.abs(g - 1)[1, enough] < 4 * error[1, enough]).all()
    np.testing.assert_allclose(
        error[1, enough], 1 / np.sqrt(expected[1, enough]), rtol=0.2
    )  # Poisson's
    uniform, _ = g_of(scene, {name: seen[name] for name in ("pair_counts", "pair_snapshots")})
    assert (np.abs(uniform - 1)[1, enough] > 4 * error[1, enough]).sum() > 50
    assert np.array_equal(uniform[2], g[2])  # the gas among itself


@pytest.mark.slow
def test_contact_value_around_a_tracer_off_centre(off_centre):
    """By either route a gas of points has 1 at contact, too, though walls cut the ring of contact
    around the tracer.
    """
    scene, seen = off_centre
    ring = 2 * np.exp(1j * np.linspace(0, 2 * np.pi, 10_001)[1:]) + complex(1.6, 2.2)
    density = (
        2 * np.pi * 2 / 49 * np.mean((ring.real > 0.5) & (ring.imag > 0.5))
    )  # of a point's distance, at contact
    number = (
        40
        * density
        * np.sqrt(0.8 / (2 * np.pi * 0.75))
        * scene.times[-1]
        / theory.mean_root_chi_square(82)
    )
    counts = {"pair_collisions": number, "tracer_collisions": number, "kinetic_energy": 0.8 * 41}
    seen = seen | {name: np.full(1000, value) for name, value in counts.items()}
    found = averages_of(case_of(scene), seen, pairs.ESTIMATOR)
    values = estimator.collect_results([pairs.ESTIMATOR], case_of(scene), found)
    assert values["contact_value_standard_error"][1] < 0.1
    assert values["contact_value"][1] == pytest.approx(
        1, abs=4 * values["contact_value_standard_error"][1]
    )
    assert values["contact_value_rate"][1] == pytest.approx(
        1, abs=0.005
    )  # the ideal gas at contact, from bins: 0.2 %
    assert (found.totals["around_lone"] / found.runs * pairs.weights_of(scene)[0])[1].sum() < 0.8


def bin_averages(g, edges, flat=False):
    """Averages of g(r) over the areas of the rings (strips) between `edges`, by 20 points of
    Gauss-Legendre each.
    """
    node, weight = np.polynomial.legendre.leggauss(20)
    r = (edges[:-1, None] * (1 - node) + edges[1:, None] * (1 + node)) / 2
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
            return (1.7 - 2 * (r - 1) + 3 * (r - 1) ** 2 + x * (r - 1) ** 3) / (
                1 + decay * (r - 1) / 16
            ) ** 16

        averages = bin_averages(g, edges, flat)
        assert (averages * (fitted + following)).sum() == pytest.approx(1.7, rel=1e-9)
        assert ((averages * fitted).sum() == pytest.approx(1.7, rel=1e-9)) == (cubic == 0)


def test_truncation_widens_error_and_interval():
    """What the next order exceeds its own noise by is added in quadrature."""
    one = Estimate(*(np.array([value] * 3) for value in (2.0, 0.3, 1.5, 2.6)))
    following = Estimate(np.array([-0.5, 0.2, np.nan]), np.array([0.3, 0.3, 0.3]), None, None)
    wide = pairs.widened(one, following)
    assert wide.mean.tolist() == [2.0, 2.0, 2.0]
    assert wide.standard_error[:2] == pytest.approx([0.5, 0.3])
    assert wide.low[:2] == pytest.approx([2 - np.hypot(0.5, 1.96 * 0.4), 1.5], rel=1e-4)
    assert wide.high[:2] == pytest.approx([2 + np.hypot(0.6, 1.96 * 0.4), 2.6], rel=1e-4)
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
    scene = gas(
        number=256,
        side=float(np.sqrt(256 * np.pi / 4 / phi)),
        duration=time,
        sample_interval=time / samples,
        equilibrate={"time": 20.0, "tracer": "free"},
    )
    scene = scene.replace(**{"disks.placement": "lattice"})
    found = exact.simulate(
        scene, np.arange(16), frozenset({"none"}), observables=("pair_distribution",)
    ).observables
    values = values_of(case_of(scene), found, pairs.ESTIMATOR)
    both = np.hypot(
        values["contact_value_standard_error"], values["contact_value_rate_standard_error"]
    )
    assert np.abs(values["contact_value"] - values["contact_value_rate"]) < 3 * both
    assert both < 0.02 * values["contact_value_rate"]  # of 16 runs it is 0.3 to 1.4 %


def test_contact_values_from_rates_are_enskogs():
    """Of the tracer with the gas, and of the gas among itself, to which all other collisions
    belong.
    """
    scene = gas(tracer={"radius": 1.0, "mass": 3.0})
    of_tracer = theory.collision_rate(16 / 64, 1.5, 1.3, 0.75, 0.8)
    every = of_tracer + 16 / 2 * theory.collision_rate(15 / 64, 1.0, 1.2, 0.5, 0.8)
    time = scene.times[-1] / theory.mean_root_chi_square(32)
    counts = {
        "tracer_collisions": of_tracer * time,
        "pair_collisions": every * time,
        "kinetic_energy": 0.8 * 16,
    }
    values = values_of(
        case_of(scene),
        {name: np.full(12, value) for name, value in counts.items()},
        pairs.ESTIMATOR,
    )
    assert values["contact_value_rate"][1:] == pytest.approx([1.3, 1.2])


def test_few_pairs_have_an_interval_of_poissons():
    """Beyond contact, the 41st bin, and no shorter one by the bootstrap: 0 pairs are less than 3.84
    (Wilson, 95 %).
    """
    scene, counts = gas(), np.zeros((12, 1, 160))
    counts[:2, 0, 50] = 1
    values = values_of(
        case_of(scene), {"pair_counts": counts, "pair_snapshots": np.ones(12)}, pairs.ESTIMATOR
    )
    one = 1 / (12 * pairs.ideal(scene, pairs.bin_edges(scene)))[0]
    low, high = values["pair_distribution_low"][0] / one, values["pair_distribution_high"][0] / one
    assert high[[40, 159]] == pytest.approx([3.8415] * 2, rel=1e-4) and not high[:40].any()
    reach = 1.95996 * np.sqrt(2 + 1.95996**2 / 4)
    assert low[50] < 2.001 + 1.9207 - reach and high[50] > 1.999 + 1.9207 + reach


# --- thermodynamics


def test_pair_virial_and_wall_pressure_differ_by_the_room_of_the_centres():
    """Z = Z_wall (1 - R/w - R/h), here 7/8; of each run but for the change of sum m r.v, whose mean
    is 0.

    Within 4 standard errors of the mean difference of 60 runs: 1 false alarm in 5,000 (Student's
    t).
    """
    scene = gas("reflecting", number=24, duration=40.0)
    seen = exact.simulate(scene, np.arange(60), frozenset({"none"})).observables
    means = thermodynamics.thermodynamic_columns(
        case_of(scene), block(np.arange(60), None, seen)
    ).means
    difference = means["compressibility"] - 7 / 8 * means["wall_compressibility"]
    error = difference.std(ddof=1) / np.sqrt(60)
    assert abs(difference.mean()) < 4 * error < 0.008 * means["compressibility"].mean()
    wide = case_of(scene.replace(box={"x": [0, 16], "y": [0, 8]}))
    means = thermodynamics.thermodynamic_columns(wide, block(np.arange(60), None, seen)).means
    assert means["wall_pressure"] == pytest.approx(seen["wall_impulse"] / (2 * (16 + 8) * 40))
    assert means["wall_compressibility"] == pytest.approx(
        means["wall_pressure"] * 16 * 8 / seen["kinetic_energy"]
    )


@pytest.mark.parametrize("boundary", ["periodic", "reflecting"])
def test_rate_and_virial_of_four_disks_have_one_contact_value(boundary):
    """The mean speed at a fixed energy is not that of Maxwell and Boltzmann: 4 % more for 6 degrees
    of freedom.

    Within 4 standard errors of the mean difference of 100 runs: 1 false alarm in 8,000.
    """
    scene = gas(boundary, number=4, side=4.0, duration=200.0)
    seen = block(
        np.arange(100), None, exact.simulate(scene, np.arange(100), frozenset({"none"})).observables
    )
    means = thermodynamics.thermodynamic_columns(case_of(scene), seen).means
    difference = means["compressibility_rate"] - means["compressibility"]
    error = difference.std(ddof=1) / np.sqrt(100)
    assert abs(difference.mean()) < 4 * error < 0.016 * (means["compressibility"].mean() - 1)


def test_what_is_alike_in_all_runs_has_no_error():
    """No collision in any run, and no disk near a wall: the runs do not tell how far from 0 the
    mean is.
    """
    scene = gas("reflecting", number=2, side=1e4)
    names = "collision_rate", "compressibility", "wall_pressure", "contact_density"
    seen = exact.simulate(
        scene, np.arange(12), frozenset({"none"}), observables=("density_profile",)
    ).observables
    found = values_of(case_of(scene), seen, thermodynamics.ESTIMATOR, pairs.ESTIMATOR)
    assert [found[name] for name in names] == [0.0, 1.0, 0.0, 0.0] and found[
        "kinetic_temperature_standard_error"
    ] > 0
    empty = {name: found[name] == 0 for name in ("density_profile", *names)} | {
        "compressibility": ...
    }
    parts = ("standard_error", "low", "high")
    assert all(
        np.isnan(found[f"{name}_{part}"][where]).all()
        for name, where in empty.items()
        for part in parts
    )


def test_densities_at_the_walls_are_extrapolated_from_a_fifth_of_each_diameter():
    """Of a gas so thin that the form that is fitted is a parabola."""
    scene = gas("reflecting", side=1e4, tracer={"radius": 1.0, "mass": 3.0})
    z, weights = observables.AXES["wall_distance"].coordinates(scene), pairs.wall_weights(scene)
    assert np.count_nonzero(weights[0], axis=1).tolist() == [16, 8]
    assert weights[0] @ (1.7 - 2 * z + 3 * (z**2 + 0.025**2 / 12)) == pytest.approx(
        [1.7, 1.7], rel=1e-6
    )


def test_enskogs_theory_of_a_mixture():
    """A disk collides with all others, not with itself; D = kT/(m gamma), in the frame of the
    centre of mass.
    """
    few = {"name": "few", "count": 2, "radius": 0.1, "mass": 9.0}
    disks = {
        "tracer": {"radius": 1.0, "mass": 3.0},
        "species": [few, gas().as_mapping()["disks"]["species"][0]],
    }
    scene, number, sizes, mass = (
        gas(disks=disks),
        np.array([1, 2, 16]),
        2 * np.array([1.0, 0.1, 0.5]),
        [3.0, 9.0, 1.0],
    )
    chi, found = theory.mixture_contact_values(number / 64, sizes), thermodynamics.enskog(scene)
    rates, friction = np.zeros((2, 3, 3))
    for a, b in np.ndindex(3, 3):
        pair = (
            (number[b] - (a == b)) / 64,
            (sizes[a] + sizes[b]) / 2,
            chi[a, b],
            theory.reduced_mass(mass[a], mass[b]),
        )
        rates[a, b], friction[a, b] = (
            theory.collision_rate(*pair, 1.0),
            theory.enskog_friction(*pair, 1.0),
        )
    assert found["enskog_collision_rate"] == pytest.approx(number @ rates.sum(axis=1) / 19)
    assert found["enskog_tracer_collision_rate"] == pytest.approx(rates[0].sum())
    assert found["enskog_diffusion"] == pytest.approx((34 / 37) ** 2 / friction[0].sum())
    assert found["enskog_contact_value"] == pytest.approx(chi[0, 2]) != pytest.approx(chi[0, 1])
    assert thermodynamics.enskog(make_scene()) == {}, "it needs a temperature"
