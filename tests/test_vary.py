"""Keys of a scene that take several values: `vary` of a study, `simulate --value`, `bp.scan`, and
the figure `scan`.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray
import yaml
from hypothesis import given
from hypothesis import strategies as st

import brownpipe as bp
from brownpipe.analysis.runs import _refuse_namesakes
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.figures.cases import cases_of, series_of
from brownpipe.figures.scan import table_of_scan
from brownpipe.figures.summary import summary, summary_table
from brownpipe.scene import parse_scene
from brownpipe.scene.reading import validated
from brownpipe.scene.variation import Vary, scene_with, value_of
from brownpipe.study import read_study
from brownpipe.study.run_sets import commands, run_sets

FLUID = {
    "box": {"x": [0.0, 8.0], "y": [-4.0, 4.0], "boundary": "periodic"},
    "disks": {
        "tracer": {"radius": 0.5, "mass": 1.0, "position": [2.0, 1.0]},
        "species": [{"name": "bath", "count": 15, "radius": 0.5, "mass": 1.0}],
    },
    "velocities": {"temperature": 1.0},
    "duration": 4.0,
    "sample_interval": 0.25,
}
MASS = "disks.tracer.mass"
PHI = "packing_fraction"
VARY = {MASS: [1.0, 10.0, 100.0], PHI: [0.1, 0.2]}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene and a study that varies two keys of it, which is the current one."""
    monkeypatch.chdir(tmp_path)
    Path("fluid.yaml").write_text(yaml.safe_dump(FLUID))
    write_study()
    return tmp_path


def write_study(**keys):
    Path("study.yaml").write_text(
        yaml.safe_dump({"scenes": "fluid.yaml", "seeds": 6, "vary": VARY} | keys)
    )


def test_a_variant_is_the_scene_with_these_values_in_its_file():
    keys = json.loads(json.dumps(FLUID)) | {"duration": 2.0, "equilibrate": {"time": 2.0}}
    keys["disks"]["tracer"]["mass"], keys["disks"]["species"][0]["count"], keys["box"]["x"] = (
        10.0,
        5,
        [0.0, 9.0],
    )
    values = {
        MASS: 10.0,
        "disks.species.bath.count": 5.0,
        "duration": 2.0,
        "equilibrate.time": 2.0,
        "box.x": [0, 9.0],
    }
    variant = scene_with(FLUID, "a/fluid.yaml", values)
    assert variant.text == parse_scene(keys, "fluid.yaml").text
    assert scene_with({**FLUID, "equilibrate": 50.0}, "fluid.yaml", values) == variant
    disks = {**FLUID["disks"], "species": [{**FLUID["disks"]["species"][0], "name": "a-b"}]}
    assert (
        scene_with({**FLUID, "disks": disks}, "a.yaml", {"disks.species.a-b.mass": 2}).name
        == "a,a-b_mass=2"
    )
    oblong = scene_with({**FLUID, "box": {**FLUID["box"], "x": [0, 9]}}, "fluid.yaml", {PHI: 0.1})
    with pytest.raises(bp.AnalysisError, match="two different scenes"):
        _refuse_namesakes([oblong, scene_with(FLUID, "fluid.yaml", {PHI: 0.1})])
    assert (
        variant.name == "fluid,tracer_mass=10,bath_count=5,duration=2,equilibrate_time=2,box_x=0-9"
    )
    span = {"from": 1, "to": 100, "count": 3, "spacing": "log"}
    assert validated(Vary, {MASS: span}) == {MASS: pytest.approx((1.0, 10.0, 100.0))}
    counts = validated(Vary, {(key := "disks.species.bath.count"): span | {"from": 4, "to": 40}})[
        key
    ]
    scenes = [scene_with(FLUID, "a.yaml", {key: n}) for n in counts]
    assert [(one.name, one.particles) for one in scenes] == [
        (f"a,bath_count={n}", n + 1) for n in (4, 13, 40)
    ]


@given(st.floats(1e-3, 0.5))
def test_packing_fraction_scales_the_box_and_the_place_of_the_tracer(phi):
    scene = scene_with(FLUID, "fluid.yaml", {PHI: phi})
    factor = scene.box.width / 8.0
    assert scene.packing_fraction == pytest.approx(phi, rel=1e-12)
    assert scene.box.height / scene.box.width == pytest.approx(1.0)
    assert scene.disks.tracer.position == pytest.approx((2.0 * factor, 1.0 * factor))
    assert scene.radius.tolist() == [0.5] * 16


def test_a_value_added_later_runs_only_itself(folder):
    before = {runs.folder for runs in run_sets(read_study("study.yaml"))}
    write_study(vary={MASS: [1.0, 10.0, 30.0, 100.0], PHI: [0.1, 0.2]})
    after = {runs.folder for runs in run_sets(read_study("study.yaml"))}
    assert (len(before), len(after - before), len(before - after)) == (6, 2, 0)


def test_a_key_without_numbers_is_no_axis_of_a_figure(folder):
    for vary in ({"box.x": [[0.0, 8.0], [0.0, 9.0]]}, {"velocities.zero_momentum": [True, False]}):
        write_study(vary=vary)
        assert "scan" not in read_study("study.yaml").figures
    write_study()
    assert "scan" in read_study("study.yaml").figures


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_a_default_that_is_varied_has_its_value_as_label(distribution):
    velocities = {"standard_deviation": 1.0, "distribution": distribution}
    scene = parse_scene(FLUID | {"velocities": velocities}, "fluid.yaml")
    assert value_of(scene, "velocities.distribution") == distribution


PAIR = bp.Configuration(
    position=np.array([[1.0, 1.0], [3.0, 1.0]]),
    velocity=np.array([[0.5, 0.0], [-1.0, 0.0]]),
    radius=np.array([0.5, 0.2]),
    mass=np.array([1.0, 2.0]),
)


@pytest.mark.parametrize(("path", "values", "labels"), [
    ("disks.tracer.velocity", [None, [1.0, 0.0]], ["none", "1-0"]),
    ("disks.tracer.position", [None, [2.0, 1.0]], ["1-1", "2-1"]),
    ("disks.tracer.mass", [None, 3.0], [1.0, 3.0]),
    ("disks.species.kind-2.radius", [None, 0.3], [0.2, 0.3]),
    ("disks.push_apart", [0.0, 0.1], [0.0, 0.1]),
    ("equilibrate", [0.0, 2.0], [0.0, 2.0]),
    ("equilibrate.time", [0.0, 2.0], [0.0, 2.0]),
])  # fmt: skip
def test_every_key_of_given_disks_has_its_value_as_label(path, values, labels):
    """Also of a scene that is read from the text in a file of runs, which leaves out defaults."""
    disks = {"configuration": PAIR, "tracer": {}}
    mapping = FLUID | {"disks": disks, "box": {"x": [0.0, 8.0], "y": [0.0, 8.0]}}
    scenes = [scene_with(mapping, "pair.yaml", {path: value}) for value in values]
    stored = [parse_scene(json.loads(scene.text), "pair.yaml") for scene in scenes]
    assert [value_of(scene, path) for scene in scenes] == labels
    assert [value_of(scene, path) for scene in stored] == labels


def test_the_label_of_a_velocity_in_a_file_is_that_velocity():
    mapping = FLUID | {"disks": {"configuration": PAIR, "tracer": {}}, "velocities": None}
    scene = parse_scene(mapping, "pair.yaml")
    assert value_of(scene, "disks.tracer.velocity") == "0.5-0"


def test_radii_of_a_file_are_varied_beside_one_radius_for_all():
    """A species of several radii has none of its own, whose label is a word."""
    x, y = np.meshgrid([1.0, 3.0, 5.0, 7.0], [-3.0, -1.0, 1.0, 3.0])
    position = np.stack([x.ravel(), y.ravel()], axis=1)
    radius = np.repeat([0.5, 0.6], 8)
    named = ("bath",), np.zeros(16, int)
    sample = bp.Configuration(position, None, radius, np.ones(16), *named)
    scene = parse_scene(FLUID | {"disks": {"configuration": sample}}, "sample.yaml")
    result = bp.scan(scene, {"disks.species.bath.radius": [None, 0.5]}, seeds=2, quiet=True)
    assert result.bath_radius.values.tolist() == ["none", "0.5"]
    mean_squares = np.array([(0.5**2 + 0.6**2) / 2, 0.5**2])
    expected = 16 * np.pi * mean_squares / scene.box.area
    assert result.packing_fraction.values.ravel() == pytest.approx(expected)


def test_equilibration_of_given_disks_is_varied():
    x, y = np.meshgrid(np.arange(8.0), np.arange(-4.0, 4.0))
    position = np.stack([x.ravel(), y.ravel()], axis=1)
    crystal = bp.Configuration(position, None, np.full(64, 0.3), np.ones(64))
    scene = parse_scene(FLUID | {"disks": {"configuration": crystal}}, "crystal.yaml")
    result = bp.scan(scene, {"equilibrate": [0.0, 0.5]}, seeds=3, quiet=True)
    assert result.equilibrate.values.tolist() == [0.0, 0.5]
    assert np.isfinite(result.msd).all()


def dataset_of(study):
    """The dataset of all runs of a study with seeds 0 to 5."""
    for runs in run_sets(study):
        words = commands(study)[runs.key].replace("'", "").split()
        runs.folder.mkdir(parents=True)
        assert (
            main(["simulate", *words, "--seeds", "0-5", "--output", str(runs.folder / "0-5.h5")])
            == 0
        )
    assert main(["aggregate", "--study", "study.yaml", "--output", "study.nc"]) == 0
    assert main(["inspect", "study.nc", "--allow-failed", "0"]) == 0
    return xarray.open_dataset("study.nc")


@pytest.mark.slow
def test_boundaries_are_varied_by_word_and_by_axis(folder):
    channel = {"x": "periodic", "y": "reflecting"}
    write_study(vary={"box.boundary": ["periodic", channel]})
    cases = read_study("study.yaml").cases
    assert [case.box.in_words for case in cases] == ["periodic box", "channel along x"]
    labels = ["periodic", "x-periodic-y-reflecting"]
    assert [case.name for case in cases] == [f"fluid,box_boundary={label}" for label in labels]
    assert [value_of(case, "box.boundary") for case in cases] == labels
    words = ["reflecting", "periodic"]
    write_study(vary={"box.boundary.y": words})
    for boundary in (channel, "periodic"):
        box = FLUID["box"] | {"boundary": boundary}
        Path("fluid.yaml").write_text(yaml.safe_dump(FLUID | {"box": box}))
        cases = read_study("study.yaml").cases
        assert [value_of(case, "box.boundary.y") for case in cases] == words
        assert [case.box.in_words for case in cases] == ["channel along x", "periodic box"]


def test_the_dataset_of_a_study_is_that_of_python_and_each_part_that_of_its_scene(folder):
    windows = {"fit_windows": [[0.5, 3.25], [1.0, 4.0]]}
    analysis = windows | {"displacement_times": [1.5, 2.25], "rings": {"dr": 0.3, "count": 11}}
    write_study(**analysis)
    dataset = dataset_of(read_study("study.yaml"))
    assert (
        dict(dataset.sizes).items() >= {"scene": 1, "tracer_mass": 3, "packing_fraction": 2}.items()
    )
    assert dataset.tracer_mass.attrs == {"units": "mass", "long_name": MASS}
    scanned = bp.scan("fluid.yaml", VARY, seeds=6, quiet=True, **windows)
    xarray.testing.assert_equal(dataset[["msd", "intercept"]], scanned[["msd", "intercept"]])
    single = bp.analyse(
        bp.simulate(scene_with(FLUID, "fluid.yaml", {MASS: 10.0, PHI: 0.2}), 6, quiet=True),
        **analysis,
    )
    part = dataset.sel(tracer_mass=10, packing_fraction=0.2)
    for name in (
        "msd",
        "diffusion_coefficient_low",
        "collision_rate",
        "displacement_counts",
        "runs",
    ):
        assert np.array_equal(part[name].squeeze(), single[name].squeeze(), equal_nan=True), name


@pytest.mark.slow
def test_packing_fractions_of_several_numbers_of_disks_have_boxes_of_their_own(folder):
    """A finite-size study at given densities, from a scene in whose own box 100 disks would not
    fit.
    """
    Path("fluid.yaml").write_text(yaml.safe_dump(FLUID).replace("count: 15", "count: rest"))
    vary = {PHI: [0.1, 0.2], "velocities.temperature": [1.0, 1.5]}
    energy = {"observables": "species_energy"}
    write_study(vary=vary, vary_together=True, particles=[16, 100], **energy)
    study = read_study("study.yaml")
    dataset = dataset_of(study)
    assert (
        dict(dataset.sizes).items() >= {"scene": 1, "packing_fraction": 2, "particles": 2}.items()
    )
    assert (
        dataset.temperature.dims == ("packing_fraction",)
        and json.loads(dataset.options)["fit_windows"] is None
    )
    scanned = bp.scan("fluid.yaml", vary, 6, 100, together=True, quiet=True, **energy)
    xarray.testing.assert_equal(dataset.species_energy.sel(particles=[100]), scanned.species_energy)
    scenes = {one["scene_digest"]: one["scene"] for one in json.loads(dataset.made_from)}
    for phi, count in [(0.1, 100), (0.2, 16)]:
        (case,) = (
            case
            for case in study.cases
            if f",{PHI}={phi}," in case.name and case.particles == count
        )
        assert case.box.area == pytest.approx(count * math.pi * 0.5**2 / phi)
        assert scenes[case.digest] == json.loads(case.text)
        single = bp.analyse(bp.simulate(case, 6, quiet=True))
        part = dataset.sel(packing_fraction=phi, particles=count)
        for name in ("msd", "collision_rate", "compressibility", "runs"):
            assert np.array_equal(part[name].squeeze(), single[name].squeeze(), equal_nan=True), (
                name
            )


def test_keys_together_share_a_dimension_and_are_named_in_summary_and_table():
    vary = {MASS: [1.0, 4.0, 9.0], "disks.tracer.radius": [0.5, 0.6, 0.7]}
    result = bp.scan(bp.Scene(**FLUID), vary, seeds=2, together=True, quiet=True)
    assert (result.tracer_mass.units, result.tracer_radius.units) == ("mass", "length")
    assert result.tracer_radius.dims == (
        "tracer_mass",
    ) and "tracer mass  tracer radius" in summary(result)
    ((_, series),) = series_of(cases_of(result), "tracer_mass").items()
    assert table_of_scan(series).tracer_radius.unique().tolist() == [0.5, 0.6, 0.7]
    rest = bp.scan(bp.Scene(**FLUID), {"equilibrate": [0, 1.5]}, seeds=2, quiet=True).equilibrate
    assert (rest.units, rest.values.tolist()) == ("time", [0.0, 1.5])


def test_a_density_that_changes_with_what_is_varied_is_in_summary_and_figure():
    """The packing fraction of a tracer of radius r and fifteen disks of radius 0.5."""
    radii = [0.5, 0.8, 1.1]
    alone = {"disks.tracer.radius": radii}
    scene = bp.Scene(**FLUID)
    area = scene.box.area
    together = alone | {MASS: [1.0, 4.0, 9.0]}
    for vary in (alone, together):
        result = bp.scan(scene, vary, seeds=2, together=True, quiet=True)
        phi = [(15 * 0.25 + radius**2) * math.pi / area for radius in radii]
        for row, value in zip(summary(result).splitlines()[1:4], phi, strict=True):
            assert f"  {value:.4f}  " in row
        assert summary_table(result).packing_fraction.unique() == pytest.approx(phi)
        words = bp.plot(result, "scan").axes[0].get_xlabel()
        assert f"packing fraction $\\phi$ from {phi[0]:.4g} to {phi[-1]:.4g}" in words
        assert ("tracer mass [mass] from 1 to 9" in words) == (MASS in vary)
    for vary in ({MASS: [1.0, 4.0]}, {PHI: [0.1, 0.2]}):
        result = bp.scan(scene, vary, seeds=2, quiet=True)
        assert "phi: packing" not in summary(result)
        assert "with" not in bp.plot(result, "scan").axes[0].get_xlabel()


def test_points_of_a_scan_against_the_density_are_named_by_what_they_share():
    """And not by the values of the first point."""
    vary = {"disks.tracer.radius": [0.6, 0.9], MASS: [1.0, 4.0]}
    result = bp.scan(bp.Scene(**FLUID, name="s"), vary, seeds=3, together=True, quiet=True)
    axes = bp.plot(result, "thermodynamics").axes[0]
    assert axes.get_legend_handles_labels()[1] == ["s, N = 16"]


def test_a_scan_refuses_what_is_wrong_before_any_scene_is_run(monkeypatch):
    monkeypatch.setattr(Engine, "simulate", None)
    langevin = {"engine": "langevin", "friction": "enskog"}
    window = {"fit_windows": [(1, 9)]}
    unused = {"fit_windows": [(0, 1)], "record": "none"}, "fit_windows: must go with record"
    for options, wrong in (
        (langevin, "for a heavy tracer"),
        (window, r"fit window \[1, 9\]: must end by"),
        unused,
    ):
        with pytest.raises((bp.RequestError, bp.AnalysisError), match=wrong):
            bp.scan(bp.Scene(**FLUID), {MASS: [10.0, 1.0]}, 3, **options, quiet=True)


def test_a_varied_number_of_disks_is_the_axis_of_one_series():
    vary = {"disks.species.bath.count": [5, 10], PHI: [0.1, 0.2]}
    result = bp.scan(bp.Scene(**FLUID), vary, seeds=2, quiet=True)
    assert len(bp.plot(result, panel=PHI).axes) == 2 * len(bp.plot(result).axes)
    assert [len(series) for series in series_of(cases_of(result), "bath_count").values()] == [2, 2]


def test_differences_are_of_runs_with_the_same_seeds():
    result = bp.scan(bp.Scene(**FLUID), {MASS: [1.0, 10.0]}, seeds=12, quiet=True)
    light, heavy = (
        row for _, row in table_of_scan(cases_of(result)).drop_duplicates("tracer_mass").iterrows()
    )
    pairs = (
        result.run_msd.sel(tracer_mass=10.0) - result.run_msd.sel(tracer_mass=1.0)
    ).values.ravel()
    assert heavy["msd_difference"] == pytest.approx(pairs.mean())
    assert heavy["msd_difference_standard_error"] == pytest.approx(
        pairs.std(ddof=1) / math.sqrt(12)
    )
    assert math.isnan(light["msd_difference"]) and math.isnan(light["msd_difference_low"])
    assert heavy["msd_difference_low"] < heavy["msd_difference"] < heavy["msd_difference_high"]
    assert heavy["msd"] - light["msd"] == pytest.approx(heavy["msd_difference"])
