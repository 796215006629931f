"""Runs of a scene that claims equilibrium are tested for drifts: those that drift are named, and
nobody else.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from brownpipe import observables, theory
from brownpipe.analysis import aggregate, drift
from brownpipe.analysis.goodness import holm
from brownpipe.engines import engine_of_request
from brownpipe.engines.forecast import settling_caution, settling_time
from brownpipe.figures.cases import cases_of, drifts, title_of
from brownpipe.figures.summary import answer, summary
from brownpipe.inspection import reports
from brownpipe.observables.equilibrium import claims_equilibrium, ends_of_quarters
from brownpipe.scene import parse_scene
from brownpipe.storage.configurations import read_scene
from brownpipe.storage.trajectories import Trajectories
from scenes import CHANNEL_X, CHANNEL_Y

SCENES = Path(__file__).parent.parent / "config" / "scenes"
EXACT = engine_of_request("exact", {})
LATTICE = {
    "box": {"x": [0, 21.44], "y": [0, 21.44], "boundary": "periodic"},
    "disks": {
        "species": [{"name": "disk", "count": 400, "radius": 0.5, "mass": 1.0}],
        "placement": "lattice",
    },
    "velocities": {"temperature": 1.0, "zero_momentum": True},
    "equilibrate": {"time": 0.5, "tracer": "free"},
    "duration": 10.0,
    "sample_interval": 0.5,
}
MIXTURE = LATTICE | {
    "box": {"x": [0, 8], "y": [0, 8], "boundary": "reflecting"},
    "velocities": {"temperature": 1.0},
    "disks": {
        "species": [
            {"name": "big", "count": 3, "radius": 0.6, "mass": 5.0},
            {"name": "small", "count": 30, "radius": 0.3, "mass": 1.0},
        ]
    },
    "duration": 2.0,
    "sample_interval": 0.1,
}


def runs_of(mapping, seeds, engine=EXACT, **more):
    """Runs of a scene in memory."""
    scene = parse_scene(mapping, "scene.yaml") if isinstance(mapping, dict) else mapping
    return Trajectories(scene, engine, engine.simulate(scene, seeds, {"tracer"}, **more))


@pytest.mark.slow
def test_dense_disks_from_a_lattice_are_named_and_marked():
    """Packing fraction 0.683; after 0.5 the pressure still rises by 6 % within the runs: some 10
    standard errors.
    """
    found = runs_of(LATTICE, range(17))
    for name, values in found.ensemble.observables.items():
        values[16] = name == "failed" or 1000 * values[16]  # is left out
    dataset = aggregate([found])
    (case,) = cases_of(dataset)
    (words,) = answer(dataset).drifting
    assert words.startswith("* scene, N = 400: the pressure drifts by +")
    assert words.endswith("% within the runs: not equilibrated; try equilibrate.time: 30")
    assert words in summary(dataset)
    assert title_of(case) == "scene, N = 400, not equilibrated"
    columns = dict(column[:2] for column in answer(dataset).columns)
    for name in ("D", "MSD(t = 10)"):
        assert columns[name].endswith(" *")
    (said,) = reports.equilibrium(found)
    assert said.partition("the pressure")[2] == words.partition("the pressure")[2]


def test_a_fluid_that_settled_is_not_accused(monkeypatch):
    """By 20 times its friction time; false alarm: 1 %."""
    found = runs_of(MIXTURE | {"equilibrate": {"time": 5.0, "tracer": "free"}}, range(40))
    dataset = aggregate([found])
    assert answer(dataset).drifting == []
    assert "all 4 tests (Holm)" in summary(dataset)
    assert "equilibrium  no drift found (family-wise level 1%)" in reports.equilibrium(found)
    nearly = drift.Drift(["a", "b"], *np.ones((2, 2)), np.array([0.008, 1]))
    monkeypatch.setattr(reports, "drift_of", lambda _: nearly)
    assert "equilibrium  no drift found (family-wise level 1%)" in reports.equilibrium(found)


def test_who_claims_equilibrium():
    def claims(**changes):
        disks = MIXTURE["disks"] | {"tracer": {"radius": 0.3, "mass": 1.0}}
        return claims_equilibrium(parse_scene(MIXTURE | {"disks": disks} | changes, "scene.yaml"))

    periodic = {"box": LATTICE["box"]}
    assert claims()
    assert claims(velocities={"standard_deviation": 1.0})
    assert not claims(velocities={"temperature": 1.0, "zero_momentum": True})
    assert not claims(equilibrate=0.0)
    assert not claims(equilibrate=1.0)
    assert claims(equilibrate=1.0, **periodic)
    assert not claims(equilibrate=1.0, velocities={"standard_deviation": 1.0}, **periodic)


@pytest.mark.parametrize("boundary", [CHANNEL_X, CHANNEL_Y])
def test_channels_claim_equilibrium_with_zero_momentum_along_them(boundary):
    """Which no wall changes; but not with a tracer that is pinned, perhaps at a wall."""
    channel = MIXTURE | {"box": MIXTURE["box"] | {"boundary": boundary}}
    scene = parse_scene(channel, "scene.yaml")
    assert scene.velocities.zero_momentum and claims_equilibrium(scene)
    assert claims_equilibrium(scene.replace(**{"velocities.zero_momentum": False}))
    disks = MIXTURE["disks"] | {"tracer": {"radius": 0.3, "mass": 1.0}}
    with_tracer = parse_scene(channel | {"disks": disks, "equilibrate": 1.0}, "scene.yaml")
    assert with_tracer.equilibrate.tracer == "pinned"
    assert not claims_equilibrium(with_tracer)
    assert claims_equilibrium(with_tracer.replace(equilibrate={"time": 1.0, "tracer": "free"}))


def test_few_runs_or_samples_do_not_tell():
    for found in (
        runs_of(MIXTURE, range(7)),
        runs_of(MIXTURE | {"sample_interval": 0.9}, range(10)),
    ):
        (words,) = answer(aggregate([found])).drifting
        assert words == f"scene, N = 33: {drift.TOO_FEW}"
        assert f"equilibrium  {drift.TOO_FEW}" in reports.equilibrium(found)


def test_quarters_add_up_to_the_run():
    disks = {
        "species": MIXTURE["disks"]["species"][::-1]
    }  # small ones first; the engine has big ones first
    scene = MIXTURE | {
        "equilibrate": {"time": 0.5, "tracer": "free"},
        "disks": disks,
        "velocities": {"temperature": 5},
    }
    runs = runs_of(
        scene | {"sample_interval": 0.3},
        range(3),
        observables=("species_energy", "orientational_order"),
    )
    seen = runs.ensemble.observables
    times = runs.ensemble.times
    at = ends_of_quarters(times)
    lengths = np.diff(times[at])
    assert np.ptp(lengths) > 0.2
    quarters = drift.quarters_of(runs.scene, times, seen)
    collisions = (quarters["collision rate"] * lengths).sum(axis=1)
    np.testing.assert_allclose(collisions, seen["pair_collisions"], rtol=1e-12)
    pressure = quarters["pressure"]
    mean_pressure = 2.0 + seen["virial"] / (2 * seen["kinetic_energy"])
    np.testing.assert_allclose((pressure * lengths).sum(axis=1), mean_pressure, rtol=1e-12)
    energy = seen["quarter_energy"]
    assert np.array_equal(quarters["kinetic energy of small"], energy[:, :, 0])
    assert np.array_equal(quarters["kinetic energy of big"], energy[:, :, 1])
    found = drift.drift_of(quarters)
    change = pressure[:, 3] - pressure[:, 0]
    standard_error = change.std(ddof=1) / np.sqrt(3)
    assert found.change[0] * pressure.mean() == pytest.approx(change.mean())
    assert found.error[0] * pressure.mean() == pytest.approx(standard_error)
    assert (seen["quarter_collisions"] > 0).all()
    ends = seen["species_energy"][:, at]
    np.testing.assert_allclose(energy, (ends[:, 1:] + ends[:, :-1]) / 2, rtol=1e-12)
    assert observables.ARRAYS["quarter_energy"].dims == ("quarter", "species")
    assert energy.shape == (3, 4, 2)


@pytest.mark.parametrize(
    ("name", "engine"),
    [
        ("harrison2020", EXACT),
        ("harrison2020_thermal", EXACT),
        ("heavy", engine_of_request("timestep", {"time_step": 0.01})),
        ("heavy", engine_of_request("langevin", {"friction": "enskog"})),
    ],
)
def test_scenes_that_do_not_equilibrate_and_approximate_engines_are_not_tested(name, engine):
    """Time steps have an equilibrium of their own, to which runs drift from the exact one, however
    long that took.
    """
    scene = read_scene(SCENES / f"{name}.yaml").replace(duration=0.5)
    found = runs_of(scene, range(8), engine)
    assert not [array for array in found.ensemble.observables if array.startswith("quarter_")]
    dataset = aggregate([found])
    assert answer(dataset).drifting == []
    assert "drift" not in dataset
    if engine is EXACT:
        assert not claims_equilibrium(found.scene)
        assert "is short" not in str(settling_caution(found.scene))
        assert "quilibr" not in summary(dataset)


def test_quarters_end_at_the_samples_next_to_them():
    assert ends_of_quarters(np.linspace(0, 1, 101)).tolist() == [0, 25, 50, 75, 100]
    assert ends_of_quarters(np.array([0, 0.3, 0.5, 0.7, 1.0])).tolist() == [0, 1, 2, 3, 4]
    assert not len(ends_of_quarters(np.array([0, 0.01, 0.1, 0.2, 0.5, 1.0])))
    assert not len(ends_of_quarters(np.array([0, 0.5, 1.0])))
    assert not len(ends_of_quarters(np.zeros(0)))


@pytest.mark.parametrize("draw", ["normal", "exponential", "poisson"])
def test_the_level_is_nominal_for_stationary_numbers(draw):
    """4,000 families of three quantities; false alarm: 1e-4. Rare counts are discrete: fewer are
    rejected.
    """
    rng = np.random.default_rng(1)
    families = 4000
    values = getattr(rng, draw)(size=(families, 3, 10, 4)) + 2.0
    alarms = 0
    for family in values:
        p = drift.drift_of(dict(zip("abc", family, strict=True))).p
        alarms += (holm(p) < drift.LEVEL).any()
    sigma = np.sqrt(families * drift.LEVEL)
    assert alarms < families * drift.LEVEL + 3.7 * sigma
    if draw == "normal":
        assert alarms > families * drift.LEVEL - 3.7 * sigma


def test_the_power_stated_is_that_of_the_test():
    """A drift of the size that is said to be found with 90 %; 1,000 families, false alarm: 1e-4."""
    rng = np.random.default_rng(2)
    (size,) = drift.found_with_power(np.array([np.sqrt(2 / 40)]), 40, 3)
    shape = size * np.array([-0.5, 0.0, 0.0, 0.5])
    found = 0
    for _ in range(1000):
        quarters = rng.normal(size=(3, 40, 4)) + 1.0
        quarters[0] += shape
        p = drift.drift_of(dict(zip("abc", quarters, strict=True))).p
        found += holm(p)[0] < drift.LEVEL
    standard_error = np.sqrt(0.09 / 1000)
    assert found / 1000 == pytest.approx(0.9, abs=3.9 * standard_error)


HOT_TRACER = {
    "box": {"x": [0, 12], "y": [0, 12], "boundary": "reflecting"},
    "disks": {
        "tracer": {"radius": 0.4, "mass": 50.0},
        "species": [{"name": "bath", "count": 80, "radius": 0.4, "mass": 1.0}],
    },
    "velocities": {"standard_deviation": 1.0},
    "equilibrate": {"time": 0.3, "tracer": "free"},
    "duration": 3.0,
    "sample_interval": 0.1,
}


def test_the_power_stated_covers_the_tracer_whose_energy_is_tested_worst():
    """Its mean kinetic energy is some 25 times that of the bath; it is one disk, over 12 runs: a
    drift must exceed its mean, though 6 % of the pressure would be seen.
    """
    text = " ".join(summary(aggregate([runs_of(HOT_TRACER, range(12))])).split())
    found = re.search(
        r"90% of drifts by ([\d.]+) % of the pressure are found, "
        r"and, at worst, by ([\d.]+) % of the kinetic energy of tracer; changes that take",
        text,
    )
    assert found, text
    of_pressure, of_tracer = map(float, found.groups())
    assert of_pressure < 20
    assert of_tracer > 40


def test_the_summary_says_that_the_structure_of_large_disks_is_not_tested():
    def says_so(observables, **keys):
        found = runs_of(MIXTURE | keys, range(8), observables=observables)
        return "Not tested is g(r) of large disks among small ones" in summary(aggregate([found]))

    assert says_so(("pair_distribution",))
    assert not says_so(())
    lone = MIXTURE["disks"] | {
        "tracer": {"radius": 0.6, "mass": 5.0},
        "species": MIXTURE["disks"]["species"][1:],
    }
    assert not says_so(("pair_distribution",), disks=lone)


def test_the_family_is_all_cases_of_a_dataset():
    """p-values of the dataset are those of its cases, adjusted together."""
    runs = runs_of(MIXTURE, range(8), observables=("orientational_order",))
    others = runs_of(parse_scene(MIXTURE, "other.yaml"), range(8))
    alone = aggregate([runs])
    both = aggregate([runs, others])
    energies = ["kinetic energy of big", "kinetic energy of small"]
    assert alone["quantity"].values.tolist() == ["pressure", "collision rate", *energies, "psi_6"]
    p_among_both = both.drift_p_value.sel(scene="scene").values
    assert (p_among_both >= alone.drift_p_value.values - 1e-12).all()
    assert np.isfinite(both.drift_p_value).sum() == 5 + 4
    unlikely = alone.drift_p_value.where(alone["quantity"] != "psi_6", 1e-3)
    drifting = alone.assign(drift_p_value=unlikely)
    assert [*map(drifts, (*cases_of(drifting), *cases_of(alone)))] == [True, False]


def test_settling_is_forecast_for_a_fluid():
    dense = parse_scene(LATTICE, "dense.yaml")
    assert 15 < settling_time(dense) < 35
    assert "equilibrate.time 0.5 is short: some 26 should be enough" in settling_caution(dense)
    longer = dense.replace(equilibrate={"time": 40.0, "tracer": "free"})
    assert settling_caution(longer) is None
    assert drift.time_to_try(dense) == 30
    assert drift.time_to_try(longer) == 2 * (40 + 10)
    packed = {"x": [0, 20], "y": [0, 20], "boundary": "periodic"}
    crystal = parse_scene(LATTICE | {"box": packed}, "crystal.yaml")
    assert np.isnan(settling_time(crystal))
    assert settling_caution(crystal) is None
    heavy = {"radius": 0.3, "mass": 100.0}
    cold = parse_scene(MIXTURE, "cold.yaml").replace(**{"disks.tracer": heavy})
    # to a neighbour's place, of the slowest species
    assert settling_time(cold) == pytest.approx(np.sqrt(64 / 34 * 5))
    tracer = heavy | {"mass": 0.01}
    light = cold.replace(velocities={"standard_deviation": 1.0}, **{"disks.tracer": tracer})
    assert settling_time(light) > 5 * np.sqrt(64 / 33)  # energy takes 50/gamma, velocity 1/gamma


def mixture_of(**changes):
    """28 large disks placed before 120 small ones, at a packing fraction of 0.6."""
    small = {"name": "small", "count": 120, "radius": 0.2, "mass": 1.0}
    large = {"name": "large", "count": 28, "radius": 0.5, "mass": 2.0}
    keys = {
        "box": {"x": [0, 8], "y": [0, 8], "boundary": "periodic"},
        "disks": {"species": [small, large]},
        "velocities": {"temperature": 1.0},
        "equilibrate": {"time": 1.0, "tracer": "free"},
        "duration": 1.0,
    }
    return parse_scene(keys, "mixture.yaml").replace(**changes)


def test_large_disks_settle_as_they_diffuse_to_each_other():
    mixture = mixture_of()
    n = np.array([120, 28]) / 64
    chi = theory.mixture_contact_values(n, np.array([0.4, 1.0]))[1]
    mu = np.array([2 / 3, 1.0])
    sigma = np.array([0.7, 1.0])
    partners = n - np.array([0, 1 / 64])
    speed = np.sqrt(2 * np.pi * mu)
    friction = (2 * partners * chi * sigma * speed).sum()
    assert settling_time(mixture) == pytest.approx(1.0 * 0.4 * friction)
    assert settling_caution(mixture).endswith(
        "should be enough for large disks to diffuse to each other (Enskog's theory of the fluid, "
        "not of crystals)"
    )


@pytest.mark.parametrize(
    "species",
    [
        [{"name": "equal", "count": 90, "radius": 0.4, "mass": 1.0}],
        [
            {"name": "light", "count": 45, "radius": 0.4, "mass": 0.1},
            {"name": "heavy", "count": 45, "radius": 0.4, "mass": 1.0},
        ],
    ],
)
def test_disks_of_one_radius_settle_in_flight_with_a_large_tracer_too(species):
    disks = {"species": species}
    box = {"x": [0, 10], "y": [0, 10], "boundary": "periodic"}
    alone = mixture_of(box=box, disks=disks)
    assert settling_time(alone) == pytest.approx(10 / np.sqrt(90))
    disks = {"tracer": {"radius": 1.0, "mass": 9.0}, "species": species}
    with_tracer = mixture_of(box=box, disks=disks)
    assert settling_time(with_tracer) == pytest.approx(10 / np.sqrt(91))


@pytest.mark.slow
def test_contacts_of_large_disks_have_settled_after_the_time_that_is_forecast():
    """Their collisions in a short time, over 100 runs: less by 16 % after a flight time, and
    after the forecast as many as after four times as long, within 4.5 standard errors. A forecast
    of a flight time would be 7 standard errors away.
    """
    forecast = settling_time(mixture_of())

    def collisions(time):
        scene = mixture_of(equilibrate={"time": time, "tracer": "free"}, duration=2.0)
        events = EXACT.simulate(scene, range(100), {"events"}).events.values()
        number = np.array([np.sum((of_run.a >= 120) & (of_run.b >= 120)) for of_run in events])
        return number.mean(), number.std() / np.sqrt(100)

    flight, flight_error = collisions(0.5)
    settled, settled_error = collisions(forecast)
    late, late_error = collisions(4 * forecast)
    assert flight < settled - 4.5 * np.hypot(flight_error, settled_error)
    assert abs(settled - late) < 4.5 * np.hypot(settled_error, late_error)
